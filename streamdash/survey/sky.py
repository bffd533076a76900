"""What a telescope sees: positions on the sky, bins along the stream, shot noise.

A stream is observed as numbers of stars in bins of Galactic longitude ``ell`` (deg), of the longitude
of the stream's own frame (deg; `streamdash.streams.SkyFrame` names it, ``phi1`` for GD-1), or of
parallel angle ``theta`` (rad). Qρ of a bin is the number of stars in it over the number expected of
the smooth stream (paper §3),

    Qρ = ∫ρ dθ / ∫ρ̄ dθ   over the bin's interval of θ,

which is the same in every coordinate.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import make_interp_spline

from streamdash.engine.geometry import Geometry
from streamdash.streams import window_of

Coordinate = str
"""``ell``, ``theta``, or the longitude of the stream's frame, such as ``phi1``."""
BIN_WIDTH = 0.2
"""Width of a longitude bin (deg)."""
NOISE = 0.1
"""Standard deviation σ_ε of Qρ's shot noise in one bin of `BIN_WIDTH`."""


def coordinates(geometry: Geometry) -> tuple[str, str, str]:
    """Names of the coordinates along a stream: Galactic longitude, its own frame's, the angle."""
    return ("ell", geometry.frame.longitude, "theta")


def theta_to_ell(geometry: Geometry, theta: ArrayLike) -> np.ndarray:
    """Galactic longitude (deg, not wrapped) of the track at parallel angle `theta` (rad).

    Raises
    ------
    ValueError
        When an angle lies beyond the track; so do all conversions.
    """
    return _convert(geometry, theta, "theta", "ell")


def ell_to_theta(geometry: Geometry, ell: ArrayLike) -> np.ndarray:
    """Parallel angle (rad) of the track at Galactic longitude `ell` (deg, any turn)."""
    return _convert(geometry, ell, "ell", "theta")


def from_theta(geometry: Geometry, theta: ArrayLike, coordinate: Coordinate) -> np.ndarray:
    """Position in `coordinate` (not wrapped) of the track at parallel angle `theta` (rad)."""
    return _convert(geometry, theta, "theta", coordinate)


def to_theta(geometry: Geometry, values: ArrayLike, coordinate: Coordinate) -> np.ndarray:
    """Parallel angle (rad) of positions given in `coordinate`."""
    return _convert(geometry, values, coordinate, "theta")


def longitude_bins(
    geometry: Geometry,
    width: float = BIN_WIDTH,
    theta_window: tuple[float, float] | None = None,
    coordinate: Coordinate = "ell",
) -> np.ndarray:
    """Edges of equal bins of a longitude that fill a window of angles.

    Parameters
    ----------
    width : wished width (deg). The whole number of bins that comes closest to it is used: for the
        default stream 347 bins of 0.19993°.
    theta_window : first and last parallel angle (rad); the stream's own window when not given.
    coordinate : ``ell`` or the longitude of the stream's frame.

    Returns
    -------
    (n_bin + 1,) array
        Longitudes (deg), in the order of increasing parallel angle.

    Examples
    --------
    >>> from streamdash import StreamModel, load_geometry
    >>> len(longitude_bins(load_geometry(StreamModel()))) - 1
    347
    """
    if not (np.isfinite(width) and width > 0):
        raise ValueError(f"width must be a positive number of degrees (got {width})")
    window = theta_window if theta_window is not None else window_of(geometry.stream).theta
    first, last = from_theta(geometry, window, coordinate)
    n_bin = max(1, round(abs(last - first) / width))
    return np.linspace(first, last, n_bin + 1)


def observe(
    geometry: Geometry,
    theta: np.ndarray,
    values: np.ndarray,
    edges: np.ndarray,
    coordinate: Coordinate = "ell",
) -> np.ndarray:
    """Mean over bins of profiles known at some angles.

    Between the angles a profile is straight, so that it is never negative; that is integrated
    exactly, so bins may be narrower or wider than the spacing of the angles.

    Parameters
    ----------
    theta : (n_theta,) increasing angles (rad).
    values : (..., n_theta) profiles, for instance densities per unit of θ.
    edges : (n_bin + 1,) monotonic edges of the bins, in `coordinate`.

    Returns
    -------
    (..., n_bin) array of the floating type of `values`
        ∫ values dθ / ∫ dθ over each bin.

    Raises
    ------
    ValueError
        When the edges are not monotonic, or a bin (named) is not within the angles.
    """
    values = np.asarray(values)
    dtype = values.dtype if values.dtype.kind == "f" else np.dtype(float)
    return values @ bin_weights(geometry, theta, edges, coordinate).astype(dtype)


def q_rho(
    geometry: Geometry, ensemble: xr.Dataset, edges: np.ndarray, coordinate: Coordinate = "ell"
) -> np.ndarray:
    """Qρ of every stream of an ensemble in every bin, without noise.

    Parameters
    ----------
    ensemble : Dataset with ``density (stream, theta)`` and ``smooth (theta)``.
    edges : (n_bin + 1,) monotonic edges of the bins, in `coordinate`.

    Returns
    -------
    (n_stream, n_bin) float32 array
    """
    weights = bin_weights(geometry, ensemble.theta.values, edges, coordinate)
    weights /= ensemble.smooth.values @ weights
    return ensemble.density.values.astype("float32", copy=False) @ weights.astype("float32")


