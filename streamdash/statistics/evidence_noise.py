"""The evidence against the shot noise: up to which noise one stream would speak at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.statistics.evidence import Rules, measured_evidence

NOISES = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
"""Shot noise σ_ε at which the evidence is computed."""


@dataclass(frozen=True)
class AgainstNoise:
    """Σ ln B of a fiducial model against another one at each noise.

    Attributes
    ----------
    noise, value, low, high : (n_noise,) arrays
        σ_ε, the sum over the bins that count, and the ends of its method error.
    n_kept : (n_noise,) array
        How many bins count.
    """

    noise: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    n_kept: np.ndarray


def against_noise(
    noisy: Callable[[float], Sequence[np.ndarray]],
    n_bin: int,
    rules: Rules | None,
    fiducial: int,
    noises: Sequence[float] = NOISES,
) -> dict[int, AgainstNoise]:
    """Σ ln B for a fiducial model against each other one, at several noises.

    Parameters
    ----------
    noisy
        Called with σ_ε; returns Qρ with that noise of every class, (n_streams, n_longitudes).
    n_bin
        Number of bins in Qρ.
    rules
        Which bins count.
    fiducial
        Number of the model that the data are assumed to come from.
    noises
        Values of σ_ε.

    Returns
    -------
    dict of int to AgainstNoise
        By the number of the other model.
    """
    rows: dict[int, list[tuple[float, float, float, float]]] = {}
    for noise in noises:
        pdfs, evidence = measured_evidence(noisy(noise), noise, n_bin, rules)
        for j in range(pdfs.n_models):
            if j != fiducial:
                total = evidence.cumulative(fiducial, fiducial, j)
                rows.setdefault(j, []).append((total.value, total.low, total.high, float(total.n_kept)))
    found = {}
    for j, values in rows.items():
        value, low, high, kept = np.array(values, dtype=float).T
        found[j] = AgainstNoise(np.asarray(noises, dtype=float), value, low, high, kept.astype(int))
    return found
