"""The classifier on the shipped streams, at the paper's noise: the targets, on streams never trained on."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.classifier.model import BEST, PAPER, PAPER_CLASSES, PAPER_SCORES
from streamdash.classifier.train import train
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams
from tests.shipped import of_default_stream

NOISE = 0.1


@pytest.fixture(scope="module")
def streams(shipped_cache):
    cache = Cache.default(shipped_cache)
    keys = {entry.config.population.label: entry.key for entry in cache.entries() if of_default_stream(entry)}
    return {
        n: ObservedStreams.read(cache, [keys[label] for label in labels])
        for n, labels in PAPER_CLASSES.items()
    }


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_two_classes_are_at_least_as_good_as_the_papers_table_2(streams, seed):
    scores = train(streams[2], NOISE, BEST.model_copy(update={"seed": seed})).scores
    assert scores.counts.sum() == 1000
    assert scores.values["overall_accuracy"] >= 0.99
    for metric in ("precision", "recall", "f1"):
        assert np.all(scores.values[metric] >= PAPER_SCORES[2][metric])
    assert scores.values["ece"] <= 0.02


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_three_classes(streams, seed):
    scores = train(streams[3], NOISE, BEST.model_copy(update={"seed": seed})).scores
    assert scores.counts.sum() == 1500
    assert scores.values["overall_accuracy"] >= 0.96
    assert np.all(scores.values["recall"] >= 0.94)
    assert scores.values["ece"] <= 0.02


def test_the_papers_eight_components_do_for_two_classes_and_not_for_three(streams):
    two, three = (train(streams[n], NOISE, PAPER) for n in (2, 3))
    assert 0.7 < three.classifier.features.variance.sum() < 0.9  # the paper: 80 % of the variance
    assert two.scores.values["overall_accuracy"] >= 0.99
    assert 0.8 < three.scores.values["overall_accuracy"] < 0.93


def test_streams_that_are_confused_had_fewer_impacts(streams):
    """Few impacts in 10⁷–10⁹: a Poisson number of mean 5.7, so that some streams have hardly a gap."""
    judged = train(streams[3], NOISE, BEST)
    rows = [judged.cell(2, 0), judged.cell(2, 1), judged.cell(2, 2)]
    impacts = [streams[3].n_impacts[2][streams[3].locate(r)[1]] for r in rows]
    wrong = np.concatenate(impacts[:2])
    assert len(wrong) > 5
    assert wrong.mean() < impacts[2].mean()
    assert impacts[2].mean() == pytest.approx(5.7, abs=0.4)
