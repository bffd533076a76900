"""Simulated streams seen as one measured profile was: its bins, gaps, errors and smooth curve.

A measured profile is a few dozen bins, often with gaps between them, an error for each bin, and a
smooth profile that nobody knows. `Design` holds all of that but the measured values, so that every
simulated stream can be put through exactly the same (Bovy, Erkal & Sanders 2017, §5, divide the
density by a polynomial fitted to it; so does `Design.divide`, to data and simulations alike).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import xarray as xr

from streamdash.engine.geometry import Geometry
from streamdash.survey.sky import (
    THETA_WINDOW,
    Coordinate,
    bin_weights,
    theta_to_ell,
    theta_to_phi1,
    to_theta,
)

Quantity = Literal["q_rho", "density"]
AS_IS = -1
"""Order of the polynomial that stands for no division at all."""
ORDER_MAX = 6
"""Highest order of the polynomial: with more, it follows the gaps themselves."""
FLOOR = 0.1
"""A fitted polynomial is not taken below this share of the mean: a quotient would mean nothing."""


@dataclass(frozen=True, eq=False)
class Design:
    """How a profile was measured: everything but its values.

    Attributes
    ----------
    coordinate : {"ell", "phi1"}
        Coordinate of the bins (deg).
    low, high : ndarray (n_bin,)
        Ends of each bin, bins in rising order; there may be gaps between them.
    sigma : ndarray (n_bin,)
        Standard deviation of the values after division, that is relative to the smooth curve.
    quantity : {"q_rho", "density"}
        What is measured: Qρ, or the number of stars per degree (any unit).
    order : int
        Order of the polynomial that the quantity is divided by, 0 for its mean; `AS_IS` for none.
    """

    coordinate: Coordinate
    low: np.ndarray
    high: np.ndarray
    sigma: np.ndarray
    quantity: Quantity
    order: int

    @property
    def n_bin(self) -> int:
        """Number of bins."""
        return len(self.low)

    @property
    def centers(self) -> np.ndarray:
        """Middle of every bin (deg)."""
        return 0.5 * (self.low + self.high)

    @cached_property
    def fit(self) -> np.ndarray | None:
        """Matrix (n_bin, n_bin) that takes a profile to its least-squares polynomial; None for `AS_IS`.

        All bins weigh the same, so that the same profile has the same polynomial at any error.
        """
        return None if self.order == AS_IS else polynomial_fit(self.centers, self.order)

    @cached_property
    def key(self) -> str:
        """Hash of the design."""
        sha = hashlib.sha256(repr((self.coordinate, self.quantity, self.order)).encode())
        for array in (self.low, self.high, self.sigma):
            sha.update(np.ascontiguousarray(array, dtype=float).tobytes())
        return sha.hexdigest()[:16]


def window(geometry: Geometry, coordinate: Coordinate) -> tuple[float, float]:
    """Lowest and highest `coordinate` (deg) of the simulated stretch of the stream."""
    convert = {"ell": theta_to_ell, "phi1": theta_to_phi1}[coordinate]
    low, high = sorted(float(value) for value in convert(geometry, THETA_WINDOW))
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
    return np.maximum(profiles @ fit.T.astype(profiles.dtype), FLOOR * size[..., None])


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
    weights = _weights(geometry, ensemble, design)
    return ensemble.density.values.astype("float32", copy=False) @ weights.astype("float32")


def smooth_as(geometry: Geometry, ensemble: xr.Dataset, design: Design) -> np.ndarray:
    """The unperturbed stream in the design's bins, like `observe_as` (n_bin,)."""
    return ensemble.smooth.values @ _weights(geometry, ensemble, design)


def _weights(geometry: Geometry, ensemble: xr.Dataset, design: Design) -> np.ndarray:
    """Weights (n_theta, n_bin) that turn density per radian into what the design measures."""
    theta = ensemble.theta.values
    edges = np.unique(np.concatenate([design.low, design.high]))
    # Bins and the gaps between them; then the bins alone.
    weights = bin_weights(geometry, theta, edges, design.coordinate)
    weights = weights[:, np.searchsorted(edges, design.low)]
    if design.quantity == "q_rho":
        return weights / (ensemble.smooth.values @ weights)
    radians = np.abs(
        to_theta(geometry, design.high, design.coordinate) - to_theta(geometry, design.low, design.coordinate)
    )
    return weights * (radians / (design.high - design.low))
