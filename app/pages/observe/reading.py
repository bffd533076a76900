"""From a session's file to what is read in it and to what is said about it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from app.pages.observe.state import AUTO, LINKED, ObserveState, Upload
from app.services.results import Results
from app.session.catalog import Choice
from app.session.session import Session
from app.work.pool import Compute
from streamdash.config import ConfigError, EnsembleConfig, StreamModel
from streamdash.engine.geometry import Geometry
from streamdash.observe.guess import Assumptions, assume, guess
from streamdash.observe.observation import Observation, interpret
from streamdash.observe.provenance import Source
from streamdash.observe.report import report
from streamdash.observe.robustness import other_sets, robustness, variants
from streamdash.observe.table import ObservationError, Table, read_table
from streamdash.observe.verdict import class_bands, judge, prepare
from streamdash.streams import stream_of
from streamdash.survey.mock import EXAMPLE
from streamdash.survey.observed import ObservedStreams


@dataclass(frozen=True, eq=False)
class Reading:
    """What was found in a file: as far as it could be read, and what is wrong with the rest."""

    source: Source | None = None
    table: Table | None = None
    assumptions: Assumptions | None = None
    observation: Observation | None = None
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Outcome:
    """What is said about an observation, and the bands of the classes as so observed.

    It knows of no file: equal tables have equal answers. The page adds the file that it shows.
    """

    observation: Observation
    result: dict[str, Any]
    bands: np.ndarray


def changes_of(session: ObserveState) -> dict[str, Any]:
    """The assumptions that a session has changed."""
    linked: dict[str, Any] = {name: getattr(session, own) for name, own in LINKED.items()}
    linked = {name: value for name, value in linked.items() if value != AUTO}
    if "order" in linked:
        linked["order"] = int(linked["order"])
    return {**session.columns, **linked}


def file_of(session: ObserveState) -> Upload | None:
    """The file that is looked at: the example, one that was chosen, or nothing yet."""
    if session.example == "yes":
        return Upload(EXAMPLE.read_bytes(), EXAMPLE.name)
    return session.upload


def show_example(session: Session, **others: Any) -> None:
    """Look at the example, and at the stream it is of; set other choices with it."""
    home = session.catalog.stream(StreamModel().key)
    if home is not None and session.stream != home.key:
        session.choose_stream(home.key)
    session.param.update(example="yes", upload=None, **others)


def example_words(model: StreamModel) -> str:
    """What is read on the button that shows the example, where `model` is looked at."""
    home = StreamModel()
    return "Try the example" + ("" if model == home else f", of the {stream_of(home).title} stream")


def kept_name(session: Session) -> str:
    """Name of the file that was chosen and is shown, for a page that is built anew; empty for none."""
    return session.upload.name if session.upload is not None and session.example == "no" else ""


def read_for(results: Results, stream: StreamModel, upload: Upload, changes: Mapping[str, Any]) -> Reading:
    """`read` for a stream whose geometry is in the cache."""
    return read(upload, changes, results.geometry(stream))


def read(upload: Upload, changes: Mapping[str, Any], geometry: Geometry) -> Reading:
    """Read a file under a session's assumptions; what is wrong becomes a sentence."""
    source = Source.of(upload.data, upload.name)
    try:
        table = read_table(upload.data)
        proposal = guess(table)
    except ObservationError as error:
        return Reading(source, problem=str(error))
    try:
        assumptions = assume(table, changes)
    except ConfigError as error:
        return Reading(source, table, proposal, problem=str(error))
    try:
        return Reading(source, table, assumptions, interpret(table, assumptions, geometry))
    except ObservationError as error:
        return Reading(source, table, assumptions, problem=str(error))


@dataclass(frozen=True, eq=False)
class Look:
    """An observation over the bands of the classes: what is seen before anything is learnt."""

    observation: Observation
    bands: np.ndarray


def look_at(results: Results, keys: Sequence[str], observation: Observation) -> Look:
    """The bands of the classes as so observed, which takes about a second; a worker computes them."""
    streams = ObservedStreams.read(results.cache, keys, observation.design)
    return Look(observation, class_bands(streams))


def look_at_example(results: Results, stream: StreamModel, keys: Sequence[str]) -> Look | None:
    """The same of the example, for who has brought nothing yet."""
    observation = read_for(results, stream, Upload(EXAMPLE.read_bytes(), EXAMPLE.name), {}).observation
    return None if observation is None else look_at(results, keys, observation)


def question(
    services: Results, choices: Sequence[Choice], observation: Observation
) -> tuple[Hashable, Compute]:
    """Key and computation of the verdict on an observation, for `app.work.tasks.Work.ask`."""
    keys = [choice.key for choice in choices]
    sha = hashlib.sha256(repr(observation.stated).encode())
    sha.update(observation.design.key.encode() + observation.q.tobytes())

    return ("observe", sha.hexdigest(), *keys), partial(answer_to, services, keys, observation)


def answer_to(
    results: Results,
    keys: Sequence[str],
    observation: Observation,
    progress: Callable[[int, int], None],
    should_stop: Callable[[], bool],
) -> Outcome:
    """The verdict on an observation; a worker process computes it."""
    prepared = prepare(results.cache, keys, observation.design, progress, should_stop)
    result = report(judge(prepared, observation), observation, prepared)
    return Outcome(observation, result, prepared.bands())


def trials(
    results: Results, choices: Sequence[Choice], reading: Reading, key: Hashable
) -> tuple[Hashable, Compute]:
    """Key and computation of the table of robustness of a question, for `app.work.tasks.Work.ask`."""
    configs = [choice.config for choice in choices]
    assert reading.table is not None and reading.assumptions is not None
    return ("robustness", key), partial(tried, results, configs, reading.table, reading.assumptions)


def tried(
    results: Results,
    configs: Sequence[EnsembleConfig],
    table: Table,
    assumptions: Assumptions,
    progress: Callable[[int, int], None],
    should_stop: Callable[[], bool],
) -> list[dict[str, Any]]:
    """The table of robustness; a worker process computes it."""
    geometry = results.geometry(configs[0].stream)
    rows = variants(table, assumptions, geometry, configs, other_sets(results.cache, configs))
    return robustness(results.cache, rows, progress, should_stop)
