"""Fly-bys chosen by hand and the film of their gaps: against brute force and the engine's own today."""

from dataclasses import replace

import numpy as np
import pytest

from streamdash.config import ConfigError, Perturbers
from streamdash.engine.density import perturbed_stream
from streamdash.engine.flyby import Flyby, combine, film, flyby_impacts, kick_along_stream, random_impacts
from streamdash.engine.galpy_streams import time_unit_gyr
from streamdash.engine.geometry import TABLE_STEP
from streamdash.engine.impacts import COLUMNS, Impacts, ImpactsError, sample_impacts
from streamdash.engine.kicks import PAD, kick_tables
from tests.physics.reference import march

TWO = [Flyby(log10_mass=7.5, time_gyr=5.0, place=0.4), Flyby(log10_mass=7, b=1, time_gyr=2.5, place=0.6)]


def seen_at(geometry, impacts, time):
    """The same stream and the impacts before `time`, with that moment made today."""
    unit = time_unit_gyr()
    stream = geometry.stream
    later = sum(t <= time for t in geometry.times)
    times = tuple(t - time * unit for t in stream.impact_times_gyr[later:])
    moved = replace(
        geometry,
        stream=stream.model_copy(update={"age_gyr": stream.age_gyr - time * unit, "times_gyr": times}),
        t_disrupt=geometry.t_disrupt - time,
        times=geometry.times[later:] - time,
        node_theta=geometry.node_theta[later:],
        node_xv=geometry.node_xv[later:],
        node_jac=geometry.node_jac[later:],
    )
    old = impacts.time_gyr > time * unit
    values = {name: getattr(impacts, name)[old] for name in COLUMNS}
    values["time_gyr"] = values["time_gyr"] - time * unit
    return moved, Impacts(**values)


def test_the_last_frame_is_today(geometry):
    impacts = flyby_impacts(geometry, TWO)
    shown = film(geometry, impacts, n_frames=3, n_theta=40)
    today = perturbed_stream(geometry, impacts, shown.theta)
    assert shown.time_gyr[-1] == 0
    assert shown.time_gyr[0] == pytest.approx(max(impacts.time_gyr))
    np.testing.assert_array_equal(shown.density[-1], today.density.values.astype(np.float32))
    np.testing.assert_allclose(shown.smooth[-1], today.smooth.values, rtol=1e-6)


@pytest.mark.parametrize("frame", [1, 3])
def test_a_frame_is_the_stream_of_that_age_by_brute_force(geometry, frame):
    """Before the younger impact, and between it and today."""
    impacts = flyby_impacts(geometry, TWO)
    shown = film(geometry, impacts, n_frames=5, n_theta=60)
    time = shown.time_gyr[frame] / time_unit_gyr()
    moved, old = seen_at(geometry, impacts, time)
    assert len(old) == (1 if frame == 1 else 2)
    inside = np.flatnonzero(shown.smooth[frame] > 0.1)[::4]
    exact, _ = march(moved, old, shown.theta[inside], steps=1500)
    smooth = moved.smooth_density(shown.theta[inside])
    np.testing.assert_allclose(shown.smooth[frame][inside], smooth, rtol=1e-5)
    assert np.abs((shown.density[frame][inside] - exact) / smooth).max() < 2e-3
    assert np.abs(exact / smooth - 1).max() > 0.02


def test_at_the_impact_nothing_has_moved_yet_and_then_the_gap_opens(geometry):
    depth = np.nanmin(film(geometry, flyby_impacts(geometry, [Flyby()]), n_frames=9).q_rho, axis=1)
    assert depth[0] == pytest.approx(1, abs=1e-3)
    assert (np.diff(depth) < 0).all()
    assert depth[-1] < 0.5


def test_a_vanishing_object_leaves_every_frame_smooth(geometry):
    impacts = flyby_impacts(geometry, [Flyby(log10_mass=3, size=5, b=5)])
    assert np.nanmax(np.abs(film(geometry, impacts, n_frames=7, n_theta=60).q_rho - 1)) < 5e-4


def test_stars_are_conserved_in_every_frame(geometry):
    shown = film(geometry, flyby_impacts(geometry, [Flyby(log10_mass=7, place=0.4)]), n_frames=9)
    kicked, smooth = (np.trapezoid(x, shown.theta, axis=1) for x in (shown.density, shown.smooth))
    assert np.abs(shown.density / shown.smooth.clip(0.2) - 1).max() > 0.05
    # What flows over the film's end is not seen: none, for so light an object.
    np.testing.assert_allclose(kicked, smooth, rtol=2e-3)


def test_the_flyby_comes_as_it_was_ordered(geometry):
    flyby = Flyby(log10_mass=6, size=2, b=1.5, speed=321, pitch=40, azimuth=200, time_gyr=3.0, place=0.7)
    impact = flyby_impacts(geometry, [flyby])
    k = flyby.time_index(geometry)
    assert impact.time_gyr[0] == geometry.stream.impact_times_gyr[k]
    assert abs(impact.time_gyr[0] - 3.0) <= 0.5 * geometry.stream.impact_times_gyr[0]
    assert impact.theta[0] == pytest.approx(0.7 * geometry.length_at(geometry.times[k]))
    assert impact.r_s_kpc[0] == pytest.approx(2 * 1.05 * 0.1)
    assert impact.b_kpc[0] == pytest.approx(1.5 * impact.r_s_kpc[0])
    w = np.array([impact.vx_kms[0], impact.vy_kms[0], impact.vz_kms[0]])
    motion = geometry.tables[k, round(impact.theta[0] / TABLE_STEP), 3:6]
    assert np.linalg.norm(w) == pytest.approx(321)
    cosine = w @ motion / np.linalg.norm(w) / np.linalg.norm(motion)
    assert np.rad2deg(np.arccos(cosine)) == pytest.approx(40, abs=0.1)


def test_the_kick_shown_is_the_kick_the_engine_uses(geometry):
    flyby = Flyby()
    shown = kick_along_stream(geometry, flyby)
    tables = kick_tables(geometry, flyby_impacts(geometry, [flyby]))
    angles = (np.arange(tables.size[0] - PAD - 4) + 0.5) * tables.step[0]
    used = tables.values[PAD : PAD + len(angles)] / time_unit_gyr()
    expected = np.interp(angles, shown.theta, shown.d_omega)
    # The last entries reach beyond the stream's end.
    assert np.abs(used - expected)[:-3].max() < 3e-4 * np.abs(used).max()
    # In front of the object stars are pulled back, behind it forward.
    assert shown.dv_along.min() < -0.1 < 0.1 < shown.dv_along.max()


def test_random_flybys_are_the_first_of_one_streams_and_add_up(geometry):
    all_of_them = sample_impacts(geometry, Perturbers(), np.random.default_rng(5))
    few = random_impacts(geometry, Perturbers(), 7, seed=5)
    np.testing.assert_array_equal(few.theta, all_of_them.theta[:7])
    assert len(random_impacts(geometry, Perturbers(), 10_000, seed=5)) == len(all_of_them)
    assert len(combine([few, flyby_impacts(geometry, TWO)])) == 9
    assert len(combine([])) == 0


def test_refusals_name_the_field(geometry):
    with pytest.raises(ConfigError, match="pitch"):
        Flyby(pitch=0)
    with pytest.raises(ValueError, match="at least one impact"):
        film(geometry, Impacts.none())
    wrong = flyby_impacts(geometry, TWO)
    with pytest.raises(ImpactsError, match="row 1, column theta"):
        film(geometry, replace(wrong, theta=np.array([-1.0, 0.3])))
