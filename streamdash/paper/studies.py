"""The classifier's studies at the paper's noise, as they are shipped: there at once, before anything runs.

Each is what `streamdash.classifier.studies` computes for the two default classes of the default stream,
the best settings and σ_ε = 0.1, with the seconds that it took: from these a page says how long another
one will take.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache as once
from typing import Any

import numpy as np

from streamdash.classifier.data import check_classes
from streamdash.classifier.model import BEST, PRESETS, ClassifierConfig
from streamdash.classifier.studies import (
    Contender,
    Curve,
    Grid,
    Importance,
    compare,
    grid_search,
    importance,
    learning_curve,
    noise_curve,
    wrong_noise_curve,
)
from streamdash.classifier.train import Judged, train
from streamdash.config import EnsembleConfig
from streamdash.paper.evidence import NOISE
from streamdash.paths import DOCS
from streamdash.statistics.scores import Scores
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

FILE = "reproduction/studies.json"
KINDS = {kind.__name__: kind for kind in (Contender, Curve, Grid, Importance, Scores, ClassifierConfig)}
"""What results are made of."""
STUDIES: dict[str, Callable[[ObservedStreams, Judged], Any]] = {
    "importance": lambda streams, judged: importance(judged, streams, NOISE),
    "noise-curve": lambda streams, judged: noise_curve(streams, BEST),
    "wrong-noise": lambda streams, judged: wrong_noise_curve(streams, NOISE, BEST),
    "learning-curve": lambda streams, judged: learning_curve(streams, NOISE, BEST),
    "comparison": lambda streams, judged: compare(streams, NOISE, PRESETS),
    "tuning": lambda streams, judged: grid_search(streams, NOISE, BEST),
}
"""By name, as on the Classifier page."""


def study_results(
    cache: Cache, configs: Sequence[EnsembleConfig], names: Sequence[str] = tuple(STUDIES)
) -> dict[str, Any]:
    """All studies of some classes at the paper's noise, as plain numbers, lists and text.

    Returns
    -------
    dict
        ``keys`` of the ensembles, ``labels``, ``noise``, ``settings`` (their key), ``n_streams`` of all
        classes together, ``accuracy`` and its 68 % interval, ``n_test``, the ``seconds`` of a processor of
        one training, and ``studies``: of each its ``seconds`` and ``result`` (see `read_result`).
    """
    streams = check_classes(ObservedStreams.read(cache, list(configs)))
    start = time.process_time()
    judged = train(streams, NOISE, BEST)
    seconds = time.process_time() - start
    low, high = judged.scores.interval("overall_accuracy")
    found: dict[str, Any] = {
        "keys": list(streams.keys),
        "labels": list(streams.labels),
        "noise": NOISE,
        "settings": BEST.key,
        "n_streams": len(streams.y),
        "accuracy": float(judged.scores.values["overall_accuracy"]),
        "accuracy_interval": [float(low), float(high)],
        "n_test": len(judged.y),
        "seconds": seconds,
        "studies": {},
    }
    for name in names:
        start = time.process_time()
        result = STUDIES[name](streams, judged)
        found["studies"][name] = {"seconds": time.process_time() - start, "result": plain(result)}
    return found


@once
def shipped_studies() -> Mapping[str, Any] | None:
    """What `study_results` gave for the default classes, as it is shipped; None where it is not."""
    path = DOCS / FILE
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def shipped_result(name: str, keys: Sequence[str]) -> Any | None:
    """The shipped result of a study, if it is of these ensembles; at `NOISE`, with the best settings."""
    found = shipped_studies()
    if found is None or name not in found["studies"] or found["keys"] != list(keys):
        return None
    return read_result(found["studies"][name]["result"])


def estimated_seconds(name: str, n_streams: int) -> float | None:
    """About how long a study of so many streams takes, after the one that is shipped.

    Growing trees is proportional to the streams.
    """
    found = shipped_studies()
    if found is None or name not in found["studies"]:
        return None
    return float(found["studies"][name]["seconds"] * n_streams / found["n_streams"])


def plain(value: Any) -> Any:
    """A result as JSON can hold it: dataclasses and settings by the name of their kind."""
    if isinstance(value, ClassifierConfig):
        return {"kind": "ClassifierConfig", "json": value.model_dump_json()}
    if is_dataclass(value) and not isinstance(value, type):
        parts = {one.name: plain(getattr(value, one.name)) for one in fields(value)}
        return {"kind": type(value).__name__, **parts}
    if isinstance(value, Mapping):
        return {str(name): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def read_result(value: Any) -> Any:
    """A result from what `plain` made of it; lists of numbers become arrays."""
    if isinstance(value, Mapping):
        parts = dict(value)
        kind = parts.pop("kind", None)
        if kind == "ClassifierConfig":
            return ClassifierConfig.parse(parts["json"])
        read = {name: read_result(part) for name, part in parts.items()}
        return read if kind is None else KINDS[kind](**read)
    if isinstance(value, list):
        if value and isinstance(value[0], Mapping):
            return [read_result(part) for part in value]
        return np.asarray(value)
    return value
