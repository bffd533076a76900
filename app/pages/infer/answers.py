"""From a session's choices to a posterior: which estimator answers, for which profile. No Panel here."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.pages.infer.state import ERRORS, WINDOW_WORDS
from app.services.services import Services
from app.session.catalog import Choice
from app.session.session import Session
from app.work.tasks import Compute
from streamdash.classifier.data import Cancelled
from streamdash.config import StreamModel
from streamdash.inference.cells import AGE
from streamdash.inference.diagnostics import PairScore, Score, marginals, pair_scores, ranks, scores
from streamdash.inference.estimator import STRANGE, Estimator
from streamdash.inference.files import EstimatorFileError, load_estimator
from streamdash.inference.held_out import NOISE_SEED, HeldOut, load_streams, seen
from streamdash.inference.posterior import Posterior
from streamdash.inference.predictive import stream_weights, weighted_bands
from streamdash.inference.prior_ensemble import clean_streams, default_design
from streamdash.inference.shipped_streams import are_shipped
from streamdash.observe.infer import N_STREAMS, learnt
from streamdash.observe.observation import Observation, cut
from streamdash.observe.table import ObservationError
from streamdash.prior import PRIORS
from streamdash.streams import stream_of
from streamdash.survey.design import Design
from streamdash.survey.lsst import TODAY, YEARS, noise_factor


@dataclass(frozen=True, eq=False)
class Oracle:
    """What answers: an estimator, and streams that it has not learnt from."""

    estimator: Estimator
    streams: HeldOut
    shipped: bool
    told: bool

    @property
    def key(self) -> tuple[str | bool, ...]:
        """All that its streams and answers depend on."""
        e = self.estimator
        return e.stream.key, e.prior.key, e.design.key, self.shipped, self.told

    @property
    def errors(self) -> tuple[float, float]:
        """Smallest and largest errors that it answers for, relative to its design's."""
        if not self.estimator.noise_told:
            return 1.0, 1.0
        low, high = self.estimator.prior.noise_factor
        return max(low, ERRORS[0]), min(high, ERRORS[1])

    @property
    def ages(self) -> tuple[float, ...]:
        """Ages that can be fixed, none where it knows but one."""
        return tuple(sorted(self.estimator.prior.ages_gyr)) if AGE in self.estimator.grid else ()


@dataclass(frozen=True, eq=False)
class Data:
    """A profile that is asked about, as measured.

    Attributes
    ----------
    q : ndarray (n_bin,)
    name : str
        What it is, in a few words.
    truth : mapping or None
        Its parameters, where they are known.
    code : tuple of str
        Lines of Python that make ``q`` for ``estimator``.
    """

    q: np.ndarray
    name: str
    truth: dict[str, float] | None
    code: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Answer:
    """What is said of a profile.

    Attributes
    ----------
    posterior : Posterior
        With the age fixed, where it is taken as known.
    bands : ndarray (5, n_bin)
    strangeness : float
    """

    oracle: Oracle
    data: Data
    posterior: Posterior
    bands: np.ndarray
    strangeness: float
    noise_factor: float
    age: float | None
    joint: Posterior
    """With every age that it knows."""

    @property
    def strange(self) -> bool:
        """Whether the profile is unlike the prior's streams, so that nothing is said of it."""
        return self.strangeness > STRANGE

    @property
    def truth(self) -> dict[str, float] | None:
        """True values of the posterior's parameters, where they are known."""
        truth = self.data.truth
        return {name: truth[name] for name in self.posterior.names if name in truth} if truth else None

    @property
    def sigma(self) -> np.ndarray:
        """Errors of the bins (n_bin,)."""
        return self.noise_factor * self.oracle.estimator.design.sigma


def shipped(services: Services, model: StreamModel, prior: str) -> Oracle | None:
    """The oracle that comes with the package for a stream and a prior; one that is told, if there is one."""
    return _shipped(services, model, prior, True) or _shipped(services, model, prior, False)


def sharpest(services: Services, model: StreamModel, prior: str) -> Oracle | None:
    """The oracle of one age and one size of the errors, which says more of just those."""
    return _shipped(services, model, prior, False)


def _shipped(services: Services, model: StreamModel, prior: str, told: bool) -> Oracle | None:
    name = stream_of(model).name

    def compute() -> Oracle | None:
        try:
            estimator = load_estimator(name, prior, told)
            streams = load_streams(name, prior, told)
        except (EstimatorFileError, ValueError):
            return None
        return Oracle(estimator, streams, True, told) if same_arm(estimator.stream, model) else None

    return services.shared(("infer-shipped", name, model.arm, prior, told), compute)


def same_arm(one: StreamModel, other: StreamModel) -> bool:
    """Whether two models are one arm of one stream, at whatever age."""
    return one.arm == other.arm and one.progenitor == other.progenitor and one.potential == other.potential


