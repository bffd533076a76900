"""Spectra of an ensemble along parallel angle: small enough to keep when the ensemble is not.

These are the spectra of the convergence tests (paper, appendix A), P in rad as in BES17's figures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from streamdash.statistics.spectrum import (
    KINDS,
    SpectrumBand,
    band_of,
    cross_spectrum,
    power_spectrum,
    scales_kept,
)

STATISTICS = ("low", "median", "high", "error")


@dataclass(frozen=True)
class ThetaSpectra:
    """Density, track and cross spectrum of an ensemble along θ∥.

    Attributes
    ----------
    bands : by kind, median and band of √|P| (rad^½) over streams.
    errors : by kind, standard error of the median at each scale (rad^½).
    mean_impacts : impacts per stream.
    cost_s : core seconds of the ensemble and its spectra; 0 when not known.
    """

    bands: Mapping[str, SpectrumBand]
    errors: Mapping[str, np.ndarray]
    mean_impacts: float
    cost_s: float = 0.0

    @property
    def scale(self) -> np.ndarray:
        """1/k in deg, decreasing."""
        return self.bands["density"].scale

    def to_dataset(self) -> xr.Dataset:
        """As plain numbers, for the cache."""
        values = [[band.low, band.median, band.high, self.errors[kind]] for kind, band in self.bands.items()]
        counts = {f"n_{kind}": band.n_streams for kind, band in self.bands.items()}
        return xr.Dataset(
            {
                "scale": ("scale", self.scale),
                "sqrt_power": (("kind", "statistic", "scale"), np.array(values, dtype="float32")),
            },
            attrs={**counts, "mean_impacts": self.mean_impacts, "cost_s": self.cost_s},
        )

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset) -> ThetaSpectra:
        """Rebuild from `to_dataset`.

        Raises
        ------
        ValueError
            When something is missing or of the wrong shape.
        """
        try:
            scale = np.asarray(dataset["scale"].values, dtype=float)
            values = np.asarray(dataset["sqrt_power"].values, dtype=float)
            counts = [int(dataset.attrs[f"n_{kind}"]) for kind in KINDS]
            impacts, cost = float(dataset.attrs["mean_impacts"]), float(dataset.attrs["cost_s"])
        except KeyError as error:
            raise ValueError(f"spectra have no {error.args[0]}") from None
        if values.shape != (len(KINDS), len(STATISTICS), len(scale)):
            raise ValueError(f"spectra have the shape {values.shape}")
        bands = {
            kind: SpectrumBand(scale, low, median, high, count)
            for kind, (low, median, high, _), count in zip(KINDS, values, counts, strict=True)
        }
        return cls(bands, {kind: part[3] for kind, part in zip(KINDS, values, strict=True)}, impacts, cost)


def theta_spectra(ensemble: xr.Dataset, cost_s: float = 0.0) -> ThetaSpectra:
    """Spectra along θ∥ of the streams of an ensemble.

    Parameters
    ----------
    ensemble : Dataset as `streamdash.store.cache.Cache.open_ensemble` gives it.
    cost_s : core seconds it took.

    Raises
    ------
    ValueError
        When there are fewer than two streams with stars everywhere.
    """
    theta = ensemble.theta.values
    step, degrees = float(theta[1] - theta[0]), float(np.degrees(1.0))
    density = ensemble.density.values / ensemble.smooth.values
    track = ensemble.omega.values / ensemble.omega_smooth.values
    spectra = {
        "density": power_spectrum(density, step),
        "track": power_spectrum(track, step),
        "cross": cross_spectrum(density, track, step),
    }
    bands = {kind: band_of(k, power, degrees) for kind, (k, power) in spectra.items()}
    errors = {kind: median_error(k, power, degrees) for kind, (k, power) in spectra.items()}
    return ThetaSpectra(bands, errors, float(ensemble.n_impacts.mean()), cost_s)


def median_error(k: np.ndarray, power: np.ndarray, degrees: float) -> np.ndarray:
    """Standard error of the median of √|P| over streams, whatever its distribution, (n_scale,).

    Half the distance of the order statistics one binomial standard deviation either side of the
    median, the distribution-free 68 % interval of a median.
    """
    power = np.abs(power[np.isfinite(power[:, 0])][:, scales_kept(k, degrees)])
    if len(power) < 2:
        raise ValueError("the error of a median needs at least two streams with stars everywhere")
    half = min(0.5 / np.sqrt(len(power)), 0.5)
    low, high = np.sqrt(np.quantile(power, (0.5 - half, 0.5 + half), axis=0))
    return 0.5 * (high - low)
