"""Configurations: what they accept, how they refuse, and that their keys never change unnoticed."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from streamdash.config import (
    Accuracy,
    Config,
    ConfigError,
    EnsembleConfig,
    LogarithmicHalo,
    Perturbers,
    Population,
    Prior,
    StreamModel,
    mass_label,
    parse_mass_range,
)
from streamdash.population import DECADES_MAX, MASS_MAX, MASS_MIN

CLASSES = [LogarithmicHalo, StreamModel, Perturbers, Population, Prior, Accuracy, EnsembleConfig]

FULL = EnsembleConfig(
    stream=StreamModel(arm="trailing", times_gyr=(0.5, 2.25, 8.0), sigma_v_kms=0.3),
    perturbers=Perturbers(
        mass_range=(1e3, 3e5), profile="plummer", cutoff_mass=1e6, rs_factor=2.5, rate_factor=0.5
    ),
    n_streams=17,
    seed=12345678901234567,
    n_theta=11,
    accuracy=Accuracy(frequency_step=0.1),
)


# --- identity ---------------------------------------------------------------------------------


@pytest.mark.parametrize("cls", CLASSES)
def test_defaults_are_valid_and_keyed(cls):
    assert re.fullmatch(r"[0-9a-f]{16}", cls().key)
    assert cls().key == cls().key


def test_golden_keys():
    """Keys name cache entries: if one of these changes, every shipped entry becomes a stranger."""
    assert StreamModel().key == "5cb6c49c8c07872b"
    assert EnsembleConfig().key == "f2c155e9a3e8e228"
    assert FULL.key == "bec07bf8c5493d42"


def test_key_is_the_same_in_another_process():
    code = "from streamdash.config import EnsembleConfig as E; print(E(n_streams=3).key)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == EnsembleConfig(n_streams=3).key


@pytest.mark.parametrize("config", [EnsembleConfig(), FULL], ids=["default", "full"])
def test_round_trip_through_json_and_mappings(config):
    from_text = EnsembleConfig.parse(config.model_dump_json())
    from_dict = EnsembleConfig.parse(config.model_dump())
    from_plain_json = EnsembleConfig.parse(json.loads(config.model_dump_json()))
    assert from_text == from_dict == from_plain_json == config
    assert from_text.key == from_dict.key == from_plain_json.key == config.key
    assert hash(from_text) == hash(config)


def test_key_does_not_depend_on_how_a_value_was_written():
    assert Perturbers(mass_range="1e5-1e9") == Perturbers(mass_range=(100_000, 10**9)) == Perturbers()
    assert Perturbers(mass_range=[1e5, 1e9]).key == Perturbers().key
    assert EnsembleConfig(stream={}, perturbers={}).key == EnsembleConfig().key


OTHER_VALUES = {
    LogarithmicHalo: {"q": 0.8},
    StreamModel: {
        "potential": LogarithmicHalo(q=0.8),
        "progenitor": (1.5, 0.35, -1.15, 0.88, -0.47, 0.12),
        "isochrone_b": 0.7,
        "age_gyr": 8.0,
        "sigma_v_kms": 0.2,
        "arm": "trailing",
        "n_times": 32,
        "times_gyr": (1.0, 2.0),
    },
    Perturbers: {
        "mass_range": (1e3, 1e5),
        "X": 3.0,
        "rate_factor": 0.5,
        "slope": -1.9,
        "cutoff_mass": 1e6,
        "half_mode_mass": 1e7,
        "profile": "plummer",
        "rs_factor": 2.0,
        "sigma_h": 100.0,
        "length_factor": 1.2,
        "width_floor": False,
    },
    Population: {"components": (Perturbers(), Perturbers(mass_range=(1e3, 1e5)))},
    Prior: {
        "mass_range": (1e5, 1e9),
        "cluster_range": (1e2, 1e5),
        "log10_rate": (-2.0, 1.0),
        "log10_half_mode_mass": (5.0, 9.0),
        "log10_excess": (-1.0, 1.0),
        "log10_rs_factor": (-0.4, 0.4),
        "slope": (-2.1, -1.7),
        "X": 3.0,
        "ages_gyr": (3.0, 5.0),
        "background": 0.1,
        "background_deg": 10.0,
        "noise_factor": (0.8, 1.2),
    },
    Accuracy: {
        "frequency_step": 0.1,
        "frequency_tolerance": 0.2,
        "kick_spacing": 1e-4,
        "kick_tolerance": 1e-4,
    },
    EnsembleConfig: {
        "stream": StreamModel(n_times=32),
        "population": Population(components=(Perturbers(X=3.0),)),
        "prior": Prior(),
        "n_streams": 10,
        "seed": 1,
        "theta_min": 0.04,
        "theta_max": 0.9,
        "n_theta": 100,
        "accuracy": Accuracy(frequency_step=0.1),
    },
}


@pytest.mark.parametrize(("cls", "field"), [(c, f) for c in CLASSES for f in c.model_fields])
def test_every_field_decides_the_key(cls, field):
    assert field in OTHER_VALUES[cls], f"name another value for {cls.__name__}.{field} in OTHER_VALUES"
    assert cls(**{field: OTHER_VALUES[cls][field]}).key != cls().key


@pytest.mark.parametrize("cls", CLASSES)
def test_frozen_and_hashable(cls):
    config = cls()
    field = next(iter(cls.model_fields))
    with pytest.raises(ValidationError, match="frozen"):
        setattr(config, field, getattr(config, field))
    assert {config: 1}[cls()] == 1


# --- derived values ---------------------------------------------------------------------------


def test_impact_times_are_evenly_spaced_and_inside_the_life_of_the_stream():
    times = StreamModel(n_times=3, age_gyr=8.0).impact_times_gyr
    assert times == pytest.approx((2.0, 4.0, 6.0), rel=1e-15)
    assert StreamModel(times_gyr=(0.5, 1.5)).impact_times_gyr == (0.5, 1.5)


def test_dispersion_is_fixed_by_the_age_unless_given():
    assert StreamModel().dispersion_kms == pytest.approx(0.1825)
    assert StreamModel(age_gyr=4.5).dispersion_kms == pytest.approx(0.365)
    assert StreamModel(age_gyr=4.5, sigma_v_kms=0.2).dispersion_kms == 0.2


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cls", "values", "named", "allowed"),
    [
        (Perturbers, {"mass_range": (1e9, 1e5)}, "mass_range", "lower mass must come first"),
        (Perturbers, {"mass_range": (1e5, 1e5)}, "mass_range", "lower mass must come first"),
        (Perturbers, {"mass_range": (0.0, 1e5)}, "mass_range", "between 1 and 1e+12"),
        (Perturbers, {"mass_range": (-1e3, 1e5)}, "mass_range", "between 1 and 1e+12"),
        (Perturbers, {"mass_range": (1.0, 1e12)}, "mass_range", "at most 8 decades"),
        (Perturbers, {"mass_range": "heavy"}, "mass_range", "1e3-1e5"),
        (Perturbers, {"mass_range": (1e3, math.inf)}, "mass_range", "finite"),
        (Perturbers, {"mass_range": (1e3, math.nan)}, "mass_range", "finite"),
        (Perturbers, {"X": 0.0}, "X", "greater than or equal to 0.1"),
        (Perturbers, {"rate_factor": -1}, "rate_factor", "greater than or equal to 0"),
        (Perturbers, {"slope": 1}, "slope", "less than or equal to 0"),
        (Perturbers, {"profile": "nfw"}, "profile", "'hernquist' or 'plummer'"),
        (Perturbers, {"mass": (1e3, 1e5)}, "mass", "not permitted"),
        (StreamModel, {"age_gyr": 100}, "age_gyr", "less than or equal to 13.8"),
        (StreamModel, {"n_times": 0}, "n_times", "greater than or equal to 1"),
        (StreamModel, {"arm": "both"}, "arm", "'leading' or 'trailing'"),
        (StreamModel, {"times_gyr": (2.0, 1.0)}, "times_gyr", "increase"),
        (StreamModel, {"times_gyr": (1.0, 1.0)}, "times_gyr", "increase"),
        (StreamModel, {"times_gyr": (1.0, 9.5)}, "times_gyr", "between 0 and the age"),
        (StreamModel, {"times_gyr": ()}, "times_gyr", "at least one"),
        (StreamModel, {"progenitor": (0.0, 0, 1, 0, 0, 0)}, "progenitor", "between 0.1 and 12.5"),
        (StreamModel, {"potential": {"q": 3}}, "potential.q", "less than or equal to 1.5"),
        (EnsembleConfig, {"n_streams": 0}, "n_streams", "greater than or equal to 1"),
        (EnsembleConfig, {"n_streams": 1.5}, "n_streams", "whole number"),
        (EnsembleConfig, {"seed": -1}, "seed", "greater than or equal to 0"),
        (EnsembleConfig, {"theta_min": 0.9, "theta_max": 0.1}, "theta_min", "smaller than theta_max"),
        (EnsembleConfig, {"perturbers": {"mass_range": "1e9-1e5"}}, "perturbers.mass_range", "first"),
        (EnsembleConfig, {"perturbers": 7}, "perturbers", "mapping"),
        (EnsembleConfig, {"perturbers": {}, "population": {}}, "perturbers", "leave it out"),
        (Perturbers, {"half_mode_mass": 0}, "half_mode_mass", "greater than or equal to 1"),
        (Population, {"components": ()}, "components", "at least one"),
        (Population, {"components": [{}] * 40}, "components", "at most 8 components, this one 40"),
        (EnsembleConfig, {"population": {"components": []}}, "population.components", "at least one"),
        (EnsembleConfig, {"population": {"components": [{"X": 0}]}}, "population.components.0.X", "0.1"),
        (EnsembleConfig, {"accuracy": {"frequency_step": 0}}, "accuracy.frequency_step", "0.005"),
    ],
)
def test_refusal_is_one_sentence_naming_the_field_and_what_is_allowed(cls, values, named, allowed):
    for make in (lambda: cls(**values), lambda: cls.parse(values)):
        with pytest.raises(ConfigError) as refusal:
            make()
        sentence = str(refusal.value)
        assert re.search(rf"\b{re.escape(named)}\b", sentence)
        assert allowed in sentence
        assert sentence.endswith(".")
        assert "\n" not in sentence
        assert len(sentence) < 250


def test_refusal_from_within_a_constructor_keeps_the_inner_sentence():
    with pytest.raises(ConfigError, match=r"^mass_range: .*first"):
        EnsembleConfig(perturbers=Perturbers(mass_range="1e9-1e5"))


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '"x"', '{"seed": 1e400}', "\x00", b"\xff\xfe"])
def test_broken_json_is_refused(text):
    with pytest.raises(ConfigError):
        EnsembleConfig.parse(text)


def test_unknown_field_with_line_breaks_in_its_name_stays_one_sentence():
    with pytest.raises(ConfigError, match=r"x\\n\\ny") as refusal:
        Perturbers.parse({"x\n\ny": 1})
    assert "\n" not in str(refusal.value)


# --- anything at all --------------------------------------------------------------------------

scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=5)
    | st.sampled_from(["1e3-1e5", "1e9-1e5", "0-0", "leading", "plummer", 1e3, 1e5, 0.5])
)
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=12,
)
field_names = st.sampled_from(sorted({f for cls in CLASSES for f in cls.model_fields}))
mappings = st.dictionaries(field_names | st.text(max_size=8), values, max_size=6)


@given(cls=st.sampled_from(CLASSES), data=mappings)
def test_only_config_errors_escape_for_any_mapping(cls: type[Config], data):
    try:
        config = cls.parse(data)
    except ConfigError as refusal:
        assert "\n" not in str(refusal)
    else:
        assert cls.parse(config.model_dump_json()) == config


@given(cls=st.sampled_from(CLASSES), field=field_names, value=values)
def test_only_config_errors_escape_for_any_value_of_any_field(cls, field, value):
    try:
        config = cls(**{field: value})
    except ConfigError as refusal:
        assert field in str(refusal)
    else:
        assert cls.parse(config.model_dump_json()).key == config.key


@given(cls=st.sampled_from(CLASSES), text=st.text() | st.binary())
def test_only_config_errors_escape_for_any_text(cls, text):
    try:
        cls.parse(text)
    except ConfigError as refusal:
        assert "\n" not in str(refusal)


# --- mass ranges as text ----------------------------------------------------------------------

masses = st.floats(MASS_MIN, MASS_MAX)


@given(low=masses, high=masses)
def test_mass_label_reads_back(low, high):
    read = parse_mass_range(mass_label((low, high)))
    assert read == pytest.approx((low, high), rel=1e-12)
    assert mass_label(read) == mass_label((low, high))


@given(low=st.integers(0, 12), decades=st.integers(1, int(DECADES_MAX)))
def test_whole_decades_read_back_exactly(low, decades):
    high = min(low + decades, 12)
    if low < high:
        assert parse_mass_range(f"1e{low}-1e{high}") == (10.0**low, 10.0**high)
        assert Perturbers(mass_range=f"1e{low}-1e{high}").label == f"1e{low}-1e{high}"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e3-1e5", (1e3, 1e5)),
        (" 1E3 – 2.5e+5 ", (1e3, 2.5e5)),
        ("1000-100000", (1e3, 1e5)),
    ],
)
def test_mass_range_spellings(text, expected):
    assert parse_mass_range(text) == expected


@pytest.mark.parametrize(
    "text", ["", "1e5", "1e3:1e5", "-1e3-1e5", "1e3-1e5-1e7", "nan-1e5", "a-b", "1e-3-1e5"]
)
def test_mass_range_refusals_show_the_form(text):
    with pytest.raises(ValueError, match="1e3-1e5"):
        parse_mass_range(text)


@given(st.text(max_size=60))
def test_any_text_is_a_range_or_a_value_error(text):
    try:
        low, high = parse_mass_range(text)
    except ValueError as refusal:
        assert "1e3-1e5" in str(refusal)
    else:
        assert low >= 0
        assert high >= 0
