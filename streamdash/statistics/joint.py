"""Cumulative evidence that does not ignore the correlations between bins α.

The paper sums ln B over bins as if they were independent, and calls the sum an upper limit.
Here the bins are treated together, in two ways that share the paper's definition
E^{fid i}_j = ∫ Π(y|M_i) Π(y|M_j) dy (equation 5), now with the vector y of all kept bins:

`decorrelated`
    A linear change of variables multiplies every E by the same factor, so that ln B does not
    feel it. For two models there is always one linear change that makes *both* covariance
    matrices diagonal (the generalised eigenvectors of the two). In these components no linear
    correlation is left in either model, and the paper's own estimator, histograms and trapezoidal
    rule (without a stream's pairing with itself), is applied to each component and summed. Exact
    where uncorrelated means independent, as for any two Gaussians; the shape of each component's
    distribution is kept; dependence beyond linear correlation is still ignored.

`gaussian`
    Both models replaced by Gaussians of the same mean and covariance, for which the integral is
    known: a check of the former that has no histograms in it,

    ln B^{fid i}_ij = ½ ln(|C_i + C_j| / |2 C_i|) + ½ Δᵀ (C_i + C_j)⁻¹ Δ,   Δ = ⟨y⟩_i − ⟨y⟩_j.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamdash.statistics.evidence import jeffreys
from streamdash.statistics.overlap import Y_BINS, overlap_integrals
from streamdash.statistics.pdf import QUANTILES

JOINT_Y_BINS = Y_BINS[::5]
"""Numbers of bins per component: 10, 60, …, 460. The full set changes the sum by less than its spread."""
RANK_TOLERANCE = 1e-9
"""Directions whose mean variance in the two models, relative to each bin's own, is below this are dropped."""


@dataclass(frozen=True)
class JointEvidence:
    """Evidence from all kept bins α together, for the fiducial that is also the numerator.

    Attributes
    ----------
    value : float
        ln B^{fid i}_ij, summed over decorrelated components.
    low, high : float
        Interquantile range over the numbers of bins per component: the method error.
    gaussian : float
        The same for Gaussians of equal means and covariances.
    n_components : int
        Number of components in the sum; 0 means that nothing could be compared.
    n_unresolved : int
        Components in which the two distributions share no bin when bins are narrow: taken from the
        numbers of bins at which they do, or left out if there is none. With any of them `value` depends
        on the noise draw by more than its error says; it is no limit in either direction.
    """

    value: float
    low: float
    high: float
    gaussian: float
    n_components: int
    n_unresolved: int

    @property
    def word(self) -> str:
        """Jeffreys' word for the value."""
        return jeffreys(self.value) if self.n_components else "no bins"


def joint_evidence(
    y_i: np.ndarray, y_j: np.ndarray, kept: np.ndarray, y_bins: tuple[int, ...] = JOINT_Y_BINS
) -> tuple[JointEvidence, JointEvidence]:
    """Evidence of models i and j from all kept bins together, correlations included.

    Parameters
    ----------
    y_i, y_j : ndarray (n_streams_i, n_bin), (n_streams_j, n_bin)
        PDF(Qρ) of the streams of the two models.
    kept : ndarray of bool (n_bin,)
        Bins α to use (`Evidence.kept`).
    y_bins : tuple of int
        Numbers of bins per component that are marginalised over.

    Returns
    -------
    (JointEvidence, JointEvidence)
        ln B_ij for fiducial i, and ln B_ji for fiducial j.
    """
    transform = decorrelate(y_i[:, kept], y_j[:, kept])
    z_i, z_j = transform(y_i[:, kept]), transform(y_j[:, kept])
    if z_i.shape[1] == 0:
        nothing = JointEvidence(0.0, 0.0, 0.0, 0.0, 0, 0)
        return nothing, nothing
    # Without self-pairs: their small excess in E_ii would add up over the components.
    integrals = overlap_integrals([np.sort(z.T, axis=1) for z in (z_i, z_j)], y_bins, self_pairs=False)
    resolved = np.all(integrals > 0, axis=(1, 2))
    logs = np.log(np.where(resolved[:, None, None], integrals, np.nan))
    return (
        _summed(logs[:, 0, 0] - logs[:, 0, 1], gaussian_ln_bayes(z_i, z_j)),
        _summed(logs[:, 1, 1] - logs[:, 1, 0], gaussian_ln_bayes(z_j, z_i)),
    )


