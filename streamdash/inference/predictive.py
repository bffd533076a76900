"""What streams of a posterior look like, beside the data that it was inferred from."""

from __future__ import annotations

import numpy as np
import pandas as pd

from streamdash.inference.cells import cell_of
from streamdash.inference.posterior import Posterior
from streamdash.inference.prior_ensemble import PriorEnsemble
from streamdash.survey.design import Design, divided

BAND = (0.025, 0.16, 0.5, 0.84, 0.975)
"""Quantiles of the bands."""


def stream_weights(posterior: Posterior, truth: pd.DataFrame) -> np.ndarray:
    """How much every stream of the prior counts (n_streams,), so that they make up the posterior.

    Parameters
    ----------
    truth : true parameters, a row for every stream.
    """
    cells = tuple(
        cell_of(truth[name].to_numpy(), np.asarray(posterior.grid[name])) for name in posterior.names
    )
    weight = (posterior.p / posterior.prior)[cells]
    return weight / weight.sum()


def predictive_bands(
    posterior: Posterior, ensemble: PriorEnsemble, design: Design, clean: np.ndarray | None = None
) -> np.ndarray:
    """Quantiles `BAND` of the posterior's streams in every bin (len(BAND), n_bin), without noise.

    Parameters
    ----------
    clean : `PriorEnsemble.clean` of the design, where it is known already.
    """
    clean = ensemble.clean(design) if clean is None else clean
    return weighted_bands(divided(clean, design.fit), stream_weights(posterior, ensemble.parameters()))


def weighted_bands(profiles: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Quantiles `BAND` of weighted profiles (n, n_bin) in every bin, (len(BAND), n_bin)."""
    order = np.argsort(profiles, axis=0)
    cumulative = np.cumsum(weight[order], axis=0)
    values = np.take_along_axis(profiles, order, axis=0)
    found = [[int(np.searchsorted(column, q)) for column in cumulative.T] for q in BAND]
    rows = np.minimum(np.array(found), len(values) - 1)
    return np.stack([values[row, np.arange(values.shape[1])] for row in rows])
