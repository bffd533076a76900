"""What the worker processes compute for the pages, as functions that can be sent there. No Panel.

Each takes the process's `Results` first: streams and geometries are read where they are needed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from app.services.results import Results
from app.session.catalog import Choice
from streamdash.classifier.abundance import FreeAbundance, learn_free
from streamdash.classifier.data import Cancelled, check_classes
from streamdash.classifier.model import PRESETS, ClassifierConfig
from streamdash.classifier.store import ModelFileError, ModelStore
from streamdash.classifier.studies import Contender, Importance, compare, importance
from streamdash.classifier.train import Judged, judge, model_key, train
from streamdash.config import SpectraConfig, StreamModel
from streamdash.convergence.spectra import compute_missing
from streamdash.engine.flyby import Film
from streamdash.simulation.ensemble import Stopped
from streamdash.simulation.limits import Limits, Refused, check_size
from streamdash.simulation.workers import WorkerError
from streamdash.statistics.bispectrum import Bispectrum, bispectrum
from streamdash.statistics.cumulative import cumulative_tables
from streamdash.statistics.evidence import Rules, measured_evidence
from streamdash.statistics.evidence_growth import Growth, growth
from streamdash.statistics.evidence_noise import AgainstNoise, against_noise
from streamdash.store.cache import StoreError
from streamdash.survey.flyby import Scene, make_film
from streamdash.survey.observed import ObservedStreams

logger = logging.getLogger(__name__)
Progress = Callable[[int, int], None]
ShouldStop = Callable[[], bool]


def on_streams(
    study: Callable[..., Any],
    results: Results,
    choices: Sequence[Choice],
    arguments: Sequence[Any],
    progress: Progress,
    should_stop: ShouldStop,
) -> Any:
    """``study(streams, *arguments)`` of the chosen classes as observed by default."""
    streams = check_classes(results.observed(choices))
    return study(streams, *arguments, progress=progress, should_stop=should_stop)


def trained(
    results: Results,
    choices: Sequence[Choice],
    noise: float,
    settings: ClassifierConfig,
    store: ModelStore,
    progress: Progress,
    should_stop: ShouldStop,
) -> Judged:
    """A classifier of the chosen classes.

    A model that was kept on disk is read and judged again, which takes a fraction of a second; one
    whose files are damaged is trained anew.
    """
    streams = check_classes(results.observed(choices))
    key = model_key(streams, noise, settings)
    try:
        kept = store.open(key)
    except ModelFileError:
        store.remove(key)
        kept = None
    if kept is not None:
        return judge(kept, streams)
    judged = train(streams, noise, settings, progress, should_stop)
    try:
        store.save(key, judged.classifier)
    except OSError as error:  # a full disk or a read-only folder takes nothing from who waits
        logger.warning("the model could not be kept: %s", error)
    return judged


def freed(
    results: Results,
    choices: Sequence[Choice],
    fixed: Judged,
    noise: float,
    settings: ClassifierConfig,
    progress: Progress,
    should_stop: ShouldStop,
) -> FreeAbundance | None:
    """What changes for a trained classifier if the abundance of its classes is free."""
    return learn_free(
        results.cache,
        results.observed(choices).configs,
        fixed,
        noise=noise,
        settings=settings,
        progress=progress,
        should_stop=should_stop,
    )


def compare_presets(
    streams: ObservedStreams,
    noise: float,
    settings: ClassifierConfig,
    progress: Progress,
    should_stop: ShouldStop,
) -> list[Contender]:
    """The presets, and what is chosen where that is none of them, on one split."""
    chosen = {} if settings in PRESETS.values() else {"as chosen": settings}
    return compare(streams, noise, {**chosen, **PRESETS}, progress=progress, should_stop=should_stop)


def importance_of(
    results: Results,
    choices: Sequence[Choice],
    noise: float,
    settings: ClassifierConfig,
    store: ModelStore,
    progress: Progress,
    should_stop: ShouldStop,
) -> Importance:
    """Where along the stream a classifier of the chosen classes finds what tells them apart."""
    judged = trained(results, choices, noise, settings, store, lambda *_: None, should_stop)
    streams = results.observed(choices)
    return importance(judged, streams, noise, progress=progress, should_stop=should_stop)


def laboratory(
    results: Results,
    configs: Sequence[SpectraConfig],
    limits: Limits,
    progress: Progress,
    should_stop: ShouldStop,
) -> None:
    """Simulate what is missing of a convergence test."""
    if not limits.max_jobs:
        raise Refused("This server does not simulate for its visitors.")
    for config in configs:
        check_size(config.ensemble, limits)
    try:
        compute_missing(configs, results.cache, limits.workers, progress, should_stop, limits.nice)
    except Stopped:
        raise Cancelled from None
    except (StoreError, WorkerError) as error:
        raise ValueError(str(error)) from error


def film_of(results: Results, stream: StreamModel, scene: Scene) -> Film:
    """The film of a fly-by."""
    return make_film(results.geometry(stream), scene)


def noisy_profiles(
    results: Results, choices: Sequence[Choice], noise: float, number: int = 0
) -> list[np.ndarray]:
    """Qρ with shot noise of every class, (n_streams, n_longitudes); `number` names another draw of it."""
    return results.observed(choices).noisy(noise, number)


def bispectra(results: Results, choices: Sequence[Choice], noise: float, step: float) -> list[Bispectrum]:
    """Bispectrum of every class."""
    return [bispectrum(q, step) for q in noisy_profiles(results, choices, noise)]


def tables_of(
    results: Results, choices: Sequence[Choice], noise: float, rules: Rules
) -> list[dict[str, Any]]:
    """Cumulative evidence of the chosen classes for several numbers of bins."""
    return cumulative_tables(
        noisy_profiles(results, choices, noise),
        noise,
        rules=rules,
        redraw=lambda number: noisy_profiles(results, choices, noise, number),
    )


def against_noise_of(
    results: Results, choices: Sequence[Choice], n_bin: int, rules: Rules, fiducial: int
) -> dict[int, AgainstNoise]:
    """The evidence for the fiducial class against each other class, at several noises."""
    return against_noise(lambda noise: noisy_profiles(results, choices, noise), n_bin, rules, fiducial)


def growth_of(
    results: Results, choices: Sequence[Choice], noise: float, n_bin: int, rules: Rules, fiducial: int
) -> dict[int, Growth]:
    """How the evidence for the fiducial class grows with the number of streams, against each other class."""
    pdfs, found = measured_evidence(noisy_profiles(results, choices, noise), noise, n_bin, rules)
    rivals = [j for j in range(pdfs.n_models) if j != fiducial]
    return {j: growth(pdfs, found, fiducial, j) for j in rivals}
