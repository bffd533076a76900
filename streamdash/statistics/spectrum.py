"""Power and cross spectra along a stream, in the conventions of Bovy, Erkal & Sanders (2017).

Of fluctuations x and y on n points a step Δ apart (appendices A and B of the paper):

    P_xy(k) = (n - 1) Δ · csd_xy(k),

with `scipy.signal.csd` over the whole stream: mean removed, Hann window, one-sided, ``spectrum``
scaling. Times the stream's length, noise has the same P however long the stream is. Shown is √|P|
against 1/k in degrees, the median over streams and the band of 68 % of them. The unit of P is that
of the axis: deg along longitude, rad along parallel angle, as in BES17's figures.

Qρ = ρ/ρ̄ is the fluctuation of the density, ⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩ that of the track in parallel frequency.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from scipy import signal

from streamdash.engine.geometry import Geometry
from streamdash.survey.bands import BAND
from streamdash.survey.observed import ObservedStreams
from streamdash.survey.sky import Coordinate, observe

WINDOW = "hann"
"""Taper of the profiles before they are transformed."""
SMALLEST_SCALE = 1.0
"""Smallest 1/k that is kept and shown (deg)."""
N_DRAWS = 1000
"""Gaussian draws behind the level of shot noise (paper, appendix B)."""
KINDS = ("density", "track", "cross")
"""Spectra of Qρ, of the track ⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩, and of one with the other."""


@dataclass(frozen=True)
class SpectrumBand:
    """√|P| over streams at each scale; arrays of shape (n_scale,).

    Attributes
    ----------
    scale : 1/k in deg, decreasing.
    low, median, high : quantiles of √|P| (deg^½, or rad^½ for spectra along θ∥).
    n_streams : number of streams behind them.
    """

    scale: np.ndarray
    low: np.ndarray
    median: np.ndarray
    high: np.ndarray
    n_streams: int

    @property
    def half_width(self) -> np.ndarray:
        """Half the width of the band: the scatter from stream to stream."""
        return 0.5 * (self.high - self.low)


def cross_spectrum(
    first: np.ndarray, second: np.ndarray, step: float, window: str = WINDOW
) -> tuple[np.ndarray, np.ndarray]:
    """Cross spectra P_xy(k) of profiles on evenly spaced points.

    Parameters
    ----------
    first, second : (..., n) arrays
        A profile with a value that is not finite has a spectrum of NaN.
    step : distance of two points.
    window : taper, by its name in scipy.

    Returns
    -------
    k : (n_k,) array
        Inverse wavelengths, cycles per unit of `step`; without k = 0.
    power : (..., n_k) array
        Complex unless `first` is `second`. Unit of the profiles' product, times that of `step`.
    """
    if first.shape[-1] != second.shape[-1] or first.shape[-1] < 3:
        raise ValueError("spectra need two profiles on the same three or more points")
    n = first.shape[-1]
    k, power = signal.csd(
        first, second, fs=1.0 / step, window=window, nperseg=n, detrend="constant", scaling="spectrum"
    )
    power = power.real if first is second else power
    return k[1:], power[..., 1:] * ((n - 1) * step)


def power_spectrum(values: np.ndarray, step: float, window: str = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """Power spectra P(k) of profiles; as `cross_spectrum` of each with itself, real.

    Examples
    --------
    A wave of 12 deg along 60 deg has its power at 1/k = 12 deg.

    >>> place = np.arange(300) * 0.2
    >>> k, power = power_spectrum(np.sin(2 * np.pi * place / 12), 0.2)
    >>> round(float(1 / k[power.argmax()]), 6)
    12.0
    """
    return cross_spectrum(values, values, step, window)


def band_of(k: np.ndarray, power: np.ndarray, degrees: float = 1.0) -> SpectrumBand:
    """Median and band of √|P| over streams, from 1/k of `SMALLEST_SCALE` upwards.

    Parameters
    ----------
    k : (n_k,) array
    power : (n_streams, n_k) array
        Spectra of NaN do not count.
    degrees : length of the unit of 1/k in degrees.
    """
    kept = scales_kept(k, degrees)
    power = np.abs(power[np.isfinite(power[:, 0])][:, kept])
    if not len(power):
        raise ValueError("no stream has a spectrum: all have stretches without stars")
    low, median, high = np.sqrt(np.quantile(power, BAND, axis=0))
    return SpectrumBand(degrees / k[kept], low, median, high, len(power))


def scales_kept(k: np.ndarray, degrees: float = 1.0) -> np.ndarray:
    """Which wavenumbers are shown, (n_k,) of bool."""
    return degrees / k >= SMALLEST_SCALE * (1 - 1e-9)


# ---------------------------------------------------------------- spectra that follow the noise


@dataclass(frozen=True)
class NoisySpectra:
    """Spectra of one ensemble's streams at any level of shot noise.

    The transform is linear, so a stream's spectrum is a polynomial in σ_ε, whose coefficients are
    computed once: P(σ) = clean + σ · mixed + σ² · noise.

    Attributes
    ----------
    scale : (n_scale,) array
        1/k in deg, decreasing.
    clean, mixed, noise : (n_scale, n_streams) float32 arrays
        Of Qρ: its spectrum, twice the real cross spectrum with the noise drawn for it at
        σ_ε = 1, and that noise's own spectrum (deg).
    track : (n_scale, n_track) float32 array
        Spectrum of the track ratio, of the streams that have stars everywhere.
    cross, cross_noise : (n_scale, n_track) complex64 arrays
        Cross spectrum of Qρ, and of the noise at σ_ε = 1, with the track ratio.
    """

    scale: np.ndarray
    clean: np.ndarray
    mixed: np.ndarray
    noise: np.ndarray
    track: np.ndarray
    cross: np.ndarray
    cross_noise: np.ndarray

    def power(self, sigma: float) -> np.ndarray:
        """P(k) of Qρ of every stream with shot noise `sigma`, (n_scale, n_streams)."""
        s = np.float32(sigma)
        return self.clean + s * (self.mixed + s * self.noise)

    def band(self, kind: str, sigma: float) -> SpectrumBand:
        """Median and band over streams of one of `KINDS` at a level of shot noise."""
        if kind == "track":
            return self._track_band
        if kind == "cross":
            return _sorted_band(self.scale, np.abs(self.cross + np.float32(sigma) * self.cross_noise))
        return _sorted_band(self.scale, self.power(sigma))

    @cached_property
    def clean_band(self) -> SpectrumBand:
        """Median and band of the density without noise."""
        return self.band("density", 0.0)

    @cached_property
    def _track_band(self) -> SpectrumBand:
        return _sorted_band(self.scale, self.track)


def noisy_spectra(q: np.ndarray, draws: np.ndarray, track: np.ndarray, step: float) -> NoisySpectra:
    """Spectra of an ensemble in evenly spaced bins, ready for any shot noise.

    Parameters
    ----------
    q, draws, track : (n_streams, n_bin) arrays
        Qρ without noise, its standard-normal draws, and the track ratio (NaN without stars).
    step : width of a bin (deg).
    """
    k, clean = power_spectrum(q, step)
    kept = scales_kept(k)
    known = np.isfinite(track).all(axis=1)

    def columns(power: np.ndarray, dtype: str = "float32") -> np.ndarray:
        return np.ascontiguousarray(power[:, kept].T, dtype=dtype)

    return NoisySpectra(
        scale=1.0 / k[kept],
        clean=columns(clean),
        mixed=columns(2 * cross_spectrum(q, draws, step)[1].real),
        noise=columns(power_spectrum(draws, step)[1]),
        track=columns(power_spectrum(track[known], step)[1]),
        cross=columns(cross_spectrum(q[known], track[known], step)[1], "complex64"),
        cross_noise=columns(cross_spectrum(draws[known], track[known], step)[1], "complex64"),
    )


def observed_spectra(geometry: Geometry, ensemble: xr.Dataset, streams: ObservedStreams) -> NoisySpectra:
    """`noisy_spectra` of one class, in evenly spaced bins.

    Parameters
    ----------
    ensemble : Dataset as `streamdash.store.cache.Cache.open_ensemble` gives it.
    streams : the same ensemble as it is observed, and nothing else.
    """
    (q,), (draws,), design = streams.q, streams.draws, streams.design
    track = track_ratio(geometry, ensemble, design.edges, design.coordinate)
    return noisy_spectra(q, draws, track, design.step)


def track_ratio(
    geometry: Geometry, ensemble: xr.Dataset, edges: np.ndarray, coordinate: Coordinate = "ell"
) -> np.ndarray:
    """⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩ per bin along the stream, (n_streams, n_bin) float32.

    A stream without stars at some angle has no track there, and a row of NaN here.
    """
    theta = ensemble.theta.values
    smooth = observe(geometry, theta, ensemble.omega_smooth.values, edges, coordinate)
    return (observe(geometry, theta, ensemble.omega.values, edges, coordinate) / smooth).astype("float32")


def shot_noise_level(
    n_bin: int, step: float, sigma: float = 1.0, n_draws: int = N_DRAWS, seed: int = 0
) -> SpectrumBand:
    """√P of nothing but shot noise: median and band of Gaussian draws (paper, appendix B).

    Parameters
    ----------
    n_bin, step : number and width (deg) of the bins.
    sigma : σ_ε per bin; the level is proportional to it.
    """
    draws = sigma * np.random.default_rng(seed).standard_normal((n_draws, n_bin))
    return band_of(*power_spectrum(draws, step))


def _sorted_band(scale: np.ndarray, power: np.ndarray) -> SpectrumBand:
    """Band of spectra (n_scale, n_streams) without NaN; a few milliseconds for 2,000 streams."""
    ordered = np.sort(power, axis=1)
    position = np.asarray(BAND) * (ordered.shape[1] - 1)
    below = position.astype(int)
    above = np.minimum(below + 1, ordered.shape[1] - 1)
    weight = position - below
    low, median, high = np.sqrt(
        np.maximum(ordered[:, below] * (1 - weight) + ordered[:, above] * weight, 0)
    ).T
    return SpectrumBand(scale, low, median, high, ordered.shape[1])
