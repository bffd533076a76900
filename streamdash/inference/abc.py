"""The field's way: approximate Bayesian computation on the largest scales of the power spectrum.

Simulated streams of the prior are kept if √P of the profile is near the observed one at each of the three
largest scales (Bovy, Erkal & Sanders 2017, §4–5; Banik et al. 2021); the parameters of the kept ones are
the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from streamdash.statistics.spectrum import power_spectrum

N_SCALES = 3
"""Largest scales that are compared."""
ACCEPTED = 0.01
"""Share of the simulated streams that is kept."""
SMOOTHING = 0.05
"""Width of the Gaussian that smooths the kept parameters, as a share of the prior's range."""


@dataclass(frozen=True, eq=False)
class Abc:
    """Accepts the nearest streams of a reference table.

    Attributes
    ----------
    summary : ndarray (n, N_SCALES)
        ln √P of the reference streams at the largest scales.
    truth : ndarray (n,)
        Their parameter.
    edges : ndarray (n_cell + 1,)
        Even cells that the posterior is given in.
    """

    summary: np.ndarray
    truth: np.ndarray
    edges: np.ndarray

    @classmethod
    def of(cls, q: np.ndarray, truth: np.ndarray, edges: np.ndarray, step: float) -> Abc:
        """From observed streams of the prior (n, n_bin), bins `step` apart."""
        return cls(largest_scales(q, step), truth, edges)

    def posterior(self, q: np.ndarray, step: float) -> np.ndarray:
        """Probability of every cell for observed profiles, (n, n_cell)."""
        scale = self.summary.std(axis=0)
        n_kept = max(20, int(ACCEPTED * len(self.summary)))
        n_cell = len(self.edges) - 1
        found = np.empty((len(q), n_cell))
        for i, one in enumerate(largest_scales(q, step)):
            # The tolerance on each scale is as wide as keeps that many.
            distance = np.abs((self.summary - one) / scale).max(axis=1)
            kept = self.truth[np.argpartition(distance, n_kept)[:n_kept]]
            counts = np.histogram(kept, self.edges)[0].astype(float)
            found[i] = gaussian_filter1d(counts, SMOOTHING * n_cell, mode="reflect")
        found = np.maximum(found, 1e-6)
        return found / found.sum(axis=1, keepdims=True)


def largest_scales(q: np.ndarray, step: float) -> np.ndarray:
    """ln √P at the largest scales, (n, N_SCALES)."""
    power = power_spectrum(q, step)[1][:, :N_SCALES]
    return 0.5 * np.log(power + 1e-9)
