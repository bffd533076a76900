"""The compiled march behind `streamdash.engine.density`: phase space traced back in time.

One line of today's phase space, θ fixed and Ω sampled, is carried back through every
impact. A first pass samples coarsely and notes, per cell between two samples, how badly
kicks would be interpolated across it; a second pass halves the cells that need it, as
often as they need. What limits the speed is the two table look-ups of a kick per sample
and impact time (two fifths of the time), then moving samples and the bookkeeping of edges.
"""

from __future__ import annotations

import math

import numpy as np

from streamdash.compiled import njit
from streamdash.engine.kicks import PAD

REACH = 4.7
"""The Gaussian is followed out to this many dispersions (beyond: 3·10⁻⁶ of the stars)."""
CHORD = 7.0
"""A chord lies at most width²/8 of the second derivative beside its curve; some more is
assumed, as the curvature is that of a stretch and not of the point."""
HALVING = 1 / 5
"""Halving a cell gains a factor 4 where kicks are not resolved yet, then ever more, up to
16. With 1/4 the worst point of many streams is the same for a fifth more time; with 1/6
it exceeds 2·10⁻³."""
LEVELS = 7
"""A cell of frequencies is halved at most this often."""
EMPTY = 1e-12
"""Density below which no star is left, and so no mean frequency."""
ROOM = 4096
"""Samples beyond the coarse ones that one angle may take, at least."""
STRETCH = 0.5
"""Neighbouring samples may differ by this many dispersions in original frequency."""
CALM = 1.5
"""Kicks that can carry a star at most this many dispersions need no scouts."""


@njit(cache=True, error_model="numpy")
def _cubic(a, b, c, d, x):
    """Cubic through (-1, a), (0, b), (1, c), (2, d) at x."""
    c1 = -a / 3 - b / 2 + c - d / 6
    c2 = (a + c) / 2 - b
    c3 = (d - a) / 6 + (b - c) / 2
    return b + x * (c1 + x * (c2 + x * c3))


@njit(cache=True, error_model="numpy")
def _cubic_integral(a, b, c, d, x0, x1):
    """Integral of the same cubic from x0 to x1."""
    c1 = -a / 3 - b / 2 + c - d / 6
    c2 = (a + c) / 2 - b
    c3 = (d - a) / 6 + (b - c) / 2
    upper = x1 * (b + x1 * (c1 / 2 + x1 * (c2 / 3 + x1 * c3 / 4)))
    return upper - x0 * (b + x0 * (c1 / 2 + x0 * (c2 / 3 + x0 * c3 / 4)))


@njit(cache=True, error_model="numpy")
def _crossing(y, i, n):
    """Where between samples i and i+1 y changes sign, in [0, 1]."""
    x = y[i] / (y[i] - y[i + 1])
    if i == 0 or i > n - 3:
        return x
    for _ in range(2):  # secant steps on the cubic, from the line's answer
        value = _cubic(y[i - 1], y[i], y[i + 1], y[i + 2], x)
        moved = x + value / (y[i] - y[i + 1])
        if not 0.0 <= moved <= 1.0:
            break
        x = moved
    return x


@njit(cache=True, error_model="numpy")
def _stars(before, a, b, after, start, end, x0, x1):
    """∫p and ∫Ωp, in widths of the cell, from x0 to x1 of the cell between p = a and b.

    Today's frequency is linear along the samples, from `start` at a to `end` at b.
    """
    step = end - start
    first, last = before * (start - step), after * (start + 2 * step)
    if x0 == 0.0 and x1 == 1.0:
        return (13.0 * (a + b) - before - after) / 24.0, (13.0 * (a * start + b * end) - first - last) / 24.0
    return _cubic_integral(before, a, b, after, x0, x1), _cubic_integral(
        first, a * start, b * end, last, x0, x1
    )


