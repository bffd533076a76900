"""How a stream is observed: its bins, gaps, errors, and what smooth curve is divided out.

A `Design` is everything about a measured profile but its values, so that every simulated stream can
be put through exactly the same. `default_design` is that of the stream's description, for the paper's
stream the paper's: 0.2° bins of longitude, one noise in all. A profile that somebody measured is a few
dozen bins, often with gaps between them, an error for each, and a smooth curve that nobody knows
(Bovy, Erkal & Sanders 2017, §5, divide the density by a polynomial fitted to it; so does `measured`,
data and simulations alike).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import xarray as xr
from scipy.linalg import block_diag

from streamdash.engine.geometry import Geometry
from streamdash.streams import bins_of, window_of
from streamdash.survey.sky import (
    NOISE,
    Coordinate,
    bin_weights,
    from_theta,
    longitude_bins,
    to_theta,
)

Quantity = Literal["q_rho", "density"]
AS_IS = -1
"""Order of the polynomial that stands for no division at all."""
ORDER_MAX = 6
"""Highest order of the polynomial: with more, it follows the gaps themselves."""
EMPTY = 1e-30
"""Taken for the mean of a stretch without stars, which so stays empty when it is divided."""
AT_ONCE = 5_000
"""Streams of a large ensemble that are put into bins at once."""
FLOOR = 0.1
"""A fitted polynomial is not taken below this share of the mean: a quotient would mean nothing."""


@dataclass(frozen=True, eq=False)
class Design:
    """How a profile is measured: everything but its values.

    Attributes
    ----------
    coordinate : str
        Coordinate of the bins (deg; rad for theta): ``ell``, ``theta`` or the longitude of the
        stream's frame, such as ``phi1``.
    low, high : ndarray (n_bin,)
        Ends of each bin, bins in one direction along the stream; there may be gaps between them.
        Where the coordinate falls from bin to bin, `low` is the end met first, the higher one.
    sigma : ndarray (n_bin,)
        Standard deviation of the values after division, that is relative to the smooth curve.
    quantity : {"q_rho", "density"}
        What is measured: Qρ, or the number of stars per degree (any unit).
    order : int
        Order of the polynomial that the quantity is divided by, 0 for its mean; `AS_IS` for none.
    arms : tuple of int
        Where both arms of a stream are observed together, the number of bins of each, one arm's bins
        after the other's; empty for one arm. Each arm has a polynomial of its own.
    """

    coordinate: Coordinate
    low: np.ndarray
    high: np.ndarray
    sigma: np.ndarray
    quantity: Quantity = "q_rho"
    order: int = AS_IS
    arms: tuple[int, ...] = ()

    @classmethod
    def beside(cls, designs: Sequence[Design]) -> Design:
        """Both arms of a stream observed together, each as its own design says.

        Raises
        ------
        ValueError
            When the designs measure different things.
        """
        first = designs[0]
        if any(
            (d.coordinate, d.quantity, d.order) != (first.coordinate, first.quantity, first.order)
            for d in designs
        ):
            raise ValueError("Arms are observed together in the same coordinate and quantity only.")
        low, high, sigma = (
            np.concatenate([getattr(d, n) for d in designs]) for n in ("low", "high", "sigma")
        )
        return replace(first, low=low, high=high, sigma=sigma, arms=tuple(d.n_bin for d in designs))

    @classmethod
    def adjoining(cls, coordinate: Coordinate, edges: np.ndarray, noise: float = NOISE) -> Design:
        """Qρ in bins without gaps, with one error in all and nothing divided out.

        Parameters
        ----------
        edges : ndarray (n_bin + 1,), rising or falling.
        noise : standard deviation σ_ε of every bin.
        """
        edges = np.asarray(edges, dtype=float)
        return cls(coordinate, edges[:-1], edges[1:], _errors(noise, len(edges) - 1))

    def with_noise(self, noise: float | np.ndarray) -> Design:
        """The same bins with other errors: one for all, or one each (n_bin,).

        Raises
        ------
        ValueError
            When an error is negative or not finite, or there are not as many as bins.
        """
        return replace(self, sigma=_errors(noise, self.n_bin))

    def part(self, bins: slice) -> Design:
        """The design with some of its bins."""
        return replace(self, low=self.low[bins], high=self.high[bins], sigma=self.sigma[bins])

    @property
    def stretches(self) -> tuple[slice, ...]:
        """The bins of each arm; of one arm, all."""
        ends = np.cumsum(self.arms or (self.n_bin,)).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True))

    @property
    def n_bin(self) -> int:
        """Number of bins."""
        return len(self.low)

    @property
    def centers(self) -> np.ndarray:
        """Middle of every bin (deg)."""
        return 0.5 * (self.low + self.high)

    @property
    def noise(self) -> float:
        """The typical error of a bin, their median."""
        return float(np.median(self.sigma))

    @property
    def gapless(self) -> bool:
        """Whether each bin begins where the one before it ends."""
        return bool(np.array_equal(self.low[1:], self.high[:-1]))

    @property
    def edges(self) -> np.ndarray:
        """Edges (n_bin + 1,) of adjoining bins.

        Raises
        ------
        ValueError
            When there are gaps between the bins.
        """
        if not self.gapless:
            raise ValueError("bins with gaps between them have no common edges; use low and high")
        return np.append(self.low, self.high[-1])

    @property
    def step(self) -> float:
        """Width of the first bin, which is that of all where they are even (deg)."""
        return abs(float(self.high[0] - self.low[0]))

    @cached_property
    def fit(self) -> np.ndarray | None:
        """Matrix (n_bin, n_bin) that takes a profile to its least-squares polynomial; None for `AS_IS`.

        All bins weigh the same, so that the same profile has the same polynomial at any error.
        """
        if self.order == AS_IS:
            return None
        parts = [polynomial_fit(self.centers[stretch], self.order) for stretch in self.stretches]
        return parts[0] if len(parts) == 1 else block_diag(*parts)

    @cached_property
    def key(self) -> str:
        """Hash of the design."""
        return self._hash(self.low, self.high, self.sigma)

    @cached_property
    def bins_key(self) -> str:
        """Hash of all but the errors: what profiles without noise depend on."""
        return self._hash(self.low, self.high)

    def _hash(self, *arrays: np.ndarray) -> str:
        also = (self.arms,) if self.arms else ()
        sha = hashlib.sha256(repr((self.coordinate, self.quantity, self.order, *also)).encode())
        for array in arrays:
            sha.update(np.ascontiguousarray(array, dtype=float).tobytes())
        return sha.hexdigest()[:16]


def default_design(geometry: Geometry, noise: float | None = None) -> Design:
    """Qρ over the whole window in the bins of the stream's description, shot noise σ_ε in each.

    For the paper's stream these are its 0.2° bins of Galactic longitude and σ_ε = 0.1.
    """
    bins = bins_of(geometry.stream)
    edges = longitude_bins(geometry, bins.width, coordinate=bins.coordinate)
    return Design.adjoining(bins.coordinate, edges, bins.noise if noise is None else noise)


def published_design(geometry: Geometry) -> Design:
    """The bins in which measured profiles of the stream were analysed: their stretch, their polynomial.

    Where the stream's description names neither, as `default_design`.
    """
    bins = bins_of(geometry.stream)
    if bins.low is None or bins.high is None:
        design = default_design(geometry)
    else:
        n_bin = round((bins.high - bins.low) / bins.width)
        edges = np.linspace(bins.low, bins.high, n_bin + 1)
        design = Design.adjoining(bins.coordinate, edges, bins.noise)
    return design if bins.order is None else replace(design, quantity="density", order=bins.order)


def window(geometry: Geometry, coordinate: Coordinate) -> tuple[float, float]:
    """Lowest and highest `coordinate` (deg) of the simulated stretch of the stream."""
    ends = from_theta(geometry, window_of(geometry.stream).theta, coordinate)
    low, high = sorted(float(value) for value in ends)
    return low, high


def polynomial_fit(x: np.ndarray, order: int) -> np.ndarray:
    """Matrix that takes values at `x` to those of the polynomial fitted to them by least squares.

    Raises
    ------
    ValueError
        When the polynomial has as many coefficients as there are values, or more.
    """
    if order + 1 >= len(x):
        raise ValueError(f"A polynomial of order {order} needs more than {order + 1} bins, not {len(x)}.")
    scaled = (x - x.mean()) / max(0.5 * np.ptp(x), 1e-12)
    basis = np.polynomial.legendre.legvander(scaled, order)
    return basis @ np.linalg.pinv(basis)


def smooth_curve(profiles: np.ndarray, fit: np.ndarray) -> np.ndarray:
    """The fitted polynomial of each profile (…, n_bin), kept above `FLOOR` of the profile's mean."""
    size = np.maximum(profiles.mean(axis=-1), FLOOR * np.abs(profiles).mean(axis=-1))
    size = np.maximum(size, EMPTY / FLOOR)
    return np.maximum(profiles @ fit.T.astype(profiles.dtype), FLOOR * size[..., None])


