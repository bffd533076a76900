"""Parts of the Classifier page: its tables, and its studies: what each computes, shows and says."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from app import ui
from app.services.services import Services
from app.session.session import Session
from app.ui.study import Study
from app.work.pieces import compare_presets, importance_of, on_streams
from app.work.pool import Compute
from app.work.training import code_head, data_key, settings_of, streams_of
from streamdash.classifier.model import paper_scores
from streamdash.classifier.store import ModelStore
from streamdash.classifier.studies import (
    Contender,
    grid_search,
    learning_curve,
    noise_curve,
    wrong_noise_curve,
)
from streamdash.classifier.train import Judged
from streamdash.naming import class_colours
from streamdash.paper.studies import estimated_seconds, shipped_result, shipped_studies
from streamdash.plots import classifier_studies as plots
from streamdash.plots.classifier import METRICS, class_names
from streamdash.plots.style import noise_label
from streamdash.words import percent_between

STYLE = (
    ui.TABLE_STYLE
    + """
th, td { padding: 5px 8px; }
tbody tr + tr > * { border-top: 1px solid #80808060; }
"""
)
CURVE_LEGEND = (("line-dots", "recall per class"), ("line-dots-grey", "accuracy over all classes"))


def scores_html(judged: Judged, beside_paper: bool) -> Markup:
    """Precision, recall, F₁, accuracy and AUC per class with 68 % intervals; the paper's beneath if asked."""
    labels = judged.classifier.card.labels
    paper = (paper_scores(labels) if beside_paper else None) or {}
    scores = judged.scores
    # The paper gives whole percents for two classes, and "≳" for three.
    sign = "" if len(labels) == 2 else "≳ "

    def cell(metric: str, c: int) -> tuple[str, ...]:
        given = paper.get(metric)
        note = (f"paper {sign}{given[c]:.2f}",) if isinstance(given, tuple) else ()
        value, _, interval = scores.text(metric, c).partition(" ")
        return (value, *([interval] if interval else []), *note)

    overall = f"{scores.text('overall_accuracy')}, 68 % interval"
    note = f", paper {paper['overall_accuracy']:.2f}" if "overall_accuracy" in paper else ""
    return ui.render(
        "pages/classifier/scores.html",
        colours=class_colours(labels),
        accuracy=overall + note,
        metrics=METRICS.values(),
        rows=[(name, [cell(metric, c) for metric in METRICS]) for c, name in enumerate(class_names(labels))],
    )


def comparison_html(contenders: Sequence[Contender], labels: Sequence[str]) -> Markup:
    """One row per preset or network, best first, on one split."""
    records = plots.comparison_table(contenders, labels).to_dict("records")
    return ui.render(
        "pages/classifier/comparison.html",
        columns=["Accuracy", "Log loss", "Calibration error", "Training", *class_names(labels)],
        rows=[
            (
                record["name"],
                [
                    percent_between(record["accuracy"], record["accuracy_low"], record["accuracy_high"]),
                    f"{record['log_loss']:.3f}",
                    f"{record['calibration_error']:.3f}",
                    f"{record['seconds']:.1f} s",
                    *(f"{100 * record[f'recall {label}']:.1f} %" for label in labels),
                ],
            )
            for record in records
        ],
    )


def studies_of(services: Services, session: Session) -> list[Study]:
    """The studies for one session; their questions follow its choices."""
    streams = streams_of(services, session)
    labels = streams.labels

    def question(name: str, study: Callable[..., Any], *, at_noise: bool = True) -> Any:
        """What to compute for the choices as they are when it is called."""

        def ask() -> tuple[Hashable, Compute]:
            noise, settings = session.noise, settings_of(session)
            arguments = (noise, settings) if at_noise else (settings,)
            key = data_key(session) if at_noise else (data_key(session)[:-2], settings.key)
            return (name, *key), partial(on_streams, study, services, session.ensembles, arguments)

        return ask

    def ask_importance() -> tuple[Hashable, Compute]:
        noise, settings = session.noise, settings_of(session)
        compute = partial(importance_of, services, session.ensembles, noise, settings, ModelStore.default())
        return ("importance", *data_key(session)), compute

    def code(call: str, module: str, draw: str, name: str) -> Callable[[], str]:
        def listing() -> str:
            head = code_head(
                session,
                f"from streamdash.{module}",
                f"from streamdash.plots.classifier_studies import {draw.split('(')[0]}",
                "from streamdash.plots.live import export",
            )
            filled = call.replace("NOISE", f"{session.noise:g}")
            return f'{head}{filled}\nPath("{name}.png").write_bytes(export({draw}, "png"))\n'

        return listing

    n_streams = len(streams.y)

    def of(name: str) -> dict[str, Any]:
        """What a study has that is shipped: its result, and how long it took."""
        return {
            "shipped": partial(shipped_for, session, name),
            "seconds": partial(estimated_seconds, name, n_streams),
        }

    size, noise = plots.SIZE_LABEL, noise_label(streams.configs[0].stream)
    true_noise = f"True {noise[0].lower()}{noise[1:]}"
    return [
        Study(
            "importance",
            "Importance along the stream: which part of it tells the masses?",
            "The Qρ of a 4° block is exchanged between test streams; what is lost shows what it tells.",
            ask_importance,
            plots.draw_importance,
            plots.importance_table,
            plots.importance_sentence,
            code(
                "judged = train(streams, NOISE, settings)\nfound = importance(judged, streams, NOISE)",
                "classifier.train import train\nfrom streamdash.classifier.studies import importance",
                "draw_importance(found, 'matplotlib')",
                "importance",
            ),
            **of("importance"),
        ),
        Study(
            "noise-curve",
            "Accuracy against noise: where does the method die?",
            "A classifier is trained and judged anew at each σ_ε.",
            question("noise curve", noise_curve, at_noise=False),
            lambda curve, backend: plots.draw_curve(curve, labels, noise, backend),
            lambda curve: plots.curve_table(curve, "noise", labels),
            plots.noise_sentence,
            code(
                "curve = noise_curve(streams, settings)",
                "classifier.studies import noise_curve",
                f"draw_curve(curve, {list(labels)}, '{noise}', 'matplotlib')",
                "noise-curve",
            ),
            CURVE_LEGEND,
            **of("noise-curve"),
        ),
        Study(
            "wrong-noise",
            "Accuracy where the noise is not the trained one: what if the errors are wrong?",
            "The classifier of the chosen σ_ε judges test streams that are truly observed with another.",
            question("wrong noise", wrong_noise_curve),
            lambda curve, backend: plots.draw_curve(curve, labels, true_noise, backend),
            lambda curve: plots.curve_table(curve, "true_noise", labels),
            lambda curve: plots.wrong_noise_sentence(curve, session.noise),
            code(
                "curve = wrong_noise_curve(streams, NOISE, settings)",
                "classifier.studies import wrong_noise_curve",
                f"draw_curve(curve, {list(labels)}, '{true_noise}', 'matplotlib')",
                "wrong-noise",
            ),
            CURVE_LEGEND,
            **of("wrong-noise"),
        ),
        Study(
            "learning-curve",
            "Learning curve: are there enough simulated streams?",
            "The same classifier trained on ever more streams, judged on the same test streams.",
            question("learning curve", learning_curve),
            lambda curve, backend: plots.draw_curve(curve, labels, size, backend, logarithmic=True),
            lambda curve: plots.curve_table(curve, "streams_per_class", labels),
            plots.learning_sentence,
            code(
                "curve = learning_curve(streams, NOISE, settings)",
                "classifier.studies import learning_curve",
                f"draw_curve(curve, {list(labels)}, '{size}', 'matplotlib', logarithmic=True)",
                "learning-curve",
            ),
            CURVE_LEGEND,
            **of("learning-curve"),
        ),
        Study(
            "comparison",
            "Presets and a dense network on the same split",
            "The paper's classifier, ours, ours with less, and small dense networks as in its conclusions.",
            question("comparison", compare_presets),
            lambda rows, backend: plots.draw_comparison(rows, labels, backend),
            lambda rows: plots.comparison_table(rows, labels),
            lambda rows: plots.comparison_sentence(rows, labels),
            code(
                "contenders = compare(streams, NOISE, PRESETS)",
                "classifier.studies import compare",
                f"draw_comparison(contenders, {list(labels)}, 'matplotlib')",
                "comparison",
            ),
            (("dots", "recall per class"), ("dots-grey", "accuracy, large dot")),
            lambda rows: ui.Html(comparison_html(rows, labels), stylesheets=[STYLE]),
            **of("comparison"),
        ),
        Study(
            "tuning",
            "Tuning: 5-fold cross-validation over depth and number of trees",
            "The paper's grid, max_depth 2 to 128 and n_estimators 10 to 200, on the training streams only.",
            question("tuning", grid_search),
            plots.draw_grid,
            plots.grid_table,
            plots.grid_sentence,
            code(
                "grid = grid_search(streams, NOISE, settings)",
                "classifier.studies import grid_search",
                "draw_grid(grid, 'matplotlib')",
                "tuning",
            ),
            (("line", "one line per depth, stronger is deeper"), ("dots-hand", "chosen")),
            lambda grid: ui.button(
                "Use these", lambda: use_grid(session, grid), css_classes=["sd-use-tuning"]
            ),
            **of("tuning"),
        ),
    ]


def shipped_for(session: Session, name: str) -> tuple[Any, str] | None:
    """The shipped result of a study of the chosen classes, and of what it is, if not of what is chosen."""
    result = shipped_result(name, [choice.key for choice in session.ensembles])
    if result is None:
        return None
    found = shipped_studies()
    assert found is not None
    settings = settings_of(session)
    # One curve runs over all noises, whichever is chosen.
    same_noise = name == "noise-curve" or session.noise == found["noise"]
    if name == "wrong-noise" and not same_noise:
        return None  # what it says is of the noise that was chosen
    if same_noise and settings.key == found["settings"]:
        return result, ""
    return result, f"As shipped, for the best settings at σ_ε = {found['noise']:g}:"


def use_grid(session: Session, grid: Any) -> None:
    """Choose the depth and number of trees that cross-validation found best."""
    chosen = grid.settings.boosting
    session.param.update(depth=int(chosen.max_depth), trees=int(chosen.n_estimators))