@njit(cache=True, error_model="numpy")
def _judge(i, n, omega, mean, sigma, cells):
    """Add to cell i the squared error of interpolating original frequencies across it, and note
    the largest p that it may hold, between its samples included."""
    a, b = omega[i], omega[i + 1]
    before, after = omega[max(i - 1, 0)], omega[min(i + 2, n - 1)]
    spread = max(abs(b - a), abs(a - before), abs(after - b))
    bent = (abs(before - a - b + after) + 2.0 * max(0.0, abs(b - a) - STRETCH * sigma)) / sigma
    cells[i, 2] += bent * bent
    nearest = 0.0
    if (a - mean) * (b - mean) > 0.0:
        nearest = max(0.0, min(abs(a - mean), abs(b - mean)) - spread) / sigma
    cells[i, 3] = max(cells[i, 3], math.exp(-0.5 * nearest * nearest))


@njit(cache=True, error_model="numpy")
def _march(theta, n, now, scratch, dt, tables, bends, mean, sigma):
    """Trace n samples that are today at (theta, now[i]) back to the start of disruption.

    The caller sets the cells to integrate: low = 0, high = 1, and 0, 0 for those that only
    join separate stretches of samples or lie beyond their ends.

    Between neighbouring samples lies a cell, of which the part [low, high] is still in
    the stream. At each step that part shrinks by what has reached θ ≤ 0, and those stars
    are added to the cell with the frequency they were stripped with, not yet kicked at
    this step: the kick is a jump in p at the edge, which no rule that ignores the edge
    integrates to better than first order. Samples beyond the edge keep moving, under
    kicks extended smoothly below θ = 0, so that p can be interpolated up to it.

    Per cell, `cells` gets: ∫p, ∫Ωp, the squared errors (in dispersions) of interpolating
    each time's kicks across it, which are independent of one another, and the largest p.
    """
    angle, omega, low, high, f, marks, place, rest, cells = scratch
    start, size, inverse, values = tables
    bend_start, bend_size, bend_inverse, bend = bends
    alive = 0
    for i in range(n):
        angle[i] = theta
        omega[i] = now[i]
        marks[i] = -1
        cells[i, :] = 0.0
        if high[i] > low[i]:
            alive = i + 1
    active = min(n, alive + 3)
    judge = len(bend) > 0
    for k in range(len(dt)):
        step = dt[k]
        left = 0
        for i in range(active):
            a = angle[i] - omega[i] * step
            angle[i] = a
            left += a <= 0.0
        # Stars at or behind the progenitor are at the fast end, so few cells are looked at.
        i = min(alive, n - 1) - 1
        seen = 0
        for j in range(i + 2, active):
            seen += angle[j] <= 0.0
        alive = 0
        while i >= 0:
            a, b = angle[i], angle[i + 1]
            seen += b <= 0.0
            if high[i] > low[i]:
                if a <= 0.0 or b <= 0.0:
                    x0, x1 = low[i], high[i]
                    if a <= 0.0 and b <= 0.0:
                        high[i] = x0
                    elif b <= 0.0:
                        x = _crossing(angle, i, n)
                        x0, high[i] = max(x, x0), min(x1, x)
                    else:
                        x = _crossing(angle, i, n)
                        x1, low[i] = min(x, x1), max(x0, x)
                    if x1 > x0:
                        # The stars that reach the progenitor now. Here and not in a function of its
                        # own: handing over the arrays took a quarter of the time.
                        for j in range(max(i - 1, 0), min(i + 3, n)):
                            if marks[j] != k:
                                marks[j] = k
                                z = (omega[j] - mean) / sigma
                                f[j] = math.exp(-0.5 * z * z)
                        before = f[i - 1] if i > 0 else 0.0
                        after = f[i + 2] if i < n - 2 else 0.0
                        stars, weighted = _stars(before, f[i], f[i + 1], after, now[i], now[i + 1], x0, x1)
                        cells[i, 0] += stars
                        cells[i, 1] += weighted
                        if judge:
                            _judge(i, n, omega, mean, sigma, cells)
                if high[i] > low[i]:
                    alive = max(alive, i + 1)
                    if seen == left:
                        break
            i -= 1
        if judge and k == len(dt) - 1:
            # Never in the stream, unless the path dips below zero between two samples.
            for i in range(1, alive):
                dip = abs(angle[i - 1] - angle[i] - angle[i + 1] + angle[min(i + 2, n - 1)])
                if high[i] > low[i] and min(angle[i], angle[i + 1]) < dip:
                    cells[i, 2] += 1.0
                    _judge(i, n, omega, mean, sigma, cells)
        if alive == 0 or k == len(dt) - 1:
            return
        if judge:
            local = bend[bend_start[k] : bend_start[k] + bend_size[k]]
            scale, end = bend_inverse[k], float(bend_size[k] - 1)
            for i in range(alive):
                place[i] = np.int32(min(max(angle[i] * scale, 0.0), end))
            for i in range(alive):
                width = angle[i] - angle[i + 1]
                bent = width * width * local[np.uint32(place[i])] / (CHORD * sigma)
                cells[i, 2] += bent * bent
        active = min(n, alive + 3)
        table = values[start[k] : start[k] + size[k]]
        scale, end = inverse[k], float(size[k] - 2)
        # Two loops: the first vectorises, the second is bound by its two look-ups; in one
        # loop neither would, and the step would take twice as long.
        for i in range(active):
            position = min(max(angle[i] * scale + (PAD - 0.5), 0.0), end)
            entry = np.int32(position)
            place[i] = entry
            rest[i] = position - entry
        for i in range(active):
            at = np.uint32(place[i])
            kick = table[at]
            omega[i] -= kick + rest[i] * (table[at + np.uint32(1)] - kick)


