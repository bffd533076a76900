"""How much of an answer is this one draw of the noise? The same stream, observed again.

Nobody can observe a measured stream again, and a stream that is estimated from its noisy profile is too
smooth or too rough, so that what is said of it is not what would be said of the true one. Simulated streams
can be observed again: each held-out one is observed as the profile was, more than once, with fresh noise
and divided by its own polynomial every time. That gives pairs of answers to one stream. The interval of an
answer is where the second answers lie for the held-out streams whose first answer was most like it (nearest
neighbours in the logarithms of the odds; conditional quantiles, Stone 1977, Ann. Statist. 5, 595).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import logit

from streamdash.survey.design import measured

N_OBSERVED = 5
"""Times each held-out stream is observed."""
N_NEAREST = 150
"""Pairs of answers that an interval is read from, at most; never more than a tenth of all."""
LEAST = 1e-6
"""Probabilities are told apart down to this."""


@dataclass(frozen=True, eq=False)
class Replicas:
    """Pairs of answers to the same streams; made by `learn_replicas`.

    Attributes
    ----------
    first, second : ndarray (n_pairs, n_classes)
        Probabilities from one observation of a held-out stream, and from another of the same.
    """

    first: np.ndarray
    second: np.ndarray

    def __call__(self, probability: np.ndarray) -> np.ndarray:
        """Answers (n, n_classes) that other observations gave where one gave `probability` (n_classes,)."""
        n = min(N_NEAREST, len(self.first) // 10)
        _, nearest = cKDTree(_odds(self.first)).query(_odds(probability[None])[0], k=max(n, 1))
        return self.second[np.atleast_1d(nearest)]


def learn_replicas(
    answer: Callable[[np.ndarray], np.ndarray],
    clean: np.ndarray,
    sigma: np.ndarray,
    fit: np.ndarray | None,
    seed: int = 0,
) -> Replicas:
    """Observe streams again and again, and keep what is said of each in pairs.

    Parameters
    ----------
    answer : callable
        Probabilities (n, n_classes) of profiles (n, n_bin).
    clean : ndarray (n_streams, n_bin)
        Streams that were never trained on, the same number of each class: no noise, not divided.
    sigma : ndarray (n_bin,)
        Error of each bin.
    fit : ndarray (n_bin, n_bin) or None
        `Design.fit`.
    """
    rng = np.random.default_rng([seed, 7])
    said = []
    for _ in range(N_OBSERVED):
        draws = rng.standard_normal(clean.shape, dtype=np.float32)
        said.append(answer(measured(clean, draws, sigma, fit).astype(np.float32)))
    pairs = [(i, j) for i in range(N_OBSERVED) for j in range(N_OBSERVED) if i != j]
    return Replicas(np.concatenate([said[i] for i, _ in pairs]), np.concatenate([said[j] for _, j in pairs]))


def _odds(probability: np.ndarray) -> np.ndarray:
    """Logarithm of the odds of each class (n, n_classes)."""
    return logit(np.clip(probability, LEAST, 1 - LEAST))
