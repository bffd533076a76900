"""How good a classifier is: the paper's metrics, and those it needs besides, with errors.

Counts follow scikit-learn: ``counts[i, j]`` streams of class i were taken for class j.
Errors are bootstrap standard deviations over the test streams. A bootstrap of nothing but right answers
does not scatter, so what is shown of shares is `Scores.interval`, which can hold: 500 of 500 right does
not prove that the next one will be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import betaincinv
from sklearn import metrics

from streamdash.words import between, percent_between

N_CONFIDENCE_BINS = 15
LEVEL = 0.6827
"""Probability of the intervals that are shown, that of one standard deviation."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of a classifier on test streams.

    Attributes
    ----------
    counts : ndarray (n_classes, n_classes) of int
        Confusion matrix, true class along rows.
    values, errors : dict
        ``accuracy, precision, recall, f1, auc`` per class (n_classes,), and
        ``overall_accuracy, log_loss, ece`` as numbers; bootstrap errors likewise.
    """

    counts: np.ndarray
    values: dict[str, np.ndarray]
    errors: dict[str, np.ndarray]

    @property
    def percent(self) -> np.ndarray:
        """Confusion matrix in percent of each true class (n_classes, n_classes)."""
        return 100 * self.counts / np.maximum(self.counts.sum(axis=1, keepdims=True), 1)

    def table(self, labels: Sequence[str]) -> pd.DataFrame:
        """One row per class: precision, recall, F1, accuracy, AUC and their errors."""
        columns = {}
        for name in ("precision", "recall", "f1", "accuracy", "auc"):
            columns[name] = self.values[name]
            columns[f"{name}_error"] = self.errors[name]
        return pd.DataFrame(columns, index=pd.Index(labels, name="class"))

    def interval(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Ends of the 68 % interval of a score, each of the shape of its value.

        Accuracy, precision and recall are shares of streams and have `share_interval`. So has
        F1 = 2J/(1 + J), with J the share of true positives among all streams that are or were taken to be of
        the class. The others have their bootstrap error, but that the area under the curve, which is 1
        where all streams are in order, has the interval of a share of the smaller group of streams: its
        variance is never larger (Birnbaum & Klose 1957, Ann. Math. Statist. 28, 933).
        """
        counts = np.asarray(self.counts)
        total, right = counts.sum(), np.diag(counts)
        said, true = counts.sum(axis=0), counts.sum(axis=1)
        value = np.asarray(self.values[name], float)
        shares = {
            "accuracy": (total - said - true + 2 * right, np.full(len(right), total)),
            "precision": (right, said),
            "recall": (right, true),
            "overall_accuracy": (right.sum(), total),
        }
        if name in shares:
            return share_interval(*shares[name])
        if name == "f1":
            low, high = share_interval(right, said + true - right)
            return 2 * low / (1 + low), 2 * high / (1 + high)
        error = np.asarray(self.errors[name], float)
        low, high = value - error, value + error
        if name == "auc":
            least = np.minimum(true, total - true)
            at_most = share_interval(value * least, least)
            return np.where(value > 1 - 1 / least, at_most[0], low), np.minimum(high, 1.0)
        return np.maximum(low, 0.0), high

    def text(self, name: str, number: int | None = None, digits: int = 3) -> str:
        """A score, of one class or of all, with its interval: ``0.982 (0.978–0.985)``."""
        return between(*self._with_interval(name, number), digits)

    def percent_text(self, name: str, number: int | None = None) -> str:
        """The same in percent: ``98.2 % (97.8–98.5 %)``."""
        return percent_between(*self._with_interval(name, number))

    def half_interval(self, name: str) -> np.ndarray:
        """Half the length of a score's interval, for error bars."""
        low, high = self.interval(name)
        return (high - low) / 2

    def _with_interval(self, name: str, number: int | None) -> tuple[float, float, float]:
        which = () if number is None else number
        parts = (self.values[name], *self.interval(name))
        low_mid_high = [float(np.asarray(part)[which]) for part in parts]
        return low_mid_high[0], low_mid_high[1], low_mid_high[2]

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for a model card."""
        plain = {name: np.asarray(value).tolist() for name, value in self.values.items()}
        errors = {name: np.asarray(value).tolist() for name, value in self.errors.items()}
        return {"counts": self.counts.tolist(), "values": plain, "errors": errors}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Reliability of the probability given to the chosen class, in bins of it.

    Attributes
    ----------
    confidence, accuracy, error : ndarray (n_used_bins,)
        Mean probability, share that was right, and its binomial (Wilson) half-width at one sigma.
    count : ndarray (n_used_bins,)
        Streams in the bin; bins without streams are left out.
    """

    confidence: np.ndarray
    accuracy: np.ndarray
    error: np.ndarray
    count: np.ndarray

    @property
    def ece(self) -> float:
        """Expected calibration error: mean \\|accuracy − confidence\\| weighted by count."""
        return float(np.sum(self.count * np.abs(self.accuracy - self.confidence)) / np.sum(self.count))