@njit(cache=True, error_model="numpy")
def _scout(theta, omega, angle, n, dt, tables):
    """Original frequencies of n points today at (theta, omega[i]), in place; `angle` is scratch."""
    start, size, inverse, values = tables
    angle[:n] = theta
    # Times outside, points inside: one point alone would wait for each of its look-ups.
    for k in range(len(dt) - 1):
        while n > 0 and angle[n - 1] <= 0.0:
            n -= 1
        table = values[start[k] : start[k] + size[k]]
        step, scale, end = dt[k], inverse[k], float(size[k] - 2)
        for i in range(n):
            if angle[i] > 0.0:
                angle[i] -= omega[i] * step
                if angle[i] > 0.0:
                    position = min(angle[i] * scale + (PAD - 0.5), end)
                    at = np.uint32(position)
                    kick = table[at]
                    omega[i] -= kick + (position - at) * (table[at + np.uint32(1)] - kick)


@njit(cache=True, error_model="numpy")
def _mark(then, n, mean, sigma, keep):
    """Which cells between scouts can hold stars: keep[i] for [i, i+1]."""
    for i in range(n - 1):
        a, b = (then[i] - mean) / sigma, (then[i + 1] - mean) / sigma
        spread = abs(b - a)
        if i > 0:
            spread = max(spread, abs(a - (then[i - 1] - mean) / sigma))
        if i < n - 2:
            spread = max(spread, abs((then[i + 2] - mean) / sigma - b))
        keep[i] = min(abs(a), abs(b)) < REACH + spread or (a < 0.0) != (b < 0.0)
    keep[n - 1] = False


@njit(cache=True, error_model="numpy")
def _level(error, weight, tolerance):
    """How often a cell must be halved to bring the square root of `error` to `tolerance`."""
    level = 0
    excess = math.sqrt(error) * weight / tolerance
    while excess > 1.0 and level < LEVELS:
        excess *= HALVING if level else 0.25
        level += 1
    return level


@njit(cache=True, error_model="numpy")
def _coarse_samples(keep, n_scout, per_cell, left, h, now, low, high):
    """Samples every h wherever scouts found stars; returns how many."""
    n = 0
    for cell in range(n_scout - 1):
        if not keep[cell]:
            continue
        if cell == 0 or not keep[cell - 1]:
            now[n] = left + cell * per_cell * h
            n += 1
        for i in range(1, per_cell + 1):
            now[n] = left + (cell * per_cell + i) * h
            low[n - 1], high[n - 1] = 0.0, 1.0
            n += 1
        low[n - 1], high[n - 1] = 0.0, 0.0
    return n


