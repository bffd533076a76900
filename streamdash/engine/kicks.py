"""Velocity kicks of subhalos and what they do to the parallel frequencies of a stream.

The frequency kick of a flyby is δΩ∥ = L·δv, with the velocity kick δv from
`streamdash.engine.impulse` and L from the geometry (BES17 §2.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from streamdash.compiled import njit
from streamdash.config import Accuracy
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.geometry import TABLE_STEP, Geometry
from streamdash.engine.impacts import Impacts, time_index
from streamdash.engine.impulse import gravity, impulse

PAD = 12
"""Entries of a kick table below θ = 0, where the kick is continued linearly: there is no
star there, but the phase-space density is interpolated across the progenitor's edge."""
TIME_ROUNDING = 1e-9
"""Times that differ by no more (natural units) are the same."""
MAX_NODES = 12000
"""Room for nodes on either side of one impact."""
FINEST = 1e-3
"""Finest spacing of kick nodes, in units of the kick's scale; some thousands a side."""
SLOWEST = 0.1
"""The stream is taken to cross a subhalo's path at no smaller sine than this."""
GROWTH = 0.5
"""Coarsest spacing of kick nodes, as a fraction of the distance from the impact."""
STREAM_SCALE = 0.3
"""Angle in rad over which the stream's own direction, and so its response to a kick, turns."""


@njit(cache=True, error_model="numpy")
def _look_up(table, theta, row):
    position = theta / TABLE_STEP
    i = min(int(position), len(table) - 2)
    f = position - i
    for c in range(9):
        row[c] = table[i, c] + f * (table[i + 1, c] - table[i, c])


@njit(cache=True, error_model="numpy")
def _follow(table, theta0, length, start, w, gm, r_s, hernquist, rate, fineness, knot, row, nodes, kicks):
    """Evaluate an impact's δΩ∥ from θ0 on for `length` (backwards if negative); how many nodes.

    At distance B from the subhalo's path, softened to r² = B² + r_s², a kick falls as 1/r, so
    its curvature as 1/r³, and a spacing ∝ r^1.5 keeps the error of linear interpolation the
    same everywhere; also where a curved stream comes near the path a second time. `rate` is
    that of B along the stream (length/rad): an upper limit at first, then as measured. The
    stream's own response is kinked at multiples of `knot`, which are evaluated too.
    """
    slowest = SLOWEST * rate
    y, n, step, r0 = 0.0, 0, 0.0, 0.0
    cx, cy, cz = 0.0, 0.0, 0.0
    while True:
        nodes[n] = theta0 + y
        _look_up(table, nodes[n], row)
        bx, by, bz, scale = impulse(
            start[0] + row[0], start[1] + row[1], start[2] + row[2],
            row[3], row[4], row[5], w[0], w[1], w[2], gm, r_s, hernquist,
        )  # fmt: skip
        kicks[n] = scale * (row[6] * bx + row[7] * by + row[8] * bz)
        n += 1
        if y == length:
            return n
        r = math.sqrt(bx * bx + by * by + bz * bz + r_s * r_s)
        if n == 1:
            r0 = r
        else:
            rate = max(math.sqrt((bx - cx) ** 2 + (by - cy) ** 2 + (bz - cz) ** 2) / step, slowest)
        cx, cy, cz = bx, by, bz
        step = min(GROWTH * r / rate, fineness * math.sqrt(r / r0) * min(r / rate, STREAM_SCALE))
        before = y
        if n == MAX_NODES - 1:
            y = length
        elif length > 0.0:
            next_knot = (math.floor(nodes[n - 1] / knot + 1e-9) + 1.0) * knot
            y = min(y + step, next_knot - theta0, length)
        else:
            next_knot = (math.ceil(nodes[n - 1] / knot - 1e-9) - 1.0) * knot
            y = max(y - step, next_knot - theta0, length)
        step = abs(y - before)


