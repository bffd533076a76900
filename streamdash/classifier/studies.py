"""What one asks of a classifier once it works: tuning, and how it depends on data, noise and place.

Every study takes the same ``progress`` and ``should_stop`` as `streamdash.classifier.train.train` and
judges on test streams that nothing was trained on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xgboost
from sklearn.metrics import accuracy_score, log_loss
from sklearn.model_selection import StratifiedKFold
from sklearn.neural_network import MLPClassifier

from streamdash.classifier.data import (
    MIN_STREAMS,
    Cancelled,
    Split,
    augmented,
    split,
)
from streamdash.classifier.model import BEST, Classifier, ClassifierConfig, class_margins
from streamdash.classifier.train import Judged, Progress, ShouldStop, boost, check_noise, train
from streamdash.statistics.features import FeatureMap
from streamdash.statistics.scores import Scores, evaluate
from streamdash.survey.observed import ObservedStreams

PAPER_DEPTHS = (2, 4, 8, 16, 32, 64, 128)
PAPER_TREES = (10, 25, 50, 100, 150, 200)
"""The paper searches "a few values" of max_depth in [2, 128] and of n_estimators in [10, 200]."""
N_FOLDS = 5
NOISES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
BLOCK_DEG = 4.0
"""Default width of the blocks of longitude that are permuted, in degrees."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Cross-validated accuracy over a grid of hyperparameters.

    Attributes
    ----------
    depths : ndarray (n_depths,)
    n_trees : ndarray (n_sizes,)
    accuracy, error : ndarray (n_depths, n_sizes)
        Mean over the folds and the standard error of that mean.
    settings : ClassifierConfig
        The settings that were searched around, with the best grid point put in.
    """

    depths: np.ndarray
    n_trees: np.ndarray
    accuracy: np.ndarray
    error: np.ndarray
    settings: ClassifierConfig


@dataclass(frozen=True, eq=False)
class Curve:
    """Accuracy and recall on the test streams against something.

    Attributes
    ----------
    x : ndarray (n_points,)
    accuracy, accuracy_error : ndarray (n_points,)
    recall, recall_error : ndarray (n_points, n_classes)
    """

    x: np.ndarray
    accuracy: np.ndarray
    accuracy_error: np.ndarray
    recall: np.ndarray
    recall_error: np.ndarray

    @classmethod
    def of(cls, x: Sequence[float], scores: Sequence[Scores]) -> Curve:
        """From the scores at each point."""
        return cls(
            np.asarray(x, float),
            np.array([s.values["overall_accuracy"] for s in scores]),
            np.array([s.half_interval("overall_accuracy") for s in scores]),
            np.array([s.values["recall"] for s in scores]),
            np.array([s.half_interval("recall") for s in scores]),
        )


@dataclass(frozen=True, eq=False)
class Importance:
    """What is lost when a block of longitude is exchanged between streams.

    Attributes
    ----------
    edges : ndarray (n_blocks + 1,)
        In the unit of the coordinate.
    log_loss, log_loss_error : ndarray (n_blocks,)
        Rise of the log loss, mean and standard deviation over the permutations.
    accuracy, accuracy_error : ndarray (n_blocks,)
        Drop of the accuracy.
    coordinate : str
        What the edges are in: ``ell`` or the longitude of the stream's frame.
    progenitor : str
        Where the progenitor is in the figure, in words.
    """

    edges: np.ndarray
    log_loss: np.ndarray
    log_loss_error: np.ndarray
    accuracy: np.ndarray
    accuracy_error: np.ndarray
    coordinate: str = "ell"
    progenitor: str = "at the left"


def grid_search(
    streams: ObservedStreams,
    noise: float | np.ndarray,
    settings: ClassifierConfig = BEST,
    depths: Sequence[int] = PAPER_DEPTHS,
    n_trees: Sequence[int] = PAPER_TREES,
    n_folds: int = N_FOLDS,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> Grid:
    """Cross-validate depth and number of trees on the training streams (paper §2.5).

    Boosting is sequential: the first n trees of a long model are the model of n trees. So each
    depth is grown once per fold, with the most trees, and judged at every number of them. Trees that
    do not reach the depth they may reach are those of any larger one, which is not grown then.

    Returns
    -------
    Grid
        The best point is the smallest model within one standard error of the highest accuracy.

    Raises
    ------
    Cancelled
        When ``should_stop`` said so.
    """
    check_noise(noise, streams.n_bins)
    sizes = np.sort(np.asarray(n_trees))
    rows = split(streams.y, settings.seed).train
    folds = StratifiedKFold(n_folds, shuffle=True, random_state=settings.seed)
    accuracy = np.zeros((n_folds, len(depths), len(sizes)))
    done, total = 0, n_folds * len(depths)
    for k, (inner, held) in enumerate(folds.split(rows, streams.y[rows])):
        q, y = augmented(streams, rows[inner], noise, settings.copies, (settings.seed, 3, k))
        features = FeatureMap.fit(q, settings.features)
        x, x_held = features(q), features(streams.observed(noise)[rows[held]])
        whole: int | None = None  # of the depths so far, the one whose trees were not cut short
        for d in np.argsort(depths, kind="stable"):
            _stop_if_asked(should_stop)
            if whole is not None:
                accuracy[k, d] = accuracy[k, whole]
            else:
                one = _with_trees(settings, int(depths[d]), int(sizes[-1]))
                booster = boost(x, y, one, int(sizes[-1]), workers=workers)
                for s, size in enumerate(sizes):
                    predicted = class_margins(booster, x_held, int(size)).argmax(axis=1)
                    accuracy[k, d, s] = np.mean(predicted == streams.y[rows[held]])
                whole = d if _deepest(booster) < depths[d] else None
            done += 1
            if progress:
                progress(done, total)
    mean, error = accuracy.mean(axis=0), accuracy.std(axis=0, ddof=1) / np.sqrt(n_folds)
    depth, size = _simplest_of_the_best(mean, error)
    best = _with_trees(settings, int(depths[depth]), int(sizes[size]))
    return Grid(np.asarray(depths), sizes, mean, error, best)


def _deepest(booster: xgboost.Booster) -> int:
    """Levels of splits of the deepest tree."""
    return max(line.count("\t") for tree in booster.get_dump() for line in tree.splitlines())


def learning_curve(
    streams: ObservedStreams,
    noise: float | np.ndarray,
    settings: ClassifierConfig = BEST,
    sizes: Sequence[int] | None = None,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> Curve:
    """Scores against the number of simulated streams per class, ``x``.

    ``x`` counts the streams that have to be simulated, test streams included. Each point is
    trained on that share of the training and validation streams, and all are judged on all the
    test streams.

    Parameters
    ----------
    sizes : sequence of int, optional
        Streams per class; by default doubling up to all there are.
    """
    most = min(len(q) for q in streams.q)
    if sizes is None:
        sizes = [int(n) for n in most / 2.0 ** np.arange(5, -1, -1) if n >= MIN_STREAMS]
    sets = split(streams.y, settings.seed)
    scores = []
    for i, size in enumerate(sizes):
        thinned = _thinned(sets, streams.y, size / most)
        step = _part(progress, i, len(sizes))
        scores.append(train(streams, noise, settings, step, should_stop, workers, thinned).scores)
    return Curve.of(sizes, scores)


def noise_curve(
    streams: ObservedStreams,
    settings: ClassifierConfig = BEST,
    noises: Sequence[float] = NOISES,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> Curve:
    """Scores against σ_ε, trained and judged anew at each: where does the method die?"""
    scores = []
    for i, noise in enumerate(noises):
        judged = train(streams, noise, settings, _part(progress, i, len(noises)), should_stop, workers)
        scores.append(judged.scores)
    return Curve.of(noises, scores)


def wrong_noise_curve(
    streams: ObservedStreams,
    noise: float,
    settings: ClassifierConfig = BEST,
    noises: Sequence[float] = NOISES,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> Curve:
    """Scores against the true σ_ε of a classifier that was trained at one: what if the errors are wrong?

    Parameters
    ----------
    noise : what the classifier is trained at.
    noises : what the test streams are truly observed with; `noise` itself is always among them.
    """
    judged = train(streams, noise, settings, progress, should_stop, workers)
    true = sorted({*noises, noise})
    scores = []
    for sigma in true:
        _stop_if_asked(should_stop)
        said = judged.classifier.predict_proba(streams.observed(sigma)[judged.rows])
        scores.append(evaluate(judged.y, said, seed=settings.seed))
    return Curve.of(true, scores)


def importance(
    judged: Judged,
    streams: ObservedStreams,
    noise: float | np.ndarray,
    block: float = BLOCK_DEG,
    n_repeats: int = 3,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
) -> Importance:
    """Which parts of the stream carry the information.

    The Qρ of a block of longitude is exchanged between test streams at random, so that the block
    keeps its looks but no longer belongs to its stream. The noise stays where it is, and the
    exchange sets in over half a block: sharp seams would look like gaps.

    Parameters
    ----------
    block : float
        Width of the blocks in the unit of ``streams.centers``.
    """
    edges = _block_edges(streams.centers, block)
    clean = streams.clean[judged.rows]
    errors = streams.observed(noise)[judged.rows] - clean
    base = _loss_and_accuracy(judged.classifier, clean + errors, judged.y)
    rng = np.random.default_rng(judged.classifier.card.settings.seed)
    change = np.zeros((n_repeats, len(edges) - 1, 2))
    for b in range(len(edges) - 1):
        share = _window(streams.centers, edges, b)
        for r in range(n_repeats):
            _stop_if_asked(should_stop)
            mixed = clean + share * (clean[rng.permutation(len(clean))] - clean) + errors
            change[r, b] = _loss_and_accuracy(judged.classifier, mixed, judged.y) - base
        if progress is not None:
            progress(b + 1, len(edges) - 1)
    mean, error = change.mean(axis=0), change.std(axis=0)
    return Importance(
        edges,
        mean[:, 0],
        error[:, 0],
        -mean[:, 1],
        error[:, 1],
        streams.design.coordinate,
        _progenitor(streams),
    )


@dataclass(frozen=True, eq=False)
class Contender:
    """One row of the comparison of presets: its name, scores and seconds of training."""

    name: str
    scores: Scores
    seconds: float


def compare(
    streams: ObservedStreams,
    noise: float | np.ndarray,
    presets: Mapping[str, ClassifierConfig],
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> list[Contender]:
    """Presets and small dense networks on one split.

    The networks are scikit-learn's ``MLPClassifier`` with three layers of 16 units (the paper's
    "few hidden layers composed by O(10) units"), once on the features of each preset named
    ``paper`` and ``best`` among ``presets``, with early stopping.
    """
    contenders = []
    networks = [name for name in ("paper", "best") if name in presets]
    total = len(presets) + len(networks)
    for i, (name, settings) in enumerate(presets.items()):
        judged = train(streams, noise, settings, _part(progress, i, total), should_stop, workers)
        contenders.append(Contender(name, judged.scores, judged.seconds))
    for i, name in enumerate(networks):
        _stop_if_asked(should_stop)
        contenders.append(_network(f"dense network, features of {name!r}", streams, noise, presets[name]))
        step = _part(progress, len(presets) + i, total)
        if step is not None:
            step(1, 1)
    return contenders


def _network(
    name: str, streams: ObservedStreams, noise: float | np.ndarray, settings: ClassifierConfig
) -> Contender:
    """A dense network on the features of some settings, on the same split."""
    started = time.perf_counter()
    sets = split(streams.y, settings.seed)
    rows = np.concatenate([sets.train, sets.validation])
    q, y = augmented(streams, rows, noise, settings.copies, (settings.seed, 2))
    features = FeatureMap.fit(q, settings.features)
    x = features(q)
    centre, width = x.mean(axis=0), x.std(axis=0) + 1e-9
    network = MLPClassifier((16, 16, 16), early_stopping=True, max_iter=300, random_state=settings.seed)
    network.fit((x - centre) / width, y)
    seconds = time.perf_counter() - started
    held = features(streams.observed(noise)[sets.test])
    probability = network.predict_proba((held - centre) / width)
    return Contender(name, evaluate(streams.y[sets.test], probability, seed=settings.seed), seconds)


def _with_trees(settings: ClassifierConfig, depth: int, n_trees: int) -> ClassifierConfig:
    """The settings with another depth and number of trees, and no early stopping."""
    update = {"max_depth": depth, "n_estimators": n_trees, "early_stopping_rounds": None}
    return settings.model_copy(update={"boosting": settings.boosting.model_copy(update=update)})


def _simplest_of_the_best(mean: np.ndarray, error: np.ndarray) -> tuple[int, int]:
    """Grid point with the fewest trees, then the least depth, within one error of the best."""
    best = np.unravel_index(mean.argmax(), mean.shape)
    good = np.argwhere(mean >= mean[best] - error[best])
    depth, size = min(good.tolist(), key=lambda point: (point[1], point[0]))
    return depth, size


def _thinned(sets: Split, y: np.ndarray, share: float) -> Split:
    """The first share of each class's training and validation streams, and all test streams."""

    def first(rows: np.ndarray) -> np.ndarray:
        classes = [rows[y[rows] == c] for c in np.unique(y)]
        return np.concatenate([c[: max(2, round(share * len(c)))] for c in classes])

    return Split(first(sets.train), first(sets.validation), sets.test)


