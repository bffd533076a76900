"""Milliseconds a stream and error, side by side, on one core; and galpy beside ours.

``python -m pytest tests/benchmarks/test_engine_speed.py --benchmark-only -s`` prints one line
a case. The error is the worst point of ten streams (400 angles each) against the same
march refined until it no longer changes, in units of the smooth density.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from streamdash.config import Accuracy, EnsembleConfig, Perturbers
from streamdash.engine.density import stream_profile, trace_back
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS, galpy_gap
from streamdash.engine.impacts import Impacts, sample_impacts
from streamdash.engine.impulse import gravity
from streamdash.engine.kicks import kick_tables

GRID = EnsembleConfig()
THETA = np.linspace(GRID.theta_min, GRID.theta_max, GRID.n_theta)
REFINED = Accuracy(frequency_step=0.0625, frequency_tolerance=1e-3, kick_spacing=4e-5, kick_tolerance=1e-6)
STREAMS = int(os.environ.get("STREAMS", "10"))


def report(line: str) -> None:
    print(f"\n    {line}")


def sampled(geometry, mass_range):
    perturbers = Perturbers(mass_range=mass_range)
    return [sample_impacts(geometry, perturbers, np.random.default_rng([3, i])) for i in range(STREAMS)]


@pytest.mark.parametrize("mass_range", ["1e3-1e5", "1e5-1e9", "1e5-1e7", "1e7-1e9"])
def test_streams(benchmark, geometry, mass_range):
    """Sampling, kicks and density of one stream, averaged over many."""
    tables = sampled(geometry, mass_range)
    profiles = [stream_profile(geometry, impacts, THETA)[0] for impacts in tables]  # and compile
    refined = [stream_profile(geometry, impacts, THETA, accuracy=REFINED)[0] for impacts in tables]
    smooth = geometry.smooth_density(THETA)
    error = np.abs(np.array(profiles) - refined) / smooth
    perturbers = Perturbers(mass_range=mass_range)

    def run():
        for i in range(STREAMS):
            impacts = sample_impacts(geometry, perturbers, np.random.default_rng([3, i]))
            stream_profile(geometry, impacts, THETA)

    benchmark.pedantic(run, rounds=7)
    per_stream = 1e3 * benchmark.stats.stats.min / STREAMS
    report(
        f"{mass_range}: {per_stream:.1f} ms a stream (best round; median "
        f"{1e3 * benchmark.stats.stats.median / STREAMS:.1f}), worst point {error.max():.1e}, "
        f"{100 * (error > 2e-3).mean():.3f} % of points beyond 2e-3, "
        f"rms {np.sqrt((error**2).mean()):.1e} of the smooth density"
    )
    benchmark.extra_info.update(ms_per_stream=per_stream, worst=float(error.max()))


@pytest.mark.parametrize("part", ["sample", "kicks", "march"])
def test_parts(benchmark, geometry, part):
    """Where the time of a 1e3-1e5 stream goes."""
    impacts = sampled(geometry, "1e3-1e5")[0]
    kicks = kick_tables(geometry, impacts)
    perturbers = Perturbers(mass_range="1e3-1e5")
    parts = {
        "sample": lambda: sample_impacts(geometry, perturbers, np.random.default_rng(3)),
        "kicks": lambda: kick_tables(geometry, impacts),
        "march": lambda: trace_back(geometry, kicks, THETA, Accuracy()),
    }
    benchmark.pedantic(parts[part], rounds=15, warmup_rounds=1)


@pytest.fixture(scope="module")
def one_impact(geometry):
    k = 10
    return Impacts(geometry.stream.impact_times_gyr[k], 0.4, 0.1, 30.0, 150.0, -80.0, 1e7, 0.332), k


def test_one_impact_ours(benchmark, geometry, one_impact):
    impacts, _ = one_impact
    benchmark.pedantic(lambda: stream_profile(geometry, impacts, THETA), rounds=15, warmup_rounds=1)
    report(f"one impact, {len(THETA)} angles: ours {1e3 * benchmark.stats.stats.min:.2f} ms")


def test_one_impact_galpy(benchmark, geometry, one_impact):
    """galpy's streamgapdf for the same impact: its kick, then its default density."""
    impacts, k = one_impact
    gap = galpy_gap(geometry.stream, geometry.stream.impact_times_gyr[k])
    gap._higherorderTrack = False

    def run():
        for name in ("_kick_interpolatedThetasTrack", "_kick_interpolatedObsTrackAA"):
            if hasattr(gap, name):
                delattr(gap, name)
        w = np.array([30.0, 150.0, -80.0]) / V0_KMS
        gap._determine_deltav_kick(0.4, 0.1 / R0_KPC, w, 1e7 * gravity(), 0.332 / R0_KPC, None, 3, True)
        gap._determine_deltaOmegaTheta_kick(3)
        return np.array([gap._density_par(theta) for theta in THETA])

    benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    difference = np.abs(run() - stream_profile(geometry, impacts, THETA)[0]) / geometry.smooth_density(THETA)
    report(
        f"one impact, {len(THETA)} angles: galpy {1e3 * benchmark.stats.stats.min:.0f} ms "
        f"(set-up of its coordinates not counted), largest difference {difference.max():.1e}"
    )
