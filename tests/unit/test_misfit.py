"""Sure answers that hang on an assumption about the data, found among streams that were never learnt from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from streamdash.observe.misfit import ERRORS, MISLED, SURE, WAVE
from streamdash.observe.verdict import learn
from streamdash.store.cache import Cache
from streamdash.survey.design import Design, divided, divisible, measured
from streamdash.survey.mock import mock_bins
from streamdash.survey.observed import ObservedStreams
from tests.shipped import of_default_stream

pytestmark = pytest.mark.slow  # all are about one detector, which learns for half a minute
N_KNOWN = 1400
"""Streams per class that are learnt from; the others are unseen."""


@pytest.fixture(scope="module")
def world(shipped_cache, geometry):
    """What is learnt of two classes in bins of 2° with errors of 12 %, divided by a cubic; unseen streams."""
    cache = Cache.default(shipped_cache)
    found = {e.config.population.label: e.config for e in cache.entries() if of_default_stream(e)}
    low, high = mock_bins(geometry, "phi1", 2.0)
    design = Design("phi1", low, high, np.full(len(low), 0.12), "density", 3)
    streams = ObservedStreams.read(cache, [found["1e3-1e5"], found["1e5-1e9"]], design)
    known = replace(
        streams, q=tuple(q[:N_KNOWN] for q in streams.q), draws=tuple(d[:N_KNOWN] for d in streams.draws)
    )
    return learn(known), tuple(q[N_KNOWN:] for q in streams.q)


@pytest.fixture(scope="module")
def suspected(world):
    """What is suspected of many profiles at once, and the answers to them."""
    prepared, _ = world

    def suspect(q: np.ndarray) -> tuple[list[str], np.ndarray]:
        answers = prepared.answers(q.astype(np.float32)).mean(axis=0)
        return [found.kind for found in prepared.misfit(q.astype(np.float32), answers)], answers

    return suspect


def seen(world, truth: int, factor: float = 1.0, wave: float = 0.0) -> np.ndarray:
    """Unseen streams of a class, with a wave over the survey and errors larger than stated."""
    prepared, unseen = world
    rng = np.random.default_rng([truth, 21])
    clean = unseen[truth][:300]
    along = np.arange(clean.shape[1]) / clean.shape[1]
    phase = 2 * np.pi * rng.random((len(clean), 1))
    clean = clean * (1 + wave * np.sin(2 * np.pi * 3 * along + phase)).astype(np.float32)
    draws = (factor * rng.standard_normal(clean.shape)).astype(np.float32)
    return measured(clean, draws, prepared.design.sigma, prepared.design.fit)


@pytest.mark.parametrize(("kind", "changes"), [(ERRORS, {"factor": 3.0}), (WAVE, {"wave": 0.3})])
def test_sure_wrong_answers_name_the_assumption_they_hang_on(world, suspected, kind, changes):
    kinds, answers = suspected(seen(world, 0, **changes))
    misled = (answers[:, 1] > SURE) & (answers[:, 1] > 0.95)
    assert misled.sum() > 60  # the light perturbers' streams are taken for the heavy ones'
    named = [kind for kind, wrong in zip(kinds, misled, strict=True) if wrong]
    assert np.mean([bool(name) for name in named]) > 0.75
    assert named.count(kind) > 0.6 * len(named)


def test_honest_sure_answers_are_seldom_suspected(world, suspected):
    kinds = [kind for truth in (0, 1) for kind in suspected(seen(world, truth))[0]]
    # 600 streams: three standard deviations of a binomial above the rate that is allowed for.
    assert np.mean([bool(kind) for kind in kinds]) < MISLED + 3 * np.sqrt(MISLED / 600)


def test_streams_that_would_be_refused_are_neither_learnt_from_nor_scored(world):
    """Measured, they would be divided by a polynomial of lower order."""
    prepared, _ = world
    streams, design = prepared.streams, prepared.design
    noisy = np.concatenate(streams.densities())
    fine = divisible(noisy, design.fit)
    assert fine[prepared.judged.rows].all()
    shares = [1 - fine[streams.y == c].mean() for c in range(2)]
    np.testing.assert_allclose(prepared.refused, shares)
    assert shares[0] < 0.01 < shares[1]
    # What is divided is what `ObservedStreams.observed` gives.
    np.testing.assert_allclose(divided(noisy, design.fit), streams.observed(), rtol=2e-4, atol=2e-4)
