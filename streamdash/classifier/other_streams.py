"""Do answers change if the streams were made otherwise: at another rate or age, or with other settings?

Everything that the classifier and the evidence say rests on simulations of one age, one rate, one X, one
number of impact times, one length, one size of the perturbers. Here each is changed by itself, in all
classes at once. Fresh streams made so are given to the classifier that knows only the usual ones, and
Σ ln B is computed from them anew. What moves no more than the scatter of a few hundred streams does not
matter for the question that the paper asks; what moves more is an assumption of every answer.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from streamdash.classifier.model import BEST, ClassifierConfig
from streamdash.classifier.train import Judged, train
from streamdash.config import EnsembleConfig, Perturbers, Population, StreamModel
from streamdash.naming import label_text
from streamdash.paths import DOCS
from streamdash.simulation.ensemble import complete
from streamdash.statistics.evidence import Rules, measured_evidence
from streamdash.statistics.scores import evaluate, share_interval, share_text
from streamdash.store.cache import Cache, StoreError
from streamdash.survey.observed import ObservedStreams

SEED = 977
"""Of the fresh streams: none of any shipped ensemble."""
N_STREAMS = 200
"""Fresh streams a class and setting."""
NOISE = 0.1
N_BIN = 20
"""Bins in Qρ of the evidence."""
CLASSES = (("1e3-1e5", "1e5-1e9"), ("1e3-1e5", "1e5-1e7", "1e7-1e9"))
N_REDRAWS = 4
"""Draws of the noise of which Σ ln B is the mean, and their scatter its error."""
MOVED = 3.0
"""Standard errors beyond which a change counts as one."""
USUAL = "as usual"


@dataclass(frozen=True)
class Setting:
    """One way in which streams are made: what differs from the usual ones.

    Attributes
    ----------
    group : what is changed: ``rate``, ``age``, ``X``, ``times``, ``length``, ``size``; `USUAL` for nothing.
    label : to what, in words.
    perturbers, stream : changes of `Perturbers` and of `StreamModel`.
    """

    group: str
    label: str
    perturbers: tuple[tuple[str, Any], ...] = ()
    stream: tuple[tuple[str, Any], ...] = ()

    def config(self, mass_range: str, n_streams: int = N_STREAMS) -> EnsembleConfig:
        """The ensemble of a class made so."""
        part = Perturbers(mass_range=mass_range)
        changes = {name: value(part) if callable(value) else value for name, value in self.perturbers}
        population = Population(components=(Perturbers(**{**part.model_dump(), **changes}),))
        return EnsembleConfig(
            stream=StreamModel(**dict(self.stream)), population=population, n_streams=n_streams, seed=SEED
        )


def _settings() -> tuple[Setting, ...]:
    def x_times(factor: float) -> Callable[[Perturbers], float]:
        return lambda part: round(part.X * factor, 4)  # the same largest impact parameter in kpc

    made = [Setting(USUAL, "9 Gyr, X = 5, 64 times")]
    made += [Setting("rate", f"{rate:g} × the rate", (("rate_factor", rate),)) for rate in (0.1, 0.3, 3, 10)]
    made += [Setting("age", f"{age:g} Gyr", stream=(("age_gyr", age),)) for age in (3, 5, 7)]
    made += [Setting("X", f"X = {x:g}", (("X", x),)) for x in (3, 10)]
    made += [Setting("times", f"{n} impact times", stream=(("n_times", n),)) for n in (16,)]
    made += [
        Setting("length", f"impacts to {factor:g} × the length", (("length_factor", factor),))
        for factor in (0.75, 1.25)
    ]
    made += [
        Setting("size", f"{factor:g} × r_s", (("rs_factor", factor), ("X", x_times(1 / factor))))
        for factor in (0.4, 2.5)
    ]
    made.append(Setting("size", "Plummer spheres", (("profile", "plummer"), ("X", x_times(1.05 / 1.62)))))
    return tuple(made)


SETTINGS = _settings()
GROUPS = {
    "rate": "Rate of impacts",
    "age": "Age of the stream",
    "X": "Largest impact parameter",
    "times": "Number of impact times",
    "length": "How far along the stream impacts reach",
    "size": "Size and profile of the perturbers",
}
"""What is changed, as people read it."""


def simulate_missing(
    cache: Cache,
    n_streams: int = N_STREAMS,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Make the fresh streams that the cache lacks; some ten minutes of one processor in all."""
    wanted = dict.fromkeys(
        setting.config(label, n_streams) for setting in SETTINGS for labels in CLASSES for label in labels
    )
    for done, config in enumerate(wanted):
        complete(config, cache, workers=workers)
        if progress is not None:
            progress(done + 1, len(wanted))


