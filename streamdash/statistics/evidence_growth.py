"""How far can ln B be trusted? Its scatter over streams, and its growth with their number.

Neither is in the paper. The method error (`Evidence.cumulative`) says only how much the number
of bins in y matters; with a finite number of simulated streams ln B also has a sampling error
(`bootstrap`) and may not have converged (`growth`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.compiled import njit
from streamdash.statistics.evidence import Evidence
from streamdash.statistics.overlap import Y_BINS, overlap_integrals, overlap_sum
from streamdash.statistics.pdf import Pdfs

CHECK_Y_BINS = (20, 50, 100, 200, 400)
"""Numbers of bins in y of the resamplings, which cost many evaluations."""
N_RESAMPLES = 100
"""Resamplings of the streams: they give a standard error to within about 7 %."""
MAX_BLOCKS = 8
"""Most disjoint sets of streams per size in `growth`."""


@dataclass(frozen=True)
class Growth:
    """Σ ln B^{fid i}_ij from ever more simulated streams.

    Attributes
    ----------
    n_streams : ndarray of int (n_sizes,)
        Streams per model.
    mean, scatter : ndarray (n_sizes,)
        Mean over disjoint sets of that many streams, and the standard deviation from set to
        set (NaN for a single set).
    n_kept : ndarray (n_sizes,)
        Mean number of bins α in the sum; with few streams some have no overlap left.
    """

    n_streams: np.ndarray
    mean: np.ndarray
    scatter: np.ndarray
    n_kept: np.ndarray


def bootstrap(
    pdfs: Pdfs,
    evidence: Evidence,
    n_resamples: int = N_RESAMPLES,
    seed: int = 0,
    y_bins: Sequence[int] = CHECK_Y_BINS,
) -> np.ndarray:
    """Standard error of Σ ln B^{fid i}_ij over streams, for every ordered pair.

    The streams of each model are drawn again with replacement, as many as there are; the bins
    of Qρ, the ranges of y and the bins α that are kept stay as they are.

    Parameters
    ----------
    pdfs : Pdfs
    evidence : Evidence
        Of the same PDFs; says which bins are kept.
    n_resamples : int
        Number of resamplings, at least 2.
    seed : int
        Seed of the resampling.
    y_bins : sequence of int
        Numbers of bins in y whose median is the value of each resampling.

    Returns
    -------
    ndarray (n_models, n_models)
        Standard deviation over the resamplings; 0 on the diagonal, NaN where no bin is kept.
    """
    if n_resamples < 2:
        raise ValueError(f"n_resamples must be at least 2 (got {n_resamples}).")
    rng = np.random.default_rng(seed)
    weights = [
        rng.multinomial(len(y), np.full(len(y), 1 / len(y)), size=n_resamples).astype(np.float64)
        for y in pdfs.y
    ]
    offsets = np.cumsum([0] + [len(y) for y in pdfs.y])
    n = pdfs.n_models
    used = np.zeros(pdfs.n_bin, dtype=bool)
    for i in range(n):
        for j in range(n):
            used |= (i != j) & evidence.kept(i, i, j)
    stacked = np.concatenate([y[:, used].T for y in pdfs.y], axis=1)
    integrals = _resampled_integrals(
        np.ascontiguousarray(stacked), np.hstack(weights), offsets, np.asarray(y_bins, dtype=np.int64)
    )
    errors = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            if i == j:
                continue
            kept = evidence.kept(i, i, j)[used]
            sums = np.median(_log_ratio(integrals[:, :, i, i], integrals[:, :, i, j])[..., kept], axis=1)
            errors[i, j] = np.nanstd(np.nansum(sums, axis=1), ddof=1) if kept.any() else np.nan
    return errors


def growth(
    pdfs: Pdfs,
    evidence: Evidence,
    i: int,
    j: int,
    sizes: Sequence[int] | None = None,
    y_bins: Sequence[int] = Y_BINS,
) -> Growth:
    """Σ ln B^{fid i}_ij from ever more streams: has it converged?

    The streams are cut into disjoint sets of each size (at most 8 of them); bins and exclusions
    stay those of the full ensembles.

    Parameters
    ----------
    pdfs : Pdfs
    evidence : Evidence
        Of the same PDFs; says which bins are kept.
    i, j : int
        Fiducial and numerator, and denominator.
    sizes : sequence of int, optional
        Streams per model; by default 50, 100, 200, … and all of them.
    """
    most = min(len(pdfs.y[i]), len(pdfs.y[j]))
    if sizes is None:
        sizes = [*(50 * 2**k for k in range(20) if 50 * 2**k < most), most]
    kept = evidence.kept(i, i, j)
    rows = [_growth_point((pdfs.y[i][:, kept], pdfs.y[j][:, kept]), n, most, y_bins) for n in sizes]
    return Growth(np.asarray(sizes), *np.array(rows, dtype=float).reshape(len(sizes), 3).T)


def _growth_point(
    y: tuple[np.ndarray, np.ndarray], n_streams: int, most: int, y_bins: Sequence[int]
) -> tuple[float, float, float]:
    """Mean and scatter of the sum over disjoint sets of streams, and the mean number of bins used."""
    sums, counts = [], []
    for block in range(min(most // n_streams, MAX_BLOCKS)):
        rows = slice(block * n_streams, (block + 1) * n_streams)
        integrals = overlap_integrals([np.sort(part[rows].T, axis=1) for part in y], y_bins)
        ratio = np.median(_log_ratio(integrals[:, 0, 0], integrals[:, 0, 1]), axis=0)
        sums.append(np.nansum(ratio))
        counts.append(np.isfinite(ratio).sum())
    scatter = np.std(sums, ddof=1) if len(sums) > 1 else np.nan
    return float(np.mean(sums)), float(scatter), float(np.mean(counts))


def _log_ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """ln(numerator / denominator), NaN where either is 0."""
    both = (numerator > 0) & (denominator > 0)
    return np.log(np.where(both, numerator, np.nan)) - np.log(np.where(both, denominator, np.nan))


@njit(cache=True, nogil=True)
def _resampled_integrals(
    y: np.ndarray, weights: np.ndarray, offsets: np.ndarray, y_bins: np.ndarray
) -> np.ndarray:
    """∫ Π_i Π_j dy for each resampling: (n_resamples, n_y_bins, n_models, n_models, n_bin).

    y is (n_bin, all streams), weights (n_resamples, all streams): how often each stream was drawn.
    """
    n_bin, n_all = y.shape
    n_models = len(offsets) - 1
    n_resamples = len(weights)
    result = np.zeros((n_resamples, len(y_bins), n_models, n_models, n_bin))
    place = np.empty(n_all, dtype=np.int64)
    heights = np.empty((n_models, y_bins.max()))
    for a in range(n_bin):
        low, high = y[a].min(), y[a].max()
        if low == high:
            low, high = low - 0.5, high + 0.5
        for k in range(len(y_bins)):
            n_y = y_bins[k]
            per_width = n_y / (high - low)
            for s in range(n_all):
                place[s] = min(int((y[a, s] - low) * per_width), n_y - 1)
            for r in range(n_resamples):
                for m in range(n_models):
                    row = heights[m]
                    row[:n_y] = 0.0
                    for s in range(offsets[m], offsets[m + 1]):
                        row[place[s]] += weights[r, s]
                for i in range(n_models):
                    for j in range(i, n_models):
                        total = overlap_sum(heights[i], heights[j], n_y, True)
                        pairs = (offsets[i + 1] - offsets[i]) * (offsets[j + 1] - offsets[j])
                        result[r, k, i, j, a] = result[r, k, j, i, a] = total * per_width / pairs
    return result
