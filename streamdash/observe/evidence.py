"""PDF evidence for one measured profile: which class makes its distribution of Qρ most probable?

The paper's observable, PDF(Qρ) (§3.1.1), for data with errors: each measured value is spread over
the bins α as a Gaussian of its own error, so that y_α of data and of simulations blur alike, and the
simulations carry the same noise. The paper compares models by the overlap of Π(y_α|M) (equation 5);
with data the integral becomes the likelihood of the vector y that was measured,

    ln L_M = −½ [(y − μ_M)ᵀ C_M⁻¹ (y − μ_M) + ln |2π C_M|],

with the mean μ_M and covariance C_M of y over the streams of M (a synthetic likelihood, Wood 2010):
correlations between bins are included, so that nothing is counted twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from streamdash.statistics.evidence import jeffreys

N_BIN = 10
"""Bins of Qρ: a few dozen values fill no more."""
TAIL = 0.005
"""Share of all simulated values in each of the two outer bins at least."""
N_BOOTSTRAP = 50
RIDGE = 1e-3
"""Added to the variances of y, relative: what never varies in the simulations proves nothing."""


@dataclass(frozen=True, eq=False)
class PdfEvidence:
    """Evidence for each class from a measured PDF(Qρ).

    Attributes
    ----------
    ln_bayes : ndarray (n_classes,)
        ln of each class's likelihood over that of the best one; 0 for the best.
    error : ndarray (n_classes,)
        Its standard deviation over resamplings of the simulated streams.
    accuracy : float
        Share of held-out streams for which the class with the highest likelihood is the true one.
    """

    ln_bayes: np.ndarray
    error: np.ndarray
    accuracy: float

    @property
    def words(self) -> list[str]:
        """Jeffreys' word for the evidence against each class; empty for the best."""
        return ["" if value == 0 else jeffreys(value) for value in self.ln_bayes]


@dataclass(frozen=True, eq=False)
class PdfJudge:
    """PDF(Qρ) of every class in one design; made by `learn_pdfs`.

    Attributes
    ----------
    edges : ndarray (N_BIN + 1,)
        Edges of the bins α; the outer ones are open.
    sigma : ndarray (n_bin,)
        Error of each bin of the profile.
    y : tuple of ndarray (n_streams, N_BIN)
        y_α of the streams of each class.
    accuracy : float
        On held-out streams.
    """

    edges: np.ndarray
    sigma: np.ndarray
    y: tuple[np.ndarray, ...]
    accuracy: float = float("nan")

    def __call__(self, q: np.ndarray, seed: int = 0) -> PdfEvidence:
        """Evidence for one profile (n_bin,)."""
        measured = blurred_pdf(q[None], self.sigma, self.edges)
        values = self.ln_likelihood(measured)[0]
        rng = np.random.default_rng([seed, 6])
        samples = []
        for _ in range(N_BOOTSTRAP):
            again = tuple(y[rng.integers(len(y), size=len(y))] for y in self.y)
            samples.append(_ln_likelihood(measured, again)[0])
        best = int(np.argmax(values))
        spread = np.array(samples)
        return PdfEvidence(values - values[best], (spread - spread[:, [best]]).std(axis=0), self.accuracy)

    def ln_likelihood(self, y: np.ndarray) -> np.ndarray:
        """ln L of measured y (n_profiles, N_BIN) for every class (n_profiles, n_classes)."""
        return _ln_likelihood(y, self.y)


def learn_pdfs(
    q: np.ndarray, truth: np.ndarray, sigma: np.ndarray, known: np.ndarray, held_out: np.ndarray
) -> PdfJudge:
    """Measure PDF(Qρ) of every class, and how often it identifies held-out streams.

    Parameters
    ----------
    q : ndarray (n_streams, n_bin)
        Streams with noise, divided.
    truth : ndarray (n_streams,) of int
        Their classes.
    sigma : ndarray (n_bin,)
        Error of each bin.
    known, held_out : ndarray of int
        Rows to learn from and to judge by.
    """
    low, high = np.quantile(q[known], (TAIL, 1 - TAIL))
    edges = np.linspace(low, max(high, low + 1e-6), N_BIN - 1)
    edges = np.concatenate([[-np.inf], edges, [np.inf]])
    y = blurred_pdf(q, sigma, edges)
    classes = tuple(y[known[truth[known] == c]] for c in range(int(truth.max()) + 1))
    said = _ln_likelihood(y[held_out], classes).argmax(axis=1)
    return PdfJudge(edges, sigma, classes, float(np.mean(said == truth[held_out])))


def blurred_pdf(q: np.ndarray, sigma: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Share of a profile in each bin α, each value spread by its error (n_profiles, N_BIN).

    Parameters
    ----------
    q : ndarray (n_profiles, n_bin)
    sigma : ndarray (n_bin,)
    edges : ndarray (N_BIN + 1,)
        The outer ones infinite.
    """
    below = np.empty((len(q), len(edges)))
    below[:, 0], below[:, -1] = 0.0, 1.0
    for a, edge in enumerate(edges[1:-1], start=1):
        below[:, a] = ndtr((edge - q) / sigma).mean(axis=1)
    return np.diff(below, axis=1)


def _ln_likelihood(y: np.ndarray, classes: tuple[np.ndarray, ...]) -> np.ndarray:
    # The shares add up to one: the last says nothing new.
    columns = []
    pooled = np.concatenate(classes)[:, :-1].var(axis=0)
    for streams in classes:
        mean = streams[:, :-1].mean(axis=0)
        spread = np.cov(streams[:, :-1], rowvar=False) + np.diag(RIDGE * pooled + 1e-12)
        off = y[:, :-1] - mean
        size = np.linalg.slogdet(2 * np.pi * spread)[1]
        columns.append(-0.5 * (np.einsum("ni,ni->n", off, np.linalg.solve(spread, off.T).T) + size))
    return np.stack(columns, axis=1)