def other_streams_results(
    cache: Cache, n_streams: int = N_STREAMS, settings: ClassifierConfig = BEST, workers: int = 1
) -> dict[str, Any]:
    """What classifier and evidence say of streams that were made otherwise.

    Returns
    -------
    dict
        ``noise``, ``n_streams`` and ``rows``: one for each of `SETTINGS` and `CLASSES`, with the shares
        of all streams (``accuracy``) and of each class (``recall``) put right, the mean probability of the
        answers, and for two classes ``evidence``: Σ ln B for each as the truth with its error.

    Raises
    ------
    StoreError
        When streams are missing; `simulate_missing` makes the fresh ones.
    """
    rows = []
    for labels in CLASSES:
        usual = ObservedStreams.read(cache, _usual(cache, labels))
        judged = train(usual, NOISE, settings, workers=workers)
        for setting in SETTINGS:
            made = [setting.config(label, n_streams) for label in labels]
            streams = ObservedStreams.read(cache, made, usual.design)
            rows.append(_row(setting, judged, streams))
    return {"noise": NOISE, "n_bin": N_BIN, "n_streams": n_streams, "rows": rows}


def is_usual(config: EnsembleConfig) -> bool:
    """Whether an ensemble is of the usual streams of a class, however many and of whatever seed."""
    (part, *others) = config.population.components
    made = SETTINGS[0].config(part.label, config.n_streams).model_copy(update={"seed": config.seed})
    return not others and config == made


def _usual(cache: Cache, labels: Sequence[str]) -> list[EnsembleConfig]:
    """The largest complete ensemble of the usual streams of every class."""
    there = [e.config for e in cache.complete_ensembles(lambda c: is_usual(c) and c.seed != SEED)]
    found = []
    for label in labels:
        fits = [config for config in there if config.label == label]
        if not fits:
            raise StoreError(f"There are no streams of {label}; `streamdash simulate --mass {label}` first.")
        found.append(max(fits, key=lambda config: config.n_streams))
    return found


def _row(setting: Setting, judged: Judged, streams: ObservedStreams) -> dict[str, Any]:
    said = judged.classifier.predict_proba(streams.observed(NOISE))
    scores = evaluate(streams.y, said, seed=0)
    row = {
        "group": setting.group,
        "label": setting.label,
        "classes": list(streams.labels),
        "accuracy": float(scores.values["overall_accuracy"]),
        "recall": scores.values["recall"].tolist(),
        "confidence": float(said.max(axis=1).mean()),
        "evidence": [],
    }
    if len(streams.q) == 2:
        row["evidence"] = _evidence(streams)
    return row


def _evidence(streams: ObservedStreams) -> list[dict[str, float]]:
    """Σ ln B with each class as the truth: mean over draws of the noise; the error is that of halves."""
    half = min(len(q) for q in streams.q) // 2
    whole, parts = [], []
    for number in range(N_REDRAWS):
        noisy = streams.noisy(NOISE, number)
        whole.append(_sums(noisy))
        parts.append([_sums([q[:half] for q in noisy]), _sums([q[half:] for q in noisy])])
    value = np.mean(whole, axis=0)
    # Two halves differ by twice the error of the whole, if it falls with the root of the streams.
    between = np.abs(np.diff(np.mean(parts, axis=0), axis=0)[0]) / 2
    error = np.hypot(between, np.std(whole, axis=0, ddof=1))
    return [{"sum": float(v), "error": float(e)} for v, e in zip(value, error, strict=True)]


def _sums(profiles: Sequence[np.ndarray]) -> list[float]:
    _, found = measured_evidence(profiles, NOISE, N_BIN, Rules())
    return [found.cumulative(i, i, 1 - i).value for i in (0, 1)]


def shipped_results() -> dict[str, Any] | None:
    """The results as they are shipped, of `other_streams_results`; None where they are not."""
    path = DOCS / "reproduction/other_streams.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def chosen_rows(results: Mapping[str, Any], groups: Sequence[str]) -> list[Mapping[str, Any]]:
    """The rows of some groups, those of the usual streams first."""
    order = (USUAL, *groups)
    return sorted(
        (row for row in results["rows"] if row["group"] in order), key=lambda row: order.index(row["group"])
    )


def moved(results: Mapping[str, Any], row: Mapping[str, Any]) -> tuple[bool, bool]:
    """Whether accuracy and Σ ln B differ from the usual ones' by more than their scatter."""
    base = _usual_row(results, row)
    n = results["n_streams"] * len(row["classes"])
    errors = [np.ptp(share_interval(one["accuracy"] * n, n)) / 2 for one in (row, base)]
    accuracy = abs(row["accuracy"] - base["accuracy"]) > MOVED * float(np.hypot(*errors))
    pairs = zip(row["evidence"], base["evidence"], strict=True)
    evidence = any(abs(a["sum"] - b["sum"]) > MOVED * np.hypot(a["error"], b["error"]) for a, b in pairs)
    return accuracy, bool(evidence)