def divisible(profiles: np.ndarray, fit: np.ndarray | None) -> np.ndarray:
    """Which profiles (…, n_bin) have a polynomial that stays above `FLOOR` of their mean everywhere.

    The others are refused when they are measured, since a quotient by almost nothing means nothing.
    """
    if fit is None:
        return np.ones(profiles.shape[:-1], dtype=bool)
    mean = profiles.mean(axis=-1)
    lowest = (profiles @ fit.T.astype(profiles.dtype)).min(axis=-1)
    return (mean > 0) & (lowest >= FLOOR * mean)


def divided(profiles: np.ndarray, fit: np.ndarray | None) -> np.ndarray:
    """Profiles over their own polynomial, or as they are where there is none."""
    return profiles if fit is None else profiles / smooth_curve(profiles, fit)


def measured(
    profiles: np.ndarray, draws: np.ndarray, sigma: np.ndarray | float, fit: np.ndarray | None
) -> np.ndarray:
    """Profiles with noise, divided afterwards as the data are.

    Parameters
    ----------
    profiles : ndarray (n_streams, n_bin)
        Without noise and not divided.
    draws : ndarray (n_streams, n_bin)
        Standard-normal draws.
    sigma : ndarray (n_bin,) or float
        Standard deviation relative to the smooth curve.
    fit : ndarray (n_bin, n_bin) or None
        `Design.fit`.
    """
    sigma = np.asarray(sigma, profiles.dtype)
    if fit is None:
        return profiles + sigma * draws
    return divided(profiles + sigma * smooth_curve(profiles, fit) * draws, fit)


