"""The convergence laboratory: settings, spectra that are kept, shifts and verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from streamdash.config import ConfigError, EnsembleConfig, Perturbers, SpectraConfig, StreamModel
from streamdash.convergence.knobs import KNOBS, N_STREAMS, ConvergenceTest, Setting, knob, orbital_phases
from streamdash.convergence.spectra import (
    WORKSHOP,
    compute_missing,
    ensemble_spectra,
    missing,
    stored_spectra,
)
from streamdash.convergence.theta_spectra import ThetaSpectra, theta_spectra
from streamdash.convergence.verdicts import (
    BIN_DEG,
    NOISE,
    judge,
    shift_by_scale,
    verdict_sentence,
    verdict_word,
)
from streamdash.engine.galpy_streams import progenitor_radius
from streamdash.simulation.ensemble import Stopped, simulate
from streamdash.statistics.spectrum import KINDS, SpectrumBand, power_spectrum

SCALE = np.array([54.0, 27.0, 18.0, 9.0])
SMALL = SpectraConfig(ensemble=EnsembleConfig(n_streams=12, n_theta=60))


def made_up(median: list[float], half: float = 0.2, error: float = 0.01) -> ThetaSpectra:
    """Spectra of all three kinds with the same median."""
    values = np.array(median)
    band = SpectrumBand(SCALE, values - half, values, values + half, 100)
    return ThetaSpectra(dict.fromkeys(KINDS, band), {kind: np.full(4, error) for kind in KINDS}, 60.0)


def test_every_knob_is_a_set_of_different_valid_ensembles():
    for key in KNOBS:
        found = knob(key)
        configs = [setting.config for setting in found.settings]
        assert found.key == key
        assert len(set(configs)) == len(configs) >= 3
        assert min(config.n_streams for config in configs) >= N_STREAMS or key == "streams"
        assert len({setting.label for setting in found.settings}) == len(configs)
        for setting in found.settings:
            reference = found.settings[setting.reference]
            assert reference.reference == found.settings.index(reference)


def test_knobs_turn_what_they_say_and_nothing_else():
    fiducial = knob("x").settings[2].config.ensemble
    assert (fiducial.perturbers.X, fiducial.stream.n_times) == (5.0, 32)
    for key in ("length", "profile"):
        assert any(setting.config.ensemble == fiducial for setting in knob(key).settings)
    for setting in knob("profile").settings:
        perturbers = setting.config.ensemble.perturbers
        relation = {"hernquist": 1.05, "plummer": 1.62}[perturbers.profile]
        assert perturbers.X * perturbers.rs_factor * relation == pytest.approx(5 * 1.05, rel=1e-4)
    assert [len(s.config.ensemble.stream.impact_times_gyr) for s in knob("phase").settings] == [1] * 8
    assert [len(s.config.ensemble.stream.impact_times_gyr) for s in knob("times").settings] == [
        1, 2, 4, 8, 16, 32, 64,
    ]  # fmt: skip
    for key in ("frequencies", "kicks"):  # the same streams, so that shifts are the engine's alone
        ensembles = [setting.config.ensemble for setting in knob(key).settings]
        assert len({(e.stream.key, e.perturbers.key, e.seed) for e in ensembles}) == 1
    assert knob("times", n_streams=50, seed=3).settings[0].config.ensemble.seed == 3


def test_orbital_phases_are_turning_points_of_the_orbit():
    for near in (1.0, 3.0):
        phases = orbital_phases(StreamModel(), near)
        r = {
            name: progenitor_radius(StreamModel(), np.array([0.0, time]))[1] for name, time in phases.items()
        }
        around = progenitor_radius(StreamModel(), np.linspace(0, near + 0.5, 2000))
        assert r["pericentre"] < around.min() * 1.08
        assert r["apocentre"] > around.max() * 0.99
        assert r["pericentre"] * 1.3 < r["between"] < r["apocentre"] / 1.1
        assert r["next pericentre"] == pytest.approx(r["pericentre"], rel=0.15)
        assert all(abs(time - near) < 0.25 for name, time in phases.items() if name != "next pericentre")
        low, high = sorted((phases["pericentre"], phases["next pericentre"]))
        assert low < phases["between"] < high and low < phases["apocentre"] < high


def test_a_part_of_an_ensemble_must_be_a_part():
    assert SpectraConfig(ensemble=SMALL.ensemble, first=5).n_streams == 5
    with pytest.raises(ConfigError, match="first must be smaller"):
        SpectraConfig(ensemble=SMALL.ensemble, first=12)


# ---------------------------------------------------------------- verdicts


def test_shifts_are_in_half_bands_of_the_reference():
    spectra = [made_up([1.0, 1.0, 1.1, 1.0], half=0.1), made_up([1.0, 0.9, 1.0, 0.8], half=0.2)]
    settings = tuple(Setting(label, SMALL, 1) for label in ("a", "b"))
    verdict = judge(ConvergenceTest("k", "", "", "", settings), spectra)
    assert len(verdict.shifts) == 2 * 4  # two decades of three spectra, and of the density as observed
    large, small = (verdict.of(0, "track", decade) for decade in ("large", "small"))
    assert (large.mean, small.mean) == (pytest.approx(1 / 3), pytest.approx(1.0))
    assert large.largest == pytest.approx(0.5) and large.scale in (27.0, 18.0)
    assert large.error == pytest.approx(np.hypot(0.01, 0.01) / 0.2)
    assert verdict.worst_clean.mean == pytest.approx(1.0)
    assert verdict.worst.observed and verdict.word == "within the scatter of streams"
    assert verdict.of(1, "track", "large") is None


def test_noise_hides_shifts_below_it_and_not_those_above():
    """Half bands of signal plus noise: of a signal far below the noise nothing is left."""
    loud = [made_up([m] * 4, half=0.2 * m) for m in (1.2, 1.0)]
    faint = [made_up([m] * 4, half=0.2 * m) for m in (1.2e-3, 1.0e-3)]
    for spectra, kept in ((loud, True), (faint, False)):
        clean, seen = (
            shift_by_scale(*(one.bands["density"] for one in spectra), observed) for observed in (False, True)
        )
        np.testing.assert_allclose(clean, 1.0)
        np.testing.assert_allclose(seen, 1.0 if kept else 0.0, atol=0.02)


def test_the_level_of_noise_is_that_of_drawn_noise():
    """White noise in bins has the mean power that is added to the medians."""
    n, step = 347, np.radians(BIN_DEG)
    draws = NOISE * np.random.default_rng(4).standard_normal((400, n))
    _, power = power_spectrum(draws, step)
    assert power[:, 2:-2].mean() == pytest.approx(3 * NOISE**2 * step, rel=0.02)


def test_impacts_at_one_time_are_compared_at_equal_age():
    """A spectrum that grows steadily with time does not depend on the phase."""
    found = knob("phase")
    times = [s.config.ensemble.stream.impact_times_gyr[0] for s in found.settings]
    grown = [made_up([np.exp(time)] * 4, half=0.2) for time in times]
    verdict = judge(found, grown)
    assert {shift.setting for shift in verdict.shifts} == {1, 2, 5, 6}
    assert all(abs(shift.mean) < 1e-9 for shift in verdict.shifts)


def test_what_the_paper_says_of_small_scales_is_judged_there():
    found = knob("x")
    assert found.scales == ("small",)
    apart_above = [made_up([1.0 + 0.4 * (i < 4)] * 3 + [1.0]) for i in range(5)]
    assert judge(found, apart_above).word == "agrees"
    assert judge(replace(found, scales=("small", "large")), apart_above).word == "differs"


@pytest.mark.parametrize(
    ("medians", "start", "words"),
    [
        ([1.3, 1.01, 1.02, 1.0], 1, "Converged from b on"),
        ([1.01, 1.3, 1.02, 1.0], 2, "Converged from c on"),
        ([1.01, 1.02, 1.0, 1.0], 0, "Converged at every setting"),
        ([1.0, 1.0, 1.3, 1.0], None, "No other setting agrees with d"),
    ],
)
def test_convergence_counts_from_where_on_nothing_shifts_any_more(medians, start, words):
    settings = tuple(Setting(label, SMALL, 3) for label in "abcd")
    found = ConvergenceTest("k", "", "", "It converges.", settings, ordered=True, claim=2)
    verdict = judge(found, [made_up([m, m, m, 1.0]) for m in medians])
    assert verdict.converged_from == start
    assert verdict.worst.setting == 2
    assert verdict_sentence(found, verdict).startswith(words)


def test_words_of_verdicts():
    assert [verdict_word(x) for x in (0.0, -0.25, 0.26, -1.0, 1.01)] == [
        "agrees", "agrees", *["within the scatter of streams"] * 2, "differs",
    ]  # fmt: skip


# ---------------------------------------------------------------- spectra that are kept


@pytest.fixture(scope="module")
def simulated(shipped_cache):
    """A few streams, for spectra of them."""
    from streamdash.store.cache import Cache
    from tests.shipped import of_default_stream

    config = next(
        e.config
        for e in Cache.default(shipped_cache).entries()
        if e.label == "1e5-1e9" and of_default_stream(e)
    )
    return Cache.default(shipped_cache).open_ensemble(config, 60)


def test_spectra_along_theta_are_those_of_the_profiles(simulated):
    spectra = theta_spectra(simulated, cost_s=3.0)
    q = simulated.density.values / simulated.smooth.values
    theta = simulated.theta.values
    assert spectra.scale[0] == pytest.approx(np.degrees(400 * (theta[1] - theta[0])))
    assert set(spectra.bands) == set(KINDS)
    # the largest scales carry the variance of the tapered profile
    taper = np.hanning(401)[:-1]
    tapered = taper * (q - q.mean(axis=1, keepdims=True))
    power = np.abs(tapered @ np.exp(-2j * np.pi * np.arange(400) / 400)) ** 2 * 2 / taper.sum() ** 2
    expected = np.sqrt(np.median(power) * (theta[-1] - theta[0]))
    assert spectra.bands["density"].median[0] == pytest.approx(expected, rel=1e-4)


def test_spectra_survive_the_cache(simulated, cache):
    spectra = theta_spectra(simulated, cost_s=3.0)
    cache.save_spectra(SMALL, spectra.to_dataset(), 3.0)
    kept = stored_spectra(SMALL, cache)
    for kind in KINDS:
        np.testing.assert_allclose(kept.bands[kind].median, spectra.bands[kind].median, rtol=1e-6)
        np.testing.assert_allclose(kept.errors[kind], spectra.errors[kind], rtol=1e-6)
        assert kept.bands[kind].n_streams == 60
    assert (kept.mean_impacts, kept.cost_s) == (spectra.mean_impacts, 3.0)
    (entry,) = cache.entries()
    assert (entry.kind, entry.state, entry.label) == ("spectra", "complete", "1e5-1e9-64times-12streams")
    assert cache.verify(entry) == []


def test_damaged_spectra_are_named_and_passed_over(simulated, cache, toy, caplog):
    cache.save_spectra(SMALL, theta_spectra(simulated).to_dataset())
    (entry,) = cache.entries()
    toy.damage(entry.path / "data.zarr" / "sqrt_power" / "c" / "0" / "0" / "0", "bit-flipped")
    assert stored_spectra(SMALL, cache) is None
    assert "does not match its checksum" in caplog.text
    assert missing([SMALL], cache) == [SMALL]


def test_an_ensemble_is_simulated_for_its_spectra_and_not_kept(geometry_cache):
    seen = []
    spectra = ensemble_spectra(SMALL, geometry_cache, workers=1, progress=lambda *step: seen.append(step))
    assert seen[-1] == (12, 12)
    assert sorted(entry.kind for entry in geometry_cache.entries()) == ["geometry", "spectra"]
    assert not (geometry_cache.writable / WORKSHOP).exists()
    assert stored_spectra(SMALL, geometry_cache).cost_s == spectra.cost_s > 0
    # fewer streams are the first of the same
    simulate(SMALL.ensemble, "inline", cache=geometry_cache)
    first = SpectraConfig(ensemble=SMALL.ensemble, first=6)
    from_part = ensemble_spectra(first, geometry_cache)
    alone = ensemble_spectra(
        SpectraConfig(ensemble=SMALL.ensemble.model_copy(update={"n_streams": 6})), geometry_cache, workers=1
    )
    np.testing.assert_array_equal(from_part.bands["density"].median, alone.bands["density"].median)


def test_computing_a_knob_can_be_stopped_and_resumed(geometry_cache):
    configs = [
        SpectraConfig(ensemble=EnsembleConfig(perturbers=Perturbers(X=x), n_streams=60, n_theta=30))
        for x in (1.0, 2.0)
    ]
    steps = []
    with pytest.raises(Stopped):
        compute_missing(configs, geometry_cache, 1, should_stop=lambda: True)
    assert (geometry_cache.writable / WORKSHOP).exists()  # the first chunk is not lost
    compute_missing(configs, geometry_cache, 1, progress=lambda done, total: steps.append(done / total))
    assert steps == sorted(steps) and steps[-1] == 1.0
    assert missing(configs, geometry_cache) == []
    assert not (geometry_cache.writable / WORKSHOP).exists()