@njit(cache=True, error_model="numpy")
def _add_impact(
    table, end, knot, step, moments, theta0, b, w, gm, r_s, tangent, peak, hernquist, tolerance, row,
    nodes, kicks,
):  # fmt: skip
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
    start = np.array([nx * norm - x0[0], ny * norm - x0[1], nz * norm - x0[2]])
    fineness = max(math.sqrt(12.0 * tolerance / peak), FINEST)
    behind = _follow(
        table, theta0, -theta0, start, w, gm, r_s, hernquist, tangent, fineness, knot, row, nodes, kicks
    )
    for j in range(behind // 2):  # found outwards from the impact; wanted in order of angle
        k = behind - 1 - j
        nodes[j], nodes[k] = nodes[k], nodes[j]
        kicks[j], kicks[k] = kicks[k], kicks[j]
    # The impact itself, last behind, is first ahead.
    n = behind - 1 + _follow(
        table, theta0, end - theta0, start, w, gm, r_s, hernquist, tangent, fineness, knot, row,
        nodes[behind - 1 :], kicks[behind - 1 :],
    )  # fmt: skip
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
    for j in range(n):
        largest = np.float32(0.0)
        for i in range(PAD + j * stride, min(PAD + (j + 1) * stride, len(kicks) - 4)):
            largest = max(largest, abs(kicks[i - 1] - kicks[i] + (kicks[i + 1] - kicks[i])))
        local[j] = largest / (step * step)
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

    def before(self, time: float) -> KickTables:
        """The kicks of impacts at `time` before today (natural units) and earlier."""
        first = int(np.searchsorted(self.times, time - TIME_ROUNDING))
        values, bends = (
            at[first] if first < len(self.times) else len(array)
            for at, array in ((self.start, self.values), (self.bend_start, self.bends))
        )
        return KickTables(
            self.times[first:],
            self.start[first:] - values,
            self.size[first:],
            self.step[first:],
            self.values[values:],
            self.bend_start[first:] - bends,
            self.bend_size[first:],
            self.bend_step[first:],
            self.bends[bends:],
        )


def kick_tables(
    geometry: Geometry,
    impacts: Impacts,
    accuracy: Accuracy | None = None,
) -> KickTables:
    """Add up the kicks of all impacts at each impact time.

    Parameters
    ----------
    geometry : Geometry
    impacts : Impacts
        Times must be impact times of the stream.
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
    tolerance = accuracy.kick_tolerance * geometry.sigma_omega
    scale, tangent, peak = _shapes(geometry, impacts, index)
    step = _table_steps(scale, peak, index, hit, accuracy.kick_spacing, tolerance)
    cells = np.ceil(ends / step).astype(np.int64)
    size = cells + PAD + 4
    start = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
    values = np.empty(int(size.sum()), dtype=np.float32)
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
            tangent,
            peak,
            impacts.profile == "hernquist",
        ],
        axis=1,
    )[order]
    # One entry of curvature per distance between stars sampled at neighbouring frequencies.
    stride = np.maximum(1, np.rint(accuracy.frequency_step * geometry.sigma_omega * times / step)).astype(int)
    bend_size = cells // stride + 2
    bend_start = np.concatenate([[0], np.cumsum(bend_size)[:-1]])
    bends = np.zeros(int(bend_size.sum()))
    moments = np.empty((cells.max(initial=0), 4))  # one for all: a new one each time costs 2 ms a stream
    for t, k in enumerate(hit):
        table = values[start[t] : start[t] + size[t]]
        here = columns[first[t] : first[t] + count[t]]
        _fill(
            geometry.tables[k],
            ends[t],
            geometry.node_theta[k, 1],
            step[t],
            moments[: cells[t]],
            here,
            tolerance,
            table,
        )
        _bend(table, step[t], stride[t], bends[bend_start[t] : bend_start[t] + bend_size[t]])
    return KickTables(times, start, size, step, values, bend_start, bend_size, stride * step, bends)


def _shapes(geometry: Geometry, impacts: Impacts, index: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of each impact: the scale of its kick (rad), the stream's length per angle there, and the
    largest |δΩ∥| that it can cause near it (natural units)."""
    entry = np.minimum((impacts.theta / TABLE_STEP).astype(int), geometry.tables.shape[1] - 2)
    row = geometry.tables[index, entry]
    tangent = np.linalg.norm(geometry.tables[index, entry + 1, :3] - row[:, :3], axis=1) / TABLE_STEP
    w = np.stack([impacts.vx_kms, impacts.vy_kms, impacts.vz_kms], axis=1) / V0_KMS
    distance = np.hypot(impacts.b_kpc, impacts.r_s_kpc) / R0_KPC
    speed, response = np.linalg.norm(w - row[:, 3:6], axis=1), np.linalg.norm(row[:, 6:], axis=1)
    return (
        distance / tangent,
        tangent,
        2.0 * gravity() * impacts.mass_msun * response / (speed * distance),
    )


def _table_steps(
    scale: np.ndarray, peak: np.ndarray, index: np.ndarray, hit: np.ndarray, finest: float, tolerance: float
) -> np.ndarray:
    """Spacing of the table of each time in `hit`: interpolation in it errs by at most `tolerance`
    (a kick of scale s and height P is curved by P/s²), as far as `finest` allows.

    Narrower kicks than that are weak and are averaged, see `_finish`.
    """
    wanted = np.full(len(hit), np.inf)
    np.minimum.at(wanted, np.searchsorted(hit, index), scale * np.sqrt(8.0 * tolerance / peak))
    return np.clip(wanted, finest, max(finest, TABLE_STEP))


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(table, end, knot, step, moments, impacts, tolerance, out):
    row, nodes, kicks = np.empty(9), np.empty(2 * MAX_NODES), np.empty(2 * MAX_NODES)
    moments[:] = 0.0
    for i in range(len(impacts)):
        theta, b, w, gm, r_s = impacts[i, 0], impacts[i, 1], impacts[i, 2:5], impacts[i, 5], impacts[i, 6]
        tangent, peak, hernquist = impacts[i, 7], impacts[i, 8], impacts[i, 9] > 0.0
        _add_impact(
            table, end, knot, step, moments, theta, b, w, gm, r_s, tangent, peak, hernquist, tolerance, row,
            nodes, kicks,
        )  # fmt: skip
    _finish(moments, end, step, out)