@njit(cache=True, error_model="numpy")
def _fine_samples(coarse, n, h, tolerance, cells, limit, now, low, high):
    """Samples within cells that need them, two more beyond either end; how many.

    Neighbouring cells that need it equally often are halved together. When the scratch
    arrays are full the remaining cells are halved less often.
    """
    count = 0
    i = 0
    while i < n - 1:
        level = _level(cells[i, 2], cells[i, 3], tolerance)
        if level == 0 or coarse[i + 1] - coarse[i] > 1.5 * h:
            i += 1
            continue
        j = i + 1
        while j < n - 1 and _level(cells[j, 2], cells[j, 3], tolerance) == level:
            j += 1
        to_come = 7 * (n - 1 - j)  # what the cells beyond need at the least
        while level > 1 and count + (j - i) * 2**level + 5 + to_come > limit:
            level -= 1
        fine = h / 2**level
        size = (j - i) * 2**level + 5
        for m in range(size):
            now[count + m] = coarse[i] + (m - 2) * fine
            core = 2 <= m < size - 3
            low[count + m], high[count + m] = 0.0, 1.0 if core else 0.0
        count += size
        i = j
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def integrate_lines(theta, mean, sigma, step, tolerance, largest, dt, tables, bends, density, omega):
    """Fill `density` and `omega` at the angles `theta`; see `streamdash.engine.density.trace_back`.

    Parameters
    ----------
    theta : (n,) array, rad
    mean, sigma : float
        Of the frequencies that stars are stripped with.
    step, tolerance : float
        Coarsest spacing of frequencies, and error at which it is halved, in sigma.
    largest : float
        The farthest that kicks can carry a star in frequency.
    dt : (n_times + 1,) array
        From today to each impact time, and on to the start of disruption.
    tables, bends : tuples of four arrays
        Start, size, inverse spacing, values of the kicks and of their curvature.
    density, omega : (n,) arrays, overwritten
    """
    h = step * sigma
    half = REACH * sigma + largest
    left = mean - half
    per_cell = max(1, int(round(1.0 / step)))
    n_scout = int(math.ceil(2 * half / (h * per_cell))) + 1
    room = n_scout * (per_cell + 1) + 1
    room_fine = ROOM + 8 * room
    coarse, then, now = np.empty(room), np.empty(room_fine), np.empty(room_fine)
    angle, f, rest = np.empty(room_fine), np.empty(room_fine), np.empty(room_fine)
    low, high, cells = np.empty(room_fine), np.empty(room_fine), np.empty((room_fine, 4))
    marks, place = np.empty(room_fine, dtype=np.int64), np.empty(room_fine, dtype=np.int32)
    scratch = (angle, then, low, high, f, marks, place, rest, cells)
    keep = np.ones(n_scout, dtype=np.bool_)
    none = (bends[0], bends[1], bends[2], np.empty(0))
    for line in range(len(theta)):
        if largest > CALM * sigma:
            for i in range(n_scout):
                then[i] = left + i * per_cell * h
            _scout(theta[line], then, angle, n_scout, dt, tables)
            _mark(then, n_scout, mean, sigma, keep)
        n = _coarse_samples(keep, n_scout, per_cell, left, h, coarse, low, high)
        _march(theta[line], n, coarse, scratch, dt, tables, bends, mean, sigma)
        total, weighted = 0.0, 0.0
        for i in range(n - 1):
            if _level(cells[i, 2], cells[i, 3], tolerance) == 0:
                total += h * cells[i, 0]
                weighted += h * cells[i, 1]
        n = _fine_samples(coarse, n, h, tolerance, cells, room_fine, now, low, high)
        if n > 0:
            _march(theta[line], n, now, scratch, dt, tables, none, mean, sigma)
            for i in range(n - 1):
                fine = now[i + 1] - now[i]
                total += fine * cells[i, 0]
                weighted += fine * cells[i, 1]
        density[line] = total / (sigma * math.sqrt(2 * math.pi))
        if total <= EMPTY * sigma:  # rounding of the cubic may leave it a hair below zero
            density[line], omega[line] = 0.0, np.nan
        else:
            omega[line] = weighted / total
