"""The paper's second method: which mass range perturbed this stream? (paper §2.5, §3.2)

StandardScaler → PCA (and summary features) → gradient-boosted trees → temperature.
`train` takes streams as they are observed (`ObservedStreams`) and returns a `Classifier`; two presets matter,
``paper`` (8 components, nothing else) and ``best``, the default. `scores` of the test set
travel with the model in its `ModelCard`.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import sklearn
import xgboost
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax

from streamdash.classifier.data import (
    Cancelled,
    ClassifierError,
    Split,
    augmented,
    check_classes,
    split,
)
from streamdash.classifier.model import BEST, SCHEMA, Classifier, ClassifierConfig, ModelCard, class_margins
from streamdash.statistics.features import FeatureMap
from streamdash.statistics.scores import Scores, evaluate
from streamdash.survey.observed import ObservedStreams

Progress = Callable[[int, int], None]
ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Judged:
    """A classifier with what it says about the streams it was never trained on.

    Attributes
    ----------
    classifier : Classifier
    rows : ndarray (n_test,)
        Row numbers of the test streams (see `ObservedStreams.locate`).
    y : ndarray (n_test,)
        True classes.
    probability : ndarray (n_test, n_classes)
    scores : Scores
    seconds : float
        What the training took; not a number for a model read from disk.
    """

    classifier: Classifier
    rows: np.ndarray
    y: np.ndarray
    probability: np.ndarray
    scores: Scores
    seconds: float

    def cell(self, truth: int, taken_for: int) -> np.ndarray:
        """Row numbers of the test streams in one cell of the confusion matrix, least certain first."""
        predicted = self.probability.argmax(axis=1)
        inside = np.flatnonzero((self.y == truth) & (predicted == taken_for))
        return self.rows[inside[np.argsort(self.probability[inside, taken_for])]]


def model_key(streams: ObservedStreams, noise: float | np.ndarray, settings: ClassifierConfig) -> str:
    """Name of the model that `train` would return: a hash of everything it depends on."""
    text = json.dumps([SCHEMA, streams.digest, np.asarray(noise, float).tolist(), settings.key])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def train(
    streams: ObservedStreams,
    noise: float | np.ndarray,
    settings: ClassifierConfig = BEST,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
    sets: Split | None = None,
) -> Judged:
    """Train a classifier and judge it on the test streams.

    With early stopping the number of trees is found on the validation streams, the
    temperature is fitted to them, and the trees are then grown again on the training and
    validation streams together, as many as were found. The test streams are used for nothing
    but the scores.

    Parameters
    ----------
    streams : ObservedStreams
    noise : float or ndarray (n_bins,)
        σ_ε per bin.
    settings : ClassifierConfig
    progress : callable (done, total), optional
        Called after every tree of every class.
    should_stop : callable, optional
        Asked at the same moments.
    workers : int, optional
        Threads that grow trees. With one, the same seed gives the same bytes on one machine; more
        help on idle cores only, on busy ones they wait for each other.
    sets : Split, optional
        Who is trained on; by default the `split` of ``settings.seed``.

    Raises
    ------
    ClassifierError
        When the streams make no classes, or the noise is negative or does not fit the bins.
    Cancelled
        When ``should_stop`` said so.
    """
    check_classes(streams)
    check_noise(noise, streams.n_bins)
    if streams.design.arms:
        of_arms = settings.features.model_copy(update={"arms": streams.design.arms})
        settings = settings.model_copy(update={"features": of_arms})
    started = time.perf_counter()
    sets = sets or split(streams.y, settings.seed)
    n_steps = 2 * settings.boosting.n_estimators
    watch = _Watch(progress, should_stop, n_steps)
    n_trees, temperature = _tune_on_validation(streams, noise, settings, sets, watch, workers)
    watch.start(n_steps - n_trees)

    everything = np.concatenate([sets.train, sets.validation])
    q, y = augmented(streams, everything, noise, settings.copies, (settings.seed, 2))
    features = FeatureMap.fit(q, settings.features)
    booster = boost(features(q), y, settings, n_trees, watch=watch, workers=workers)
    seconds = time.perf_counter() - started

    card = ModelCard(
        labels=streams.labels,
        data_keys=streams.keys,
        data_digest=streams.digest,
        n_streams=tuple(len(q) for q in streams.q),
        ell=tuple(streams.centers.tolist()),
        noise=np.asarray(noise, float).tolist(),
        settings=settings,
        n_trees=n_trees,
        temperature=temperature,
        versions={m.__name__: m.__version__ for m in (xgboost, sklearn, np)},
    )
    judged = judge(Classifier(card, features, booster), streams, sets, seconds)
    card = card.model_copy(update={"scores": judged.scores.to_dict()})
    return replace(judged, classifier=Classifier(card, features, booster))


def judge(
    classifier: Classifier,
    streams: ObservedStreams,
    sets: Split | None = None,
    seconds: float = math.nan,
) -> Judged:
    """Have a classifier say what the test streams are; for one just trained, or read from disk.

    Raises
    ------
    ClassifierError
        When the model was made from other streams.
    """
    card = classifier.card
    if card.data_digest != streams.digest:
        raise ClassifierError("The model was trained on other streams than these; train it on these.")
    test = (sets or split(streams.y, card.settings.seed)).test
    truth = streams.y[test]
    probability = classifier.predict_proba(streams.observed(np.asarray(card.noise))[test])
    scores = evaluate(truth, probability, seed=card.settings.seed)
    return Judged(classifier, test, truth, probability, scores, seconds)


def check_noise(noise: float | np.ndarray, n_bins: int) -> None:
    """Raise `ClassifierError` when the noise cannot be used with that many bins."""
    values = np.asarray(noise, float)
    if values.shape not in ((), (n_bins,)):
        raise ClassifierError(f"The noise must be one number or {n_bins}, one per bin.")
    if not np.all(np.isfinite(values)) or np.any(values < 0):
        raise ClassifierError("The noise must be finite and not negative.")


def boost(
    x: np.ndarray,
    y: np.ndarray,
    settings: ClassifierConfig,
    n_trees: int,
    validation: tuple[np.ndarray, np.ndarray] | None = None,
    watch: _Watch | None = None,
    workers: int = 1,
) -> xgboost.Booster:
    """Grow trees on features.

    Parameters
    ----------
    x : ndarray (n_rows, n_features)
    y : ndarray (n_rows,)
        Classes; each class weighs the same however many rows it has.
    n_trees : int
        Trees per class.
    validation : (x, y), optional
        With it, and ``early_stopping_rounds``, growth stops when their log loss stalls.
    """
    boosting = settings.boosting
    n_classes = int(y.max()) + 1
    parameters = boosting.model_dump(exclude={"n_estimators", "early_stopping_rounds"}) | {
        "tree_method": "hist",
        "seed": settings.seed,
        "nthread": workers,
        # as in the paper, two classes are one logistic function
        **({"objective": "binary:logistic"} if n_classes == 2 else {}),
        **({"objective": "multi:softprob", "num_class": n_classes} if n_classes > 2 else {}),
        "eval_metric": "logloss" if n_classes == 2 else "mlogloss",
    }
    matrix = xgboost.QuantileDMatrix(x, y, weight=_balance(y), max_bin=boosting.max_bin, nthread=workers)
    evals = []
    if validation is not None:
        held = xgboost.DMatrix(*validation, weight=_balance(validation[1]), nthread=workers)
        evals = [(held, "validation")]
    booster = xgboost.train(
        parameters,
        matrix,
        num_boost_round=n_trees,
        evals=evals,
        early_stopping_rounds=boosting.early_stopping_rounds if evals else None,
        callbacks=[watch] if watch is not None else None,
        verbose_eval=False,
    )
    if watch is not None and watch.stopped:
        raise Cancelled
    return booster


def fit_temperature(margins: np.ndarray, y: np.ndarray) -> float:
    """Temperature T that minimises the log loss of softmax(margins / T).

    A finite number of rows without a single error does not prove certainty: as in Platt's
    scaling, each of the n rows counts as one of its class with probability (n + 1)/(n + C).

    Parameters
    ----------
    margins : ndarray (n_rows, n_classes)
        Of rows that the trees were not grown on.
    """
    n_rows, n_classes = margins.shape
    target = np.full(margins.shape, 1 / (n_rows + n_classes))
    target[np.arange(n_rows), y] = (n_rows + 1) / (n_rows + n_classes)

    def loss(log_temperature: float) -> float:
        return -(target * log_softmax(margins / np.exp(log_temperature), axis=1)).sum(axis=1).mean()

    return float(np.exp(minimize_scalar(loss, bounds=(-2.5, 2.5), method="bounded").x))


def _tune_on_validation(
    streams: ObservedStreams,
    noise: float | np.ndarray,
    settings: ClassifierConfig,
    sets: Split,
    watch: _Watch,
    workers: int,
) -> tuple[int, float]:
    """Number of trees and temperature, from the validation streams."""
    stopping = settings.boosting.early_stopping_rounds is not None
    calibrating = settings.calibration == "temperature"
    if not (stopping or calibrating):
        return settings.boosting.n_estimators, 1.0
    q, y = augmented(streams, sets.train, noise, settings.copies, (settings.seed, 1))
    features = FeatureMap.fit(q, settings.features)
    held, truth = features(streams.observed(noise)[sets.validation]), streams.y[sets.validation]
    watch.start(0)
    booster = boost(
        features(q), y, settings, settings.boosting.n_estimators, (held, truth), watch=watch, workers=workers
    )
    n_trees = booster.best_iteration + 1 if stopping else settings.boosting.n_estimators
    temperature = fit_temperature(class_margins(booster, held, n_trees), truth) if calibrating else 1.0
    return n_trees, temperature


def _balance(y: np.ndarray) -> np.ndarray:
    """Weights that make all classes count the same, 1 on average."""
    counts = np.bincount(y)
    return (len(y) / (len(counts) * counts[y])).astype(np.float32)


class _Watch(xgboost.callback.TrainingCallback):
    """Reports progress after each round of boosting, and ends it when asked to."""

    def __init__(self, progress: Progress | None, should_stop: ShouldStop | None, total: int) -> None:
        super().__init__()
        self.progress, self.should_stop, self.total = progress, should_stop, total
        self.first = 0
        self.stopped = False

    def start(self, first: int) -> None:
        """Count from here."""
        self.first = first

    def after_iteration(self, model, epoch: int, evals_log) -> bool:
        if self.progress is not None:
            self.progress(self.first + epoch + 1, self.total)
        self.stopped = self.should_stop is not None and self.should_stop()
        return self.stopped
