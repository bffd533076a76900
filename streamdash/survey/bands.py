"""An ensemble as a survey shows it: binned profiles, how many pass where, quantile bands.

Noise is added per bin of the stream's description (0.2° of Galactic longitude in the default one),
whatever coordinate the profiles are shown in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from streamdash.compiled import njit
from streamdash.config import EnsembleConfig
from streamdash.engine.galpy_streams import time_unit_gyr
from streamdash.engine.geometry import Geometry
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams, arm_keys, open_ensembles
from streamdash.survey.sky import from_theta, observe, to_theta

RANGES = {"q_rho": (-0.5, 3.0), "rho": (-0.5, 3.0), "omega": (0.0, 0.25)}
"""Vertical range of each figure, the same for every ensemble and noise."""
HISTOGRAM_RANGES = {"q_rho": (-4.0, 6.0), "rho": (-4.0, 6.0), "omega": (-0.5, 0.75)}
"""Values that enter the quantiles; wide enough for σ_ε = 1."""
FINE_ROWS = 4000
"""Cells of the histogram per longitude bin; quantiles are resolved to a fraction of one."""
SCALES = {"shared": "Shared", "own": "Own", "log": "Log", "residual": "Residual"}
"""Vertical scales: the same linear one for all classes, one that fits each class, log₁₀, and what is
left after the class's median; and what they are called."""
LOG_FLOOR = 1e-2
"""Smallest value on the logarithmic scale: noise makes some densities negative."""
LOG_RANGES = {"q_rho": (-1.5, 1.0), "rho": (-2.0, 1.0), "omega": (-2.0, 0.0)}
"""Of the logarithm's decades."""
IMAGE_ROWS = 120
BAND = (0.16, 0.5, 0.84)
"""Quantiles drawn: band edges and median (68 % of the streams lie in the band)."""


@dataclass(frozen=True)
class Binned:
    """One ensemble's profiles of one quantity, averaged over longitude bins.

    Attributes
    ----------
    config : EnsembleConfig
    quantity : str
    ell, theta, longitude : (n_bin + 1,) arrays
        Edges of the bins in deg, rad, and deg of the stream's own frame.
    values : (n_bin, n_streams) float32 array
        Profiles; bins first, so that a bin's streams lie side by side.
    draws : (n_bin, n_streams) float32 array
        One standard-normal draw per stream and bin, fixed for ever.
    scale : (n_bin,) array
        What a noise of σ_ε = 1 means in this quantity: 1 for Qρ, ρ̄ for ρ, 0 for ⟨Ω∥⟩.
    smooth : (n_bin,) array
        The unperturbed stream.
    n_impacts : (n_streams,) array
        How often each stream was hit; empty where that is not known.
    """

    config: EnsembleConfig
    quantity: str
    ell: np.ndarray
    theta: np.ndarray
    longitude: np.ndarray
    values: np.ndarray
    draws: np.ndarray
    scale: np.ndarray
    smooth: np.ndarray
    n_impacts: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))

    def edges(self, coordinate: str) -> np.ndarray:
        """Edges of the bins in ``ell``, ``theta`` or the longitude of the stream's frame."""
        return getattr(self, coordinate) if coordinate in ("ell", "theta") else self.longitude


@dataclass(frozen=True)
class Bands:
    """What is shown of one class; arrays of shape (n_bin,) unless said otherwise.

    Attributes
    ----------
    index : int
        Number of the class, 0 for the lowest masses.
    image : (IMAGE_ROWS, n_column) uint8 array
        How many profiles pass through each cell, lowest row first.
    extent : tuple of float
        Left, bottom, right and top edge of the image.
    streams : (n_highlight,) array
        Numbers of the highlighted streams.
    highlighted : (n_highlight, n_bin) array
    impacts : (n_highlight,) array
        How often each highlighted stream was hit.
    scale : str
        Vertical scale, one of `SCALES`, in which all of this is.
    off : float
        Share of the values that lie beyond it.
    """

    index: int
    config: EnsembleConfig
    quantity: str
    coordinate: str
    noise: float
    x: np.ndarray
    smooth: np.ndarray
    low: np.ndarray
    median: np.ndarray
    high: np.ndarray
    image: np.ndarray
    extent: tuple[float, float, float, float]
    streams: np.ndarray
    highlighted: np.ndarray
    impacts: np.ndarray
    scale: str = "shared"
    off: float = 0.0


# ---------------------------------------------------------------- collect


