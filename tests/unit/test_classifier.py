"""The classifier on toy streams whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.classifier.data import (
    Cancelled,
    ClassifierError,
    augmented,
    check_classes,
    split,
)
from streamdash.classifier.model import BEST, PAPER, Boosting, ClassifierConfig
from streamdash.classifier.train import fit_temperature, model_key, train
from streamdash.statistics.features import ALL_SUMMARIES, FeatureMap, FeatureSet, summarise
from streamdash.statistics.scores import calibration
from streamdash.survey.observed import ObservedStreams
from tests.unit import made_up

LABELS = ("1e3-1e5", "1e5-1e7", "1e7-1e9")
FIVE = (*LABELS, "1e9-1e10", "1e10-1e11")
N_BINS = 60
ONES = [np.ones((120, N_BINS), np.float32)] * 3
SMALL = ClassifierConfig(
    features=FeatureSet(n_pca=5, scales=(3, 9)),
    boosting=Boosting(max_depth=3, n_estimators=40, learning_rate=0.2, early_stopping_rounds=10),
)


def toy(amplitudes=(0.0, 0.5, 2.0), n_streams=120, seed=0) -> ObservedStreams:
    """Classes that differ in the amplitude of one wave, by far more than it varies within a class."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 2 * np.pi, N_BINS)
    q = []
    for amplitude in amplitudes:
        size = amplitude * rng.choice([0.9, 1.0, 1.1], (n_streams, 1))
        q.append((1 + size * np.sin(2 * x)).astype(np.float32))
    draws = tuple(rng.standard_normal(a.shape, dtype=np.float32) for a in q)
    return made_up.observed(q, draws, LABELS[: len(q)])


@pytest.mark.parametrize("amplitudes", [(0.0, 1.0), (0.0, 0.5, 2.0)])
@pytest.mark.parametrize("settings", [SMALL, BEST, PAPER], ids=["small", "best", "paper"])
def test_separable_classes_are_told_apart_without_an_error(amplitudes, settings):
    # without noise: trees cut at the outermost training stream, and one test stream may lie beyond it
    judged = train(toy(amplitudes), 0.0, settings)
    assert judged.scores.values["overall_accuracy"] == 1.0
    for name in ("precision", "recall", "f1", "auc"):
        np.testing.assert_allclose(judged.scores.values[name], 1.0)


def test_shuffled_labels_leave_chance():
    streams = toy(n_streams=400)
    order = np.random.default_rng(1).permutation(1200)
    q = streams.clean[order].reshape(3, 400, N_BINS)
    judged = train(made_up.observed(q, streams.draws, LABELS), 0.01, SMALL)
    # 300 test streams of 3 classes: chance is 1/3 with a standard deviation of 0.027
    assert abs(judged.scores.values["overall_accuracy"] - 1 / 3) < 4 * 0.0272
    assert np.all(np.abs(judged.scores.values["auc"] - 0.5) < 0.15)


def test_temperature_calibrates_labels_that_are_partly_noise():
    """15 % wrong labels: nobody can be more than 85 % + certain, and the model must know it."""
    streams = toy((0.0, 1.0), n_streams=1500, seed=3)
    rng = np.random.default_rng(4)
    y = streams.y ^ (rng.random(3000) < 0.15)
    q = tuple(streams.clean[y == c] for c in (0, 1))
    draws = tuple(rng.standard_normal(a.shape, dtype=np.float32) for a in q)
    judged = train(made_up.observed(q, draws, LABELS[:2]), 0.01, SMALL)
    assert judged.scores.values["overall_accuracy"] == pytest.approx(0.85, abs=0.04)
    assert calibration(judged.y, judged.probability).ece < 0.05


def test_temperature_recovers_a_known_one():
    rng = np.random.default_rng(5)
    margins = rng.normal(0, 2, (20000, 3))
    p = np.exp(margins) / np.exp(margins).sum(1, keepdims=True)
    y = (rng.random((20000, 1)) > np.cumsum(p, axis=1)).sum(axis=1)
    assert fit_temperature(2.5 * margins, y) == pytest.approx(2.5, rel=0.05)


