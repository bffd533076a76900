"""Velocity kicks of subhalos and what they do to the parallel frequencies of a stream.

The impulse approximation on a curved stream: the star at x moving with v, passed by a
subhalo of mass M and scale r_s moving with w at impact parameter b of the stream point
(x0, v0), is kicked by

    δv = -(2 G M / |w - v|) F(B) B,    B = (b b̂ + x - x0) without its part along w - v,

with b̂ = w × v0 / |w × v0| and F(B) = 1/(B² + r_s²) for a Plummer sphere, and
F = (1 - X(u)) / (B² - r_s²), u = B/r_s, for a Hernquist one (X from Hernquist 1990, eq. 33).
The frequency kick is δΩ∥ = L·δv with L from the geometry (BES17 §2.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from streamdash.config import Accuracy
from streamdash.geometry import R0_KPC, TABLE_STEP, V0_KMS, Geometry
from streamdash.impacts import Impacts, time_index

PAD = 12
"""Entries of a kick table below θ = 0, where the kick is continued linearly: there is no
star there, but the phase-space density is interpolated across the progenitor's edge."""
MAX_NODES = 4000
"""Room for nodes on either side of one impact."""
FINEST = 1e-3
"""Finest spacing of kick nodes, in units of the kick's scale; some 2,600 a side."""
GROWTH = 0.35
"""Coarsest spacing of kick nodes, as a fraction of the distance from the impact."""
ENTRIES = 2
"""Entries of a kick table per `Accuracy.kick_spacing`: with one, 4 of 9,600 points of sampled
streams were off by more than 2·10⁻³ (up to 3.8·10⁻³); with two, none was."""
PER_SCALE = 8
"""Entries of a kick table per scale of the smallest kick in it."""
COARSEST = 5
"""Coarsest spacing of a kick table, in units of the finest."""
STEP_MAX = 0.02
"""Coarsest spacing of kick nodes in rad (~0.4 kpc): a curved stream can come near the
subhalo's path a second time, away from the impact."""


def gravity() -> float:
    """G · 1 M☉ in natural units."""
    from galpy.util import conversion

    return 1.0 / float(conversion.mass_in_msol(V0_KMS, R0_KPC))


@njit(cache=True, error_model="numpy")
def hernquist_factor(u: float) -> float:
    """(1 - X(u)) / (u² - 1) of the Hernquist kick; regular (1/3) at u = 1."""
    t = 1.0 - u * u
    if abs(t) < 0.05:
        return 1 / 3 + t * (1 / 5 + t * (1 / 7 + t * (1 / 9 + t * (1 / 11 + t * (1 / 13 + t / 15)))))
    if t > 0.0:
        return (math.log((1.0 + math.sqrt(t)) / u) / math.sqrt(t) - 1.0) / t
    return (math.acos(1.0 / u) / math.sqrt(-t) - 1.0) / t


@njit(cache=True, error_model="numpy")
def _kick(px, py, pz, vx, vy, vz, wx, wy, wz, gm, r_s, hernquist):
    """Kick of a star at offset p (from the subhalo's path point) moving with v."""
    rx, ry, rz = wx - vx, wy - vy, wz - vz
    speed2 = rx * rx + ry * ry + rz * rz
    along = (px * rx + py * ry + pz * rz) / speed2
    px, py, pz = px - along * rx, py - along * ry, pz - along * rz
    distance2 = px * px + py * py + pz * pz
    if hernquist:
        u = max(math.sqrt(distance2) / r_s, 1e-30)
        factor = hernquist_factor(u) / (r_s * r_s)
    else:
        factor = 1.0 / (distance2 + r_s * r_s)
    scale = -2.0 * gm * factor / math.sqrt(speed2)
    return scale * px, scale * py, scale * pz


@njit(cache=True, error_model="numpy")
def _impulse(v, x, offset, w, x0, gm, r_s, hernquist):
    out = np.empty_like(v)
    for i in range(len(v)):
        px = offset[0] + x[i, 0] - x0[0]
        py = offset[1] + x[i, 1] - x0[1]
        pz = offset[2] + x[i, 2] - x0[2]
        out[i] = _kick(px, py, pz, v[i, 0], v[i, 1], v[i, 2], w[0], w[1], w[2], gm, r_s, hernquist)
    return out


