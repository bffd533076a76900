"""Populations: one component is what perturbers always were, several are their own identity."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamdash.config import (
    ConfigError,
    EnsembleConfig,
    Perturbers,
    Population,
    SpectraConfig,
    StreamModel,
)
from streamdash.naming import class_labels, differences, population_text

ROOT = Path(__file__).parents[2]
LOW, HIGH = Perturbers(mass_range="1e3-1e5"), Perturbers(mass_range="1e5-1e9")
KINDS = {"ensembles": EnsembleConfig, "geometries": StreamModel, "spectra": SpectraConfig}
components = st.builds(
    Perturbers,
    mass_range=st.sampled_from(["1e3-1e5", "1e5-1e9", "1e3-1e9"]),
    rate_factor=st.sampled_from([0.0, 1.0, 3.0]),
    half_mode_mass=st.sampled_from([None, 1e7]),
    profile=st.sampled_from(["hernquist", "plummer"]),
)


def mixed(*components: Perturbers, **values) -> EnsembleConfig:
    return EnsembleConfig(population=Population(components=components), **values)


def shipped():
    return sorted((ROOT / "cache").glob("*/*/config.json"))


def test_every_shipped_entry_keeps_its_name_and_its_configuration_as_written():
    assert len(shipped()) > 40
    for path in shipped():
        cls = KINDS.get(path.parents[1].name)
        if cls is None:
            continue
        config = cls.parse(path.read_bytes())
        assert path.parent.name.endswith(f"-{config.key}")
        assert json.loads(config.model_dump_json()) == json.loads(path.read_bytes())


def test_keys_that_shipped_entries_and_links_rely_on():
    assert EnsembleConfig(perturbers=LOW, n_streams=2000).key == "ad8830a089cc65a2"
    assert EnsembleConfig(perturbers=HIGH, n_streams=2000).key == "fb3c13db907b621f"


def test_perturbers_is_short_for_a_population_of_one():
    short, long = EnsembleConfig(perturbers=LOW, seed=3), mixed(LOW, seed=3)
    assert short == long
    assert short.key == long.key
    assert short.perturbers == LOW
    assert long.population.key == LOW.key
    assert long.population.label == LOW.label
    assert "population" not in json.loads(long.model_dump_json())
    assert EnsembleConfig().model_copy(update={"perturbers": LOW}) == EnsembleConfig(perturbers=LOW)
    assert EnsembleConfig().population == Population() == Population(components=(Perturbers(),))


@given(st.lists(components, min_size=1, max_size=4), st.randoms())
def test_order_says_nothing_and_a_configuration_reads_what_it_writes(parts, random):
    shuffled = random.sample(parts, len(parts))
    config = mixed(*parts)
    assert mixed(*shuffled) == config
    assert mixed(*shuffled).key == config.key
    for text in (config.model_dump_json(), config.model_dump_json(exclude_defaults=True)):
        assert EnsembleConfig.parse(text) == config


def test_several_components_are_not_taken_for_one():
    config = mixed(LOW, HIGH)
    assert config.key not in (EnsembleConfig(perturbers=LOW).key, EnsembleConfig(perturbers=HIGH).key)
    assert config.population.mass_range == (1e3, 1e9)
    with pytest.raises(ConfigError, match=r"several components, 1e3-1e5\+1e5-1e9"):
        _ = config.perturbers


def test_overlapping_masses_are_allowed_and_said():
    assert Population(components=(LOW, HIGH)).overlaps() == []
    (sentence,) = Population(components=(LOW, Perturbers(mass_range="1e4-1e6"))).overlaps()
    assert sentence == "1e3-1e5 and 1e4-1e6 overlap in mass: there, their numbers add up."
    assert len(Population(components=(LOW, LOW, LOW)).overlaps()) == 3


def test_the_label_of_many_components_stays_short():
    many = tuple(Perturbers(mass_range=(1.2345678e3 * 2**i, 1.2345678e3 * 2 ** (i + 1))) for i in range(8))
    assert len(Population(components=many).label) < 60
    assert population_text(Population(components=many)).endswith("M☉ (8 components)")


def test_classes_of_the_same_masses_are_told_apart_by_what_differs():
    excess = mixed(LOW, HIGH, LOW.model_copy(update={"rate_factor": 3.0}))
    cold, more = mixed(LOW, HIGH), mixed(LOW.model_copy(update={"rate_factor": 3.0}), HIGH)
    warm = EnsembleConfig(perturbers=Perturbers(half_mode_mass=1e8))
    assert class_labels([cold, more]) == ["10³–10⁵ + 10⁵–10⁹ M☉", "10³–10⁵ + 10⁵–10⁹ M☉, rate × 3 in 10³–10⁵"]
    half = "warm, half-mode mass 10⁸ M☉ (4.89 keV)"
    assert class_labels([EnsembleConfig(), warm]) == ["10⁵–10⁹ M☉", f"10⁵–10⁹ M☉, {half}"]
    assert class_labels([cold, excess])[1] == "10³–10⁵ + 10³–10⁵ + 10⁵–10⁹ M☉"
    assert differences(more) == ["rate × 3 in 10³–10⁵"]