def test_no_errors_do_not_prove_certainty():
    """Ten right out of ten: the most likely temperature would be zero."""
    y = np.arange(10) % 2
    margins = np.where(np.eye(2)[y] > 0, 3.0, -3.0)
    chosen = 1 / (1 + np.exp(-6 / fit_temperature(margins, y)))
    assert chosen == pytest.approx(11 / 12, abs=1e-3)


def test_no_stream_is_in_two_sets():
    y = np.repeat([0, 1, 2], [400, 300, 100])
    sets = split(y, seed=7)
    together = np.concatenate([sets.train, sets.validation, sets.test])
    np.testing.assert_array_equal(np.sort(together), np.arange(800))
    for rows, share in ((sets.test, 0.25), (sets.validation, 0.1875), (sets.train, 0.5625)):
        np.testing.assert_allclose(np.bincount(y[rows]), share * np.array([400, 300, 100]), atol=1)
    np.testing.assert_array_equal(split(y, seed=7).test, sets.test)
    assert not np.array_equal(split(y, seed=8).test, sets.test)


def test_copies_are_of_training_streams_only_and_differ_in_noise():
    streams = toy()
    rows = split(streams.y, 0).train
    q, y = augmented(streams, rows, 0.1, 3, (0, 1))
    assert q.shape == (3 * len(rows), N_BINS)
    noise = (q - np.tile(streams.clean[rows], (3, 1))).reshape(3, len(rows), N_BINS) / 0.1
    np.testing.assert_allclose(noise[0], np.concatenate(streams.draws)[rows], atol=1e-4)
    np.testing.assert_array_equal(y.reshape(3, -1)[2], streams.y[rows])
    between = np.corrcoef(noise.reshape(3, -1))
    assert np.all(np.abs(between[~np.eye(3, dtype=bool)]) < 0.03)


def test_test_streams_do_not_reach_the_model():
    """Whatever the test streams look like, the trees and the features are the same."""
    streams = toy()
    test = split(streams.y, SMALL.seed).test
    changed = streams.clean.copy()
    changed[test] = 1 + np.random.default_rng(0).normal(0, 5, (len(test), N_BINS))
    other = made_up.observed(changed.reshape(3, 120, N_BINS), streams.draws, LABELS)
    a, b = train(streams, 0.1, SMALL), train(other, 0.1, SMALL)
    assert a.classifier.booster.save_raw("ubj") == b.classifier.booster.save_raw("ubj")
    np.testing.assert_array_equal(a.classifier.features.components, b.classifier.features.components)
    assert a.scores.values["overall_accuracy"] > b.scores.values["overall_accuracy"] + 0.2


def test_cell_lists_exactly_the_streams_that_are_counted():
    streams = toy((0.0, 0.05, 0.1))
    judged = train(streams, 0.3, SMALL)
    assert judged.scores.counts.sum() > np.trace(judged.scores.counts)
    for truth in range(3):
        for taken_for in range(3):
            rows = judged.cell(truth, taken_for)
            assert len(rows) == judged.scores.counts[truth, taken_for]
            owner, index = streams.locate(rows)
            assert np.all(owner == truth) and np.all(index < 120)


def test_model_key_depends_on_everything():
    streams = toy()
    other = made_up.observed(streams.q, [d + 1 for d in streams.draws], LABELS)
    keys = [
        model_key(streams, 0.1, BEST),
        model_key(streams, 0.2, BEST),
        model_key(streams, 0.1, PAPER),
        model_key(other, 0.1, BEST),
        model_key(made_up.observed(streams.q, streams.draws, LABELS[::-1]), 0.1, BEST),
    ]
    assert len(set(keys)) == len(keys)
    assert model_key(toy(), 0.1, BEST) == keys[0]


