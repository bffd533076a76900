"""What a measured profile says about its perturbers, from models made for its own quality.

`prepare` puts every simulated stream through the observation's bins, gaps, errors and division,
trains on some of them and judges itself on the others; `judge` then answers for the observation. All
that is said about reliability is measured on streams observed in the same way and never trained on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from streamdash.classifier.abundance import FreeAbundance, free_streams
from streamdash.classifier.data import (
    ClassifierError,
    Split,
    augmented,
    check_classes,
    split,
)
from streamdash.classifier.model import BEST, Classifier, ClassifierConfig, committee_proba
from streamdash.classifier.train import Judged, Progress, ShouldStop, boost, train
from streamdash.config import EnsembleConfig
from streamdash.observe.evidence import PdfEvidence, PdfJudge, learn_pdfs
from streamdash.observe.misfit import Misfit, Misled, learn_misfit
from streamdash.observe.observation import Observation
from streamdash.observe.replicas import Replicas, learn_replicas
from streamdash.observe.resemblance import Cloud, Likeness, Resemblance, learn_likeness
from streamdash.observe.side_by_side import SideBySide
from streamdash.statistics.features import FeatureMap
from streamdash.statistics.scores import evaluate
from streamdash.store.cache import Cache
from streamdash.survey.design import Design, divided, divisible, measured
from streamdash.survey.observed import ObservedStreams

N_MODELS = 8
"""Models trained on resampled streams; their spread is part of the uncertainty."""
N_FREE = 5
"""The same for classes whose abundance is free."""
ERROR_FACTORS = (0.5, 1.5, 2.0)
"""By how much the errors may be wrong when it is told what that would do."""
FEWEST = 10
"""Streams of a class in every set, without which none are left out."""
COSTS = {
    "train": 6,
    "free": 6,
    "misfit": 60,
    "likeness": 15,
    "resampled": 20,
    "pdfs": 1,
    "replicas": 5,
    "wrong errors": 3,
}
"""Rough share of the processor's time that each step takes, for the progress that is shown."""
BAND = (0.16, 0.84)
"""Ends of the interval that is quoted for a probability (68 %)."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """Everything that is learnt for one design: how streams of each class look when so observed.

    Attributes
    ----------
    design : Design
    streams : ObservedStreams
        Every simulated stream in the design's bins.
    smooth : ndarray (n_bin,)
        The unperturbed stream, divided as the design says.
    models : tuple of Classifier
        A committee: one trained on all streams but the held-out ones, `N_MODELS` on resampled ones.
        Its answer is the mean of theirs.
    judged : Judged
        What the committee says about held-out streams (with its first member).
    likeness : Likeness
    pdfs : PdfJudge
    replicas : Replicas
    free : FreeAbundance or None
        The classes with their abundance free, where the cache has such streams.
    misfit : Misfit or None
        Detector of sure answers that hang on an assumption about the data.
    wrong_errors : tuple of (factor, accuracy)
        Share of held-out streams put right if the errors truly are the stated ones times a factor.
    refused : tuple of float
        Share of each class's streams whose polynomial comes close to zero: measured, they would not be
        divided by one of this order, so that they are neither learnt from nor scored.
    """

    design: Design
    streams: ObservedStreams
    smooth: np.ndarray
    models: tuple[Classifier, ...]
    judged: Judged
    likeness: Likeness
    pdfs: PdfJudge
    replicas: Replicas
    free: FreeAbundance | None = None
    misfit: Misfit | None = None
    wrong_errors: tuple[tuple[float, float], ...] = ()
    refused: tuple[float, ...] = ()

    def answers(self, q: np.ndarray) -> np.ndarray:
        """Every member's probabilities of profiles (…, n_bin): (n_models, …, n_classes)."""
        return committee_proba(self.models, q)

    def bands(self) -> np.ndarray:
        """See `class_bands`."""
        return class_bands(self.streams)