@dataclass(frozen=True)
class Decorrelation:
    """A linear change of variables in which two samples are uncorrelated, each within itself.

    Attributes
    ----------
    middle : ndarray (n_bin,)
        Midway between the two means.
    matrix : ndarray (n_bin, n_components)
    """

    middle: np.ndarray
    matrix: np.ndarray

    def __call__(self, y: np.ndarray) -> np.ndarray:
        """Components (n_streams, n_components) of densities (n_streams, n_bin)."""
        return (y - self.middle) @ self.matrix


def decorrelate(y_i: np.ndarray, y_j: np.ndarray) -> Decorrelation:
    """The change of variables after which two samples are uncorrelated within each of them.

    Parameters
    ----------
    y_i, y_j : ndarray (n_streams_i, n_bin), (n_streams_j, n_bin)

    Returns
    -------
    Decorrelation
        Of the components that it gives, the mean of the two covariance matrices is the unit matrix
        and each is diagonal. There are fewer components than bins where bins are linear functions of
        others, as they are when the bins hold all the probability.
    """
    n_bin = y_i.shape[1]
    middle = 0.5 * (y_i.mean(axis=0) + y_j.mean(axis=0)) if n_bin else np.zeros(0)
    matrix = np.zeros((n_bin, 0))
    if n_bin == 0 or min(len(y_i), len(y_j)) < 2:
        return Decorrelation(middle, matrix)
    c_i, c_j = (np.atleast_2d(np.cov(y, rowvar=False)) for y in (y_i, y_j))
    # Bins differ in scale by orders of magnitude: rank is judged on unit variances.
    scale = np.sqrt(0.5 * (np.diag(c_i) + np.diag(c_j)))
    usable = scale > 0
    scale = scale[usable]
    c_i, c_j = (c[np.ix_(usable, usable)] / np.outer(scale, scale) for c in (c_i, c_j))
    power, axes = np.linalg.eigh(0.5 * (c_i + c_j))
    full = power > RANK_TOLERANCE * power.max(initial=0.0)
    whiten = axes[:, full] / np.sqrt(power[full])
    _, rotate = np.linalg.eigh(whiten.T @ c_i @ whiten)
    matrix = np.zeros((n_bin, int(full.sum())))
    matrix[usable] = (whiten / scale[:, None]) @ rotate
    return Decorrelation(middle, matrix)


def gaussian_ln_bayes(z_i: np.ndarray, z_j: np.ndarray) -> float:
    """ln B^{fid i}_ij for Gaussians with the means and variances of uncorrelated components.

    Parameters
    ----------
    z_i, z_j : ndarray (n_streams_i, n_components), (n_streams_j, n_components)
        From `decorrelate`.

    Returns
    -------
    float
        NaN where a component does not vary in one of the models: there are too few streams.
    """
    v_i, v_j = z_i.var(axis=0, ddof=1), z_j.var(axis=0, ddof=1)
    delta = z_i.mean(axis=0) - z_j.mean(axis=0)
    if min(v_i.min(), v_j.min()) <= RANK_TOLERANCE:
        return float("nan")
    return float(0.5 * np.sum(np.log((v_i + v_j) / (2 * v_i)) + delta**2 / (v_i + v_j)))


def _summed(by_y_bins: np.ndarray, gaussian: float) -> JointEvidence:
    """Sum over components of ln B (n_y_bins, n_components), NaN where the two models do not overlap."""
    missing = np.isnan(by_y_bins)
    usable = ~missing.all(axis=0)
    found = by_y_bins[:, usable]
    medians = np.nanmedian(found, axis=0)
    low, high = np.quantile(np.where(np.isnan(found), medians, found).sum(axis=1), QUANTILES[::2])
    return JointEvidence(
        value=float(medians.sum()),
        low=float(low),
        high=float(high),
        gaussian=gaussian,
        n_components=int(usable.sum()),
        n_unresolved=int(missing.any(axis=0).sum()),
    )