def training(services: Services, model: StreamModel, prior: str, design: Design) -> tuple[Hashable, Compute]:
    """Key and computation of an oracle for somebody's own bins, for `app.work.tasks.Work.ask`."""
    cache, nice = services.cache, services.jobs.limits.nice

    def compute(progress: Callable[[int, int], None], should_stop: Callable[[], bool]) -> Oracle:
        first = 0

        def report(what: str, done: int, total: int) -> None:
            nonlocal first
            if should_stop():
                raise Cancelled
            share = done / max(total, 1)
            if what.startswith("Sim"):  # where none are shipped, that takes nine tenths of the time
                first = 900
                progress(round(first * share), 1000)
            else:
                progress(round(first + (1000 - first) * share), 1000)

        estimator, streams = learnt(
            PRIORS[prior],
            model,
            design,
            cache,
            progress=report,
            nice=nice,
        )
        return Oracle(estimator, streams, False, False)

    return ("infer", model.key, prior, design.key), compute


def cost(model: StreamModel, prior: str) -> str:
    """What it takes to train an estimator, in words."""
    if are_shipped(PRIORS[prior], model):
        return "it learns from shipped streams, in less than a minute, and is kept."
    return (
        f"{N_STREAMS} streams are simulated for it first, which takes some minutes; they and the estimator "
        "are kept."
    )


def usual_design(services: Services, model: StreamModel, oracle: Oracle | None) -> Design:
    """How the stream is observed unless a file says otherwise."""
    return oracle.estimator.design if oracle else default_design(services.geometry(model))


def halvable(design: Design) -> bool:
    """Whether half of the bins are enough for the polynomial that is divided out, and some more."""
    return design.n_bin // 2 > design.order + 2


def halved(observation: Observation) -> dict[str, Observation]:
    """Either half of a measured profile; nothing where one of them says too little by itself."""
    n_bin = observation.design.n_bin
    try:
        return {window: cut(observation, part_of(n_bin, window)) for window in ("first", "second")}
    except ObservationError:
        return {}


def part_of(n_bin: int, window: str) -> slice:
    """Bins of a window."""
    half = n_bin // 2
    return {"whole": slice(None), "first": slice(0, half), "second": slice(half, None)}[window]


def mock(oracle: Oracle, base: Oracle, number: int, window: str, factor: float) -> Data:
    """A held-out stream of the base oracle, of the stream's own age, seen as the oracle's design says."""
    truths = base.streams.truth
    usual = np.arange(len(truths))
    if AGE in truths:
        usual = np.flatnonzero(truths[AGE] == base.estimator.stream.age_gyr)
    index = int(usual[(number - 1) % len(usual)])
    clean = base.streams.clean[index : index + 1]
    truth = {AGE: base.estimator.stream.age_gyr}
    truth |= {name: float(value) for name, value in truths.iloc[index].items()}
    part = part_of(clean.shape[1], window)
    return Data(
        _seen(oracle, clean[:, part], factor, index),
        f"mock {number}",
        truth,
        (
            f"clean = mocks.clean[{index}:{index + 1}, {words_of(part)}]",
            f"q = seen(clean, estimator, {factor:g}, np.random.default_rng([NOISE_SEED, {index}]))[0]",
        ),
    )


def simulated(
    services: Services, oracle: Oracle, whole: Design, choice: Choice, number: int, window: str, factor: float
) -> Data:
    """A stream of an ensemble of the cache, seen as the oracle's design says."""

    def compute() -> np.ndarray:
        return clean_streams(services.geometry(choice.config.stream), services.ensemble(choice.key), whole)

    clean = services.shared(("infer-clean", choice.key, whole.bins_key), compute)
    index = (number - 1) % len(clean)
    part = part_of(clean.shape[1], window)
    return Data(
        _seen(oracle, clean[index : index + 1, part], factor, index),
        f"stream {index + 1} of {choice.label}",
        None,
        (
            f'entry = cache.find("{choice.key}")  # {choice.label}',
            "geometry = load_geometry(entry.config.stream, cache)",
            f"ensemble = cache.open_ensemble(entry.config).isel(stream=[{index}])",
            f"clean = clean_streams(geometry, ensemble, whole)[:, {words_of(part)}]",
            f"q = seen(clean, estimator, {factor:g}, np.random.default_rng([NOISE_SEED, {index}]))[0]",
        ),
    )


def uploaded(observation: Observation, example: bool) -> Data:
    """The profile of a file."""
    name = "the example" if example else "the uploaded profile"
    return Data(observation.q.astype(np.float32), name, None, ())


def answer(oracle: Oracle, data: Data, factor: float, age: float | None) -> Answer:
    """Posterior, strangeness and predictive bands of a profile."""
    estimator = oracle.estimator
    joint = estimator.posteriors(data.q[None], factor)[0]
    kept = joint
    if age is not None and AGE in joint.grid:
        kept = joint.given(AGE, *cell_ends(joint, age))
    weight = stream_weights(kept, oracle.streams.truth)
    some = weight > 0  # those of other ages have none
    bands = weighted_bands(oracle.streams.observed(estimator, factor)[some], weight[some])
    strangeness = float(estimator.strangeness(data.q[None], factor)[0])
    return Answer(oracle, data, at_age(joint, age), bands, strangeness, factor, age, joint)


