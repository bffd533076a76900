"""Would another assumption about the data explain a sure answer as well? A detector of the misled.

A classifier that learnt from streams observed as the table says is sure of itself also where the table is
wrong: a survey whose depth varies along the stream, errors larger than stated, bins that lie elsewhere or
run the other way. Here simulated streams are observed so, and those of which it is sure all the same, and
wrong, are kept. For each kind of mistake and each class that is answered, trees learn to tell them from
honest streams of which the same is said as surely. Their score is ranked among honest streams that nothing
was trained on, so that a fraction p of honest sure answers looks as misled or more.

Only streams that mislead are learnt from: to see that a small wave is there which changes no answer would
cost false alarms and gain nothing. For the same reason an answer counts as sure where it is so both at the
simulated abundance and with the abundance free: what hangs on the abundance is said to do so anyhow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import xgboost
from scipy.special import logit

from streamdash.classifier.model import Classifier
from streamdash.observe.resemblance import TREES as CLOUD_TREES
from streamdash.observe.resemblance import Cloud
from streamdash.statistics.features import summarise
from streamdash.survey.design import Design, measured, polynomial_fit

Answers = Callable[[np.ndarray], np.ndarray]
"""Probabilities (n, n_classes) of profiles (n, n_bin)."""
SURE = 0.95
"""An answer above this probability can mislead; one below says itself that it may be wrong."""
MISLED = 0.03
"""Below this p-value a sure answer is said to hang on an assumption about the data."""
WAVE, ERRORS, PLACE, DIRECTION = "wave", "errors", "place", "direction"
SHARES = {WAVE: 0.52, ERRORS: 0.02, PLACE: 0.02, DIRECTION: 0.44}
"""Kinds of wrong assumptions, and the share of the false alarms that the detector of each may give."""
WORDS = {
    WAVE: "The evenness of the survey decides. The profile looks like one on which a smooth wave along the "
    "stream was laid, of the survey's depth or of the background: without that wave, its perturbers may be "
    "others.",
    ERRORS: "The errors decide. The profile scatters from bin to bin as if its errors were larger than "
    "stated: if they are, its perturbers may be others.",
    PLACE: "The positions decide. The profile looks like one whose bins lie some degrees elsewhere: check "
    "the coordinate.",
    DIRECTION: "The direction decides. The profile looks like a stream that runs the other way: check the "
    "sign of the coordinate and which end is near the progenitor.",
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
COPIES = {"wave": 9, "smooth wave": 4, "errors": 3, "shift": 2, "reversed": 8, "honest": 9, "held out": 10}
"""Times every stream is observed in each way."""
ORDERS = (5, 8)
"""Orders of polynomials whose remainders show what is left without smooth waves."""
TREES = {
    "objective": "binary:logistic",
    "max_depth": 6,
    "eta": 0.1,
    "colsample_bytree": 0.5,
    "subsample": 0.5,
    "lambda": 1.0,
    "tree_method": "hist",
    "max_bin": 64,
    "nthread": 1,
}
ROUNDS = 350
SIEVE = {**TREES, "max_depth": 4, "eta": 0.3, "max_bin": 16}
"""Few coarse trees that find which features tell a kind of mistake."""
SIEVE_ROUNDS, SIEVE_ROWS, KEPT = 30, 3, 60
"""They are shown every third stream; so many features are kept of all."""
LEAST_LEARNT = 30
"""Of fewer misled streams nothing is learnt: no alarm of this kind is needed."""
LEAST_ODDS = 1e-5
"""Probabilities are told apart down to this."""


@dataclass(frozen=True)
class Misled:
    """Whether an answer hangs on an assumption about the data.

    Attributes
    ----------
    p : float
        Share of honest streams, called the same and with as much certainty, that look as misled or more.
    kind : str
        What would explain the profile best, a key of `WORDS`; empty where nothing is suspected.
    """

    p: float
    kind: str

    @property
    def words(self) -> str:
        """The warning in a sentence or two; empty where nothing is suspected."""
        return WORDS.get(self.kind, "")


@dataclass(frozen=True, eq=False)
class _Detector:
    """Trees that know one kind of mistake among answers of one class, and the scores of honest streams."""

    kind: str
    called: int
    share: float
    columns: np.ndarray
    trees: xgboost.Booster
    honest: np.ndarray

    def ranks(self, x: np.ndarray) -> np.ndarray:
        """Share of honest streams that look as misled or more, over this detector's share of the alarms."""
        worse = len(self.honest) - np.searchsorted(self.honest, _margin(self.trees, x[:, self.columns]))
        return (1 + worse) / (1 + len(self.honest)) / self.share


