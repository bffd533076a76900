"""Classes whose abundance is not known: the same mass ranges, hit 0.1 to 10 times as often as simulated.

Ten times the light objects may look like a tenth of the heavy ones. A classifier that learnt from one rate a
class is sure of itself where one that learnt from all of them is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.classifier.model import BEST, Classifier, ClassifierConfig, committee_proba
from streamdash.classifier.train import Judged, Progress, ShouldStop, train
from streamdash.config import EnsembleConfig
from streamdash.prior import Prior
from streamdash.store.cache import Cache
from streamdash.survey.design import Design
from streamdash.survey.observed import ObservedStreams

LOG10_RATE = (-1.0, 1.0)
"""Abundance relative to cold dark matter's, uniform in its logarithm."""
WORDS = "anywhere from 0.1 to 10 times that of cold dark matter"


@dataclass(frozen=True, eq=False)
class FreeAbundance:
    """A classifier of the same ranges whose abundance is free, beside one of a fixed abundance.

    Attributes
    ----------
    judged : Judged
        Learnt from streams of free abundance, and judged on others of them.
    fixed_accuracy : float
        Share of the same held-out streams that the classifier of the fixed abundance puts right.
    fixed_confidence : float
        Mean probability that it gives to its answers there.
    models : tuple of Classifier
        Those whose mean is the answer, the first of them that of `judged`.
    """

    judged: Judged
    fixed_accuracy: float
    fixed_confidence: float
    models: tuple[Classifier, ...]

    @classmethod
    def of(
        cls,
        judged: Judged,
        streams: ObservedStreams,
        sigma: float | np.ndarray,
        fixed: Judged,
        models: Sequence[Classifier] = (),
    ) -> FreeAbundance:
        """From classifiers of streams of free abundance with errors `sigma`, and one of a fixed one."""
        said = fixed.classifier.predict_proba(streams.observed(sigma)[judged.rows])
        right = float(np.mean(said.argmax(axis=1) == judged.y))
        return cls(judged, right, float(said.max(axis=1).mean()), tuple(models) or (judged.classifier,))

    def predict_proba(self, q: np.ndarray) -> np.ndarray:
        """Probability of each class (n, n_classes) for profiles (n, n_bin), the abundance free."""
        return committee_proba(self.models, q).mean(axis=0)

    @property
    def accuracy(self) -> tuple[float, float]:
        """Share of held-out streams of free abundance put right, and its error."""
        scores = self.judged.scores
        return float(scores.values["overall_accuracy"]), float(scores.errors["overall_accuracy"])

    @property
    def sentence(self) -> str:
        """How probabilities change where the abundance is not known."""
        right, said = self.accuracy[0], float(self.judged.probability.max(axis=1).mean())
        return (
            f"Where the abundance is {WORDS}, a classifier that learnt one abundance a class puts "
            f"{self.fixed_accuracy:.0%} of streams right and gives its answers a mean probability of "
            f"{self.fixed_confidence:.2f}; one that learnt all of them puts {right:.0%} right and says "
            f"{said:.2f}."
        )


def free_prior(config: EnsembleConfig) -> Prior | None:
    """What a class stands for if its abundance is not known; None where it is no range of CDM's shape."""
    if config.prior is not None or len(config.population.components) != 1:
        return None
    (one,) = config.population.components
    if not one.rate_factor > 0:
        return None
    prior = Prior(mass_range=one.mass_range, X=one.X, log10_rate=LOG10_RATE)
    alike = prior.population({"log10_rate": math.log10(one.rate_factor)})
    (same,) = alike.components
    return prior if same.model_copy(update={"rate_factor": one.rate_factor}) == one else None


def free_ensembles(cache: Cache, classes: Sequence[EnsembleConfig]) -> tuple[EnsembleConfig, ...]:
    """Complete ensembles of the same streams and ranges with free abundance; none if one is missing."""
    priors = [free_prior(config) for config in classes]
    stream, wanted = classes[0].stream, [prior for prior in priors if prior is not None]
    there = cache.complete_ensembles(lambda c: c.prior in wanted and c.stream == stream)
    found = []
    for prior in priors:
        fits = [entry.config for entry in there if prior is not None and entry.config.prior == prior]
        if not fits:
            return ()
        found.append(max(fits, key=lambda c: c.n_streams))
    differ = len({c.key for c in found}) == len(found)  # ranges that differ in their rate alone are one here
    return tuple(found) if differ else ()


def free_streams(
    cache: Cache, classes: Sequence[EnsembleConfig], design: Design | None = None
) -> ObservedStreams | None:
    """Streams of `free_ensembles` as a design observes them; None where there are none."""
    ensembles = free_ensembles(cache, classes)
    return ObservedStreams.read(cache, ensembles, design) if ensembles else None


def learn_free(
    cache: Cache,
    classes: Sequence[EnsembleConfig],
    fixed: Judged,
    design: Design | None = None,
    noise: float | np.ndarray | None = None,
    settings: ClassifierConfig = BEST,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
) -> FreeAbundance | None:
    """Learn the classes with their abundance free; None where their streams are not in the cache.

    Nor is there an answer where `fixed` sees other bins than those of `design`, as both arms together are.

    Parameters
    ----------
    classes : what `fixed` was trained on, in its order.
    fixed : the classifier of the fixed abundance, for the same bins.
    design, noise : how streams are observed.

    Raises
    ------
    Cancelled
        When ``should_stop`` said so.
    """
    streams = free_streams(cache, classes, design)
    if streams is None or streams.n_bins != fixed.classifier.features.n_bins:
        return None
    sigma = streams.design.sigma if noise is None else noise
    return FreeAbundance.of(train(streams, sigma, settings, progress, should_stop), streams, sigma, fixed)