def velocity_kick(v, x, b, w, x0, v0, gm, r_s, profile="hernquist") -> np.ndarray:
    """Velocity kicks along a curved stream, in any consistent units.

    The same quantity as ``galpy.df.streamgapdf.impulse_deltav_{hernquist,plummer}_curvedstream``,
    and finite also where galpy's Hernquist formula divides zero by zero (B = r_s).

    Parameters
    ----------
    v, x : (n, 3) arrays
        Velocities and positions along the stream.
    b : float
        Impact parameter; its sign chooses the side.
    w : (3,) array
        Velocity of the subhalo.
    x0, v0 : (3,) arrays
        Position and velocity of the stream at closest approach.
    gm, r_s : float
        G times mass, and scale radius.
    profile : {"hernquist", "plummer"}

    Returns
    -------
    (n, 3) array
    """
    normal = np.cross(w, v0)
    offset = b * normal / np.linalg.norm(normal)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (np.atleast_2d(v), np.atleast_2d(x), w, x0)]
    return _impulse(arrays[0], arrays[1], offset, arrays[2], arrays[3], gm, r_s, profile == "hernquist")


@njit(cache=True, error_model="numpy")
def _look_up(table, theta, row):
    position = theta / TABLE_STEP
    i = min(int(position), len(table) - 2)
    f = position - i
    for c in range(9):
        row[c] = table[i, c] + f * (table[i + 1, c] - table[i, c])


@njit(cache=True, error_model="numpy")
def _frequency_kick(row, offset, x0, w, gm, r_s, hernquist):
    dx, dy, dz = _kick(
        offset[0] + row[0] - x0[0],
        offset[1] + row[1] - x0[1],
        offset[2] + row[2] - x0[2],
        row[3],
        row[4],
        row[5],
        w[0],
        w[1],
        w[2],
        gm,
        r_s,
        hernquist,
    )
    return row[6] * dx + row[7] * dy + row[8] * dz


@njit(cache=True, error_model="numpy")
def _place_nodes(length, scale, fineness, limit, out):
    """Distances from the impact, from 0 to length, at which to evaluate its kick.

    A kick falls as 1/y beyond its scale s, so its curvature falls as 1/y³, and a spacing
    ∝ (s² + y²)^¾ keeps the error of linear interpolation the same everywhere.
    """
    y, n = 0.0, 0
    while y < length and n < len(out) - 1:
        out[n] = y
        n += 1
        r = math.sqrt(scale * scale + y * y)
        y += min(GROWTH * r, fineness * r * math.sqrt(r / scale), limit)
    out[n] = length
    return n + 1


