"""Streams of any profiles at all, as if they had been simulated and observed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streamdash.config import EnsembleConfig, Perturbers
from streamdash.survey.design import Design
from streamdash.survey.observed import ObservedStreams


def observed(
    q: Sequence[np.ndarray],
    draws: Sequence[np.ndarray],
    masses: Sequence[str],
    edges: np.ndarray | None = None,
    n_impacts: tuple[np.ndarray, ...] = (),
) -> ObservedStreams:
    """Classes of some masses from their profiles (n_streams, n_bin) and noise draws.

    Parameters
    ----------
    edges : of the bins in degrees; around 0, 1, 2, … by default.
    """
    edges = np.arange(q[0].shape[-1] + 1) - 0.5 if edges is None else edges
    configs = tuple(EnsembleConfig(perturbers=Perturbers(mass_range=mass)) for mass in masses)
    return ObservedStreams(configs, Design.adjoining("ell", edges), tuple(q), tuple(draws), n_impacts)
