"""Populations of several components: their impacts, rates and what warm dark matter leaves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate, stats

from streamdash.config import Perturbers, Population
from streamdash.engine.density import stream_profile
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.impacts import (
    COLUMNS,
    Impacts,
    ImpactsError,
    expected_impacts,
    sample_impacts,
)
from streamdash.engine.mass_function import mass_decades, scale_radius, subhalo_count, suppression
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.streams import named_stream
from tests.physics.reference import march

LOW = Perturbers(mass_range="1e3-1e5", profile="plummer")
HIGH = Perturbers(mass_range="1e5-1e9", rate_factor=2)
THETA = np.linspace(0.03, 0.987, 60)


def population(*components: Perturbers) -> Population:
    return Population(components=components)


def same(a: Impacts, b: Impacts) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in COLUMNS)


def test_two_components_are_the_union_of_their_impacts(geometry):
    both = sample_impacts(geometry, population(HIGH, LOW), np.random.default_rng(7))
    rng = np.random.default_rng(7)
    first, second = sample_impacts(geometry, LOW, rng), sample_impacts(geometry, HIGH, rng)
    assert len(first) > 700
    assert len(second) > 70
    assert same(both, Impacts.joined([first, second]))
    assert set(both.profile[: len(first)]) == {"plummer"}
    assert set(both.profile[len(first) :]) == {"hernquist"}


def test_one_component_draws_what_it_draws_alone(geometry):
    alone = sample_impacts(geometry, HIGH, np.random.default_rng(3))
    assert same(alone, sample_impacts(geometry, population(HIGH), np.random.default_rng(3)))


def test_two_halves_equal_the_whole_in_distribution(geometry):
    """Number of impacts, their masses, and the gaps that they leave."""
    whole = Perturbers(mass_range="1e6-1e9")
    halves = population(*[whole.model_copy(update={"rate_factor": 0.5})] * 2)
    assert expected_impacts(geometry, halves) == pytest.approx(expected_impacts(geometry, whole), rel=1e-12)
    numbers, masses, depths = [], [], []
    for seed, perturbers in ((1, whole), (2, halves)):
        rng = np.random.default_rng(seed)
        drawn = [sample_impacts(geometry, perturbers, rng) for _ in range(400)]
        numbers.append([len(impacts) for impacts in drawn])
        masses.append(np.concatenate([impacts.mass_msun for impacts in drawn]))
        smooth = geometry.smooth_density(THETA)
        depths.append([(stream_profile(geometry, i, THETA)[0] / smooth).std() for i in drawn[:150]])
    mean = expected_impacts(geometry, whole)
    for number in numbers:  # Poisson: mean within 5 of its errors, variance like the mean
        assert np.mean(number) == pytest.approx(mean, abs=5 * np.sqrt(mean / len(number)))
        assert np.var(number) == pytest.approx(mean, rel=0.4)
    assert stats.ks_2samp(*masses).pvalue > 1e-4
    assert stats.ks_2samp(*depths).pvalue > 1e-4


def test_hernquist_and_plummer_in_one_stream_against_brute_force(geometry):
    rng = np.random.default_rng(11)
    parts = (Perturbers(mass_range="1e6-1e9", profile="plummer"), Perturbers(mass_range="1e6-1e9"))
    impacts = sample_impacts(geometry, population(*parts), rng)
    assert {"hernquist", "plummer"} == set(impacts.profile)
    angles = np.linspace(0.03, 0.987, 17)
    density, _ = stream_profile(geometry, impacts, angles)
    brute, _ = march(geometry, impacts, angles, steps=2500, spacing=2e-5)
    smooth = geometry.smooth_density(angles)
    assert np.abs((density - brute) / smooth).max() < 2e-3
    for profile in ("hernquist", "plummer"):  # neither all of one kind nor all of the other
        other, _ = stream_profile(geometry, dataclasses.replace(impacts, profile=profile), angles)
        assert np.abs((density - other) / smooth).max() > 4e-3


def test_expected_impacts_are_galpys_encounters_of_every_component(smooth_of_today):
    """Both computed here: the shipped geometry has another processor's last digits."""
    geometry, smooth = smooth_of_today
    concentrated = Perturbers(mass_range="1e6-1e8", rs_factor=0.4, X=12, rate_factor=0.3)
    parts = (LOW, HIGH, concentrated)
    total = sum(
        part.rate_factor
        * smooth.subhalo_encounters(
            sigma=part.sigma_h / V0_KMS,
            nsubhalo=subhalo_count(low, high, part.slope),
            bmax=part.X * scale_radius(np.sqrt(low * high), part) / R0_KPC,
        )
        for part in parts
        for low, high in mass_decades(part.mass_range)
    )
    assert expected_impacts(geometry, population(*parts)) == pytest.approx(total, rel=1e-10)