@njit(cache=True, error_model="numpy")
def _add_impact(table, end, step, moments, theta0, b, w, gm, r_s, hernquist, tolerance, row, nodes, kicks):
    """Add one impact's δΩ∥(θ), piecewise linear between graded nodes, to `moments`.

    A change of slope Δ at node y adds
    ½Δ(x - y)² to the integral of the kick at every x > y; keeping the sums of Δ, Δy and
    Δy² per cell makes that integral exact at every cell edge for any number of impacts
    at a cost that does not depend on the number of cells.
    """
    _look_up(table, theta0, row)
    x0 = row[:3].copy()
    v0 = row[3:6].copy()
    nx, ny, nz = w[1] * v0[2] - w[2] * v0[1], w[2] * v0[0] - w[0] * v0[2], w[0] * v0[1] - w[1] * v0[0]
    norm = b / math.sqrt(nx * nx + ny * ny + nz * nz)
    offset = np.array([nx * norm, ny * norm, nz * norm])
    i = min(int(theta0 / TABLE_STEP), len(table) - 2)
    tangent = 0.0
    for c in range(3):
        tangent += ((table[i + 1, c] - table[i, c]) / TABLE_STEP) ** 2
    scale = math.sqrt(b * b + r_s * r_s) / math.sqrt(tangent)
    # Largest |δΩ∥| of the kick, to choose how finely it must be followed.
    speed = math.sqrt((w[0] - v0[0]) ** 2 + (w[1] - v0[1]) ** 2 + (w[2] - v0[2]) ** 2)
    response = math.sqrt(row[6] ** 2 + row[7] ** 2 + row[8] ** 2)
    peak = 2.0 * gm * response / (speed * math.sqrt(b * b + r_s * r_s))
    limit = STEP_MAX if peak > 50.0 * tolerance else 1e9
    fineness = max(math.sqrt(12.0 * tolerance / peak), FINEST)
    behind = _place_nodes(theta0, scale, fineness, limit, nodes[:MAX_NODES])
    for j in range(behind):  # placed outwards from the impact; wanted in order of angle
        nodes[j] = theta0 - nodes[j]
    for j in range(behind // 2):
        nodes[j], nodes[behind - 1 - j] = nodes[behind - 1 - j], nodes[j]
    # The impact itself, last behind, is first ahead.
    n = behind - 1 + _place_nodes(end - theta0, scale, fineness, limit, nodes[behind - 1 :])
    for j in range(behind - 1, n):
        nodes[j] += theta0
    for j in range(n):
        _look_up(table, nodes[j], row)
        kicks[j] = _frequency_kick(row, offset, x0, w, gm, r_s, hernquist)
    moments[0, 3] += kicks[0]
    slope_a, flatter_a = 0.0, kicks[0]
    for j in range(n - 1):
        width = nodes[j + 1] - nodes[j]
        if width <= 0.0:
            continue
        # A chord of a curved kick lies width²/12 of its second derivative beside it on
        # average; nodes moved by that leave an interpolation that is right on average.
        flatter_b = kicks[j + 1]
        if j + 2 < n and nodes[j + 2] > nodes[j + 1]:
            next_width = nodes[j + 2] - nodes[j + 1]
            bend = (kicks[j + 2] - kicks[j + 1]) / next_width - (kicks[j + 1] - kicks[j]) / width
            flatter_b -= bend * (width * width + next_width * next_width) / (12.0 * (width + next_width))
        slope = (flatter_b - flatter_a) / width
        cell = min(int(nodes[j] / step), len(moments) - 1)
        change = slope - slope_a
        moments[cell, 0] += change
        moments[cell, 1] += change * nodes[j]
        moments[cell, 2] += change * nodes[j] * nodes[j]
        slope_a, flatter_a = slope, flatter_b


@njit(cache=True, error_model="numpy")
def _finish(moments, end, step, out):
    """Turn slope moments into the entries of one time's table, at the centres of cells.

    From the kick's average c over each cell: a kick narrower than a cell is averaged, not
    hit or missed, and what it does to the density is then exact to first order. Averaging
    and linear interpolation together flatten a curved kick by step²/8 of its second
    derivative; taking that off the entries leaves no error of second order on average.
    """
    n = len(moments)
    a0, a1, a2, constant = 0.0, 0.0, 0.0, moments[0, 3]
    before = 0.0
    for i in range(n):
        a0 += moments[i, 0]
        a1 += moments[i, 1]
        a2 += moments[i, 2]
        x = min((i + 1) * step, end)
        integral = constant * x + 0.5 * (a0 * x * x - 2.0 * a1 * x + a2)
        moments[i, 3] = (integral - before) / step
        before = integral
    for i in range(1, n - 1):
        bend = moments[i - 1, 3] - 2.0 * moments[i, 3] + moments[i + 1, 3]
        out[PAD + i] = moments[i, 3] - bend / 8.0
    out[PAD] = moments[0, 3]
    out[PAD + n - 1] = moments[n - 1, 3]
    out[PAD + n :] = 0.0
    slope = out[PAD + 1] - out[PAD]
    for i in range(1, PAD + 1):
        out[PAD - i] = out[PAD] - i * slope


@njit(cache=True, error_model="numpy")
def _bend(kicks, step, stride, out):
    """Largest |d²δΩ∥/dθ²| within a stretch of the table and its two neighbours."""
    n = len(out)
    local = np.zeros(n)
    for i in range(PAD, len(kicks) - 4):
        j = (i - PAD) // stride
        local[j] = max(local[j], abs(kicks[i - 1] - 2.0 * kicks[i] + kicks[i + 1]) / (step * step))
    for j in range(n):
        out[j] = max(local[max(j - 1, 0)], local[j], local[min(j + 1, n - 1)])


@dataclass(frozen=True)
class KickTables:
    """Summed frequency kicks δΩ∥(θ) at each impact time that has any, newest first.

    Attributes
    ----------
    times : (n,) array
        Those impact times before today (natural units).
    start, size : (n,) arrays of int
        Where each time's table begins in `values`, and its number of entries.
    step : (n,) array
        Spacing of the entries (rad); entry `PAD` is at θ = ½ step.
    values : (total,) array
        Kicks (natural units).
    bend_start, bend_size, bend_step, bends : arrays
        Likewise, on a coarser grid from θ = 0: the largest curvature of the kick near
        each angle, which tells how densely stars must be sampled there.
    """

    times: np.ndarray
    start: np.ndarray
    size: np.ndarray
    step: np.ndarray
    values: np.ndarray
    bend_start: np.ndarray
    bend_size: np.ndarray
    bend_step: np.ndarray
    bends: np.ndarray

    def largest(self) -> float:
        """Sum over times of the largest |δΩ∥|: no star is carried further in frequency."""
        if not len(self.times):
            return 0.0
        return float(np.maximum.reduceat(np.abs(self.values), self.start).sum())


def kick_tables(
    geometry: Geometry,
    impacts: Impacts,
    profile: str = "hernquist",
    accuracy: Accuracy | None = None,
) -> KickTables:
    """Add up the kicks of all impacts at each impact time.

    Parameters
    ----------
    geometry : Geometry
    impacts : Impacts
        Times must be impact times of the stream.
    profile : {"hernquist", "plummer"}
    accuracy : Accuracy, optional

    Returns
    -------
    KickTables
    """
    accuracy = accuracy or Accuracy()
    index = time_index(geometry, impacts)
    hit = np.unique(index)
    times = geometry.times[hit]
    ends = geometry.table_ends[hit]
    step = _table_steps(geometry, impacts, index, hit, accuracy)
    cells = np.ceil(ends / step).astype(np.int64)
    size = cells + PAD + 4
    start = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
    values = np.zeros(int(size.sum()))
    order = np.argsort(index, kind="stable")
    first = np.searchsorted(index[order], hit)
    count = np.diff(np.append(first, len(order)))
    columns = np.stack(
        [
            impacts.theta,
            impacts.b_kpc / R0_KPC,
            impacts.vx_kms / V0_KMS,
            impacts.vy_kms / V0_KMS,
            impacts.vz_kms / V0_KMS,
            impacts.mass_msun * gravity(),
            impacts.r_s_kpc / R0_KPC,
        ],
        axis=1,
    )[order]
    tolerance = accuracy.kick_tolerance * geometry.sigma_omega
    # One entry of curvature per distance between stars sampled at neighbouring frequencies.
    stride = np.maximum(1, np.rint(accuracy.frequency_step * geometry.sigma_omega * times / step)).astype(int)
    bend_size = cells // stride + 2
    bend_start = np.concatenate([[0], np.cumsum(bend_size)[:-1]])
    bends = np.zeros(int(bend_size.sum()))
    for t, k in enumerate(hit):
        table = values[start[t] : start[t] + size[t]]
        here = columns[first[t] : first[t] + count[t]]
        _fill(geometry.tables[k], ends[t], step[t], cells[t], here, profile == "hernquist", tolerance, table)
        _bend(table, step[t], stride[t], bends[bend_start[t] : bend_start[t] + bend_size[t]])
    return KickTables(times, start, size, step, values, bend_start, bend_size, stride * step, bends)


def _table_steps(
    geometry: Geometry, impacts: Impacts, index: np.ndarray, hit: np.ndarray, accuracy: Accuracy
) -> np.ndarray:
    """Spacing of the table of each time in `hit`: fine enough for its sharpest kick."""
    kpc_per_rad = geometry.arc_lengths[index, -1] / geometry.table_ends[index]
    smallest = np.full(len(geometry.times), np.inf)
    np.minimum.at(smallest, index, np.hypot(impacts.b_kpc, impacts.r_s_kpc) / kpc_per_rad)
    finest = accuracy.kick_spacing / ENTRIES
    return np.clip(smallest[hit] / PER_SCALE, finest, COARSEST * finest)


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(table, end, step, cells, impacts, hernquist, tolerance, out):
    row, nodes, kicks = np.empty(9), np.empty(2 * MAX_NODES), np.empty(2 * MAX_NODES)
    moments = np.zeros((cells, 4))
    for i in range(len(impacts)):
        theta, b, w, gm, r_s = impacts[i, 0], impacts[i, 1], impacts[i, 2:5], impacts[i, 5], impacts[i, 6]
        _add_impact(table, end, step, moments, theta, b, w, gm, r_s, hernquist, tolerance, row, nodes, kicks)
    _finish(moments, end, step, out)
