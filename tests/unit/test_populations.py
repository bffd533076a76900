"""Named populations, components as text, and both on the command line."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, optimize

from streamdash.config import ConfigError, Perturbers, Population
from streamdash.engine.impacts import expected_impacts
from streamdash.populations import (
    COMPONENT_WORDS,
    PRESETS,
    cold,
    component_text,
    half_mode_mass,
    parse_component,
    preset,
    title_of,
    warm,
    wdm_mass,
    with_excess,
)
from tests.unit.commands import refused, run


def test_half_mode_mass_is_where_the_transfer_function_falls_to_one_half():
    """From the transfer function itself: T(k) = (1 + (αk)^2ν)^(-5/ν), T(2π/λ_hm) = ½."""
    for kev in (1.0, 3.3, 6.5):
        alpha, nu = 0.048 / 0.6774 * kev**-1.11, 1.12

        def transfer(k, alpha=alpha, nu=nu):
            return (1 + (alpha * k) ** (2 * nu)) ** (-5 / nu)

        k = optimize.brentq(lambda k: transfer(k) - 0.5, 1e-3, 1e4)
        radius = math.pi / k
        mass, _ = integrate.quad(lambda r: 4 * math.pi * r * r * 0.3089 * 1.27e11, 0, radius)
        assert half_mode_mass(kev) == pytest.approx(mass, rel=1e-6)
        assert wdm_mass(half_mode_mass(kev)) == pytest.approx(kev, rel=1e-12)
    assert half_mode_mass(6.5) < half_mode_mass(3.3)
    for wrong in (0.0, -1.0, 1e3, math.nan):
        with pytest.raises(ConfigError, match="m_wdm: must lie between 0.5 and 100 keV"):
            half_mode_mass(wrong)


def test_presets_are_what_their_titles_say(geometry):
    low, high = (expected_impacts(geometry, Perturbers(mass_range=m)) for m in ("1e3-1e5", "1e5-1e9"))
    assert expected_impacts(geometry, cold()) == pytest.approx(low + high, rel=1e-12)
    for excess in (1, 3, 10):
        population = preset(f"clusters-{excess}").population
        assert expected_impacts(geometry, population) == pytest.approx((1 + excess) * low + high, rel=1e-12)
    assert with_excess(0) == cold()
    assert expected_impacts(geometry, warm(2)) < expected_impacts(geometry, warm(6.5)) < low + high
    few = [expected_impacts(geometry, preset(name).population) for name in ("cdm", "concentrated")]
    assert few[0] == pytest.approx(few[1], rel=1e-9)
    assert len({entry.population.key for entry in PRESETS.values()}) == len(PRESETS)
    for entry in PRESETS.values():
        assert title_of(entry.population) == entry.title
    assert title_of(Population(components=(Perturbers(X=7),))) == ""


def test_presets_take_any_number():
    assert preset("wdm-4.2kev").population == warm(4.2)
    assert preset("clusters-0.3").population == with_excess(0.3)
    for wrong in ("wdm-kev", "wdm-nankev", "cold", "", "clusters-x"):
        with pytest.raises(ConfigError, match=r"^preset: .* is not one of paper-1e3-1e5, .*\.$"):
            preset(wrong)


components = st.builds(
    Perturbers,
    mass_range=st.sampled_from(["1e3-1e5", "2.5e3-7e6"]),
    X=st.floats(0.1, 50),
    rate_factor=st.floats(0, 100),
    cutoff_mass=st.none() | st.floats(1, 1e12),
    half_mode_mass=st.none() | st.floats(1, 1e12),
    profile=st.sampled_from(["hernquist", "plummer"]),
)


@given(components)
def test_a_component_reads_what_it_writes(component):
    assert parse_component(component_text(component)) == component


def test_every_field_of_a_component_has_a_word():
    assert {"mass_range", *COMPONENT_WORDS.values()} == set(Perturbers.model_fields)
    assert parse_component("1e3-1e5 , m_wdm = 5").half_mode_mass == pytest.approx(half_mode_mass(5), rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "1e3-1e5"),
        ("1e3", "1e3-1e5"),
        ("1e3-1e5,rate", "followed by = and a value"),
        ("1e3-1e5,speed=3", "'speed=3' is not one of rate, rs"),
        ("1e3-1e5,rate=-1", "rate_factor: input should be greater"),
        ("1e3-1e5,rate=1,rate=2", "rate is given twice"),
        ("1e3-1e5,m_wdm=warm", "m_wdm must be a mass in keV"),
        ("1e3-1e5,m_wdm=0.1", "between 0.5 and 100 keV"),
        ("1e3-1e5,profile=nfw", "'hernquist' or 'plummer'"),
        ("1e3-1e5,mhm=1e7,m_wdm=5", "mhm is given twice"),
    ],
)
def test_a_component_is_refused_in_one_sentence(text, said):
    with pytest.raises(ConfigError) as refusal:
        parse_component(text)
    assert str(refusal.value).startswith("component ")
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


DRY = ("simulate", "--dry-run", "--json", "-n", "10")


def test_the_command_line_tells_the_impacts_of_every_component(geometry_cache, geometry):
    at = ("--cache", geometry_cache.roots[0])
    answer = json.loads(
        run(*DRY, "--component", "1e5-1e9", "--component", "1e3-1e5,rate=3,rs=0.4", *at).stdout
    )
    expected = [Perturbers(mass_range="1e3-1e5", rate_factor=3, rs_factor=0.4), Perturbers()]
    assert [one["component"] for one in answer["components"]] == ["1e3-1e5,rate=3,rs=0.4", "1e5-1e9"]
    for one, component in zip(answer["components"], expected, strict=True):
        assert one["impacts"] == pytest.approx(expected_impacts(geometry, component), rel=1e-12)
    assert answer["impacts_per_stream"] == pytest.approx(sum(one["impacts"] for one in answer["components"]))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--component", "1e5-1e9", "--mass", "1e3-1e5"), "--mass: leave it out where --component says"),
        (("--preset", "cdm", "--X", "3"), "--X: leave it out where --preset says"),
        (("--preset", "cdm", "--component", "1e5-1e9"), "--preset: leave it out where --component says"),
        (("--preset", "cold"), "'cold' is not one of"),
        (("--component", "1e5-1e9") * 40, "at most 8 components, this one 40"),
        ((), "or --component or --preset"),
    ],
)
def test_wrong_populations_are_refused(geometry_cache, options, said):
    assert said in refused(*DRY, *options, "--cache", geometry_cache.roots[0])


def test_overlapping_components_are_simulated_and_said(geometry_cache):
    done = run(*DRY, "--component", "1e5-1e7", "--component", "1e6-1e9", "--cache", geometry_cache.roots[0])
    assert "1e5-1e7 and 1e6-1e9 overlap in mass: there, their numbers add up." in done.stderr
