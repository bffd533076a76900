"""How much of an answer is this one draw of the noise? The same stream, observed again and again.

Adding noise to a profile that has its own already would observe it at worse quality than it was, and
noise looks like perturbers. So the stream behind the profile is estimated first, by Wiener's filter

    x̂ = μ_c + S_c (S_c + N)⁻¹ (q − μ_c),

with mean μ_c and covariance S_c of the noiseless streams of a class and N the errors squared; then it
is observed with fresh noise. Classes take part by the probability that was found for them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Replicas:
    """Observes the stream behind a profile anew; made by `learn_replicas`.

    Attributes
    ----------
    means : tuple of ndarray (n_bin,)
        Mean noiseless profile of each class.
    filters : tuple of ndarray (n_bin, n_bin)
        S (S + N)⁻¹ of each class.
    sigma : ndarray (n_bin,)
        Error of each bin.
    """

    means: tuple[np.ndarray, ...]
    filters: tuple[np.ndarray, ...]
    sigma: np.ndarray

    def __call__(self, q: np.ndarray, probability: np.ndarray, n: int, seed: int = 0) -> np.ndarray:
        """Replicas (n, n_bin) of a profile q (n_bin,) of which the classes have some probability."""
        rng = np.random.default_rng([seed, 7])
        # The same share of draws as of probability, without the scatter of drawing classes too.
        owner = np.searchsorted(np.cumsum(probability)[:-1], (np.arange(n) + 0.5) / n)
        streams = np.stack(
            [mean + matrix @ (q - mean) for mean, matrix in zip(self.means, self.filters, strict=True)]
        )
        return (streams[owner] + self.sigma * rng.standard_normal((n, len(q)))).astype(np.float32)


def learn_replicas(clean: np.ndarray, truth: np.ndarray, sigma: np.ndarray) -> Replicas:
    """Mean and filter of each class.

    Parameters
    ----------
    clean : ndarray (n_streams, n_bin)
        Noiseless streams, divided.
    truth : ndarray (n_streams,) of int
        Their classes.
    sigma : ndarray (n_bin,)
        Error of each bin.
    """
    means, filters = [], []
    for c in range(int(truth.max()) + 1):
        members = clean[truth == c].astype(float)
        spread = np.cov(members, rowvar=False)
        means.append(members.mean(axis=0))
        filters.append(np.linalg.solve(spread + np.diag(sigma**2), spread).T)
    return Replicas(tuple(means), tuple(filters), sigma)
