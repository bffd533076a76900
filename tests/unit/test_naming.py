"""Names of classes: for people and for files, once for all pages."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.naming import class_labels, class_names, differences, label_text, mass_text, model_labels


def ensemble(mass: str = "1e5-1e9", *, seed: int = 0, n_streams: int = 1000, **perturbers) -> EnsembleConfig:
    return EnsembleConfig(
        perturbers=Perturbers(mass_range=mass, **perturbers), seed=seed, n_streams=n_streams
    )


def test_a_class_is_called_by_its_masses():
    configs = [ensemble("1e3-1e5", slope=-1.9), ensemble("2.5e5-1e9", cutoff_mass=1e7)]
    assert class_names(configs) == ["1e3-1e5", "2.5e5-1e9"]
    assert class_labels(configs) == ["10³–10⁵ M☉", "2.5·10⁵–10⁹ M☉"]
    assert model_labels(configs) == ["M0 · 10³–10⁵ M☉", "M1 · 2.5·10⁵–10⁹ M☉"]


@pytest.mark.parametrize(
    ("other", "label"),
    [
        (ensemble(cutoff_mass=1e7), "10⁵–10⁹ M☉, cutoff 10⁷ M☉"),
        (ensemble(profile="plummer"), "10⁵–10⁹ M☉, Plummer spheres"),
        (ensemble(rate_factor=2.5, X=3), "10⁵–10⁹ M☉, X = 3, rate × 2.5"),
        (ensemble(seed=7), "10⁵–10⁹ M☉, seed 7"),
        (ensemble(n_streams=200), "10⁵–10⁹ M☉, 200 streams"),
        (EnsembleConfig(n_theta=100), "10⁵–10⁹ M☉, n_theta 100"),
    ],
)
def test_classes_of_the_same_masses_say_what_sets_them_apart(other, label):
    assert class_labels([ensemble(), other]) == ["10⁵–10⁹ M☉", label]


def test_what_they_have_in_common_is_not_said():
    configs = [ensemble(cutoff_mass=mass, slope=-1.9) for mass in (1e7, 1e8)]
    assert class_labels(configs) == ["10⁵–10⁹ M☉, cutoff 10⁷ M☉", "10⁵–10⁹ M☉, cutoff 10⁸ M☉"]


perturbers = st.builds(
    Perturbers,
    X=st.sampled_from([3.0, 5.0]),
    slope=st.floats(-4, 0),
    cutoff_mass=st.none() | st.floats(1, 1e12),
    profile=st.sampled_from(["hernquist", "plummer"]),
)
configurations = st.builds(
    EnsembleConfig, perturbers=perturbers, seed=st.integers(0, 3), n_streams=st.integers(1, 9)
)


@given(st.lists(configurations, min_size=2, max_size=4, unique_by=lambda config: config.key))
def test_different_classes_have_different_names(configs):
    assert len(set(class_names(configs))) == len(set(class_labels(configs))) == len(configs)


@given(st.lists(configurations, min_size=1, max_size=4))
def test_names_of_files_are_the_names_of_people_in_plain_letters(configs):
    assert [label_text(name) for name in class_names(configs)] == class_labels(configs)


@given(st.text())
def test_any_other_text_stays_as_it_is(text):
    masses, _, words = text.partition(", ")
    shown = label_text(text)
    assert shown == text or shown.endswith("M☉") or words


def test_a_menu_says_what_is_not_as_by_default():
    config = ensemble(cutoff_mass=3e6, seed=2, n_streams=9)
    trailing = config.model_copy(update={"stream": StreamModel(arm="trailing")})
    assert differences(config) == differences(trailing) == ["cutoff 3·10⁶ M☉", "seed 2"]
    assert differences(ensemble()) == []
    assert mass_text((1e5, 1e9)) == "10⁵–10⁹ M☉"
