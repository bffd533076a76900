"""A plain, slow, independent march of the same model, to hold the engine to.

No graded nodes, no box averages, no pilot, no end corrections: kicks on an even grid of
angles, frequencies on an even grid over a wide window, the rectangle rule. Converges
only with brute force, which is its point.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.geometry import TABLE_STEP
from streamdash.engine.impacts import time_index
from streamdash.engine.impulse import gravity, velocity_kick


def kick_grids(geometry, impacts, spacing):
    """δΩ∥ on an even grid of angles at each impact time that has any, newest first."""
    index = time_index(geometry, impacts)
    hit = np.unique(index)
    grids = []
    for k in hit:
        theta = np.arange(0.0, geometry.table_ends[k] + spacing, spacing)
        table = _columns(geometry, k, theta)
        total = np.zeros(len(theta))
        for i in np.flatnonzero(index == k):
            closest = _columns(geometry, k, impacts.theta[i : i + 1])[0]
            w = np.array([impacts.vx_kms[i], impacts.vy_kms[i], impacts.vz_kms[i]]) / V0_KMS
            kick = velocity_kick(
                table[:, 3:6],
                table[:, :3],
                impacts.b_kpc[i] / R0_KPC,
                w,
                closest[:3],
                closest[3:6],
                impacts.mass_msun[i] * gravity(),
                impacts.r_s_kpc[i] / R0_KPC,
                impacts.profile[i],
            )
            total += np.einsum("nc,nc->n", table[:, 6:], kick)
        grids.append(total)
    return geometry.times[hit], grids


def _columns(geometry, k, theta):
    table = geometry.tables[k]
    place = np.arange(len(table)) * TABLE_STEP
    return np.stack([np.interp(theta, place, table[:, c]) for c in range(table.shape[1])], axis=1)


@njit(parallel=True, fastmath=True)
def _march(theta, omega, dt, spacing, start, size, values, end, mean, sigma, t_disrupt, oldest):
    density, weighted = np.zeros(len(theta)), np.zeros(len(theta))
    for line in prange(len(theta)):
        for o in omega:
            angle, then, alive = theta[line], o, True
            for k in range(len(dt)):
                angle -= then * dt[k]
                if angle <= 0.0:
                    alive = False
                    break
                if angle < end[k]:
                    place = angle / spacing
                    j = int(place)
                    low = values[start[k] + j]
                    then -= low + (place - j) * (values[start[k] + j + 1] - low)
            if alive and angle > then * (t_disrupt - oldest):
                continue
            p = np.exp(-0.5 * ((then - mean) / sigma) ** 2)
            density[line] += p
            weighted[line] += p * o
    return density, weighted


def march(geometry, impacts, theta, steps=200, spacing=2e-5, reach=None):
    """Density and mean frequency with `steps` frequencies per dispersion."""
    times, grids = kick_grids(geometry, impacts, spacing)
    size = np.array([len(grid) for grid in grids])
    start = np.concatenate([[0], np.cumsum(size)[:-1]])
    largest = sum(np.abs(grid).max() for grid in grids)
    sigma, mean = geometry.sigma_omega, geometry.mean_omega
    half = 6 * sigma + (largest if reach is None else reach * sigma)
    omega = np.arange(mean - half, mean + half, sigma / steps)
    end = np.array([(len(grid) - 2) * spacing for grid in grids])
    density, weighted = _march(
        np.asarray(theta),
        omega,
        np.diff(times, prepend=0.0),
        spacing,
        start,
        size,
        np.concatenate(grids),
        end,
        mean,
        sigma,
        geometry.t_disrupt,
        times[-1],
    )
    return density / steps / np.sqrt(2 * np.pi), weighted / density