def bin_weights(
    geometry: Geometry, theta: np.ndarray, edges: np.ndarray, coordinate: Coordinate = "ell"
) -> np.ndarray:
    """Weights (n_theta, n_bin) with which values at `theta` enter the mean over each bin."""
    theta = np.asarray(theta, dtype=float)
    ends = _bin_ends(geometry, theta, np.asarray(edges, dtype=float), coordinate)
    # A spline is linear in its values: that of the unit vectors gives the weights of all profiles.
    integral = make_interp_spline(theta, np.eye(len(theta)), k=1).antiderivative()(ends)
    return (np.diff(integral, axis=0) / np.diff(ends)[:, None]).T


def shot_noise(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """One standard-normal draw for each stream and bin, to be scaled by the noise level.

    Parameters
    ----------
    shape : number of streams and of bins. The first streams' draws do not depend on how many
        streams follow.

    Returns
    -------
    (n_stream, n_bin) float32 array
    """
    return np.random.default_rng(seed).standard_normal(shape, dtype="float32")


def add_noise(q: np.ndarray, draws: np.ndarray, sigma: float) -> np.ndarray:
    """Qρ with Gaussian shot noise of standard deviation `sigma` per bin; may turn negative.

    Raises
    ------
    ValueError
        When `sigma` is negative or not finite, or `q` has more streams or bins than `draws`.

    Examples
    --------
    >>> q = np.ones((2, 3), np.float32)
    >>> draws = shot_noise(q.shape)
    >>> bool(np.allclose(add_noise(q, draws, 0.2) - 1, 2 * (add_noise(q, draws, 0.1) - 1), atol=1e-6))
    True
    """
    if not (np.isfinite(sigma) and sigma >= 0):
        raise ValueError(f"the noise must be a number of 0 or more (got {sigma})")
    if q.shape[1:] != draws.shape[1:] or len(q) > len(draws):
        raise ValueError(f"noise was drawn for streams and bins {draws.shape}, not {q.shape}")
    return q + np.asarray(sigma, dtype=q.dtype) * draws[: len(q)]


def _track(geometry: Geometry, coordinate: str) -> np.ndarray:
    """Positions along today's track, up to where its longitude turns back beyond the window."""
    if coordinate not in coordinates(geometry):
        raise ValueError(f"coordinate must be one of {', '.join(coordinates(geometry))} (got {coordinate!r})")
    own = coordinate == geometry.frame.longitude
    positions = geometry.track_longitude if own else getattr(geometry, f"track_{coordinate}")
    steps = np.diff(positions)
    turned = np.flatnonzero(np.sign(steps) != np.sign(steps[0]))
    end = turned[0] + 1 if len(turned) else len(positions)
    if geometry.track_theta[end - 1] < window_of(geometry.stream).theta_max:
        raise ValueError(f"{coordinate} turns back along this stream; use theta instead")
    return positions[:end]


def _unit(coordinate: Coordinate) -> str:
    return " rad" if coordinate == "theta" else "°"


def _convert(geometry: Geometry, values: ArrayLike, source: str, target: str) -> np.ndarray:
    # Linear between the track's ~1000 points: off by at most 4·10⁻⁵ deg, and exactly invertible.
    asked = np.asarray(values, dtype=float)
    x, y = _track(geometry, source), _track(geometry, target)
    length = min(len(x), len(y))
    x, y = x[:length], y[:length]
    if x[0] > x[-1]:
        x, y = x[::-1], y[::-1]
    if source != "theta":
        asked = asked - 360.0 * np.round((asked - (x[0] + x[-1]) / 2) / 360.0)
    slack = 1e-9 * (x[-1] - x[0])
    outside = ~((asked >= x[0] - slack) & (asked <= x[-1] + slack))
    if outside.any():
        worst = asked[outside].flat[0]
        unit = _unit(source)
        raise ValueError(
            f"{source} {worst:g}{unit} is off the stream's track, {x[0]:.4g} to {x[-1]:.4g}{unit}"
        )
    return np.interp(asked, x, y)


def _bin_ends(geometry: Geometry, theta: np.ndarray, edges: np.ndarray, coordinate: str) -> np.ndarray:
    """Angles of the edges, once they are known to make bins within `theta`."""
    if edges.ndim != 1 or len(edges) < 2 or not np.isfinite(edges).all():
        raise ValueError("edges must be a list of at least two finite numbers")
    steps = np.diff(edges)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise ValueError("edges must increase (or decrease) from bin to bin, without repeats")
    inside = np.clip(edges, *_limits(geometry, theta, coordinate))
    slack = 1e-9 * abs(edges[-1] - edges[0])
    outside = np.flatnonzero(np.abs(edges - inside) > slack)
    if len(outside):
        j = min(outside[0], len(edges) - 2)
        low, high = _limits(geometry, theta, coordinate)
        unit = _unit(coordinate)
        raise ValueError(
            f"bin {j} ({edges[j]:.6g} to {edges[j + 1]:.6g}{unit}) is not within the profiles, "
            f"{coordinate} {low:.6g} to {high:.6g}{unit}"
        )
    return np.clip(_convert(geometry, inside, coordinate, "theta"), theta[0], theta[-1])


def _limits(geometry: Geometry, theta: np.ndarray, coordinate: str) -> tuple[float, float]:
    low, high = sorted(_convert(geometry, theta[[0, -1]], "theta", coordinate))
    return float(low), float(high)
