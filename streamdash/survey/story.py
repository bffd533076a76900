"""What the story on the Learn page shows of the smooth stream and of the ensembles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import gaussian_kde

from streamdash.engine.geometry import Geometry

PIECES = (1, 2, 4, 8, 16, 32, 64, 128)
"""Bins per piece into which streams are cut, as far as there are two such pieces."""
QUANTILES = (0.16, 0.5, 0.84)


@dataclass(frozen=True)
class Track:
    """Where the stream is on the sky today; arrays (n,) from the progenitor to its far end.

    Attributes
    ----------
    ell, b : Galactic longitude and latitude, deg
    distance : from the Sun, kpc
    theta : parallel angle, rad
    density : ρ̄, 1 near the progenitor
    """

    ell: np.ndarray
    b: np.ndarray
    distance: np.ndarray
    theta: np.ndarray
    density: np.ndarray

    @property
    def sky_length(self) -> float:
        """Length along the track on the sky, deg."""
        ell, b = np.deg2rad(self.ell), np.deg2rad(self.b)
        points = np.stack([np.cos(b) * np.cos(ell), np.cos(b) * np.sin(ell), np.sin(b)], axis=1)
        chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
        return float(np.rad2deg(2 * np.arcsin(chords / 2)).sum())


@dataclass(frozen=True)
class Pieces:
    """How far the density of pieces of a stream is from the smooth stream's.

    Attributes
    ----------
    width : (n,) array
        Length of a piece, deg.
    deviation : (n_classes, 3, n) array
        Root mean square of Qρ - 1 over a stream's pieces: quantiles 16, 50, 84 % over the streams.
    noise : (n,) array
        Shot noise of a piece.
    """

    width: np.ndarray
    deviation: np.ndarray
    noise: np.ndarray

    def visible_from(self, index: int) -> float:
        """Shortest piece (deg) in which the ups and downs of a class exceed the noise; infinite if none."""
        seen = np.flatnonzero(self.deviation[index, 1] > self.noise)
        return float(self.width[seen[0]]) if len(seen) else float("inf")


@dataclass(frozen=True)
class Odds:
    """How common each value of a number is for two explanations.

    Attributes
    ----------
    value : (n,) array
        Values of the number.
    density : (2, n) array
        How common they are if the first, or the second, explanation is true.
    right : tuple of float
        Share of the cases of each for which the odds point the right way.
    """

    value: np.ndarray
    density: np.ndarray
    right: tuple[float, float]

    def at(self, value: float) -> float:
        """Odds of the first explanation against the second, if both were equally likely before."""
        first, second = (float(np.interp(value, self.value, d)) for d in self.density)
        return first / second


def odds(first: np.ndarray, second: np.ndarray, n: int = 400) -> Odds:
    """Odds of one number whose values (n_streams,) under two explanations are known.

    Densities are Gaussian kernels'; one stream's worth of a flat one is added, because a value that no
    stream had must not be impossible.
    """
    pooled = np.concatenate([first, second]).astype(float)
    pad = 0.05 * float(np.ptp(pooled)) or 1.0
    value = np.linspace(pooled.min() - pad, pooled.max() + pad, n)
    spread = float(np.ptp(value))
    both = (np.asarray(first, dtype=float), np.asarray(second, dtype=float))
    density = np.array([(1 - 1 / len(x)) * _kernel(x, value) + 1 / len(x) / spread for x in both])
    for_first = np.interp(pooled, value, density[0]) > np.interp(pooled, value, density[1])
    return Odds(
        value, density, (float(for_first[: len(first)].mean()), float((~for_first[len(first) :]).mean()))
    )


def _kernel(sample: np.ndarray, value: np.ndarray) -> np.ndarray:
    if np.ptp(sample) == 0:  # kernels need a scatter
        width = 0.01 * float(np.ptp(value))
        return np.exp(-0.5 * ((value - sample[0]) / width) ** 2) / (width * np.sqrt(2 * np.pi))
    return gaussian_kde(sample)(value)


def track(geometry: Geometry) -> Track:
    """The smooth stream on the sky, from the progenitor to where it ends."""
    inside = (geometry.track_theta >= 0) & (geometry.track_theta <= geometry.length)
    theta = geometry.track_theta[inside]
    return Track(
        geometry.track_ell[inside],
        geometry.track_b[inside],
        geometry.track_dist[inside],
        theta,
        geometry.smooth_density(theta),
    )


def deviations(q: np.ndarray) -> np.ndarray:
    """Root mean square of Qρ - 1 over pieces of each length of `PIECES`, (3, n): quantiles over streams.

    Parameters
    ----------
    q : (n_streams, n_bin) array
        Qρ without noise.
    """
    found = []
    for size in (size for size in PIECES if 2 * size <= q.shape[1]):
        n_piece = q.shape[1] // size
        mean = q[:, : n_piece * size].reshape(len(q), n_piece, size).mean(axis=2)
        rms = np.sqrt(((mean - 1) ** 2).mean(axis=1))
        found.append(np.quantile(rms, QUANTILES))
    return np.array(found).T


def pieces(deviation: list[np.ndarray], noise: float, width: float) -> Pieces:
    """Deviations of several classes beside the shot noise, which averages out as 1/√bins.

    Parameters
    ----------
    deviation : of each class, as `deviations` gives it.
    noise, width : of a bin (deg).
    """
    found = np.array(deviation)
    size = np.array(PIECES[: found.shape[2]], dtype=float)
    return Pieces(width * size, found, noise / np.sqrt(size))


def stars_per_bin(noise: float) -> float:
    """Stars counted in one bin if the shot noise is that of counting them, σ_ε = 1/√N."""
    return 1 / noise**2 if noise > 0 else float("inf")
