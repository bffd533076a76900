"""Training 3 classes × 2,000 streams in 10 s on two cores; one profile classified in 20 ms."""

from __future__ import annotations

import pytest

from streamdash.classifier.model import BEST, PAPER_CLASSES
from streamdash.classifier.train import train
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams
from tests.shipped import of_default_stream

TRAINING_S = 10.0
PREDICTION_S = 0.020


@pytest.fixture(scope="module")
def streams(shipped_cache):
    cache = Cache.default(shipped_cache)
    keys = {entry.config.population.label: entry.key for entry in cache.entries() if of_default_stream(entry)}
    return ObservedStreams.read(cache, [keys[label] for label in PAPER_CLASSES[3]])


@pytest.mark.benchmark(group="classifier")
def test_training(benchmark, streams):
    judged = benchmark.pedantic(train, args=(streams, 0.1, BEST), warmup_rounds=1, rounds=3)
    assert judged.scores.counts.sum() == 1500
    if benchmark.stats is not None:
        assert benchmark.stats.stats.median <= TRAINING_S


@pytest.mark.benchmark(group="classifier")
def test_prediction_of_one_profile(benchmark, streams):
    classifier = train(streams, 0.1, BEST).classifier
    profile = streams.observed(0.1)[0]
    probability = benchmark.pedantic(classifier.predict_proba, args=(profile,), warmup_rounds=5, rounds=50)
    assert probability.sum() == pytest.approx(1)
    if benchmark.stats is not None:
        assert benchmark.stats.stats.median <= PREDICTION_S