def _block_edges(ell: np.ndarray, block: float) -> np.ndarray:
    """Edges of blocks of about the given width that fill the bins."""
    half = 0.5 * abs(ell[1] - ell[0])
    low, high = ell.min() - half, ell.max() + half
    return np.linspace(low, high, max(1, round((high - low) / block)) + 1)


def _progenitor(streams: ObservedStreams) -> str:
    """Where the progenitor is: bins are counted from it, in each arm."""
    if streams.design.arms:
        return "between the arms"
    return "at the left" if streams.centers[0] < streams.centers[-1] else "at the right"


def _window(ell: np.ndarray, edges: np.ndarray, b: int) -> np.ndarray:
    """How much of each bin is exchanged with block ``b``: 0 to 1, in ramps centred on its edges."""
    ramp = 0.5 * (edges[1] - edges[0])
    rise = np.ones_like(ell) if b == 0 else np.clip((ell - edges[b]) / ramp + 0.5, 0, 1)
    last = b == len(edges) - 2
    fall = np.ones_like(ell) if last else np.clip((edges[b + 1] - ell) / ramp + 0.5, 0, 1)
    return (rise * fall).astype(np.float32)


def _loss_and_accuracy(classifier: Classifier, q: np.ndarray, y: np.ndarray) -> np.ndarray:
    probability = classifier.predict_proba(q)
    labels = np.arange(probability.shape[1])
    return np.array([log_loss(y, probability, labels=labels), accuracy_score(y, probability.argmax(axis=1))])


def _part(progress: Progress | None, i: int, n: int) -> Callable[[int, int], None] | None:
    """Progress of step ``i`` of ``n`` as progress of the whole, in thousandths."""
    if progress is None:
        return None
    return lambda done, total: progress(int(1000 * (i + done / total) / n), 1000)


def _stop_if_asked(should_stop: ShouldStop | None) -> None:
    if should_stop is not None and should_stop():
        raise Cancelled
