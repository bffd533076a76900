"""What the classifier looks at: principal components and summaries of an observed Qρ.

The paper (§2.5 "Gradient Boosting classifier") standardises each longitude bin and keeps
the first principal components. They describe *where* along the stream the density
changes. The summaries describe *how*: the spread of Qρ and its quantiles at several
smoothing scales, the power in each band of scales and in blocks along the stream, the
power spectrum, the histogram of Qρ, and the smoothed profile itself. Most do not depend on
where a gap happens to lie, so a few thousand streams suffice to learn them.

Everything is computed along the last axis and counted in bins, so any evenly ordered
coordinate (l, φ1, θ∥) will do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_serializer
from scipy.ndimage import uniform_filter1d
from sklearn.decomposition import PCA
from sklearn.preprocessing import StandardScaler

from streamdash.config import Config

Summary = Literal["moments", "quantiles", "bands", "spectrum", "histogram", "profile", "power"]
ALL_SUMMARIES: tuple[Summary, ...] = ("moments", "quantiles", "bands", "spectrum", "histogram", "profile")
"""What a classifier is given unless asked otherwise. ``power``, the power spectrum as the field measures
it, would add nothing to them; it is for classifiers that see nothing else."""

QUANTILES = np.array([0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99])
HISTOGRAM_EDGES = np.array([0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.6, 1.8, 2.0, 2.5])
N_BLOCKS = 6
"""Stretches of the stream in which the power of each band is measured."""
PLACE_BINS = 15
"""Profiles smoothed over fewer bins are not features themselves."""
N_WAVENUMBERS = 15
"""Logarithmic bins of the power spectrum."""
FINEST_WAVE = 5
"""Shortest wavelength of ``power`` in bins: 1° for bins of 0.2°."""
POWER_FLOOR = 1e-6
"""Added before the logarithm of a power, so that a constant profile has one."""

Scales = dict[int, np.ndarray]
"""Profiles (n_streams, n_bins) by the width in bins over which they are smoothed; 1 for as observed."""


class FeatureSet(Config):
    """Which features a classifier is given."""

    n_pca: int = Field(30, ge=0, le=1000, description="principal components kept; 0 for none")
    summaries: tuple[Summary, ...] = Field(ALL_SUMMARIES, description="groups of summary features")
    scales: tuple[int, ...] = Field(
        (3, 7, 15, 31, 63, 127), max_length=12, description="smoothing widths in bins, increasing and odd"
    )

    arms: tuple[int, ...] = Field(
        (), max_length=2, description="bins of each arm, where profiles of both stand side by side"
    )

    @model_serializer(mode="wrap")
    def _without_newer_fields(self, handler: Any) -> dict[str, Any]:
        """Keys of models that are older than a field hold: it is written only where it is given."""
        data = handler(self)
        if not self.arms:
            data.pop("arms", None)
        return data

    @field_validator("scales")
    @classmethod
    def _check_scales(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        increasing = all(a < b for a, b in zip(value, value[1:], strict=False))
        if not increasing or any(w < 3 or w % 2 == 0 for w in value):
            raise ValueError("scales must be odd, at least 3 and increasing, for example (3, 7, 15)")
        return value


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """From observed profiles to features; fitted on training streams only.

    Attributes
    ----------
    features : FeatureSet
        What is computed.
    mean, scale : ndarray (n_bins,)
        Mean and standard deviation of Qρ per bin over the training streams.
    components : ndarray (n_pca, n_bins)
        Principal components of the standardised profiles.
    variance : ndarray (n_pca,)
        Share of the total variance that each component explains.
    """

    features: FeatureSet
    mean: np.ndarray
    scale: np.ndarray
    components: np.ndarray
    variance: np.ndarray

    @classmethod
    def fit(cls, q: np.ndarray, features: FeatureSet) -> FeatureMap:
        """Fit StandardScaler and PCA to training profiles.

        Parameters
        ----------
        q : ndarray (n_streams, n_bins)
            Observed (noisy) Qρ of the training streams.
        features : FeatureSet
            What to compute. No more components are kept than the data have.
        """
        scaler = StandardScaler().fit(q.astype(np.float64))
        n_pca = min(features.n_pca, *q.shape)
        if n_pca == 0:
            components, variance = np.zeros((0, q.shape[1])), np.zeros(0)
        else:
            # covariance_eigh is exact, quick for n_bins << n_streams, and has no random start
            pca = PCA(n_pca, svd_solver="covariance_eigh").fit(scaler.transform(q.astype(np.float64)))
            components, variance = pca.components_, pca.explained_variance_ratio_
        return cls(features, scaler.mean_, scaler.scale_, components, variance)

    @property
    def n_bins(self) -> int:
        """Number of bins a profile must have."""
        return len(self.mean)

    @property
    def names(self) -> list[str]:
        """Names of the features, in order."""
        names = [f"PC {i + 1}" for i in range(len(self.components))]
        arms = self.features.arms or (self.n_bins,)
        for number, n_bins in enumerate(arms):
            which = f" of arm {number + 1}" if len(arms) > 1 else ""
            for summary in self.features.summaries:
                names += [name + which for name in _names(summary, _widths(self.features, n_bins), n_bins)]
        return names

    def __call__(self, q: np.ndarray, summaries: np.ndarray | None = None) -> np.ndarray:
        """Features of observed profiles.

        Parameters
        ----------
        q : ndarray (n_streams, n_bins)
        summaries : ndarray (n_streams, n_summaries), optional
            What `summarise` says of them, if it is known already.

        Returns
        -------
        ndarray (n_streams, n_features), float32
        """
        scores = ((q - self.mean) / self.scale) @ self.components.T
        columns = [scores.astype(np.float32)]
        if self.features.summaries:
            columns.append(summarise(q, self.features) if summaries is None else summaries)
        return np.concatenate(columns, axis=1)


def summarise(q: np.ndarray, features: FeatureSet) -> np.ndarray:
    """Summary features of profiles.

    Parameters
    ----------
    q : ndarray (n_streams, n_bins)
        Observed Qρ.

    Returns
    -------
    ndarray (n_streams, n_features), float32
        The groups of ``features.summaries`` one after the other.
    """
    q = np.asarray(q, np.float32)
    if features.arms:  # nothing is smoothed, nor has a wavelength, across the progenitor
        one = features.model_copy(update={"arms": ()})
        ends = np.cumsum(features.arms)
        if ends[-1] != q.shape[1]:
            raise ValueError(f"profiles must have {ends[-1]} bins of all arms (got {q.shape[1]})")
        return np.concatenate([summarise(arm, one) for arm in np.split(q, ends[:-1], axis=1)], axis=1)
    widths = _widths(features, q.shape[1])
    smoothed = {1: q} | {w: uniform_filter1d(q, w, axis=1, mode="nearest") for w in widths}
    groups = [_COMPUTE[name](smoothed) for name in features.summaries]
    return np.concatenate(groups, axis=1).astype(np.float32)


def _widths(features: FeatureSet, n_bins: int) -> tuple[int, ...]:
    """Smoothing widths that fit into the profile."""
    return tuple(w for w in features.scales if w < n_bins)


def _moments(smoothed: Scales) -> np.ndarray:
    """Mean, standard deviation, skewness and kurtosis at each scale."""
    columns = []
    for x in smoothed.values():
        mean = x.mean(axis=1)
        z = x - mean[:, None]
        z2 = z * z  # powers of arrays are tenfold slower
        std = np.sqrt(z2.mean(axis=1)) + np.float32(1e-9)
        columns += [mean, std, (z2 * z).mean(axis=1) / std**3, (z2 * z2).mean(axis=1) / std**4]
    return np.stack(columns, axis=1)


def _quantiles(smoothed: Scales) -> np.ndarray:
    """Quantiles of Qρ at each scale, and its extremes at the smoothed ones."""
    columns = []
    for x in smoothed.values():
        ordered = np.sort(x, axis=1)
        index = np.round(QUANTILES * (x.shape[1] - 1)).astype(int)
        columns += [ordered[:, index], ordered[:, [0, -1]]]
    return np.concatenate(columns, axis=1)


def _bands(smoothed: Scales) -> np.ndarray:
    """Between neighbouring scales: log power overall and per block, lowest and highest value."""
    columns = []
    for fine, coarse in itertools.pairwise(smoothed.values()):
        band = fine - coarse
        power = band**2
        blocks = [block.mean(axis=1) for block in np.array_split(power, N_BLOCKS, axis=1)]
        columns += [np.log(p + POWER_FLOOR) for p in (power.mean(axis=1), *blocks)]
        columns += [band.min(axis=1), band.max(axis=1)]
    return np.stack(columns, axis=1) if columns else np.zeros((len(smoothed[1]), 0), np.float32)


def _spectrum(smoothed: Scales) -> np.ndarray:
    """Log power in logarithmic bins of wavenumber."""
    q = smoothed[1]
    power = np.abs(np.fft.rfft(q - q.mean(axis=1, keepdims=True), axis=1)) ** 2 / q.shape[1]
    edges = np.geomspace(1, power.shape[1], N_WAVENUMBERS + 1)
    columns = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        first = min(int(low), power.shape[1] - 1)
        columns.append(power[:, first : max(int(high), first + 1)].mean(axis=1))
    return np.log(np.stack(columns, axis=1) + POWER_FLOOR)


def _power(smoothed: Scales) -> np.ndarray:
    """Log power at every wavenumber, in the conventions of `streamdash.statistics.spectrum`."""
    from streamdash.statistics.spectrum import power_spectrum  # with numba, which no other group needs

    q = smoothed[1]
    return np.log(power_spectrum(q, 1.0)[1][:, : _n_waves(q.shape[1])] + POWER_FLOOR)


def _n_waves(n_bins: int) -> int:
    """Number of wavenumbers whose power is a feature."""
    return max(1, (n_bins - 1) // FINEST_WAVE)


def _histogram(smoothed: Scales) -> np.ndarray:
    """Share of bins with Qρ in each interval of `HISTOGRAM_EDGES`, and below and above them."""
    q = smoothed[1]
    n_cells = len(HISTOGRAM_EDGES) + 1
    cell = np.searchsorted(HISTOGRAM_EDGES, q) + n_cells * np.arange(len(q))[:, None]
    return np.bincount(cell.ravel(), minlength=n_cells * len(q)).reshape(len(q), n_cells) / q.shape[1]


def _profile(smoothed: Scales) -> np.ndarray:
    """The smoothed profiles themselves, once per smoothing width of at least `PLACE_BINS`."""
    columns = [x[:, _places(w, x.shape[1])] for w, x in smoothed.items() if w >= PLACE_BINS]
    return np.concatenate(columns, axis=1) if columns else np.zeros((len(smoothed[1]), 0), np.float32)


def _places(width: int, n_bins: int) -> np.ndarray:
    """Bins at which a profile smoothed over ``width`` bins is worth reading."""
    return np.arange(width // 2, n_bins, width)


_COMPUTE: dict[Summary, Callable[[Scales], np.ndarray]] = {
    "moments": _moments,
    "quantiles": _quantiles,
    "bands": _bands,
    "spectrum": _spectrum,
    "histogram": _histogram,
    "profile": _profile,
    "power": _power,
}


def _names(summary: Summary, widths: tuple[int, ...], n_bins: int) -> list[str]:
    """Names of one group's features, in the order in which they are computed."""
    scales = ["1 bin", *(f"{w} bins" for w in widths)]
    if summary == "moments":
        return [f"{m} of {s}" for s in scales for m in ("mean", "std", "skewness", "kurtosis")]
    if summary == "quantiles":
        return [f"{m} of {s}" for s in scales for m in (*(f"q{p:g}" for p in QUANTILES), "min", "max")]
    if summary == "bands":
        parts = ("power", *(f"power in block {i + 1}" for i in range(N_BLOCKS)), "min", "max")
        return [f"{p} of {a} - {b}" for a, b in zip(scales[:-1], scales[1:], strict=True) for p in parts]
    if summary == "spectrum":
        return [f"P(k) bin {i + 1}" for i in range(N_WAVENUMBERS)]
    if summary == "power":
        return [f"P(k) of {j + 1} waves along the stream" for j in range(_n_waves(n_bins))]
    if summary == "profile":
        wide = [w for w in widths if w >= PLACE_BINS]
        return [f"Qρ of {w} bins at bin {place}" for w in wide for place in _places(w, n_bins)]
    pairs = zip(HISTOGRAM_EDGES[:-1], HISTOGRAM_EDGES[1:], strict=True)
    return [f"share of Qρ {c}" for c in ("below", *(f"{a:g} to {b:g}" for a, b in pairs), "above")]
