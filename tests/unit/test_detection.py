"""Is any perturbation seen? Smooth streams, divided like the data, and waves."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from streamdash.observe.detection import smooth_p
from streamdash.survey.design import AS_IS, Design, measured


@pytest.mark.parametrize("order", [AS_IS, pytest.param(0, marks=pytest.mark.slow), 3])
def test_smooth_streams_are_not_detected_and_perturbed_ones_are(order):
    n, sigma = 36, np.full(36, 0.12)
    edges = np.linspace(-80.0, -8.0, n + 1)
    design = Design("phi1", edges[:-1], edges[1:], sigma, "q_rho", order)
    rng = np.random.default_rng(5)
    smooth = measured(np.ones((300, n)), rng.standard_normal((300, n)), sigma, design.fit)
    wave = 1 + 0.3 * np.sin(2 * np.pi * np.arange(n) / 10)
    waves = measured(np.tile(wave, (30, 1)), rng.standard_normal((30, n)), sigma, design.fit)

    def p(q):
        return smooth_p(SimpleNamespace(design=design, q=q))

    ps = np.array([p(q) for q in smooth])
    assert np.mean(ps < 0.01) < 0.035  # 1 % expected: 3 of 300, at most 10
    assert 0.4 < np.mean(ps < 0.5) < 0.6
    assert np.mean([p(q) < 0.01 for q in waves]) > 0.9
