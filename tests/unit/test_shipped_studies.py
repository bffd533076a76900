"""The studies that the Classifier page shows at once are those of the shipped streams."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.classifier.model import BEST
from streamdash.classifier.studies import Contender, Curve
from streamdash.classifier.train import train
from streamdash.paper.evidence import NOISE, TWO_CLASSES, load_sample
from streamdash.paper.studies import (
    STUDIES,
    estimated_seconds,
    plain,
    read_result,
    shipped_result,
    shipped_studies,
    study_results,
)
from streamdash.store.cache import Cache


@pytest.fixture(scope="module")
def sample(shipped_cache):
    return load_sample(Cache((shipped_cache,))).only(TWO_CLASSES)


def test_shipped_studies_are_of_the_shipped_streams_and_of_nothing_else(sample):
    found = shipped_studies()
    assert found is not None and (found["noise"], found["settings"]) == (NOISE, BEST.key)
    assert set(found["studies"]) == set(STUDIES)
    for name in STUDIES:
        assert shipped_result(name, sample.keys) is not None
        assert shipped_result(name, sample.keys[::-1]) is None
    assert shipped_result("no such study", sample.keys) is None


def test_a_result_is_read_as_it_was_computed(sample):
    judged = train(sample, NOISE, BEST.model_copy(update={"copies": 1}))
    curve = Curve.of([0.1, 0.2], [judged.scores, judged.scores])
    again = read_result(plain(curve))
    assert isinstance(again, Curve)
    np.testing.assert_array_equal(again.recall, curve.recall)
    (contender,) = read_result(plain([Contender("ours", judged.scores, 1.5)]))
    assert contender.name == "ours" and contender.seconds == 1.5
    assert contender.scores.text("recall", 1) == judged.scores.text("recall", 1)
    assert read_result(plain(BEST)) == BEST


def test_the_estimate_grows_with_the_streams():
    found = shipped_studies()
    assert found is not None
    once, twice = (estimated_seconds("noise-curve", n * found["n_streams"]) for n in (1, 2))
    assert once is not None and once > 0 and twice == pytest.approx(2 * once)
    assert estimated_seconds("no such study", 100) is None


@pytest.mark.slow
def test_what_is_shipped_is_what_is_computed(sample, shipped_cache):
    """As far as another processor grows the same trees."""
    found = shipped_studies()
    again = study_results(Cache((shipped_cache,)), sample.configs, ["noise-curve"])
    low, high = found["accuracy_interval"]
    assert low - 0.01 <= again["accuracy"] <= high + 0.01
    curves = [read_result(one["studies"]["noise-curve"]["result"]) for one in (found, again)]
    error = np.maximum(curves[0].accuracy_error, 1 / found["n_test"])
    assert np.all(np.abs(curves[1].accuracy - curves[0].accuracy) < 5 * error)
