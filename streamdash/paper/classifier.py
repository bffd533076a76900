"""The paper's classifier results, table 2 and figure 6, beside ours (paper §3.2).

`classifier_results` returns one plain dictionary; `classifier_markdown` renders it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from streamdash.classifier.model import BEST, PAPER, PAPER_CLASSES, ClassifierConfig, paper_scores
from streamdash.classifier.studies import grid_search
from streamdash.classifier.train import Judged, train
from streamdash.config import EnsembleConfig
from streamdash.statistics.scores import Scores
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

SEEDS = (0, 1, 2)
"""Splits that everything is repeated for; tables show the first, and the lowest of all."""
METRICS = ("precision", "recall", "f1")


def classifier_results(
    cache: Cache,
    ensembles: Mapping[str, str | EnsembleConfig],
    noise: float = 0.1,
    seeds: Sequence[int] = SEEDS,
    workers: int = 1,
) -> dict[str, Any]:
    """Train and judge the paper's classifier and the best one, for its two and its three classes.

    Parameters
    ----------
    cache : Cache
    ensembles : mapping
        Key or configuration of the ensemble of each mass range, for example ``1e3-1e5``.
    noise : float
        Shot noise σ_ε per 0.2° bin.
    seeds : sequence of int
        The first one's results are given in full.

    Returns
    -------
    dict
        ``noise``, ``seeds`` and one entry per set of classes that the ensembles allow, ``two``
        and ``three``; numbers, lists and text only.
    """
    results: dict[str, Any] = {"noise": noise, "seeds": list(seeds)}
    for name, labels in zip(("two", "three"), PAPER_CLASSES.values(), strict=True):
        if set(labels) <= set(ensembles):
            streams = ObservedStreams.read(cache, [ensembles[label] for label in labels])
            results[name] = results_of(streams, noise, seeds, workers)
    return results


def results_of(streams: ObservedStreams, noise: float, seeds: Sequence[int], workers: int) -> dict[str, Any]:
    """Results for one set of classes, as one entry of `classifier_results`."""
    grid = grid_search(streams, noise, PAPER, workers=workers)
    chosen = grid.settings.boosting
    methods = {"best": BEST, "paper's method": grid.settings}
    return {
        "labels": list(streams.labels),
        "n_streams": [len(q) for q in streams.q],
        "paper": paper_scores(streams.labels),
        "grid": {
            "max_depth": chosen.max_depth,
            "n_estimators": chosen.n_estimators,
            "accuracy": float(grid.accuracy.max()),
        },
        "methods": {
            name: _repeated(streams, noise, settings, seeds, workers) for name, settings in methods.items()
        },
    }


def _repeated(
    streams: ObservedStreams,
    noise: float,
    settings: ClassifierConfig,
    seeds: Sequence[int],
    workers: int,
) -> dict[str, Any]:
    """Scores of the first seed in full, and the accuracy and lowest recall of all."""
    runs = [
        train(streams, noise, settings.model_copy(update={"seed": seed}), workers=workers) for seed in seeds
    ]
    first = runs[0]
    return {
        **first.scores.to_dict(),
        "seconds": first.seconds,
        "accuracies": [float(run.scores.values["overall_accuracy"]) for run in runs],
        "lowest_recalls": [float(run.scores.values["recall"].min()) for run in runs],
        "calibration_errors": [float(run.scores.values["ece"]) for run in runs],
        "confused": _confused(streams, first),
    }


def _confused(streams: ObservedStreams, judged: Judged) -> list[dict[str, Any]]:
    """What sets the wrong streams of each class apart from the right ones: impacts and spread of Qρ."""
    taken_for = judged.probability.argmax(axis=1)
    rows = []
    for c, label in enumerate(streams.labels):
        for kind, chosen in (("right", taken_for == c), ("wrong", taken_for != c)):
            members = judged.rows[(judged.y == c) & chosen]
            owner, index = streams.locate(members)
            hits = [streams.n_impacts[o][i] for o, i in zip(owner, index, strict=True)]
            rows.append(
                {
                    "label": label,
                    "kind": kind,
                    "n": len(members),
                    "median_impacts": float(np.median(hits)) if len(members) else None,
                    "median_std_q_rho": float(np.median(streams.clean[members].std(axis=1)))
                    if len(members)
                    else None,
                }
            )
    return rows


# ---------------------------------------------------------------- text


def classifier_markdown(results: Mapping[str, Any]) -> str:
    """Table 2, the confusion matrices and what limits the rest, as Markdown."""
    parts = ["## Classifier (paper table 2, figure 6)\n"]
    for name in ("two", "three"):
        if name in results:
            parts.append(_set_markdown(results[name], results["noise"], results["seeds"]))
    return "\n".join(parts)


def _set_markdown(part: Mapping[str, Any], noise: float, seeds: Sequence[int]) -> str:
    labels, paper, methods = part["labels"], part["paper"], part["methods"]
    sign = "" if len(labels) == 2 else "≳"
    n_test = sum(map(sum, methods["best"]["counts"]))
    lines = [
        f"### {len(labels)} classes, σ_ε = {noise:g}, {n_test} test streams (split of seed {seeds[0]})\n",
        "| class | method | precision | recall | F1 |",
        "|---|---|---|---|---|",
    ]
    scores = {n: Scores(np.array(m["counts"]), m["values"], m["errors"]) for n, m in methods.items()}
    for c, label in enumerate(labels):
        for name, score in scores.items():
            cells = [score.text(m, c) for m in METRICS]
            lines.append(f"| {label} | {name} | {' | '.join(cells)} |")
        lines.append(f"| {label} | paper | {' | '.join(f'{sign}{paper[m][c]:.2f}' for m in METRICS)} |")
    for name, method in methods.items():
        values = method["values"]
        lines += [
            f"\n**{name}**: accuracy {scores[name].text('overall_accuracy', digits=4)}"
            f"{_paper_accuracy(paper)}, calibration error {values['ece']:.3f}; over seeds "
            f"{', '.join(map(str, seeds))}: accuracy {_series(method['accuracies'])}, lowest recall "
            f"{_series(method['lowest_recalls'])}, calibration error "
            f"{_series(method['calibration_errors'])}.\n",
            f"| true, taken for | {' | '.join(labels)} |",
            "|---" * (len(labels) + 1) + "|",
        ]
        for label, row in zip(labels, method["counts"], strict=True):
            total = max(sum(row), 1)
            lines.append(f"| {label} | {' | '.join(f'{n} ({100 * n / total:.1f} %)' for n in row)} |")
    grid = part["grid"]
    lines.append(
        f"\nThe paper's method is 8 components, and the simplest trees within one error of the best of its "
        f"grid in 5-fold cross-validation: max_depth {grid['max_depth']}, n_estimators "
        f"{grid['n_estimators']}. {_limits(methods['best']['confused'])}\n"
    )
    return "\n".join(lines)


def _paper_accuracy(paper: Mapping[str, Any]) -> str:
    return f" (paper {paper['overall_accuracy']:.2f})" if "overall_accuracy" in paper else ""


def _series(values: Sequence[float]) -> str:
    return "/".join(f"{value:.3f}" for value in values)


def _limits(confused: Sequence[Mapping[str, Any]]) -> str:
    """What the wrong streams of the class with most of them have in common, in words."""
    wrong = max((row for row in confused if row["kind"] == "wrong"), key=lambda row: row["n"])
    if wrong["n"] == 0:
        return "No test stream is wrong."
    right = next(row for row in confused if row["kind"] == "right" and row["label"] == wrong["label"])
    return (
        f"What limits the rest: the {wrong['n']} wrong streams of {wrong['label']} had "
        f"{wrong['median_impacts']:g} impacts (median) against {right['median_impacts']:g} of those put "
        f"right, and their Qρ spreads by {wrong['median_std_q_rho']:.2f} against "
        f"{right['median_std_q_rho']:.2f}."
    )
