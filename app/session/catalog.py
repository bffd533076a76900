"""Which streams and ensembles can be shown: a frozen snapshot of the cache. Pure; no Panel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.naming import differences, population_text
from streamdash.streams import STREAM_NAMES, both_arms_text, stream_of, stream_text

CLASSES_MIN, CLASSES_MAX = 2, 4
"""Fewest and most mass ranges compared at once."""
SHOWN = ("ensembles", "geometries")
"""Kinds of cache entries that a catalog is made of."""
PAPER_RANGES = ("1e3-1e5", "1e5-1e9")
"""Mass ranges compared when nothing else was asked for: the paper's two classes."""


@dataclass(frozen=True)
class Choice:
    """One complete ensemble a person can pick."""

    key: str
    """Name of the cache entry."""
    token: str
    """Short name in links: the mass range, with part of the key where that is not enough."""
    label: str
    """Name in menus: the mass range and whatever differs from the defaults."""
    config: EnsembleConfig
    arms: tuple[Choice, ...] = ()
    """Of both arms of a stream together, the ensemble of each; empty for one arm."""


@dataclass(frozen=True)
class Stream:
    """One stream model, or both arms of one, that has complete ensembles, lowest masses first."""

    key: str
    label: str
    model: StreamModel
    ensembles: tuple[Choice, ...]
    arms: tuple[Stream, ...] = ()
    """Each arm by itself, where this is both; empty for one arm."""

    @property
    def token(self) -> str:
        """Short name in links: of a named stream ``pal5``, ``pal5-leading``, ``pal5-both``; else the key."""
        named = stream_of(self.model)
        if named.arms.get(self.model.arm) != self.model or named.name not in STREAM_NAMES:
            return self.key
        if self.arms:
            return f"{named.name}-both"
        return named.name if self.model.arm == named.default_arm else f"{named.name}-{self.model.arm}"

    def find(self, token: str) -> Choice | None:
        """The ensemble of a link's token, of a cache key, or of its first eight digits or more."""
        for choice in self.ensembles:
            if choice.token == token or (len(token) >= 8 and choice.key.startswith(token)):
                return choice
        return None

    def default(self) -> tuple[Choice, ...]:
        """The paper's two classes where they exist, else the first two ensembles."""
        paper = tuple(c for c in map(self.find, PAPER_RANGES) if c is not None)
        return paper if len(paper) == len(PAPER_RANGES) else self.ensembles[:CLASSES_MIN]


@dataclass(frozen=True)
class Catalog:
    """All streams that can be shown, and one sentence for every entry that cannot."""

    streams: tuple[Stream, ...] = ()
    problems: tuple[str, ...] = ()
    unfinished: tuple[Choice, ...] = ()
    """Ensembles that were begun and can be resumed."""

    def stream(self, key: str) -> Stream | None:
        """The stream model of a key, or of a link's short name; the first one for an empty key."""
        if not key:
            return self.streams[0] if self.streams else None
        return next((s for s in self.streams if key in (s.key, s.token)), None)


def read_catalog(entries: Iterable[Any]) -> Catalog:
    """Sort cache entries (`streamdash.store.cache.Entry`) into what can be shown and what cannot."""
    groups: dict[str, list[Any]] = {}
    problems, unfinished = [], []
    for entry in entries:
        if entry.state in ("damaged", "foreign"):
            problems.append(f"Cache entry {entry.label or entry.key} is {entry.state}: {entry.reason}")
        elif entry.kind == "ensemble" and entry.config.prior is not None:
            continue  # streams that differ in their population are no class: they are for inference
        elif entry.kind == "ensemble" and entry.state == "partial":
            unfinished.append(Choice(entry.key, entry.key, entry_label(entry), entry.config))
        elif entry.kind == "ensemble" and entry.state == "complete":
            group = groups.setdefault(entry.config.stream.key, [])
            if all(entry.key != other.key for other in group):  # shipped and a user's own copy
                group.append(entry)
    default_key = StreamModel().key
    ordered = sorted(groups, key=lambda key: (key != default_key, key))
    return Catalog(_with_both(_stream(groups[key]) for key in ordered), tuple(problems), tuple(unfinished))


def of_paper(configs: Sequence[EnsembleConfig]) -> bool:
    """Whether classes differ from the paper's in nothing but their masses: its numbers may stand beside."""
    return all(config.stream == StreamModel() and not differences(config) for config in configs)


def entry_label(entry: Any) -> str:
    """Name of an ensemble for people: the one it was given, its masses, and what sets it apart."""
    return label_of(entry.config, entry.title)


def label_of(config: EnsembleConfig, title: str = "") -> str:
    """Name of a configuration for people; ``title`` comes first where somebody gave one."""
    words = [title] if title else []
    return " · ".join([*words, population_text(config.population), *differences(config)])


def _stream(entries: Sequence[Any]) -> Stream:
    ordered = sorted(entries, key=_order)
    model = ordered[0].config.stream
    choices: list[Choice] = []
    for entry in ordered:
        plain = entry.config.population.label.replace("+", "_")  # a plus means a space in links
        taken = any(choice.token == plain for choice in choices)
        token = f"{plain}~{entry.key[:8]}" if taken or differences(entry.config) else plain
        label = entry_label(entry)
        labels = {choice.label for choice in choices}
        if label in labels:
            label += f" · n_streams {entry.config.n_streams}"
        if label in labels:  # menus go by the label
            label += f" · {entry.key[:8]}"
        choices.append(Choice(entry.key, token, label, entry.config))
    return Stream(model.key, stream_text(model), model, tuple(choices))


def _with_both(streams: Iterable[Stream]) -> tuple[Stream, ...]:
    """The streams, the arms of one together, and after them both of its arms as one more."""
    by_name: dict[str, list[Stream]] = {}
    for stream in streams:
        by_name.setdefault(stream.model.model_copy(update={"arm": "leading"}).key, []).append(stream)
    found: list[Stream] = []
    for arms in by_name.values():
        order = list(stream_of(arms[0].model).arms)
        arms.sort(key=lambda one: order.index(one.model.arm) if one.model.arm in order else len(order))
        found += arms
        both = _both(arms) if len(arms) > 1 else None
        if both is not None:
            found.append(both)
    return tuple(found)


def _both(arms: Sequence[Stream]) -> Stream | None:
    """Both arms of a stream as one, with the populations that hit both."""
    first, second = arms
    choices: list[Choice] = []
    for one in first.ensembles:
        other = next((c for c in second.ensembles if _alike(c.config) == _alike(one.config)), None)
        if other is None or any(_alike(c.config) == _alike(one.config) for c in choices):
            continue
        config = min(one.config, other.config, key=lambda c: c.n_streams)
        config = one.config.model_copy(update={"n_streams": config.n_streams})
        choices.append(Choice(f"{one.key}+{other.key}", one.token, one.label, config, (one, other)))
    if not choices:
        return None
    label = both_arms_text(first.model)
    return Stream(f"{first.key}+{second.key}", label, first.model, tuple(choices), (first, second))


def _alike(config: EnsembleConfig) -> tuple:
    """What the ensembles of both arms must have in common."""
    return config.population, config.prior, config.seed, config.accuracy


def _order(entry: Any) -> tuple:
    low, high = entry.config.population.mass_range
    return low, high, len(differences(entry.config)), -entry.config.n_streams, entry.key