@pytest.mark.parametrize("half_mode_mass", [1e5, 1e7, 1e10])
def test_warm_dark_matter_thins_the_mass_function_as_published(geometry, half_mode_mass):
    cold = Perturbers(mass_range="1e5-1e9")
    warm = cold.model_copy(update={"half_mode_mass": half_mode_mass})

    def left(mass):
        return (1 + 2.7 * half_mode_mass / mass) ** -0.99

    mass = np.logspace(5, 9, 9)
    assert suppression(mass, warm) == pytest.approx(left(mass), rel=1e-12)
    assert suppression(mass, cold) == pytest.approx(np.ones(9))
    kept, _ = integrate.quad(lambda x: np.exp(-0.5 * x) * left(np.exp(x)), np.log(1e5), np.log(1e9))
    all_of_them, _ = integrate.quad(lambda x: np.exp(-0.5 * x), np.log(1e5), np.log(1e9))
    share = expected_impacts(geometry, warm) / expected_impacts(geometry, cold)
    assert share == pytest.approx(kept / all_of_them, rel=1e-5)
    rng, many = np.random.default_rng(5), warm.model_copy(update={"rate_factor": 100.0})
    drawn = Impacts.joined(sample_impacts(geometry, many, rng) for _ in range(20)).mass_msun
    grid = np.linspace(np.log(1e5), np.log(1e9), 20001)
    cumulative = integrate.cumulative_trapezoid(np.exp(-0.5 * grid) * left(np.exp(grid)), grid, initial=0)
    assert (
        stats.ks_1samp(np.log(drawn), lambda x: np.interp(x, grid, cumulative / cumulative[-1])).pvalue > 1e-4
    )


def test_cutoff_and_warm_dark_matter_together(geometry):
    both = Perturbers(cutoff_mass=1e6, half_mode_mass=1e7)
    mass = np.array([1e6, 1e8])
    product = np.exp(-1e6 / mass) * (1 + 2.7e7 / mass) ** -0.99
    assert suppression(mass, both) == pytest.approx(product, rel=1e-12)
    only = [Perturbers(cutoff_mass=1e6), Perturbers(half_mode_mass=1e7)]
    assert expected_impacts(geometry, both) < min(expected_impacts(geometry, p) for p in only)


def test_a_table_of_impacts_keeps_who_is_what(geometry, tmp_path):
    few = [p.model_copy(update={"rate_factor": 0.05}) for p in (LOW, HIGH)]
    impacts = sample_impacts(geometry, population(*few), np.random.default_rng(2))
    assert len(set(impacts.profile)) == 2
    impacts.to_csv(tmp_path / "impacts.csv")
    assert same(Impacts.read_csv(tmp_path / "impacts.csv", geometry), impacts)
    text = (tmp_path / "impacts.csv").read_text().replace("plummer", "pumpkin", 1)
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(ImpactsError, match="row 1, column profile: must be hernquist or plummer"):
        Impacts.read_csv(tmp_path / "wrong.csv", geometry)
    impacts.to_frame().drop(columns="profile").to_csv(tmp_path / "older.csv", index=False)
    assert set(Impacts.read_csv(tmp_path / "older.csv", geometry, "plummer").profile) == {"plummer"}


def test_both_arms_share_the_population_and_are_hit_by_its_rate(shipped_cache):
    """Per angle and time the same rate: impacts differ only as the arms' own length and width do."""
    cache = Cache((shipped_cache,))
    arms = [load_geometry(model, cache) for model in named_stream("gd1").arms.values()]
    assert len(arms) == 2
    both = population(LOW, HIGH)
    for parts in (both, population(HIGH)):
        hits = [expected_impacts(arm, parts) / (arm.mean_omega * arm.mean_radius) for arm in arms]
        assert hits[0] == pytest.approx(hits[1], rel=0.15)
        thrice = [part.model_copy(update={"rate_factor": 3 * part.rate_factor}) for part in parts.components]
        for arm in arms:
            ratio = expected_impacts(arm, population(*thrice)) / expected_impacts(arm, parts)
            assert ratio == pytest.approx(3, rel=1e-12)
    drawn = [sample_impacts(arm, both, np.random.default_rng(1)) for arm in arms]
    assert not np.array_equal(drawn[0].mass_msun, drawn[1].mass_msun)  # each arm has its own impacts