def test_noise_may_differ_from_bin_to_bin():
    """A signal is of no use where the noise drowns it."""
    x = np.zeros((2, 200, N_BINS), np.float32)
    x[1, :, 30:] = 1
    draws = np.random.default_rng(0).standard_normal(x.shape, dtype=np.float32)
    streams = made_up.observed(x, draws, LABELS[:2])
    loud = np.where(np.arange(N_BINS) < 30, 0.1, 100.0)
    assert train(streams, loud[::-1].copy(), PAPER).scores.values["overall_accuracy"] == 1.0
    assert train(streams, loud, PAPER).scores.values["overall_accuracy"] < 0.75


def test_cancel_stops_the_training():
    asked = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) > 5

    with pytest.raises(Cancelled):
        train(toy(), 0.1, SMALL, should_stop=stop)
    assert len(asked) < 10


def test_progress_rises_to_the_end():
    seen = []
    train(toy(), 0.1, SMALL, progress=lambda done, total: seen.append((done, total)))
    done = [d for d, _ in seen]
    assert done == sorted(done) and seen[-1][0] == seen[-1][1]


@pytest.mark.parametrize("summary", ALL_SUMMARIES)
def test_features_have_a_name_each_and_are_finite(summary):
    features = FeatureSet(n_pca=3, summaries=(summary,))
    q = toy().clean
    fitted = FeatureMap.fit(q, features)
    x = fitted(np.concatenate([q, np.ones((1, N_BINS), np.float32)]))
    assert x.shape == (len(q) + 1, len(fitted.names)) and len(set(fitted.names)) == len(fitted.names)
    assert np.all(np.isfinite(x))


def test_principal_components_are_scikit_learns():
    from sklearn.decomposition import PCA
    from sklearn.preprocessing import StandardScaler

    q = toy().observed(0.1)
    pca = PCA(4).fit(StandardScaler().fit_transform(q))
    fitted = FeatureMap.fit(q, FeatureSet(n_pca=4, summaries=()))
    np.testing.assert_allclose(fitted.variance, pca.explained_variance_ratio_, rtol=1e-4)
    expected = pca.transform(StandardScaler().fit_transform(q))
    np.testing.assert_allclose(np.abs(fitted(q)), np.abs(expected), atol=1e-3)


def test_summaries_do_not_depend_on_the_company():
    q = toy().observed(0.1)
    np.testing.assert_allclose(summarise(q, FeatureSet())[7], summarise(q[7:8], FeatureSet())[0], rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"q": ONES[:1], "draws": ONES[:1], "masses": LABELS[:1]}, "2 to 4"),
        ({"q": ONES + ONES[:2], "draws": ONES + ONES[:2], "masses": FIVE}, "2 to 4"),
        ({"q": [x[:5] for x in ONES], "draws": [x[:5] for x in ONES]}, "at least 20"),
        ({"q": [x * np.nan for x in ONES]}, "not finite"),
    ],
)
def test_streams_that_are_no_classes_are_refused(change, words):
    streams = toy()
    wrong = made_up.observed(**({"q": streams.q, "draws": streams.draws, "masses": LABELS} | change))
    for use in (check_classes, lambda streams: train(streams, 0.1, SMALL)):
        with pytest.raises(ClassifierError, match=words):
            use(wrong)


@pytest.mark.parametrize("noise", [-0.1, np.nan, np.ones(3)])
def test_noise_that_does_not_fit_is_refused(noise):
    with pytest.raises(ClassifierError, match="noise"):
        train(toy(), noise, SMALL)


def test_profiles_that_do_not_fit_are_refused():
    classifier = train(toy(), 0.1, SMALL).classifier
    with pytest.raises(ClassifierError, match="60 bins"):
        classifier.predict_proba(np.ones(59))
    with pytest.raises(ClassifierError, match="not finite"):
        classifier.predict_proba(np.full(60, np.nan))
    one, many = classifier.predict_proba(toy().clean[0]), classifier.predict_proba(toy().clean[:1])
    np.testing.assert_array_equal(one, many[0])
    assert one.sum() == pytest.approx(1)