def class_bands(streams: ObservedStreams) -> np.ndarray:
    """16 %, 50 % and 84 % quantiles of each class's streams as observed (n_classes, 3, n_bin)."""
    q = streams.observed(streams.design.sigma)
    classes = range(len(streams.labels))
    return np.stack([np.quantile(q[streams.y == c], (BAND[0], 0.5, BAND[1]), axis=0) for c in classes])


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is said about one observation.

    Attributes
    ----------
    labels : tuple of str
        Mass range of each class.
    probability : ndarray (n_classes,)
        Calibrated; classes are taken to be equally likely beforehand.
    low, high : ndarray (n_classes,)
        68 % of the answers to the same stream observed again (`streamdash.observe.replicas`).
    models_low, models_high : ndarray (n_classes,)
        68 % of the members' answers to the profile as measured.
    resemblance : Resemblance
    evidence : PdfEvidence
    judged : Judged
        Held-out streams at this observation's quality.
    free : ndarray (n_classes,) or None
        Probabilities if the abundance is not the simulated one, but free (`streamdash.classifier.abundance`).
    misled : Misled
        Whether the answer hangs on an assumption about the data.
    """

    labels: tuple[str, ...]
    probability: np.ndarray
    low: np.ndarray
    high: np.ndarray
    models_low: np.ndarray
    models_high: np.ndarray
    resemblance: Resemblance
    evidence: PdfEvidence
    judged: Judged
    free: np.ndarray | None = None
    misled: Misled = Misled(1.0, "")

    @property
    def best(self) -> int:
        """The most probable class."""
        return int(self.probability.argmax())

    @property
    def accuracy(self) -> tuple[float, float]:
        """Share of held-out streams put right at this quality, and its error."""
        scores = self.judged.scores
        return float(scores.values["overall_accuracy"]), float(scores.errors["overall_accuracy"])


def prepare(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    design: Design,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    settings: ClassifierConfig = BEST,
) -> Prepared:
    """Observe ensembles as a profile was observed, and learn to tell them apart.

    Parameters
    ----------
    cache : Cache
    ensembles : sequence of str or EnsembleConfig
        Keys or configurations of 2 to 4 complete ensembles of one stream, lowest masses first.
    design : Design
        `Observation.design`.
    progress : callable (done, total), optional
    should_stop : callable, optional

    Raises
    ------
    StoreError
        When an ensemble is missing or damaged.
    ValueError
        When they are not of one stream, or make no classes (`ClassifierError`).
    Cancelled
        When ``should_stop`` said so.
    """
    streams = ObservedStreams.read(cache, ensembles, design)
    free = free_streams(cache, streams.configs, design)
    return learn(streams, progress, should_stop, settings, free)


def learn(
    streams: ObservedStreams,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    settings: ClassifierConfig = BEST,
    free: ObservedStreams | None = None,
) -> Prepared:
    """`prepare` for streams that are observed already.

    ``free`` are the same classes with their abundance free, see `free_streams`.
    """
    design, smooth, seed = check_classes(streams).design, streams.smooth, settings.seed
    sets, refused = _accepted(split(streams.y, seed), streams)
    known, observed = np.concatenate([sets.train, sets.validation]), streams.observed(design.sigma)
    with SideBySide(progress, should_stop, sum(COSTS.values())) as steps:
        trained = steps.start(
            0.0,
            train,
            streams,
            design.sigma,
            settings,
            steps.within(COSTS["train"]),
            should_stop,
            sets=sets,
        )
        cloud = Cloud.of(observed[known], streams.y[known], design.sigma)
        free_trained = (
            None
            if free is None
            else steps.start(COSTS["free"], train, free, design.sigma, settings, None, should_stop)
        )
        # It needs no model: begun while the first one is trained.
        likeness = steps.start(
            COSTS["likeness"], learn_likeness, streams, design.sigma, smooth, known, sets.test, cloud, seed
        )
        judged = trained.result()
        freed = None if free is None or free_trained is None else _free(free_trained.result(), free, judged)
        misfit = steps.start(
            COSTS["misfit"],
            learn_misfit,
            judged.classifier,
            None if freed is None else freed.predict_proba,
            cloud,
            design,
            streams.clean,
            streams.y,
            smooth,
            known,
            sets.test,
            seed,
        )
        resampled = [
            steps.start(COSTS["resampled"] / N_MODELS, _resampled, judged, streams, design, sets, number)
            for number in range(N_MODELS)
        ]
        pdfs = steps.start(COSTS["pdfs"], learn_pdfs, observed, streams.y, design.sigma, known, sets.test)
        models = (judged.classifier, *(model.result() for model in resampled))
        replicas = steps.start(
            COSTS["replicas"],
            learn_replicas,
            lambda q: committee_proba(models, q).mean(axis=0),
            streams.clean[_as_many_of_each(sets.test, streams.y)],
            design.sigma,
            design.fit,
            seed,
        )
        wrong_errors = steps.start(
            COSTS["wrong errors"], _if_errors_are_wrong, models, streams, sets.test, seed
        )
        return Prepared(
            design,
            streams,
            divided(smooth, design.fit),
            models,
            _committee(judged, models, observed[sets.test]),
            likeness.result(),
            pdfs.result(),
            replicas.result(),
            free=freed,
            refused=refused,
            misfit=misfit.result(),
            wrong_errors=wrong_errors.result(),
        )


def judge(prepared: Prepared, observation: Observation) -> Verdict:
    """Say what an observation is, with models made for its design.

    Raises
    ------
    ClassifierError
        When the models were made for another design.
    """
    design = observation.design
    if design.key != prepared.design.key:
        raise ClassifierError("The models were made for other bins or errors than this observation's.")
    q = observation.q.astype(np.float32)
    as_measured = prepared.answers(q)
    answer = as_measured.mean(axis=0)
    return Verdict(
        prepared.streams.labels,
        answer,
        *_band(prepared.replicas(answer), answer),
        *_band(as_measured, answer),
        resemblance=prepared.likeness(q[None])[0],
        evidence=prepared.pdfs(q),
        judged=prepared.judged,
        misled=prepared.misfit(q[None], answer[None])[0] if prepared.misfit else Misled(1.0, ""),
        free=None if prepared.free is None else prepared.free.predict_proba(q[None])[0],
    )


def _band(samples: np.ndarray, answer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the quoted interval; the answer itself is always inside."""
    low, high = np.quantile(samples, BAND, axis=0)
    return np.minimum(low, answer), np.maximum(high, answer)


