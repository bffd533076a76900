"""Compiled actions, frequencies and angles against galpy's own, and against themselves."""

import numpy as np
import pytest
from galpy.actionAngle import actionAngleIsochroneApprox
from galpy.df.streamdf import calcaAJac

from streamdash.config import StreamModel
from streamdash.engine.action_angles import STEP, CompiledIsochroneApprox
from streamdash.engine.galpy_streams import galpy_gap, galpy_potential, impact_nodes, progenitor_orbit
from streamdash.streams import STREAM_NAMES, named_stream

NOISE = 2e-4
"""What galpy's differences over 10⁻⁸ may be off by: steps of its integrator, 10⁻¹², over them."""


def both(stream):
    """galpy's object and ours, and the progenitor as a point."""
    potential = galpy_potential(stream)
    point = np.array(progenitor_orbit(stream).vxvv[0])
    point[5] %= 2 * np.pi
    kinds = actionAngleIsochroneApprox, CompiledIsochroneApprox
    return *(kind(pot=potential, b=stream.isochrone_b) for kind in kinds), point


@pytest.fixture(scope="module", params=STREAM_NAMES)
def pair(request):
    return both(named_stream(request.param).arm())


def values(found):
    return np.array(found)[:, 0]


def test_values_are_galpys(pair):
    theirs, ours, point = pair
    expected = values(theirs.actionsFreqsAngles(*map(float, point)))
    assert values(ours.actionsFreqsAngles(*map(float, point))) == pytest.approx(expected, abs=2e-9)


def test_values_are_galpys_for_other_orbits():
    """Prograde and retrograde, rising and falling, near the plane and over the poles."""
    theirs, ours, _ = both(StreamModel())
    rng = np.random.default_rng(3)
    for sign in (1, -1):
        for _ in range(3):
            point = np.array([1.2, 0.3, sign, 0.4, 0.3, 3.0]) + 0.2 * rng.standard_normal(6)
            expected = values(theirs.actionsFreqsAngles(*map(float, point)))
            assert ours.evaluate(point[None])[0] == pytest.approx(expected, abs=2e-9)


def test_derivatives_are_galpys_within_the_noise_of_its_own(pair):
    theirs, ours, point = pair
    expected, found = (
        calcaAJac(point.copy(), approximation, actionsFreqsAngles=True) for approximation in (theirs, ours)
    )
    scale = np.abs(expected).max()
    assert np.abs(found - expected).max() < NOISE * scale


def test_derivatives_repeat_over_another_interval(pair):
    """Theirs over 10⁻⁸ do so to 10⁻⁶ at best."""
    _, ours, point = pair
    found = ours.derivatives(point)
    other = np.zeros((9, 6))
    for axis in range(6):
        step = 3 * STEP * np.eye(6)[axis]
        rise = np.subtract(*ours.evaluate(np.stack([point + step, point - step])))
        rise[6:] = (rise[6:] + np.pi) % (2 * np.pi) - np.pi
        other[:, axis] = rise / (6 * STEP)
    assert np.abs(found - other)[3:6].max() < 5e-7
    assert np.abs(found - other).max() < 2e-5


def test_points_near_the_last_one_are_on_its_tangent(pair):
    _, ours, point = pair
    middle = values(ours.actionsFreqsAngles(*map(float, point)))
    near = point + 5e-8 * np.array([1, -1, 1, 1, -1, 1])
    found = values(ours.actionsFreqsAngles(*map(float, near)))
    assert (found != middle).any()
    assert found == pytest.approx(ours.evaluate(near[None])[0], abs=1e-10)


def test_what_galpys_streams_do_not_ask_for_is_galpys_own(pair):
    """Several points at once, other orders."""
    theirs, ours, point = pair
    several = [np.array([value, value]) for value in point]
    for asked in (
        lambda approximation: approximation.actionsFreqsAngles(*several),
        lambda approximation: approximation.actionsFreqsAngles(*map(float, point), maxn=4),
    ):
        assert np.array_equal(np.array(asked(theirs)), np.array(asked(ours)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "k"), [("gd1-like", 40), ("gd1", 50), ("pal5", 60)])
def test_nodes_of_an_impact_time_are_galpys(name, k):
    stream = named_stream(name).arm()
    nodes, gap = impact_nodes(stream, k), galpy_gap(stream, stream.impact_times_gyr[k])
    row = gap._sigMeanSign * np.einsum(
        "f,nfv->nv", gap._dsigomeanProgDirection, gap._gap_alljacsTrack[:, :3, [1, 2, 4]]
    )
    assert nodes.theta == pytest.approx(gap._gap_thetasTrack, rel=1e-5)
    assert nodes.xv == pytest.approx(gap._gap_ObsTrackXY, abs=2e-5)
    assert nodes.jac == pytest.approx(row, abs=NOISE)
