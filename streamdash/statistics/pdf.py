"""The probability density of Qρ along a stream, and its scatter from stream to stream.

This is the first of the paper's two observables (section 3.1.1, "Modeling the prior
distribution"): how often each value of Qρ = ρ/ρ̄ occurs along one stream, whatever its
place. Over many simulated streams every bin α of that histogram becomes a random
variable y_α, whose distribution Π(y_α|M) is the prior of the model selection in
`streamdash.statistics.evidence`.

Arrays are plain: profiles ``(n_streams, n_longitudes)``, densities
``(n_streams, n_bin)``. A model is one element of a sequence, lowest mass first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from streamdash.compiled import njit

QUANTILES = (0.16, 0.5, 0.84)
"""Lower edge, middle and upper edge of a band: 68 % of the streams around the median."""
CENTRAL = 0.998
"""Share of every model's values that the default range of Qρ holds."""
N_BIN_MIN, N_BIN_MAX = 2, 500
"""Fewest and most bins of Qρ (and of y) that are accepted."""


@dataclass(frozen=True)
class Band:
    """Quantiles over streams of every bin: ``low``, ``median`` and ``high``, each (n_bin,)."""

    low: np.ndarray
    median: np.ndarray
    high: np.ndarray


@dataclass(frozen=True)
class Pdfs:
    """PDF(Qρ) of every stream of every model, on common bins.

    Attributes
    ----------
    edges : ndarray (n_bin + 1,)
        Edges of the bins α in Qρ.
    y : tuple of ndarray (n_streams, n_bin)
        y_α of each stream, one array a model; every row integrates to 1, except that a
        stream with no value inside the edges is a row of zeros.
    """

    edges: np.ndarray
    y: tuple[np.ndarray, ...]

    @property
    def n_bin(self) -> int:
        """Number of bins α."""
        return len(self.edges) - 1

    @property
    def n_models(self) -> int:
        """Number of models M."""
        return len(self.y)

    @property
    def centers(self) -> np.ndarray:
        """Middle of every bin α in Qρ, (n_bin,)."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    @cached_property
    def sorted_y(self) -> tuple[np.ndarray, ...]:
        """y_α of each bin in rising order: (n_bin, n_streams) per model.

        Quantiles and every histogram of y_α are read off this one sort.
        """
        return tuple(np.sort(y.T, axis=1) for y in self.y)

    def band(self, model: int, quantiles: tuple[float, float, float] = QUANTILES) -> Band:
        """Median and quantile band of one model's PDF(Qρ) (paper figure 3)."""
        return Band(*quantiles_of_sorted(self.sorted_y[model], quantiles))

    def occupied(self, model: int) -> np.ndarray:
        """Number of streams with y_α > 0, per bin (n_bin,)."""
        return np.count_nonzero(self.y[model] > 0, axis=0)


def common_range(profiles: Sequence[np.ndarray]) -> tuple[float, float]:
    """Widest range of Qρ in which every model has samples (paper section 3.1.1).

    The largest of the models' minima and the smallest of their maxima. Where that is a
    single value (every profile constant and equal), it is widened by 0.5 on both sides,
    as `numpy.histogram` does.

    Raises
    ------
    ValueError
        If there is no model, a model has no finite value, or two models share no value.
    """
    if not len(profiles):
        raise ValueError("PDF(Qρ) needs the profiles of at least one model.")
    low, high = -np.inf, np.inf
    for number, q in enumerate(profiles):
        finite = _finite(q)
        if finite.size == 0:
            raise ValueError(f"Model M{number} has no finite Qρ value, so PDF(Qρ) has no range.")
        low, high = max(low, float(finite.min())), min(high, float(finite.max()))
    if low > high:
        raise ValueError(
            f"The models share no value of Qρ (one starts at {low:.4g}, another ends at {high:.4g}): "
            "they are told apart without a PDF."
        )
    return (low - 0.5, high + 0.5) if low == high else (low, high)


def central_range(profiles: Sequence[np.ndarray], share: float = CENTRAL) -> tuple[float, float]:
    """Range of Qρ that holds the central `share` of the values of every model.

    The largest of the models' lower ends and the smallest of their upper ends. Unlike `common_range`
    it does not hang on the two most extreme values, and so hardly on the draw of the noise. The ends
    are in falling order where the models' central ranges do not overlap.

    Raises
    ------
    ValueError
        If there is no model, or a model has no finite value.
    """
    if not len(profiles):
        raise ValueError("PDF(Qρ) needs the profiles of at least one model.")
    ends = []
    for number, q in enumerate(profiles):
        finite = _finite(q)
        if finite.size == 0:
            raise ValueError(f"Model M{number} has no finite Qρ value, so PDF(Qρ) has no range.")
        ends.append(np.quantile(finite, ((1 - share) / 2, (1 + share) / 2)))
    lows, highs = zip(*ends, strict=True)
    return float(max(lows)), float(min(highs))


