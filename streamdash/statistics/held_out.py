"""How well does PDF(Qρ) tell two models apart? The likelihood ratio of streams that were held out.

The paper's E^{fid i}_j = ∫ Π(y|M_i) Π(y|M_j) dy (equation 5) is a figure of merit, not the probability
of any data: it falls when the fiducial's own Π is broad, even where every single stream can be told
apart. What an observer gets from one stream is ln p(y|M_i) − ln p(y|M_j) of that stream. Here it is
measured for streams that had no part in the densities: the streams of each model are divided in two,
each half is judged by densities learnt from the other.

A stream's y (PDF of its Qρ in `n_bin` bins) is taken to components that are uncorrelated in both
models (`streamdash.statistics.joint.decorrelate`), whose densities are smoothed histograms; they are
multiplied. Dependence beyond linear correlation is ignored, so that the size of the ratio tends to be
too large where it is large; its sign, the share of streams put right, does not suffer from that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, stats

from streamdash.statistics.joint import decorrelate
from streamdash.statistics.pdf import QUANTILES, bin_edges, central_range, pdf_of_profiles

FOLDS = 2
GRID = 1024
"""Points on which the density of a component is tabulated."""


@dataclass(frozen=True)
class HeldOut:
    """Held-out streams of one model (the truth), judged against one other.

    Attributes
    ----------
    ln_ratio : ndarray (n_streams,)
        ln p(y|truth) − ln p(y|other) of each stream.
    """

    ln_ratio: np.ndarray

    @property
    def n_right(self) -> int:
        """Streams that the truth explains better."""
        return int(np.count_nonzero(self.ln_ratio > 0))

    @property
    def right(self) -> float:
        """Share of streams that the truth explains better."""
        return self.n_right / len(self.ln_ratio)

    @property
    def right_interval(self) -> tuple[float, float]:
        """68 % interval of that share (Wilson)."""
        found = stats.binomtest(self.n_right, len(self.ln_ratio)).proportion_ci(0.6827, method="wilson")
        return float(found.low), float(found.high)

    @property
    def quantiles(self) -> tuple[float, float, float]:
        """16 %, 50 % and 84 % of the ln ratio over streams."""
        low, middle, high = np.quantile(self.ln_ratio, QUANTILES)
        return float(low), float(middle), float(high)


def held_out(q_i: np.ndarray, q_j: np.ndarray, n_bin: int) -> tuple[HeldOut, HeldOut]:
    """Likelihood ratios of all streams of two models, each judged by streams of the other half.

    Parameters
    ----------
    q_i, q_j : ndarray (n_streams, n_longitudes)
        Qρ with noise of the streams of each model, at least 4 streams each.
    n_bin : int
        Number of bins in Qρ, over the central range of both models; what lies beyond counts in the
        first and last bin.

    Returns
    -------
    (HeldOut, HeldOut)
        With the first model and with the second as the truth.

    Raises
    ------
    ValueError
        When a model has too few streams.
    """
    profiles = (np.asarray(q_i), np.asarray(q_j))
    if min(map(len, profiles)) < 2 * FOLDS:
        raise ValueError(f"Held-out streams need at least {2 * FOLDS} streams of each model.")
    ratios = [np.empty(len(q)) for q in profiles]
    for fold in range(FOLDS):
        mine = [np.arange(len(q)) % FOLDS == fold for q in profiles]
        learnt = [q[~m] for q, m in zip(profiles, mine, strict=True)]
        low, high = sorted(central_range(learnt))
        edges = bin_edges((low, high) if low < high else (low - 0.5, high + 0.5), n_bin)
        y = [_counted(q, edges) for q in learnt]
        transform = decorrelate(*y)
        z = [transform(part) for part in y]
        for truth, sign in ((0, 1.0), (1, -1.0)):
            judged = transform(_counted(profiles[truth][mine[truth]], edges))
            ratio = _ln_density(z[0], judged) - _ln_density(z[1], judged)
            ratios[truth][mine[truth]] = sign * ratio
    return HeldOut(ratios[0]), HeldOut(ratios[1])


def _counted(q: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """PDF(Qρ) in which values beyond the edges count in the first and last bin."""
    return pdf_of_profiles(np.clip(q, edges[0], edges[-1]), edges)


def _ln_density(learnt: np.ndarray, judged: np.ndarray) -> np.ndarray:
    """Sum over components of the ln of a smoothed histogram of `learnt` at `judged`, (n_judged,)."""
    return sum(
        (_ln_density_of_one(a, b) for a, b in zip(learnt.T, judged.T, strict=True)), np.zeros(len(judged))
    )


def _ln_density_of_one(learnt: np.ndarray, judged: np.ndarray) -> np.ndarray:
    n, spread = len(learnt), float(np.std(learnt))
    low, high = (min(learnt.min(), judged.min()), max(learnt.max(), judged.max()))
    if not low < high:
        return np.zeros(len(judged))
    middle = float(np.median(learnt))
    spread = spread or 1e-3 * (high - low)
    # Silverman's rule, which long tails would widen if it used the standard deviation alone.
    quartiles = float(np.subtract(*np.quantile(learnt, (0.75, 0.25)))) / 1.349
    width = 0.9 * (min(spread, quartiles) or spread) * n**-0.2
    low, high = low - 4 * width, high + 4 * width
    step = (high - low) / GRID
    heights, edges = np.histogram(learnt, GRID, (low, high))
    smooth = ndimage.gaussian_filter1d(heights / (n * step), width / step, mode="constant")
    grid = 0.5 * (edges[1:] + edges[:-1])
    # One stream's worth of a distribution with long tails: a value that no learnt stream came near
    # must not decide by itself.
    off = (grid - middle) / spread
    floor = 1 / np.pi / (1 + off * off) / spread / n  # Cauchy's; scipy.stats checks more than it computes
    return np.interp(judged, grid, np.log((1 - 1 / n) * smooth + floor))


def pairs(profiles: Sequence[np.ndarray], n_bin: int) -> dict[tuple[int, int], HeldOut]:
    """`held_out` of every ordered pair (truth, other) of models."""
    result = {}
    for i in range(len(profiles)):
        for j in range(i + 1, len(profiles)):
            result[i, j], result[j, i] = held_out(profiles[i], profiles[j], n_bin)
    return result
