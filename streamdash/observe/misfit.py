"""Would another assumption about the data explain a sure answer as well? A detector of the misled.

A classifier that learnt from streams observed as the table says is sure of itself also where the table is
wrong: a survey whose depth varies along the stream, errors larger than stated, bins that lie elsewhere or
run the other way. Here simulated streams are observed so, and those of which the classifier is sure all the
same, and wrong, are kept. Trees learn to tell them from honest streams of which it is just as sure. Their
score is ranked among honest streams that nothing was trained on and that were called the same, so that a
fraction p of honest sure answers looks as misled or more.

Only streams that mislead are learnt from: to see that a small wave is there which changes no answer would
cost false alarms and gain nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import xgboost

from streamdash.classifier.model import Classifier
from streamdash.observe.resemblance import TREES as CLOUD_TREES
from streamdash.observe.resemblance import Cloud
from streamdash.statistics.features import summarise
from streamdash.survey.design import Design, measured, polynomial_fit

SURE = 0.9
"""An answer above this probability can mislead; one below is undecided anyhow."""
MISLED = 0.015
"""Below this p-value a sure answer is said to hang on an assumption about the data."""
WAVE, ERRORS, PLACE = "wave", "errors", "place"
SHARES = {(WAVE, ERRORS): 0.7, (PLACE,): 0.3}
"""Kinds of wrong assumptions that one detector looks for, and its share of the false alarms."""
WORDS = {
    WAVE: "The evenness of the survey decides. The profile looks like one on which a smooth wave along the "
    "stream was laid, of the survey's depth or of the background: without that wave, its perturbers may be "
    "others.",
    ERRORS: "The errors decide. The profile scatters from bin to bin as if its errors were larger than "
    "stated: if they are, its perturbers may be others.",
    PLACE: "The positions decide. The profile looks like a stream that runs the other way, or whose bins lie "
    "some degrees elsewhere: check the coordinate.",
}
"""What is said of a profile whose answer hangs on an assumption."""
AMPLITUDES = (0.05, 0.5)
"""Smallest and largest amplitude of waves, relative to the density."""
PERIODS = 0.7
"""Fewest periods of a wave over the profile; at most one in four bins."""
ERROR_FACTORS = (1.3, 2.6)
"""Smallest and largest factor by which errors are larger than stated."""
SHIFT = 4.0
"""Most bins by which positions are off."""
COPIES = {"wave": 4, "smooth wave": 2, "errors": 4, "shift": 2, "reversed": 2, "honest": 3, "held out": 4}
"""Times every stream is observed in each way."""
ORDERS = (5, 8)
"""Orders of polynomials whose remainders show what is left without smooth waves."""
TREES = {
    "objective": "binary:logistic",
    "max_depth": 4,
    "eta": 0.1,
    "colsample_bytree": 0.3,
    "subsample": 0.7,
    "lambda": 1.0,
    "tree_method": "hist",
    "max_bin": 64,
    "nthread": 1,
}
ROUNDS, ROUNDS_OF_NAMES = 250, 60
LEAST_LEARNT = 30
"""Of fewer misled streams nothing is learnt: no alarm of this kind is needed."""


@dataclass(frozen=True)
class Misled:
    """Whether an answer hangs on an assumption about the data.

    Attributes
    ----------
    p : float
        Share of honest streams, called the same and with as much certainty, that look as misled or more.
    kind : str
        What would explain the profile best: `WAVE`, `ERRORS` or `PLACE`; empty where nothing is suspected.
    """

    p: float
    kind: str

    @property
    def words(self) -> str:
        """The warning in a sentence or two; empty where nothing is suspected."""
        return WORDS.get(self.kind, "")


@dataclass(frozen=True, eq=False)
class _Detector:
    """Trees for some kinds, their names, and the scores of honest streams by the class they are called."""

    kinds: tuple[str, ...]
    share: float
    trees: xgboost.Booster | None
    names: xgboost.Booster | None
    honest: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Misfit:
    """The detectors for one design; made by `learn_misfit`."""

    head: Classifier
    cloud: Cloud
    fits: tuple[np.ndarray, ...]
    detectors: tuple[_Detector, ...]

    def __call__(self, q: np.ndarray, probability: np.ndarray) -> list[Misled]:
        """What is suspected of profiles (n, n_bin), given the answers to them (n, n_classes)."""
        x = features(q, self.head, self.cloud, self.fits)
        called, sure = probability.argmax(axis=1), probability.max(axis=1) > SURE
        ranks = np.ones((len(self.detectors), len(q)))
        for d, detector in enumerate(self.detectors):
            if detector.trees is None:
                continue
            scores = _margin(detector.trees, x)
            for c, honest in enumerate(detector.honest):
                mine = called == c
                worse = len(honest) - np.searchsorted(honest, scores[mine], side="left")
                ranks[d, mine] = (1 + worse) / (1 + len(honest)) / detector.share
        found = []
        for i in range(len(q)):
            d = int(ranks[:, i].argmin())
            p = float(min(1.0, ranks[d, i]))
            kind = _kind(self.detectors[d], x[i : i + 1]) if sure[i] and p < MISLED else ""
            found.append(Misled(p, kind))
        return found


def learn_misfit(
    head: Classifier,
    cloud: Cloud,
    design: Design,
    clean: np.ndarray,
    y: np.ndarray,
    smooth: np.ndarray,
    known: np.ndarray,
    held_out: np.ndarray,
    seed: int = 0,
) -> Misfit:
    """Learn what misled answers look like in one design.

    Parameters
    ----------
    head : Classifier
        Whose certainty is looked at.
    cloud : Cloud
        Where the streams of each class lie.
    clean : ndarray (n_streams, n_bin)
        All streams, no noise, not divided.
    y : ndarray (n_streams,)
        Their classes.
    smooth : ndarray (n_bin,)
        The unperturbed stream, likewise.
    known, held_out : ndarray of int
        Rows to learn from, and rows to rank profiles among.
    """
    rng = np.random.default_rng([seed, 12])
    fits = tuple(
        polynomial_fit(design.centers, order).astype(np.float32)
        for order in ORDERS
        if order + 2 <= design.n_bin // 2
    )

    def seen(profiles: np.ndarray, factor: np.ndarray | float = 1.0) -> np.ndarray:
        draws = (factor * rng.standard_normal(profiles.shape)).astype(np.float32)
        return measured(profiles.astype(np.float32), draws, design.sigma, design.fit).astype(np.float32)

    samples: dict[str, list[np.ndarray]] = {WAVE: [], ERRORS: [], PLACE: []}
    for kind, profiles, factor, truth in _altered(clean[known], y[known], smooth, rng):
        q = seen(profiles, factor)
        said = head.predict_proba(q)
        # A stream that is put elsewhere is read wrongly, whatever it is called.
        wrong = (said.argmax(axis=1) != truth) | (kind == PLACE)
        misled = (said.max(axis=1) > SURE) & wrong
        if misled.any():
            samples[kind].append(features(q[misled], head, cloud, fits))
    honest = []
    for _ in range(COPIES["honest"]):
        q = seen(clean[known])
        sure = head.predict_proba(q).max(axis=1) > SURE
        honest.append(q[sure])
    real = features(np.concatenate(honest), head, cloud, fits)
    again = np.concatenate([seen(clean[held_out]) for _ in range(COPIES["held out"])])
    said = head.predict_proba(again)
    called = np.where(said.max(axis=1) > SURE, said.argmax(axis=1), -1)
    ranked = features(again, head, cloud, fits)

    def learnt(kinds: tuple[str, ...], share: float) -> _Detector:
        parts = [np.concatenate(samples[kind]) for kind in kinds if samples[kind]]
        there = tuple(kind for kind in kinds if samples[kind])
        if len(real) < LEAST_LEARNT or sum(map(len, parts)) < LEAST_LEARNT:
            return _Detector(kinds, share, None, None, ())
        trees = _trees([real, *parts], (0, *(1 for _ in parts)), ROUNDS, seed)
        names = _trees(parts, range(len(parts)), ROUNDS_OF_NAMES, seed) if len(parts) > 1 else None
        scores = _margin(trees, ranked)
        by_class = tuple(np.sort(scores[called == c]) for c in range(int(y.max()) + 1))
        return _Detector(there, share, trees, names, by_class)

    with ThreadPoolExecutor(len(SHARES)) as threads:
        return Misfit(head, cloud, fits, tuple(threads.map(learnt, SHARES, SHARES.values())))


def features(q: np.ndarray, head: Classifier, cloud: Cloud, fits: tuple[np.ndarray, ...]) -> np.ndarray:
    """What the trees are given: what the head and the checks see, and remainders without smooth waves."""
    summaries = summarise(q, CLOUD_TREES.features)
    seen = head.features(q, summaries if head.features.features == CLOUD_TREES.features else None)
    parts = [cloud.features(q, summaries), seen, head.probability(seen)]
    for fit in fits:
        curve = q @ fit.T
        rest = q - curve
        near, next_but_one = rest[:, 1:] * rest[:, :-1], rest[:, 2:] * rest[:, :-2]
        numbers = (rest.std(axis=1), np.abs(rest).mean(axis=1), rest.min(axis=1), rest.max(axis=1))
        parts += [np.stack((*numbers, near.mean(axis=1), next_but_one.mean(axis=1)), axis=1), curve]
    waves = np.fft.rfft(q - q.mean(axis=1, keepdims=True), axis=1)
    parts.append(np.log(np.abs(waves[:, 1:]) + 1e-3))
    return np.concatenate(parts, axis=1).astype(np.float32)


def _altered(
    clean: np.ndarray, y: np.ndarray, smooth: np.ndarray, rng: np.random.Generator
) -> Iterator[tuple[str, np.ndarray, np.ndarray | float, np.ndarray]]:
    """Streams of which an assumption does not hold: kind, profiles, factor of the errors, true classes."""
    n, n_bin = clean.shape
    bins = np.arange(n_bin)

    def waves(size: int) -> np.ndarray:
        amplitude = _log_uniform(AMPLITUDES, size, rng)
        periods = _log_uniform((PERIODS, max(n_bin / 4, 2 * PERIODS)), size, rng)
        return 1 + amplitude * np.sin(2 * np.pi * (periods * bins / n_bin + rng.random((size, 1))))

    for _ in range(COPIES["wave"]):
        yield WAVE, clean * waves(n), 1.0, y
    for _ in range(COPIES["smooth wave"]):
        yield WAVE, smooth * waves(n), 1.0, np.zeros_like(y)  # as little as the lightest perturbers do
    for _ in range(COPIES["errors"]):
        yield ERRORS, clean, _log_uniform(ERROR_FACTORS, n, rng), y
    for _ in range(COPIES["shift"]):
        off = rng.uniform(-SHIFT, SHIFT, (n, 1))
        moved = [np.interp(bins + off[i], bins, clean[i]) for i in range(n)]
        yield PLACE, np.array(moved), 1.0, y
    for _ in range(COPIES["reversed"]):
        yield PLACE, clean[:, ::-1], 1.0, y


def _log_uniform(ends: tuple[float, float], size: int, rng: np.random.Generator) -> np.ndarray:
    return np.exp(rng.uniform(np.log(ends[0]), np.log(ends[1]), (size, 1)))


def _trees(
    parts: list[np.ndarray], marks: tuple[int, ...] | range, rounds: int, seed: int
) -> xgboost.Booster:
    """Trees that tell parts marked 1 from those marked 0; all parts of a mark weigh the same."""
    weights = np.concatenate([np.full(len(part), 1 / len(part)) for part in parts])
    truth = np.repeat(list(marks), [len(part) for part in parts])
    for mark in (0, 1):
        weights[truth == mark] /= weights[truth == mark].mean()
    data = xgboost.QuantileDMatrix(
        np.concatenate(parts), truth, weight=weights, max_bin=TREES["max_bin"], nthread=1
    )
    return xgboost.train({**TREES, "seed": seed}, data, rounds)


def _margin(trees: xgboost.Booster, x: np.ndarray) -> np.ndarray:
    return trees.predict(xgboost.DMatrix(x, nthread=1), output_margin=True)


def _kind(detector: _Detector, x: np.ndarray) -> str:
    if detector.names is None:
        return detector.kinds[0]
    return detector.kinds[int(_margin(detector.names, x)[0] > 0)]