def bin_edges(value_range: tuple[float, float], n_bin: int) -> np.ndarray:
    """Edges of ``n_bin`` equal bins over a range, (n_bin + 1,).

    Raises
    ------
    ValueError
        If ``n_bin`` is outside 2…500 or the range is empty.
    """
    if not N_BIN_MIN <= n_bin <= N_BIN_MAX:
        raise ValueError(f"n_bin must lie between {N_BIN_MIN} and {N_BIN_MAX} (got {n_bin}).")
    low, high = value_range
    if not low < high:
        raise ValueError(f"The range of Qρ must have its lower end first (got {low:g}, {high:g}).")
    return np.linspace(low, high, n_bin + 1)


def pdf_of_profiles(q: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """PDF(Qρ) of every stream: y_α = c_α / (w_α Σ_β c_β) (paper section 3.1.1).

    Parameters
    ----------
    q : ndarray (n_streams, n_longitudes)
        Qρ of each stream. Values that are not finite or lie outside the edges are not counted.
    edges : ndarray (n_bin + 1,)
        Equally spaced, rising.

    Returns
    -------
    ndarray (n_streams, n_bin)
        Densities; each row integrates to 1, or is all 0 for a stream with no value inside.

    Examples
    --------
    >>> pdf_of_profiles(np.array([[0.1, 0.1, 0.6, 0.9]]), np.array([0.0, 0.5, 1.0]))
    array([[1., 1.]])
    """
    q = np.asarray(q)
    if q.ndim != 2:
        raise ValueError(f"Profiles must be an array (n_streams, n_longitudes), not of {q.ndim} dimensions.")
    return _densities(q, float(edges[0]), float(edges[-1]), len(edges) - 1)


def measure_pdfs(
    profiles: Sequence[np.ndarray], n_bin: int, value_range: tuple[float, float] | None = None
) -> Pdfs:
    """PDF(Qρ) of every stream of every model, on common bins.

    Parameters
    ----------
    profiles : sequence of ndarray (n_streams, n_longitudes)
        Qρ with noise, one array a model, lowest mass first; the numbers of streams may differ.
    n_bin : int
        Number of bins in Qρ.
    value_range : (float, float), optional
        Range of Qρ; `common_range` when not given.
    """
    edges = bin_edges(common_range(profiles) if value_range is None else value_range, n_bin)
    return Pdfs(edges, tuple(pdf_of_profiles(q, edges) for q in profiles))


def quantiles_of_sorted(values: np.ndarray, quantiles: Sequence[float]) -> np.ndarray:
    """Linear-interpolation quantiles of arrays sorted along the last axis, (n_quantiles, …)."""
    position = np.asarray(quantiles) * (values.shape[-1] - 1)
    below = np.floor(position).astype(int)
    above = np.minimum(below + 1, values.shape[-1] - 1)
    fraction = position - below
    picked = values[..., below] * (1 - fraction) + values[..., above] * fraction
    return np.moveaxis(picked, -1, 0)


def y_range(samples: Sequence[np.ndarray]) -> tuple[float, float]:
    """Common range of y_α over all models: from the smallest to the largest value of any.

    A single value is widened by 0.5 on both sides.
    """
    low = min(float(np.min(y)) for y in samples)
    high = max(float(np.max(y)) for y in samples)
    return (low - 0.5, high + 0.5) if low == high else (low, high)


def y_distribution(samples: Sequence[np.ndarray], n_y: int) -> tuple[np.ndarray, np.ndarray]:
    """Π(y_α|M) of one bin α for every model, on bins common to all (paper figure 4).

    Parameters
    ----------
    samples : sequence of ndarray (n_streams,)
        y_α over the streams of each model.
    n_y : int
        Number of bins in y.

    Returns
    -------
    edges : ndarray (n_y + 1,)
    heights : ndarray (n_models, n_y)
        Densities that integrate to 1.
    """
    edges = bin_edges(y_range(samples), n_y)
    heights = [np.histogram(y, edges)[0] / (len(y) * (edges[1] - edges[0])) for y in samples]
    return edges, np.asarray(heights)


def _finite(q: np.ndarray) -> np.ndarray:
    """The finite values of an array; the array itself when all are."""
    q = np.asarray(q)
    # One sum finds any NaN or infinity far faster than a mask of every element does.
    return q if q.size and np.isfinite(q.sum(dtype=np.float64)) else q[np.isfinite(q)]


@njit(cache=True, nogil=True)
def _densities(q: np.ndarray, low: float, high: float, n_bin: int) -> np.ndarray:
    """Histogram of each row of q over [low, high], both ends included, as densities."""
    n_streams, n_longitudes = q.shape
    y = np.zeros((n_streams, n_bin))
    per_width = n_bin / (high - low)
    for s in range(n_streams):
        inside = 0
        for p in range(n_longitudes):
            value = q[s, p]
            if value >= low and value <= high:  # False for NaN
                y[s, min(int((value - low) * per_width), n_bin - 1)] += 1.0
                inside += 1
        if inside:
            factor = per_width / inside
            for a in range(n_bin):
                y[s, a] *= factor
    return y
