"""Kicks against galpy's impulse formulas and its propagation to frequencies."""

import numpy as np
import pytest
from galpy.df.streamgapdf import (
    HernquistX,
    impulse_deltav_hernquist_curvedstream,
    impulse_deltav_plummer_curvedstream,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from streamdash.config import Accuracy
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.geometry import TABLE_STEP
from streamdash.engine.impacts import Impacts
from streamdash.engine.impulse import gravity, hernquist_factor, velocity_kick
from streamdash.engine.kicks import PAD, kick_tables

GALPY = {"hernquist": impulse_deltav_hernquist_curvedstream, "plummer": impulse_deltav_plummer_curvedstream}


def curved_stream(n=41):
    """A piece of a circle traversed at unit speed."""
    angle = np.linspace(-0.6, 0.6, n)
    x = np.stack([1.6 * np.cos(angle), 1.6 * np.sin(angle), 0.1 * angle], axis=1)
    v = np.stack([-np.sin(angle), np.cos(angle), 0.05 + 0 * angle], axis=1)
    return x, v


@pytest.mark.parametrize("profile", ["hernquist", "plummer"])
@pytest.mark.parametrize("b", [1e-5, -0.003, 0.04, 0.6], ids=lambda b: f"b={b}")
@pytest.mark.parametrize("speed", [0.02, 0.5, 5.0], ids=lambda s: f"w={s}")
def test_kick_equals_galpys(profile, b, speed):
    x, v = curved_stream()
    w = speed * np.array([0.3, -0.5, 0.8])
    theirs = GALPY[profile](v, x, b, w, x[20], v[20], 1e-5, 0.011)
    ours = velocity_kick(v, x, b, w, x[20], v[20], 1e-5, 0.011, profile)
    assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-12 * np.abs(theirs).max())


def test_hernquist_factor_is_smooth_where_galpys_is_undefined():
    # u = 1: the limit of (1 - X(u))/(u² - 1) is 1/3.
    assert hernquist_factor(1.0) == pytest.approx(1 / 3, abs=1e-12)
    u = np.array([0.97, 0.974, 0.98, 1.02, 1.0246, 1.03])
    direct = [(1 - HernquistX(x)) / (x**2 - 1) for x in u]
    assert [hernquist_factor(x) for x in u] == pytest.approx(direct, rel=1e-9)


@settings(max_examples=300, deadline=None)
@given(st.floats(1e-6, 1e6))
def test_hernquist_factor_is_positive_and_falls(u):
    assert 0 < hernquist_factor(u * 1.01) < hernquist_factor(u)


def one(geometry, k, theta, b, w, mass, r_s, profile="hernquist"):
    time = geometry.stream.impact_times_gyr[k]
    return Impacts(time, theta, b, w[0], w[1], w[2], mass, r_s, profile)


CASES = [
    # k, theta, b (kpc), w (km/s), mass, r_s (kpc)
    (5, 0.35, 0.3, (30.0, 150.0, -80.0), 1e8, 1.05),
    (5, 0.8, -0.02, (-100.0, 20.0, 60.0), 1e6, 0.105),
    (40, 0.2, 0.6, (0.0, 132.0, 176.0), 5e7, 0.74),
]


def hit_galpys(gap, case, profile):
    """Give galpy's stream the one impact of `case`, its kick densely sampled."""
    _, theta, b, w, mass, r_s = case
    gap._nKickPoints = 2001
    for name in ("_kick_interpolatedThetasTrack", "_kick_interpolatedObsTrackAA"):
        if hasattr(gap, name):
            delattr(gap, name)
    subhalo = (b / R0_KPC, np.array(w) / V0_KMS, mass * gravity(), r_s / R0_KPC)
    gap._determine_deltav_kick(theta, *subhalo, None, 3, profile == "hernquist")
    gap._determine_deltaOmegaTheta_kick(3)
    return gap


@pytest.mark.parametrize("profile", ["hernquist", "plummer"])
@pytest.mark.parametrize("case", CASES, ids=["near-recent", "small", "old"])
def test_frequency_kick_equals_galpys(geometry, gap_at, profile, case):
    k, theta, b, w, mass, r_s = case
    gap = hit_galpys(gap_at(k), case, profile)
    tables = kick_tables(
        geometry,
        one(geometry, k, theta, b, w, mass, r_s, profile),
        Accuracy(kick_spacing=5e-5, kick_tolerance=1e-6),
    )
    angles = (np.arange(tables.size[0]) - PAD + 0.5) * tables.step[0]
    inside = (angles > 0.01) & (angles < geometry.table_ends[k] - 0.01)
    theirs = gap._kick_interpdOpar_raw(angles[inside])
    scale = np.abs(theirs).max()
    assert np.abs(tables.values[inside] - theirs).max() < 5e-3 * scale


def on(tables, angles):
    """The first time's kicks at `angles`."""
    values = tables.values[: tables.size[0]]
    return np.interp(angles, (np.arange(len(values)) - PAD + 0.5) * tables.step[0], values)


@pytest.mark.parametrize("k", [4, 22, 40])
def test_tables_are_kicks_evaluated_everywhere(geometry, k):
    """However a flyby runs and the stream bends: massive ones, far and near, at every angle."""
    rng = np.random.default_rng([3, k])
    angles = np.arange(5, int(geometry.table_ends[k] / TABLE_STEP) - 5) * TABLE_STEP
    row = geometry.tables[k, 5 : 5 + len(angles)]
    for _ in range(20):
        mass = 10 ** rng.uniform(6, 9)
        r_s = 1.05 * np.sqrt(mass / 1e8)
        theta, b, w = rng.choice(angles), 5 * r_s * rng.uniform(-1, 1), rng.normal(0, 150, 3)
        at = geometry.tables[k, round(theta / TABLE_STEP)]
        exact = velocity_kick(
            row[:, 3:6], row[:, :3], b / R0_KPC, w / V0_KMS, at[:3], at[3:6], mass * gravity(), r_s / R0_KPC
        )
        exact = (row[:, 6:] * exact).sum(axis=1)
        table = on(kick_tables(geometry, one(geometry, k, theta, b, w, mass, r_s)), angles)
        error = np.abs(table - exact)
        assert error.max() < max(1e-3 * geometry.sigma_omega, 1e-3 * np.abs(exact).max())
        assert np.sqrt((error**2).mean()) < 1e-4 * geometry.sigma_omega


def test_kicks_add(geometry):
    """Two halves at one place and time are one; a far coarser table keeps the integral."""
    whole = one(geometry, 30, 0.3, 0.05, (50.0, -90.0, 120.0), 1e6, 0.105)
    half = one(geometry, 30, 0.3, 0.05, (50.0, -90.0, 120.0), 5e5, 0.105)
    twice = Impacts(*(np.repeat(getattr(half, c), 2) for c in vars(half)))
    a, b = kick_tables(geometry, whole), kick_tables(geometry, twice)
    peak = np.abs(a.values).max()
    angles = np.linspace(0.001, geometry.table_ends[30] - 0.001, 5000)  # the last entries: beyond all stars
    assert np.abs(on(a, angles) - on(b, angles)).max() < 1e-3 * peak
    coarse = kick_tables(geometry, whole, accuracy=Accuracy(kick_spacing=0.01))
    inside, coarsely = (t.values[PAD:].sum() * t.step[0] for t in (a, coarse))
    scale = np.abs(a.values[PAD:]).sum() * a.step[0]
    assert coarsely == pytest.approx(inside, abs=1e-2 * scale)