def read_profiles(cache: Cache, ensembles: Sequence[str | EnsembleConfig], quantity: str) -> list[Binned]:
    """Open ensembles of one stream and average their profiles over the bins of that stream.

    Two keys joined by ``+`` are the two arms of a stream, whose profiles follow each other.

    Raises
    ------
    StoreError
        When an ensemble is missing or damaged.
    """
    keys = [key for ensemble in ensembles for key in arm_keys(ensemble)]
    if len(keys) > len(ensembles):
        return [binned for key in keys for binned in read_profiles(cache, [key], quantity)]
    opened = open_ensembles(cache, ensembles)
    return [
        bin_profiles(opened.geometry, dataset, ObservedStreams.of(opened.geometry, dataset, config), quantity)
        for config, dataset in zip(opened.configs, opened.datasets, strict=True)
    ]


def bin_profiles(geometry: Geometry, dataset: xr.Dataset, streams: ObservedStreams, quantity: str) -> Binned:
    """Profiles of one class in the bins it is observed in.

    Parameters
    ----------
    dataset : the ensemble, as of `streamdash.store.cache.Cache.open_ensemble`.
    streams : Qρ of the same ensemble in adjoining bins.
    quantity : ``q_rho``, ``rho`` or ``omega``.
    """
    (config,), (q,), (draws,), design = streams.configs, streams.q, streams.draws, streams.design
    where, edges = design.coordinate, design.edges
    theta = to_theta(geometry, edges, where)
    ell, longitude = (
        edges if name == where else from_theta(geometry, theta, name)
        for name in ("ell", geometry.frame.longitude)
    )

    def binned(values: xr.DataArray) -> np.ndarray:
        return observe(geometry, dataset.theta.values, values.values, edges, where)

    if quantity == "omega":
        unit = time_unit_gyr()
        values, smooth = binned(dataset.omega) / unit, binned(dataset.omega_smooth) / unit
        scale = np.zeros(len(smooth))
    else:
        scale = smooth = binned(dataset.smooth) if quantity == "rho" else np.ones(design.n_bin)
        values = q * scale
    return Binned(
        config,
        quantity,
        ell,
        theta,
        longitude,
        np.ascontiguousarray(values.T, dtype=np.float32),
        np.ascontiguousarray(draws.T, dtype=np.float32),
        scale,
        smooth,
        streams.n_impacts[0] if streams.n_impacts else np.zeros(0, dtype=np.int32),
    )


def bin_angles(dataset: xr.Dataset, config: EnsembleConfig) -> Binned:
    """Qρ of an ensemble at its own angles, without noise: for any stream, and for streams so far.

    Parameters
    ----------
    dataset : Dataset
        As of `streamdash.store.cache.Cache.open_ensemble`.

    Returns
    -------
    Binned
        Of which only the coordinate ``theta`` can be drawn.
    """
    centres = dataset.theta.values
    middles = (centres[1:] + centres[:-1]) / 2
    edges = np.concatenate([[2 * centres[0] - middles[0]], middles, [2 * centres[-1] - middles[-1]]])
    values = (dataset.density / np.maximum(dataset.smooth, 1e-6)).values.T
    values = np.ascontiguousarray(values, dtype=np.float32)
    none, ones = np.full(len(edges), np.nan), np.ones(len(centres))
    hits = dataset["n_impacts"].to_numpy() if "n_impacts" in dataset else np.zeros(0, dtype=np.int32)
    return Binned(config, "q_rho", none, edges, none, values, np.zeros_like(values), ones, ones, hits)


# ---------------------------------------------------------------- compute


