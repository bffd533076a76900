"""Films of orbits: energy is kept, the fly-by is where the engine has it, pulled forward falls back."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.engine.flyby import Flyby
from streamdash.engine.galpy_streams import R0_KPC, galpy_potential
from streamdash.engine.orbits import follow
from streamdash.survey.passing import PASSING_FRAMES, passing, pulled


def energy(potential, xv: np.ndarray) -> np.ndarray:
    from galpy.potential import evaluatePotentials

    radius = np.hypot(xv[..., 0], xv[..., 1])
    return 0.5 * (xv[..., 3:] ** 2).sum(axis=-1) + evaluatePotentials(potential, radius, xv[..., 2])


def test_bodies_keep_their_energy_and_come_back_along_their_way(geometry):
    stars = geometry.tables[0][::40, :6]
    times = np.linspace(-3.0, 3.0, 31)
    there = follow(geometry.stream, stars, times)
    np.testing.assert_allclose(there[15], stars, atol=1e-9)
    before = energy(galpy_potential(geometry.stream), there)
    np.testing.assert_allclose(before, before[15][None, :].repeat(31, axis=0), rtol=1e-5)
    np.testing.assert_allclose(follow(geometry.stream, there[-1], -times[15:])[-1], stars, atol=1e-5)


@pytest.mark.parametrize("b", [0.0, 1.0])
def test_the_object_comes_nearest_at_the_flyby(geometry, b):
    flyby = Flyby(b=b)
    shown = passing(geometry, flyby)
    middle = PASSING_FRAMES // 2
    apart = np.hypot(shown.object_along, shown.object_across)
    # On the sky the nearest moment may be another one, but not by more than the object needs to pass.
    assert abs(shown.time_myr[apart.argmin()]) < 5
    assert apart[middle] < 1.2 * apart.min() + 0.3
    if b == 0:
        assert apart[middle] == pytest.approx(0, abs=1e-6)
    assert np.abs(shown.across[middle]).max() < 5
    assert (np.diff(shown.along[middle]) > 0).all()


def test_pulled_forward_runs_ahead_and_falls_back(geometry):
    shown = pulled(geometry, Flyby())
    ahead, behind = shown.lead.T
    assert ahead[3] > 0 > behind[3]
    assert ahead[-1] < -5 < 5 < behind[-1]
    assert 0 < shown.falls_back < 0.5
    assert shown.lead[0] == pytest.approx(0, abs=1e-9)
    # The circular speed is 220 km/s everywhere: nobody leaves the reach of the progenitor's orbit by much.
    radius = np.hypot(*shown.place[:, 0].T)
    assert R0_KPC < radius.min() < radius.max() < 4 * R0_KPC