def _usual_row(results: Mapping[str, Any], row: Mapping[str, Any]) -> Mapping[str, Any]:
    same = (one for one in results["rows"] if one["group"] == USUAL and one["classes"] == row["classes"])
    return next(same)


def group_sentence(results: Mapping[str, Any], group: str) -> str:
    """What one change does to accuracy and evidence, in one sentence."""
    parts = []
    for labels in CLASSES:
        rows = [r for r in results["rows"] if r["group"] == group and tuple(r["classes"]) == labels]
        base = _usual_row(results, rows[0])
        shares = ", ".join(f"{100 * r['accuracy']:.1f} % ({r['label']})" for r in rows)
        changes = any(moved(results, r)[0] for r in rows)
        verb = "changes" if changes else "does not change beyond its scatter"
        text = (
            f"With {len(labels)} classes accuracy {verb}: {shares}; as usual {100 * base['accuracy']:.1f} %."
        )
        if base["evidence"]:
            sums = "; ".join(
                f"{', '.join(_sum_text(r, i) for r in rows)} instead of {_sum_text(base, i)} with "
                f"{label_text(label)} as the truth"
                for i, label in enumerate(labels)
            )
            verb = (
                "changes" if any(moved(results, r)[1] for r in rows) else "does not change beyond its scatter"
            )
            text += f" Σ ln B {verb}: {sums}."
        parts.append(text)
    return f"{GROUPS[group]}. {' '.join(parts)}"


def caveat(results: Mapping[str, Any] | None, labels: Sequence[str]) -> str:
    """What other rates and ages do to the share put right, in one sentence; empty for other classes."""
    rows = [] if results is None else [r for r in results["rows"] if r["classes"] == list(labels)]
    if results is None or not rows:
        return ""
    base = _usual_row(results, rows[0])
    parts = ", ".join(
        f"{100 * r['accuracy']:.0f} % ({r['label']})" for r in rows if r["group"] in ("rate", "age")
    )
    return (
        "The probabilities hold at the simulated rate and age. In bins of 0.2° with errors of "
        f"{results['noise']:g}, a classifier that knows only these puts {100 * base['accuracy']:.0f} % of "
        f"such streams right, and of others {parts}; the Classifier page has the study."
    )


def other_streams_markdown(results: Mapping[str, Any]) -> str:
    """The question that matters as Markdown: one table, and a sentence for each change."""
    n = results["n_streams"]
    lines = [
        "# Do classifier and evidence change?\n",
        f"One thing is changed at a time, in all classes, and {n} fresh streams a class are made so. The "
        "classifiers have learnt the usual streams only (9 Gyr, cold dark matter's rate, X = 5, 64 impact "
        f"times) and are never told. σ_ε = {results['noise']:g}; Σ ln B by this project's rules, N_bin = "
        f"{results['n_bin']}, from as many streams in every row. A share of streams has its 68 % interval; "
        f"a change counts beyond {MOVED:g} standard errors (**bold**). Written by "
        "`streamdash convergence --answers`.\n",
        "| streams | right, 2 classes | mean probability | Σ ln B, truth 10³–10⁵ | Σ ln B, truth 10⁵–10⁹ | "
        "right, 3 classes | mean probability |",
        "|---" * 7 + "|",
    ]
    two, three = ([r for r in results["rows"] if len(r["classes"]) == len(labels)] for labels in CLASSES)
    for a, b in zip(two, three, strict=True):
        (acc2, ev2), (acc3, _) = moved(results, a), moved(results, b)
        cells = [
            a["label"] if a["group"] != USUAL else f"{USUAL}: {a['label']}",
            _bold(share_text(a["accuracy"], 2 * n), acc2),
            f"{a['confidence']:.3f}",
            *(_bold(_sum_text(a, i), ev2) for i in (0, 1)),
            _bold(share_text(b["accuracy"], 3 * n), acc3),
            f"{b['confidence']:.3f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", *(f"- {group_sentence(results, group)}" for group in GROUPS)]
    return "\n".join(lines) + "\n"


def _sum_text(row: Mapping[str, Any], truth: int) -> str:
    found = row["evidence"][truth]
    return f"{found['sum']:.1f} ± {found['error']:.1f}"


def _bold(text: str, yes: bool) -> str:
    return f"**{text}**" if yes else text