def observe_as(geometry: Geometry, ensemble: xr.Dataset, design: Design) -> np.ndarray:
    """Every stream of an ensemble in the design's own bins: no noise, not divided.

    Parameters
    ----------
    ensemble : Dataset with ``density (stream, theta)`` and ``smooth (theta)``.

    Returns
    -------
    (n_stream, n_bin) float32 array
        Qρ, or stars per degree (in the unit of the density times rad/deg).

    Raises
    ------
    ValueError
        When a bin is not within the profiles.
    """
    weights = _weights(geometry, ensemble, design).astype("float32")
    n = ensemble.sizes["stream"]
    if n <= AT_ONCE:
        return ensemble.density.values.astype("float32", copy=False) @ weights
    binned = np.empty((n, weights.shape[1]), "float32")
    for first in range(0, n, AT_ONCE):  # an ensemble may lie on disk: no more of it is held than this
        some = slice(first, first + AT_ONCE)
        binned[some] = ensemble.density.isel(stream=some).values.astype("float32", copy=False) @ weights
    return binned


def smooth_as(geometry: Geometry, ensemble: xr.Dataset, design: Design) -> np.ndarray:
    """The unperturbed stream in the design's bins, like `observe_as` (n_bin,)."""
    return ensemble.smooth.values @ _weights(geometry, ensemble, design)


def _weights(geometry: Geometry, ensemble: xr.Dataset, design: Design) -> np.ndarray:
    """Weights (n_theta, n_bin) that turn density per radian into what the design measures."""
    theta = ensemble.theta.values
    if design.gapless:
        weights = bin_weights(geometry, theta, design.edges, design.coordinate)
    else:
        ends = np.sort([design.low, design.high], axis=0)
        edges = np.unique(ends)
        # Bins and the gaps between them; then the bins alone.
        weights = bin_weights(geometry, theta, edges, design.coordinate)
        weights = weights[:, np.searchsorted(edges, ends[0])]
    if design.quantity == "q_rho":
        return weights / (ensemble.smooth.values @ weights)
    radians = to_theta(geometry, design.high, design.coordinate) - to_theta(
        geometry, design.low, design.coordinate
    )
    return weights * np.abs(radians / (design.high - design.low))


def _errors(noise: float | np.ndarray, n_bin: int) -> np.ndarray:
    sigma = np.asarray(noise, dtype=float)
    if not (np.isfinite(sigma) & (sigma >= 0)).all():
        raise ValueError(f"the noise must be a number of 0 or more (got {noise})")
    if sigma.shape not in ((), (n_bin,)):
        raise ValueError(f"give one error for all {n_bin} bins, or one for each (got {len(sigma)})")
    return np.broadcast_to(sigma, n_bin).copy()