def cell_ends(joint: Posterior, age: float) -> tuple[float, float]:
    """Ends of the age's cell."""
    edges = joint.grid[AGE]
    cell = int(np.searchsorted(edges, age, side="right")) - 1
    return float(edges[cell]), float(edges[cell + 1])


def at_age(joint: Posterior, age: float | None) -> Posterior:
    """The posterior when the age is known, without the age; as it is when it is not, or not inferred."""
    return joint if age is None or AGE not in joint.grid else joint.at(AGE, age)


def moved(
    given: Answer,
    told: Oracle | None = None,
    data_at: Callable[[Oracle, float, str], Data | None] | None = None,
    cut: Mapping[str, Oracle] | None = None,
) -> list[tuple[str, Posterior]]:
    """The answer under other assumptions: other ages, a part of the stretch, other surveys' errors.

    Parameters
    ----------
    told : what answers for other ages and errors; the answer's own oracle by default.
    data_at : callable, optional
        Gives the same stream for an oracle, with errors of another size, in a part of the stretch; None where
        there is but one measurement.
    cut : what answers for parts of the stretch, by `app.pages.infer.state.WINDOW_WORDS`.
    """
    told = told or given.oracle
    estimator = told.estimator
    asked = given.posterior.without(AGE)
    rows = [("as asked", asked)]
    if told.ages:
        joint = given.joint
        if told is not given.oracle:
            joint = estimator.posteriors(given.data.q[None], given.noise_factor)[0]
        for age in told.ages:
            same = age == given.age
            rows.append((f"age {age:g} Gyr", asked if same else at_age(joint, age)))
        rows.append(("age unknown", joint.without(AGE)))
    if data_at is None:
        return rows
    for window, oracle in (cut or {}).items():
        data = data_at(oracle, 1.0, window)
        if data is not None:
            rows.append((f"{WINDOW_WORDS[window]} alone", oracle.estimator.posteriors(data.q[None])[0]))
    stream = stream_of(estimator.stream).name
    if estimator.noise_told and stream in TODAY:
        for years in YEARS:
            factor = round(noise_factor(stream, years), 3)
            data = data_at(told, factor, "whole") if told.errors[0] <= factor <= told.errors[1] else None
            if data is not None:
                other = estimator.posteriors(data.q[None], factor)[0]
                label = f"LSST, year {years}: errors × {factor:.2g}, roughly"
                rows.append((label, at_age(other, given.age).without(AGE)))
    return rows


@dataclass(frozen=True, eq=False)
class Calibration:
    """Scores of every parameter and pair, and ranks of the first one's truth, on held-out streams."""

    scores: dict[str, Score]
    pairs: dict[tuple[str, str], PairScore]
    ranks: np.ndarray
    name: str
    age: float | None = None
    """The age of the streams, where it was taken as known."""


def calibration(services: Services, oracle: Oracle, factor: float, age: float | None = None) -> Calibration:
    """How well the oracle's posteriors do on the streams it has not learnt from, at these errors.

    Where an age is taken as known that it could infer, on the streams of that age.
    """
    estimator = oracle.estimator
    fixed = age if AGE in estimator.grid else None

    def compute() -> Calibration:
        p = estimator.posterior(oracle.streams.observed(estimator, factor), factor)
        truth, grid = oracle.streams.truth, dict(estimator.grid)
        if fixed is not None:
            there = (truth[AGE] == fixed).to_numpy()
            posteriors = [Posterior(grid, one).at(AGE, fixed) for one in p[there]]
            p, truth, grid = np.array([one.p for one in posteriors]), truth[there], dict(posteriors[0].grid)
        name = next(name for name in grid if name != AGE)
        rank = ranks(marginals(p, grid, name), np.asarray(grid[name]), truth[name].to_numpy())
        found = scores(p, grid, truth)
        pairs = pair_scores(p, grid, truth, without=(AGE,))
        return Calibration({n: score for n, score in found.items() if n != AGE}, pairs, rank, name, fixed)

    return services.shared(("infer-calibration", *oracle.key, factor, fixed), compute)


def words_of(part: slice) -> str:
    """A slice as it is written."""
    return f"{'' if part.start is None else part.start}:{'' if part.stop is None else part.stop}"


def _seen(oracle: Oracle, clean: np.ndarray, factor: float, index: int) -> np.ndarray:
    q: Any = seen(clean, oracle.estimator, factor, np.random.default_rng([NOISE_SEED, index]))
    return q[0]


def choice_of(session: Session) -> Choice | None:
    """The ensemble that a simulated stream is taken from."""
    stream = session.catalog.stream(session.stream)
    if stream is None or not stream.ensembles:
        return None
    return stream.ensembles[min(session.infer_class, len(stream.ensembles) - 1)]
