"""Studies on toy streams: what they find is what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from streamdash.classifier.data import Cancelled, split
from streamdash.classifier.model import Boosting, ClassifierConfig
from streamdash.classifier.studies import (
    compare,
    grid_search,
    importance,
    learning_curve,
    noise_curve,
    wrong_noise_curve,
)
from streamdash.classifier.train import train
from streamdash.plots.classifier_studies import wrong_noise_sentence
from streamdash.statistics.features import FeatureSet
from streamdash.survey.observed import ObservedStreams
from tests.unit import made_up

N_BINS = 40
SETTINGS = ClassifierConfig(
    features=FeatureSet(n_pca=4, scales=(3, 9)),
    boosting=Boosting(max_depth=3, n_estimators=30, learning_rate=0.3, early_stopping_rounds=None),
)


@pytest.fixture(scope="module")
def streams() -> ObservedStreams:
    """Class 1 is higher by a random amount in bins 10 to 19 only; l runs from 200° by 0.2°."""
    rng = np.random.default_rng(0)
    q = np.ones((2, 400, N_BINS), np.float32)
    q[1, :, 10:20] += rng.uniform(0.05, 0.3, (400, 1)).astype(np.float32)
    draws = rng.standard_normal(q.shape, dtype=np.float32)
    edges = 199.9 + 0.2 * np.arange(N_BINS + 1)
    return made_up.observed(q, draws, ("1e3-1e5", "1e5-1e9"), edges)


def test_grid_is_that_of_separate_models(streams):
    """The accuracy at n trees is what a model of n trees has."""
    short = grid_search(streams, 0.2, SETTINGS, depths=(2, 3), n_trees=(5,), n_folds=3)
    long = grid_search(streams, 0.2, SETTINGS, depths=(2, 3), n_trees=(5, 20), n_folds=3)
    assert long.accuracy.shape == (2, 2)
    np.testing.assert_allclose(long.accuracy[:, 0], short.accuracy[:, 0])
    assert long.accuracy.max() > 0.7
    chosen = long.settings.boosting
    assert chosen.max_depth in (2, 3) and chosen.n_estimators in (5, 20)
    assert chosen.early_stopping_rounds is None


def test_depths_that_no_tree_reaches_are_as_if_grown(streams):
    """What is not grown again has the accuracy it has when it is grown by itself."""
    arguments = {"n_trees": (5, 20), "n_folds": 3}
    together = grid_search(streams, 0.2, SETTINGS, depths=(90, 2, 30, 60), **arguments)
    for d, depth in enumerate((90, 2, 30, 60)):
        alone = grid_search(streams, 0.2, SETTINGS, depths=(depth,), **arguments)
        np.testing.assert_array_equal(together.accuracy[d], alone.accuracy[0])


def test_grid_never_sees_test_streams(streams):
    rows = split(streams.y, SETTINGS.seed).test
    changed = streams.clean.copy()
    changed[rows] = 1e6
    other = replace(streams, q=tuple(changed.reshape(2, 400, N_BINS)))
    arguments = {"depths": (2,), "n_trees": (10,), "n_folds": 3}
    a = grid_search(streams, 0.2, SETTINGS, **arguments)
    b = grid_search(other, 0.2, SETTINGS, **arguments)
    np.testing.assert_array_equal(a.accuracy, b.accuracy)


def test_more_noise_means_fewer_right(streams):
    curve = noise_curve(streams, SETTINGS, (0.0, 0.3, 5.0))
    assert curve.accuracy[0] == 1.0
    assert np.all(np.diff(curve.accuracy) < 0)
    assert curve.accuracy[-1] == pytest.approx(0.5, abs=0.13)  # 200 test streams
    assert curve.recall.shape == (3, 2) and curve.accuracy_error[1] > 0


def test_more_streams_mean_more_right(streams):
    curve = learning_curve(streams, 0.25, SETTINGS)
    np.testing.assert_array_equal(curve.x, [25, 50, 100, 200, 400])
    assert curve.accuracy[-1] > curve.accuracy[0]
    whole = train(streams, 0.25, SETTINGS)
    assert curve.accuracy[-1] == whole.scores.values["overall_accuracy"]


def test_importance_points_at_the_place_that_was_changed(streams):
    judged = train(streams, 0.1, SETTINGS)
    found = importance(judged, streams, 0.1, block=2.0)
    np.testing.assert_allclose(found.edges, [199.9, 201.9, 203.9, 205.9, 207.9])
    assert found.log_loss.argmax() == 1 and found.accuracy.argmax() == 1
    others = [0, 2, 3]
    assert np.all(found.log_loss[1] > 5 * np.abs(found.log_loss[others]))


def test_comparison_is_on_one_split(streams):
    seen = []
    rows = compare(
        streams,
        0.1,
        {"best": SETTINGS, "other": SETTINGS},
        lambda a, b: seen.append((a, b)),
    )
    assert [r.name for r in rows] == ["best", "other", "dense network, features of 'best'"]
    np.testing.assert_array_equal(rows[0].scores.counts, rows[1].scores.counts)
    assert all(r.scores.counts.sum() == 200 and r.scores.values["overall_accuracy"] > 0.8 for r in rows)
    assert seen[-1][0] == seen[-1][1] and [a for a, _ in seen] == sorted(a for a, _ in seen)


@pytest.mark.parametrize(
    "study",
    [
        lambda s, stop: grid_search(s, 0.1, SETTINGS, should_stop=stop),
        lambda s, stop: learning_curve(s, 0.1, SETTINGS, should_stop=stop),
        lambda s, stop: noise_curve(s, SETTINGS, should_stop=stop),
        lambda s, stop: compare(s, 0.1, {"best": SETTINGS}, should_stop=stop),
    ],
)
def test_studies_stop_when_asked(streams, study):
    with pytest.raises(Cancelled):
        study(streams, lambda: True)


def test_a_classifier_that_trusts_a_wrong_noise_is_worse_where_it_is_larger(streams):
    curve = wrong_noise_curve(streams, 0.3, SETTINGS, (0.0, 5.0))
    assert curve.x.tolist() == [0.0, 0.3, 5.0]
    at_its_own = noise_curve(streams, SETTINGS, (0.3,))
    assert curve.accuracy[1] == at_its_own.accuracy[0]
    assert curve.accuracy[2] < curve.accuracy[1] - 0.1
    sentence = wrong_noise_sentence(curve, 0.3)
    assert (
        "Trained at σ_ε = 0.3" in sentence and f"{100 * curve.accuracy[1]:.1f} % of the streams" in sentence
    )
