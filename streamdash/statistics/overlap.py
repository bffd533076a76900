"""∫ Π(y|M_i) Π(y|M_j) dy from samples: the integral behind every Bayes factor, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streamdash.compiled import njit

Y_BINS = tuple(range(10, 501, 10))
"""Numbers of bins in y that are marginalised over: 10, 20, …, 500 (paper: "10–500")."""


def overlap_integrals(
    sorted_y: Sequence[np.ndarray],
    y_bins: Sequence[int] = Y_BINS,
    self_pairs: bool = True,
    trapezoid: bool = True,
    from_zero: bool = False,
) -> np.ndarray:
    """E^{fid i}_j = ∫ Π(y_α|M_i) Π(y_α|M_j) dy_α for every pair of models (equation 5).

    Parameters
    ----------
    sorted_y : sequence of ndarray (n_bin, n_streams)
        y_α in rising order over the streams of each model; the numbers of streams may differ.
    y_bins : sequence of int
        Numbers of bins in y, at least 2 each; bins reach from the smallest to the largest value
        of y_α in any model.
    self_pairs, trapezoid, from_zero : bool
        See `streamdash.statistics.evidence.Rules`.

    Returns
    -------
    ndarray (len(y_bins), n_models, n_models, n_bin)
    """
    if any(y.shape[1] == 0 for y in sorted_y):
        raise ValueError("Every model needs at least one stream.")
    if not len(y_bins) or min(y_bins) < 2:
        raise ValueError("Every number of bins in y must be at least 2 for the trapezoidal rule.")
    offsets = np.cumsum([0] + [y.shape[1] for y in sorted_y])
    stacked = np.ascontiguousarray(np.concatenate(sorted_y, axis=1), dtype=np.float64)
    return _integrals(stacked, offsets, np.asarray(y_bins, dtype=np.int64), self_pairs, trapezoid, from_zero)


@njit(cache=True, nogil=True)
def _integrals(
    y: np.ndarray,
    offsets: np.ndarray,
    y_bins: np.ndarray,
    self_pairs: bool,
    trapezoid: bool,
    from_zero: bool,
) -> np.ndarray:
    """Kernel of `overlap_integrals`: y (n_bin, all streams), sorted within each model's columns."""
    n_bin, n_all = y.shape
    n_models = len(offsets) - 1
    n_y_max = y_bins.max()
    result = np.zeros((len(y_bins), n_models, n_models, n_bin))
    # y takes few distinct values (counts over 347 longitudes): merging equal ones first makes
    # each of the many histograms several times cheaper.
    values = np.empty(n_all)
    weights = np.empty(n_all)
    ends = np.zeros(n_models + 1, dtype=np.int64)
    heights = np.empty((n_models, n_y_max))
    for a in range(n_bin):
        low, high = 0.0 if from_zero else np.inf, -np.inf
        n_distinct = 0
        for m in range(n_models):
            first, last = offsets[m], offsets[m + 1]
            low, high = min(low, y[a, first]), max(high, y[a, last - 1])
            for s in range(first, last):
                if s > first and y[a, s] == values[n_distinct - 1]:
                    weights[n_distinct - 1] += 1.0
                else:
                    values[n_distinct] = y[a, s]
                    weights[n_distinct] = 1.0
                    n_distinct += 1
            ends[m + 1] = n_distinct
        if low == high:
            low, high = low - 0.5, high + 0.5
        for k in range(len(y_bins)):
            n_y = y_bins[k]
            per_width = n_y / (high - low)
            for m in range(n_models):
                row = heights[m]
                row[:n_y] = 0.0
                for u in range(ends[m], ends[m + 1]):
                    row[min(int((values[u] - low) * per_width), n_y - 1)] += weights[u]
            for i in range(n_models):
                n_i = offsets[i + 1] - offsets[i]
                for j in range(i, n_models):
                    n_j = offsets[j + 1] - offsets[j]
                    total = overlap_sum(heights[i], heights[j], n_y, trapezoid)
                    pairs = n_i * n_j
                    if i == j and not self_pairs:
                        total -= _total(heights[i], n_y, trapezoid)
                        pairs = max(n_i * (n_i - 1), 1)
                    result[k, i, j, a] = result[k, j, i, a] = total * per_width / pairs
    return result


@njit(cache=True, nogil=True, fastmath=True)
def overlap_sum(first: np.ndarray, second: np.ndarray, n: int, trapezoid: bool) -> float:
    """Σ first · second over n bins, with the end bins halved for the trapezoidal rule (numba)."""
    total = 0.0
    for k in range(n):
        total += first[k] * second[k]
    if trapezoid:
        total -= 0.5 * (first[0] * second[0] + first[n - 1] * second[n - 1])
    return total


@njit(cache=True, nogil=True)
def _total(heights: np.ndarray, n: int, trapezoid: bool) -> float:
    """Σ heights, with the end bins halved for the trapezoidal rule."""
    total = 0.0
    for k in range(n):
        total += heights[k]
    if trapezoid:
        total -= 0.5 * (heights[0] + heights[n - 1])
    return total
