"""Is any perturbation seen at all? A measured profile against smooth streams observed in the same way."""

from __future__ import annotations

import numpy as np

from streamdash.observe.observation import Observation
from streamdash.survey.design import measured

DETECTED = 0.01
"""Below this p-value a profile is not what a smooth stream would be."""
N_SMOOTH = 4000
"""Smooth streams that a profile is compared with."""
WIDTHS = (1, 2, 4, 8)
"""Numbers of neighbouring bins over which departures are summed before they are squared."""


def smooth_p(observation: Observation, seed: int = 0) -> float:
    """How often a smooth stream, observed like this profile, departs from 1 as much or more.

    Smooth streams get the stated errors and the same division by a polynomial. Departures are summed
    over `WIDTHS` neighbouring bins, so that broad waves count as well as single bins; what stands out
    most of these is compared with what stands out most in each smooth stream.

    Returns
    -------
    float
        p-value, at least 1 / (`N_SMOOTH` + 1).
    """
    design = observation.design
    rng = np.random.default_rng(seed)
    draws = rng.standard_normal((N_SMOOTH, design.n_bin))
    smooth = measured(np.ones((N_SMOOTH, design.n_bin)), draws, design.sigma, design.fit)
    powers = _powers((np.vstack([observation.q, smooth]) - 1) / design.sigma)
    middle, spread = powers[1:].mean(axis=0), powers[1:].std(axis=0)
    outstanding = ((powers - middle) / spread).max(axis=1)
    return float((1 + np.count_nonzero(outstanding[1:] >= outstanding[0])) / (N_SMOOTH + 1))


def _powers(departures: np.ndarray) -> np.ndarray:
    """Sum of squares of running sums of each width, (n_profiles, n_widths)."""
    n_bin = departures.shape[1]
    total = np.pad(np.cumsum(departures, axis=1), ((0, 0), (1, 0)))
    widths = [w for w in WIDTHS if w <= n_bin]
    return np.stack([np.square(total[:, w:] - total[:, :-w]).sum(axis=1) / w for w in widths], axis=1)