def _accepted(sets: Split, streams: ObservedStreams) -> tuple[Split, tuple[float, ...]]:
    """The sets without streams that would be refused when measured, and the share of those by class.

    Nothing is left out where too few of a class would remain to learn from.
    """
    noisy = np.concatenate(streams.densities())
    fine = divisible(noisy, streams.design.fit)
    classes = range(len(streams.labels))
    kept = Split(*(rows[fine[rows]] for rows in (sets.train, sets.validation, sets.test)))
    smallest = (kept.validation, kept.test)
    few = min(np.count_nonzero(streams.y[rows] == c) for c in classes for rows in smallest)
    refused = tuple(float(1 - fine[streams.y == c].mean()) for c in classes)
    return (sets, tuple(0.0 for _ in classes)) if few < FEWEST else (kept, refused)


def _if_errors_are_wrong(
    models: Sequence[Classifier], streams: ObservedStreams, rows: np.ndarray, seed: int
) -> tuple[tuple[float, float], ...]:
    """Share of streams put right with errors truly `ERROR_FACTORS` times the stated ones."""
    rng = np.random.default_rng([seed, 13])
    draws = rng.standard_normal(streams.clean[rows].shape, dtype=np.float32)
    found = []
    for factor in ERROR_FACTORS:
        q = measured(
            streams.clean[rows], np.float32(factor) * draws, streams.design.sigma, streams.design.fit
        )
        said = committee_proba(models, q.astype(np.float32)).mean(axis=0)
        found.append((factor, float(np.mean(said.argmax(axis=1) == streams.y[rows]))))
    return tuple(found)


def _as_many_of_each(rows: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The first rows of each class, as many as the smallest class has."""
    parts = [rows[y[rows] == c] for c in range(int(y.max()) + 1)]
    return np.concatenate([part[: min(map(len, parts))] for part in parts])


def _free(judged: Judged, streams: ObservedStreams, fixed: Judged) -> FreeAbundance:
    """A committee for classes whose abundance is free: one alone is too sure at the ends of its range."""
    sets = split(streams.y, judged.classifier.card.settings.seed)
    others = [_resampled(judged, streams, streams.design, sets, number) for number in range(N_FREE)]
    models, sigma = (judged.classifier, *others), streams.design.sigma
    held_out = streams.observed(sigma)[sets.test]
    return FreeAbundance.of(_committee(judged, models, held_out), streams, sigma, fixed, models)


def _committee(judged: Judged, models: Sequence[Classifier], held_out: np.ndarray) -> Judged:
    """What the mean of several models says about the held-out streams (n_test, n_bin), and its scores."""
    probability = committee_proba(models, held_out).mean(axis=0)
    scores = evaluate(judged.y, probability, seed=judged.classifier.card.settings.seed)
    return replace(judged, probability=probability, scores=scores)


def _resampled(
    judged: Judged, streams: ObservedStreams, design: Design, sets: Split, number: int
) -> Classifier:
    """The classifier trained once more, on streams drawn with replacement."""
    card = judged.classifier.card
    settings = card.settings.model_copy(update={"seed": card.settings.seed + 1 + number})
    rng = np.random.default_rng([settings.seed, 8])
    known = np.concatenate([sets.train, sets.validation])
    parts = [known[streams.y[known] == c] for c in range(len(streams.labels))]
    rows = np.concatenate([rng.choice(part, len(part)) for part in parts])
    q, y = augmented(streams, rows, design.sigma, settings.copies, (settings.seed, 9))
    features = FeatureMap.fit(q, settings.features)
    return Classifier(card, features, boost(features(q), y, settings, card.n_trees))