def compute(
    binned: Binned,
    index: int,
    coordinate: str,
    noise: float,
    highlight: int,
    seed: int,
    scale: str = "shared",
) -> Bands:
    """Everything that is shown of one class at a given noise; a few milliseconds for 2,000 streams.

    Parameters
    ----------
    scale
        Vertical scale, one of `SCALES`.
    """
    n_streams = binned.values.shape[1]
    edges = binned.edges(coordinate)
    spread = np.asarray(noise * binned.scale, dtype=np.float32)
    offset = np.zeros(len(spread))

    def count(low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        return _count(
            binned.values,
            binned.draws,
            spread,
            offset,
            *HISTOGRAM_RANGES[binned.quantity],
            FINE_ROWS,
            low,
            high,
            IMAGE_ROWS,
            np.asarray(BAND),
            LOG_FLOOR if scale == "log" else 0.0,
        )

    low, high = (LOG_RANGES if scale == "log" else RANGES)[binned.quantity]
    counts, quantiles = count(low, high)
    smooth = binned.smooth
    if scale == "log":
        smooth = np.log10(np.maximum(smooth, LOG_FLOOR))
    if scale == "residual":
        offset = quantiles[1]
    if scale in ("own", "residual"):
        low, high = _fitting(quantiles - offset)
        counts, quantiles = count(low, high)
        quantiles, smooth = quantiles - offset, smooth - offset
    left, right = float(min(edges[0], edges[-1])), float(max(edges[0], edges[-1]))
    image = _shades(n_streams)[counts.T[:, _columns(edges, left, right)]]
    streams = pick_streams(n_streams, highlight, seed)
    highlighted = binned.values[:, streams] + (noise * binned.scale)[:, None] * binned.draws[:, streams]
    highlighted = highlighted - offset[:, None]
    if scale == "log":
        highlighted = np.log10(np.maximum(highlighted, LOG_FLOOR))
    return Bands(
        index,
        binned.config,
        binned.quantity,
        coordinate,
        noise,
        (edges[:-1] + edges[1:]) / 2,
        smooth,
        quantiles[0],
        quantiles[1],
        quantiles[2],
        image,
        (left, low, right, high),
        streams,
        highlighted.T,
        binned.n_impacts[streams] if len(binned.n_impacts) else np.zeros(len(streams), dtype=np.int32),
        scale,
        1.0 - float(counts.sum()) / max(binned.values.size, 1),
    )


def _fitting(quantiles: np.ndarray) -> tuple[float, float]:
    """Ends of an axis that hold a class's band with room for the streams beyond it, on tenths."""
    low, high = float(quantiles[0].min()), float(quantiles[2].max())
    room = 0.75 * max(high - low, 1e-3)
    step = 10.0 ** np.floor(np.log10(room)) / 2
    return step * np.floor((low - room) / step), step * np.ceil((high + room) / step)


def pick_streams(n_streams: int, highlight: int, seed: int) -> np.ndarray:
    """Numbers of the highlighted streams, in increasing order, without repeats."""
    count = min(highlight, n_streams)
    return np.sort(np.random.default_rng(seed).choice(n_streams, size=count, replace=False))


def _columns(edges: np.ndarray, left: float, right: float) -> np.ndarray:
    """Which bin each of the image's columns shows; columns are even in the drawn coordinate."""
    n_bin = len(edges) - 1
    centres = left + (np.arange(n_bin) + 0.5) * (right - left) / n_bin
    rising = edges if edges[0] < edges[-1] else edges[::-1]
    shown = np.clip(np.searchsorted(rising, centres) - 1, 0, n_bin - 1)
    return shown if edges[0] < edges[-1] else n_bin - 1 - shown


def _shades(n_streams: int) -> np.ndarray:
    """Shade (0–255) of a cell by the number of profiles in it; a single one is just visible."""
    filled = np.arange(n_streams + 1) / (0.2 * n_streams)
    return np.round(255 * np.minimum(filled, 1.0) ** 0.4).astype(np.uint8)


@njit(cache=True)
def _count(
    values: np.ndarray,
    draws: np.ndarray,
    noise: np.ndarray,
    offset: np.ndarray,
    low: float,
    high: float,
    n_fine: int,
    image_low: float,
    image_high: float,
    n_rows: int,
    levels: np.ndarray,
    floor: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Image counts (n_bin, n_rows) and quantiles (n_level, n_bin) of values + noise · draws.

    Of their log₁₀ where there is a floor for them; the image is of what is left after an offset per bin.

    Each bin's fine histogram fits the processor's first cache; quantiles are interpolated in it.
    Values beyond the histogram count at its ends, values beyond the image in no row.
    """
    n_bin, n_streams = values.shape
    counts = np.zeros((n_bin, n_rows), dtype=np.int32)
    quantiles = np.empty((len(levels), n_bin))
    fine = np.empty(n_fine, dtype=np.int32)
    per_fine = n_fine / (high - low)
    per_row = n_rows / (image_high - image_low)
    for j in range(n_bin):
        fine[:] = 0
        for i in range(n_streams):
            value = values[j, i] + noise[j] * draws[j, i]
            if floor > 0.0:
                value = np.log10(max(value, floor))
            fine[min(max(int((value - low) * per_fine), 0), n_fine - 1)] += 1
            row = int(np.floor((value - offset[j] - image_low) * per_row))
            if 0 <= row < n_rows:
                counts[j, row] += 1
        k, below = 0, 0
        for level in range(len(levels)):
            wanted = levels[level] * n_streams
            while below + fine[k] < wanted and k < n_fine - 1:
                below += fine[k]
                k += 1
            inside = (wanted - below) / max(fine[k], 1)
            quantiles[level, j] = low + (k + inside) / per_fine
    return counts, quantiles