@dataclass(frozen=True, eq=False)
class _View:
    """What the trees look at: both answers, what the checks see, and remainders without smooth waves."""

    head: Classifier
    free: Answers | None
    cloud: Cloud
    fits: tuple[np.ndarray, ...]

    def sure(self, q: np.ndarray, said: np.ndarray | None = None) -> np.ndarray:
        """The class that is surely answered for each profile, −1 where none is."""
        said = self.head.predict_proba(q) if said is None else said
        called = np.where(said.max(axis=1) > SURE, said.argmax(axis=1), -1)
        rows = np.flatnonzero(called >= 0)
        if self.free is not None and len(rows):
            also = self.free(q[rows])[np.arange(len(rows)), called[rows]] > SURE
            called[rows[~also]] = -1
        return called

    def __call__(self, q: np.ndarray) -> np.ndarray:
        summaries = summarise(q, CLOUD_TREES.features)
        seen = self.head.features(
            q, summaries if self.head.features.features == CLOUD_TREES.features else None
        )
        parts = [self.cloud.features(q, summaries), seen, self.head.probability(seen)]
        if self.free is not None:
            parts.append(logit(np.clip(self.free(q), LEAST_ODDS, 1 - LEAST_ODDS)))
        for fit in self.fits:
            curve = q @ fit.T
            rest = q - curve
            near, next_but_one = rest[:, 1:] * rest[:, :-1], rest[:, 2:] * rest[:, :-2]
            numbers = (rest.std(axis=1), np.abs(rest).mean(axis=1), rest.min(axis=1), rest.max(axis=1))
            parts += [np.stack((*numbers, near.mean(axis=1), next_but_one.mean(axis=1)), axis=1), curve]
        waves = np.fft.rfft(q - q.mean(axis=1, keepdims=True), axis=1)
        parts.append(np.log(np.abs(waves[:, 1:]) + 1e-3))
        return np.concatenate(parts, axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Misfit:
    """The detectors for one design; made by `learn_misfit`."""

    view: _View
    detectors: tuple[_Detector, ...]

    def __call__(self, q: np.ndarray, probability: np.ndarray) -> list[Misled]:
        """What is suspected of profiles (n, n_bin), given the answers to them (n, n_classes)."""
        found = [Misled(1.0, "")] * len(q)
        sure = self.view.sure(q, probability)
        for c in range(probability.shape[1]):
            detectors, rows = [d for d in self.detectors if d.called == c], np.flatnonzero(sure == c)
            if not detectors or not len(rows):
                continue
            x = self.view(q[rows])
            ranks = np.stack([detector.ranks(x) for detector in detectors])
            for i, row in enumerate(rows):
                d = int(ranks[:, i].argmin())
                p = float(min(1.0, ranks[d, i]))
                found[row] = Misled(p, detectors[d].kind if p < MISLED else "")
        return found


def learn_misfit(
    head: Classifier,
    free: Answers | None,
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
    free : callable or None
        Answers with the abundance of each class free, where there are such.
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
    view = _View(head, free, cloud, fits)

    def seen(profiles: np.ndarray, factor: np.ndarray | float = 1.0) -> np.ndarray:
        draws = (factor * rng.standard_normal(profiles.shape)).astype(np.float32)
        return measured(profiles.astype(np.float32), draws, design.sigma, design.fit).astype(np.float32)

    classes = range(int(y.max()) + 1)
    samples: dict[tuple[str, int], list[np.ndarray]] = {(kind, c): [] for kind in SHARES for c in classes}
    for kind, profiles, factor, truth in _altered(clean[known], y[known], smooth, rng):
        q = seen(profiles, factor)
        said = head.predict_proba(q)
        # A stream that runs the other way is read wrongly, whatever it is called.
        wrong = (said.argmax(axis=1) != truth) | (kind == DIRECTION)
        q, said = q[wrong], said[wrong]
        called = view.sure(q, said)
        for c in classes:
            samples[kind, c].append(q[called == c])
    honest = np.concatenate([seen(clean[known]) for _ in range(COPIES["honest"])])
    again = np.concatenate([seen(clean[held_out]) for _ in range(COPIES["held out"])])
    for_learning, for_ranks = view.sure(honest), view.sure(again)

    def learnt(c: int) -> list[_Detector]:
        misled = {kind: np.concatenate(samples[kind, c]) for kind in SHARES}
        misled = {kind: q for kind, q in misled.items() if len(q) >= LEAST_LEARNT}
        real, ranked = honest[for_learning == c], again[for_ranks == c]
        if len(real) < LEAST_LEARNT or not len(ranked) or not misled:
            return []
        real, ranked = view(real), view(ranked)
        whole = sum(SHARES[kind] for kind in misled)
        found = []
        for kind, q in misled.items():
            x = view(q)
            columns = _telling(real, x, seed)
            trees = _trees(real[:, columns], x[:, columns], TREES, ROUNDS, seed)
            scores = np.sort(_margin(trees, ranked[:, columns]))
            found.append(_Detector(kind, c, SHARES[kind] / whole, columns, trees, scores))
        return found

    with ThreadPoolExecutor(2) as threads:
        return Misfit(view, tuple(d for found in threads.map(learnt, classes) for d in found))


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
        yield DIRECTION, clean[:, ::-1], 1.0, y


def _log_uniform(ends: tuple[float, float], size: int, rng: np.random.Generator) -> np.ndarray:
    return np.exp(rng.uniform(np.log(ends[0]), np.log(ends[1]), (size, 1)))


def _telling(honest: np.ndarray, misled: np.ndarray, seed: int) -> np.ndarray:
    """The columns that tell most, by the gain of a few coarse trees that see a part of the streams."""
    step = SIEVE_ROWS if min(len(honest), len(misled)) > SIEVE_ROWS * LEAST_LEARNT else 1
    coarse = _trees(honest[::step], misled[::step], SIEVE, SIEVE_ROUNDS, seed)
    gain = coarse.get_score(importance_type="total_gain")
    best = sorted(gain, key=lambda name: -float(np.max(gain[name])))[:KEPT]
    return np.sort([int(name.removeprefix("f")) for name in best])


def _trees(honest: np.ndarray, misled: np.ndarray, settings: dict, rounds: int, seed: int) -> xgboost.Booster:
    """Trees that tell misled streams from honest ones, which weigh the same together."""
    weights = np.repeat([1 / len(honest), 1 / len(misled)], [len(honest), len(misled)])
    data = xgboost.QuantileDMatrix(
        np.concatenate([honest, misled]),
        np.repeat([0, 1], [len(honest), len(misled)]),
        weight=weights / weights.mean(),
        max_bin=settings["max_bin"],
        nthread=1,
    )
    return xgboost.train({**settings, "seed": seed}, data, rounds)


def _margin(trees: xgboost.Booster, x: np.ndarray) -> np.ndarray:
    return trees.predict(xgboost.DMatrix(x, nthread=1), output_margin=True)
