"""Does the answer hold? The same question asked again with every choice that might decide it.

Each row has a classifier of its own, trained on streams observed as that row says: another order of the
polynomial, errors half or twice as large as stated, either half of the stream, other sets of mass ranges.
One classifier a row and no committee: the rows are compared with the first, which is made in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from streamdash.classifier.data import Cancelled
from streamdash.classifier.model import BEST, ClassifierConfig
from streamdash.classifier.train import Progress, ShouldStop, train
from streamdash.config import EnsembleConfig
from streamdash.engine.geometry import Geometry
from streamdash.naming import label_text
from streamdash.observe.guess import Assumptions
from streamdash.observe.observation import NAMES, Observation, interpret
from streamdash.observe.table import ObservationError, Table
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

ORDERS = range(6)
"""Orders of the polynomial that are tried."""
ERRORS = (0.5, 2.0)
"""What the stated errors are multiplied with, beside 1."""
MAX_SETS = 6
SURE = 0.75
"""Below this probability a row decides nothing."""
LIGHT = BEST.model_copy(update={"copies": 1})
"""How the classifier of a row is trained."""


@dataclass(frozen=True, eq=False)
class Variant:
    """One row: what is different, and the observation and classes that this makes.

    Attributes
    ----------
    group : {"as chosen", "order", "errors", "half", "classes"}
    name : str
    observation : Observation or None
        None where the profile cannot be read so.
    configs : tuple of EnsembleConfig
    problem : str
        Why it cannot be read so.
    """

    group: str
    name: str
    observation: Observation | None
    configs: tuple[EnsembleConfig, ...]
    problem: str = ""


def variants(
    table: Table,
    assumptions: Assumptions,
    geometry: Geometry,
    configs: Sequence[EnsembleConfig],
    others: Sequence[tuple[EnsembleConfig, ...]] = (),
) -> list[Variant]:
    """Every row of the table of robustness; the first is the question as it was asked.

    Parameters
    ----------
    table, assumptions, geometry : of the observation, see `interpret`.
    configs : of the compared classes.
    others : other sets of classes, see `other_sets`.

    Raises
    ------
    ObservationError
        When the profile cannot be read as it was asked.
    """
    classes = tuple(configs)
    asked = interpret(table, assumptions, geometry)
    rows = [Variant("as chosen", "as chosen", asked, classes)]

    def tried(group: str, name: str, part: Table, a: Assumptions) -> None:
        try:
            found = interpret(part, a, geometry)
        except ObservationError as error:
            rows.append(Variant(group, name, None, classes, str(error)))
            return
        used = found.design.order
        if group == "order" and used != a.order:
            problem = f"this polynomial comes close to zero or follows so few bins too closely (order {used})"
            rows.append(Variant(group, name, None, classes, problem))
        else:
            more = "" if used == asked.design.order or group == "order" else f", order {used}"
            rows.append(Variant(group, name + more, found, classes))

    for order in ORDERS if assumptions.kind != "detrended" else ():
        if order != asked.design.order:
            a = assumptions.model_copy(update={"order": order})
            tried("order", f"polynomial of order {order}", table, a)
    for factor in ERRORS:
        design = replace(asked.design, sigma=factor * asked.design.sigma)
        rows.append(Variant("errors", f"errors × {factor:g}", replace(asked, design=design), classes))
    middle = float(np.median(asked.design.centers))
    x = table.column(assumptions.position)
    x = x - 360.0 * np.round((x - middle) / 360.0)
    name = NAMES[assumptions.coordinate]
    for words, part in (("below", x < middle), ("above", x >= middle)):
        half = replace(table, values=table.values[part], lines=table.lines[part])
        tried("half", f"{name} {words} {middle:.1f}° only", half, assumptions)
    for group in others:
        labels = " or ".join(label_text(config.label) for config in group)
        rows.append(Variant("classes", f"classes {labels}", asked, group))
    return rows


def other_sets(cache: Cache, configs: Sequence[EnsembleConfig]) -> list[tuple[EnsembleConfig, ...]]:
    """Sets of two to four mass ranges that share no mass, of the same stream, other than the chosen one.

    Ensembles of one component at the rate of cold dark matter count; of several of the same range, that of
    most streams.
    """

    def counts(config: EnsembleConfig) -> bool:
        components = config.population.components
        one = config.prior is None and len(components) == 1 and components[0].rate_factor == 1
        return one and config.stream == configs[0].stream

    best: dict[tuple[float, float], EnsembleConfig] = {}
    for entry in cache.complete_ensembles(counts):
        config, masses = entry.config, entry.config.population.components[0].mass_range
        if masses not in best or best[masses].n_streams < config.n_streams:
            best[masses] = config
    ranges = sorted(best)
    chosen = {config.population.mass_range for config in configs}
    sets = [
        group
        for n in (2, 3, 4)
        for group in combinations(ranges, n)
        if set(group) != chosen and all(a[1] <= b[0] for a, b in zip(group, group[1:], strict=False))
    ]
    return [tuple(best[masses] for masses in group) for group in sets[:MAX_SETS]]


def robustness(
    cache: Cache,
    rows: Sequence[Variant],
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    settings: ClassifierConfig = LIGHT,
) -> list[dict[str, Any]]:
    """The answer of every row, as plain numbers and text.

    Returns
    -------
    list of dict
        ``group``, ``name``, ``problem``; and, where there is none, ``n_bins``, ``classes`` (mass range and
        probability of each), ``best``, ``probability``, ``accuracy`` (share of held-out streams put right)
        and ``agrees``: whether it says as surely what the first row says.

    Raises
    ------
    Cancelled
        When ``should_stop`` said so.
    """
    found: list[dict[str, Any]] = []
    for number, row in enumerate(rows):
        if should_stop is not None and should_stop():
            raise Cancelled
        found.append(_answer(cache, row, settings))
        if progress is not None:
            progress(number + 1, len(rows))
    for entry in found:
        entry["agrees"] = not entry["problem"] and _same(entry, found[0])
    return found


def _answer(cache: Cache, row: Variant, settings: ClassifierConfig) -> dict[str, Any]:
    entry: dict[str, Any] = {"group": row.group, "name": row.name, "problem": row.problem}
    if row.observation is None:
        return entry
    design = row.observation.design
    try:
        streams = ObservedStreams.read(cache, row.configs, design)
        judged = train(streams, design.sigma, settings)
    except ValueError as error:
        return {**entry, "problem": str(error)}
    said = judged.classifier.predict_proba(row.observation.q.astype(np.float32)[None])[0]
    best = int(said.argmax())
    return {
        **entry,
        "n_bins": design.n_bin,
        "classes": [
            {"mass_range": label, "probability": float(p)}
            for label, p in zip(streams.labels, said, strict=True)
        ],
        "best": streams.labels[best],
        "masses": list(row.configs[best].population.mass_range),
        "probability": float(said[best]),
        "accuracy": float(judged.scores.values["overall_accuracy"]),
    }


def _same(entry: dict[str, Any], first: dict[str, Any]) -> bool:
    """Whether a row says what the first one says: masses that overlap, and sure where that was sure."""
    if first["problem"]:
        return False
    (low, high), (first_low, first_high) = entry["masses"], first["masses"]
    sure = (entry["probability"] >= SURE) == (first["probability"] >= SURE)
    return max(low, first_low) < min(high, first_high) and sure


def robustness_words(found: Sequence[dict[str, Any]]) -> str:
    """What would change the answer, in one sentence."""
    counted = [entry for entry in found[1:] if not entry["problem"]]
    against = [entry for entry in counted if not entry["agrees"]]
    if not counted:
        return "Nothing else could be tried."
    if not against:
        return f"None of the {len(counted)} other choices that were tried changes the answer."
    named = "; ".join(
        f"{entry['name']} ({label_text(entry['best'])} with {100 * entry['probability']:.0f} %)"
        for entry in against
    )
    return (
        f"Of {len(counted)} other choices that were tried, {len(against)} would change the answer: {named}."
    )
