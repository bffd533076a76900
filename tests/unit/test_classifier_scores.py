"""Scores against hand-made counts, the paper's formulas and scikit-learn."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn import metrics

from streamdash.statistics.scores import calibration, count_scores, evaluate, roc, share_interval


def test_scores_of_counts_made_by_hand():
    scores = count_scores(np.array([[45, 5], [10, 40]]))
    np.testing.assert_allclose(scores["accuracy"], [0.85, 0.85])
    np.testing.assert_allclose(scores["precision"], [45 / 55, 40 / 45])
    np.testing.assert_allclose(scores["recall"], [0.9, 0.8])
    np.testing.assert_allclose(scores["f1"], [2 / (55 / 45 + 1 / 0.9), 2 / (45 / 40 + 1 / 0.8)])
    assert scores["overall_accuracy"] == pytest.approx(0.85)


def test_accuracy_of_one_class_of_three_counts_true_negatives():
    """Paper's A_i: (T_p + T_n) / all, one class against the rest."""
    counts = np.array([[8, 1, 1], [2, 6, 2], [0, 3, 7]])
    np.testing.assert_allclose(count_scores(counts)["accuracy"], [26 / 30, 22 / 30, 24 / 30])


def test_nothing_predicted_gives_zero_not_an_error():
    scores = count_scores(np.array([[5, 0], [5, 0]]))
    assert scores["precision"][1] == scores["recall"][1] == scores["f1"][1] == 0


@pytest.fixture
def truth_and_probability():
    rng = np.random.default_rng(0)
    y = np.repeat([0, 1, 2], [100, 150, 50])
    logits = rng.normal(0, 1, (300, 3)) + 1.5 * np.eye(3)[y]
    return y, np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)


def test_scores_equal_scikit_learns(truth_and_probability):
    y, p = truth_and_probability
    values = evaluate(y, p, n_bootstrap=0).values
    predicted = p.argmax(axis=1)
    precision, recall, f1, _ = metrics.precision_recall_fscore_support(y, predicted)
    np.testing.assert_allclose(values["precision"], precision)
    np.testing.assert_allclose(values["recall"], recall)
    np.testing.assert_allclose(values["f1"], f1)
    assert values["overall_accuracy"] == pytest.approx(metrics.accuracy_score(y, predicted))
    assert values["log_loss"] == pytest.approx(metrics.log_loss(y, p))
    for c in range(3):
        assert values["auc"][c] == pytest.approx(metrics.roc_auc_score(y == c, p[:, c]))
        assert values["accuracy"][c] == pytest.approx(metrics.accuracy_score(y == c, predicted == c))


def test_bootstrap_errors_are_those_of_a_proportion(truth_and_probability):
    y, p = truth_and_probability
    scores = evaluate(y, p, n_bootstrap=600)
    for c, n in enumerate((100, 150, 50)):
        r = scores.values["recall"][c]
        assert scores.errors["recall"][c] == pytest.approx(np.sqrt(r * (1 - r) / n), rel=0.15)
    assert scores.errors["log_loss"] > 0 and scores.errors["ece"] > 0


def test_same_seed_gives_the_same_errors(truth_and_probability):
    a, b = (evaluate(*truth_and_probability, n_bootstrap=20, seed=3) for _ in range(2))
    np.testing.assert_array_equal(a.errors["f1"], b.errors["f1"])


def test_roc_encloses_the_area_of_auc(truth_and_probability):
    y, p = truth_and_probability
    fpr, tpr = roc(y, p, n_points=2001)
    assert tpr.shape == (3, 2001) and np.all(np.diff(tpr, axis=1) >= 0)
    for c in range(3):
        assert np.trapezoid(tpr[c], fpr) == pytest.approx(metrics.roc_auc_score(y == c, p[:, c]), abs=0.01)


def test_calibration_counts_by_hand():
    p = np.array([[0.9, 0.1]] * 10 + [[0.4, 0.6]] * 10)
    y = np.array([0] * 9 + [1] + [1] * 3 + [0] * 7)
    curve = calibration(y, p, n_bins=10)
    np.testing.assert_array_equal(curve.count, [10, 10])
    np.testing.assert_allclose(curve.confidence, [0.6, 0.9])
    np.testing.assert_allclose(curve.accuracy, [0.3, 0.9])
    assert curve.ece == pytest.approx(0.5 * 0.3 + 0.5 * 0.0)


def test_honest_probabilities_have_no_calibration_error():
    rng = np.random.default_rng(1)
    p0 = rng.random(100_000)
    y = (rng.random(100_000) > p0).astype(int)
    assert calibration(y, np.stack([p0, 1 - p0], axis=1)).ece < 0.01


def test_percentages_of_rows_add_up(truth_and_probability):
    scores = evaluate(*truth_and_probability, n_bootstrap=2)
    np.testing.assert_allclose(scores.percent.sum(axis=1), 100)
    table = scores.table(["a", "b", "c"])
    assert list(table.index) == ["a", "b", "c"] and table["recall"].between(0, 1).all()


def test_class_without_test_stream_is_named():
    with pytest.raises(ValueError, match="Class 1"):
        evaluate(np.array([0, 0, 2]), np.eye(3))


def test_all_right_is_not_certainty():
    """500 of 500: the interval reaches down to a share that would show all right once in six times."""
    y = np.repeat([0, 1], 250)
    scores = evaluate(y, np.eye(2)[y])
    assert scores.values["overall_accuracy"] == 1 and scores.errors["overall_accuracy"] == 0
    low, high = scores.interval("overall_accuracy")
    assert 0.998 < low < 0.9995 and high == 1
    for name in ("accuracy", "precision", "recall", "f1", "auc"):
        ends = scores.interval(name)
        assert (ends[0] < 1).all() and (ends[0] > 0.99).all() and (ends[1] == 1).all()
    assert scores.text("overall_accuracy") == "1.000 (0.999–1.000)"
    assert scores.percent_text("recall", 0) == "100.0 % (99.8–100.0 %)"


@pytest.mark.parametrize(("share", "n"), [(0.99, 500), (0.9, 60), (0.5, 40)])
def test_the_interval_of_a_share_holds_it_as_often_as_it_says(share, n):
    seen = np.random.default_rng(3).binomial(n, share, 4000)
    low, high = share_interval(seen, n)
    assert 0.6 < np.mean((low <= share) & (share <= high)) < 0.8


def test_the_interval_of_f1_is_where_bootstrapped_values_are(truth_and_probability):
    y, p = truth_and_probability
    scores = evaluate(y, p, n_bootstrap=600)
    low, high = scores.interval("f1")
    assert np.all((low < scores.values["f1"]) & (scores.values["f1"] < high))
    np.testing.assert_allclose((high - low) / 2, scores.errors["f1"], rtol=0.35)
