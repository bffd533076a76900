"""Stars and objects on their own orbits through the stream's Galaxy, for films; integrated by galpy."""

from __future__ import annotations

import numpy as np

from streamdash.engine.galpy_streams import galpy_potential
from streamdash.stream_model import StreamModel

STEP = 0.02
"""Longest step between the times an orbit is asked for (natural units, 0.7 Myr)."""


def follow(stream: StreamModel, xv: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Positions and velocities of bodies that feel the Galaxy alone.

    Parameters
    ----------
    stream : StreamModel
        Whose potential is meant.
    xv : ndarray (n, 6)
        Rectangular Galactocentric position and velocity at time 0 (natural units).
    times : ndarray (n_times,)
        Increasing times, before (negative) or after (natural units).

    Returns
    -------
    ndarray (n_times, n, 6)
    """
    found = np.empty((len(times), len(xv), 6))
    later = times >= 0
    found[later] = _one_way(stream, xv, times[later])
    found[~later] = _one_way(stream, xv, times[~later][::-1])[::-1]
    return found


def _one_way(stream: StreamModel, xv: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The same for times that run away from 0."""
    from galpy.orbit import Orbit
    from galpy.util import coords

    if not np.any(times):  # nothing to integrate, over which galpy would never end
        return np.repeat(xv[None], len(times), axis=0)
    radius, phi, z = coords.rect_to_cyl(*xv[:, :3].T)
    v_r, v_t, v_z = coords.rect_to_cyl_vec(*xv[:, 3:].T, radius, phi, z, cyl=True)
    orbit = Orbit(np.stack([radius, v_r, v_t, z, v_z, phi], axis=1))
    steps = max(2, int(np.ceil(np.abs(times).max() / STEP)) + 1)
    grid = np.linspace(0.0, float(times[np.abs(times).argmax()]), steps)
    orbit.integrate(grid, galpy_potential(stream), progressbar=False)
    columns = [getattr(orbit, name)(times) for name in ("x", "y", "z", "vx", "vy", "vz")]
    return np.stack([np.reshape(column, (len(xv), len(times))) for column in columns], axis=2).swapaxes(0, 1)