def share_interval(
    k: np.ndarray | float, n: np.ndarray | float, level: float = LEVEL
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of Jeffreys' interval for a share of which `k` of `n` were seen.

    It is never empty, also where none or all were seen, and then reaches 0 or 1 (Brown, Cai & DasGupta
    2001, Statist. Sci. 16, 101).

    Examples
    --------
    >>> low, high = share_interval(500, 500)
    >>> f"{low:.4f} {high:.0f}"
    '0.9990 1'
    """
    k, n = np.asarray(k, float), np.asarray(n, float)
    out = 0.5 * (1 - level)
    low = np.where(k <= 0, 0.0, betaincinv(k + 0.5, n - k + 0.5, np.where(k >= n, 2 * out, out)))
    high = np.where(k >= n, 1.0, betaincinv(k + 0.5, n - k + 0.5, 1 - np.where(k <= 0, 2 * out, out)))
    return low, high


def share_text(share: float, n: int, digits: int = 3) -> str:
    """A share of `n` with its interval, ``0.982 (0.978–0.985)``."""
    low, high = share_interval(share * n, n)
    return between(share, float(low), float(high), digits)


def count_scores(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Paper's eqs. for accuracy, precision, recall and F1 (§2.5) from a confusion matrix.

    Parameters
    ----------
    counts : ndarray (..., n_classes, n_classes)
        True class along the last but one axis.

    Returns
    -------
    dict
        ``accuracy`` (one class against the rest), ``precision``, ``recall``, ``f1``, each
        (..., n_classes), and ``overall_accuracy`` (...). A ratio with nothing in its
        denominator is 0, as in scikit-learn with ``zero_division=0``.

    Examples
    --------
    >>> count_scores(np.array([[90, 10], [5, 95]]))["recall"]
    array([0.9 , 0.95])
    """
    counts = np.asarray(counts, float)
    total = counts.sum(axis=(-2, -1))[..., None]
    true_positive = np.diagonal(counts, axis1=-2, axis2=-1)
    false_positive = counts.sum(axis=-2) - true_positive
    false_negative = counts.sum(axis=-1) - true_positive
    true_negative = total - true_positive - false_positive - false_negative
    return {
        "accuracy": _ratio(true_positive + true_negative, total),
        "precision": _ratio(true_positive, true_positive + false_positive),
        "recall": _ratio(true_positive, true_positive + false_negative),
        # 2 / (1/P + 1/R), written so that it is also defined for P = R = 0
        "f1": _ratio(2 * true_positive, 2 * true_positive + false_positive + false_negative),
        "overall_accuracy": _ratio(true_positive.sum(axis=-1), total[..., 0]),
    }


def evaluate(y: np.ndarray, probability: np.ndarray, n_bootstrap: int = 200, seed: int = 0) -> Scores:
    """Score probabilities against the truth.

    Parameters
    ----------
    y : ndarray (n_streams,) of int
        True class.
    probability : ndarray (n_streams, n_classes)
        The most probable class counts as the prediction: for two classes, above 50 %.
    n_bootstrap : int
        Resamplings of the streams behind the errors.

    Raises
    ------
    ValueError
        When a class has no test stream.
    """
    y = np.asarray(y)
    n_classes = probability.shape[1]
    present = np.bincount(y, minlength=n_classes)
    if np.any(present == 0):
        raise ValueError(f"Class {int(np.argmin(present))} has no test stream; simulate more streams.")
    values = {name: value[0] for name, value in _weighted(y, probability, np.ones((1, len(y)))).items()}
    errors = {}
    if n_bootstrap:
        rng = np.random.default_rng(seed)
        weights = np.zeros((n_bootstrap, len(y)))
        for c in range(n_classes):  # within each class, so that no resampling lacks one
            share = np.full(present[c], 1 / present[c])
            weights[:, y == c] = rng.multinomial(present[c], share, n_bootstrap)
        errors = {name: value.std(axis=0) for name, value in _weighted(y, probability, weights).items()}
    return Scores(_counts(y, probability), values, errors)


def roc(y: np.ndarray, probability: np.ndarray, n_points: int = 201) -> tuple[np.ndarray, np.ndarray]:
    """ROC curve of each class against the rest.

    Returns
    -------
    false_positive_rate : ndarray (n_points,)
        Common to all classes, crowded towards 0 where the curves differ.
    true_positive_rate : ndarray (n_classes, n_points)
    """
    grid = np.linspace(0, 1, n_points) ** 3
    curves = []
    for c in range(probability.shape[1]):
        fpr, tpr, _ = metrics.roc_curve(y == c, probability[:, c])
        # the upper corner of each step: the best rate that this false-positive rate allows
        curves.append(tpr[np.searchsorted(fpr, grid, side="right") - 1])
    return grid, np.array(curves)


def calibration(y: np.ndarray, probability: np.ndarray, n_bins: int = N_CONFIDENCE_BINS) -> Calibration:
    """Reliability of the chosen class's probability in ``n_bins`` equal bins of it."""
    confidence = probability.max(axis=1)
    right = (probability.argmax(axis=1) == y).astype(float)
    bins = _confidence_bin(probability, n_bins)
    count = np.bincount(bins, minlength=n_bins)
    used = count > 0
    n = count[used]
    share = np.bincount(bins, right, n_bins)[used] / n
    error = np.sqrt(share * (1 - share) / n + 1 / (4 * n**2)) / (1 + 1 / n)
    return Calibration(np.bincount(bins, confidence, n_bins)[used] / n, share, error, n)


def _counts(y: np.ndarray, probability: np.ndarray) -> np.ndarray:
    n_classes = probability.shape[1]
    return metrics.confusion_matrix(y, probability.argmax(axis=1), labels=np.arange(n_classes))


def _weighted(y: np.ndarray, probability: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
    """All scores with the streams counted as often as ``weights`` (n_resamplings, n_streams) say.

    A resampling is a set of weights, so that all of them are a few products of matrices;
    scikit-learn's functions, one resampling at a time, take longer than the training.
    """
    n_classes = probability.shape[1]
    total = weights.sum(axis=1)
    cell = y * n_classes + probability.argmax(axis=1)
    counts = weights @ np.eye(n_classes**2)[cell]
    scores = count_scores(counts.reshape(-1, n_classes, n_classes))
    scores["auc"] = np.stack([_auc(y == c, probability[:, c], weights) for c in range(n_classes)], axis=-1)
    chosen = np.maximum(probability[np.arange(len(y)), y], 1e-15)
    scores["log_loss"] = weights @ -np.log(chosen) / total
    bins = np.eye(N_CONFIDENCE_BINS)[_confidence_bin(probability, N_CONFIDENCE_BINS)]
    surplus = (probability.argmax(axis=1) == y) - probability.max(axis=1)
    scores["ece"] = np.abs(weights @ (bins * surplus[:, None])).sum(axis=1) / total
    return scores


def _auc(positive: np.ndarray, score: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Chance that a stream of the class scores higher than one of the others, ties half."""
    order = np.argsort(score)
    starts = np.flatnonzero(np.concatenate([[True], np.diff(score[order]) > 0]))
    ours = np.add.reduceat(np.where(positive, weights, 0)[:, order], starts, axis=1)
    others = np.add.reduceat(np.where(positive, 0, weights)[:, order], starts, axis=1)
    lower = np.cumsum(others, axis=1) - 0.5 * others
    return (ours * lower).sum(axis=1) / (ours.sum(axis=1) * others.sum(axis=1))


def _confidence_bin(probability: np.ndarray, n_bins: int) -> np.ndarray:
    """Bin of each stream's highest probability, (n_streams,)."""
    return np.minimum((probability.max(axis=1) * n_bins).astype(int), n_bins - 1)


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    numerator, denominator = np.broadcast_arrays(numerator, denominator)
    return np.divide(numerator, denominator, out=np.zeros(numerator.shape), where=denominator > 0)
