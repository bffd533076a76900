"""Posteriors made as wide as they should be: by the ranks of true values among streams held back.

Where the posterior probability below the truth is not uniform over streams (Talts et al. 2018,
arXiv:1804.06788), the curve of its cumulative distribution takes stated probabilities to true ones. A beta
distribution, fitted to the ranks, says how: it holds a posterior that is too narrow, too wide or shifted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from streamdash.inference.posterior import cumulative

NODES = np.linspace(0, 1, 65)
"""Stated probabilities at which a curve is kept; 0 and 1 are themselves."""
ROUNDS = 3
"""Marginals of several parameters are put right one after the other, so many times."""
INSIDE = 1e-4
"""Ranks count as no nearer to 0 and 1 than this, where the beta distribution may have no density."""


def curve_of(rank: np.ndarray) -> np.ndarray:
    """True probability at each of `NODES`, from the ranks of true values (n,)."""
    a, b, _, _ = stats.beta.fit(np.clip(rank, INSIDE, 1 - INSIDE), floc=0, fscale=1)
    return np.asarray(stats.beta.cdf(NODES, a, b))


def calibrated(p: np.ndarray, curves: Sequence[np.ndarray]) -> np.ndarray:
    """Posteriors (n, *cells) with the marginal of each parameter put right by its curve."""
    axes = range(1, p.ndim)
    wanted = {axis: _through(_marginal(p, axis), curves[axis - 1]) for axis in axes}
    for _ in range(1 if p.ndim == 2 else ROUNDS):
        for axis, marginal in wanted.items():
            now = _marginal(p, axis)
            share = marginal / np.maximum(now, 1e-30)
            p = p * share.reshape([len(p), *(p.shape[i] if i == axis else 1 for i in axes)])
    return np.asarray(p / p.reshape(len(p), -1).sum(axis=1).reshape(-1, *(1 for _ in axes)))


def _marginal(p: np.ndarray, axis: int) -> np.ndarray:
    return np.asarray(p.sum(axis=tuple(i for i in range(1, p.ndim) if i != axis)))


def _through(p: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Cells (n, n_cell) whose cumulative probability is taken through a curve."""
    return np.diff(np.interp(cumulative(p), NODES, curve), axis=-1)
