"""Tables of the Classifier page as HTML: scores beside the paper's, and the comparison of presets."""

from __future__ import annotations

import html
from collections.abc import Sequence

from app.ui.layout import reachable
from streamdash.classifier.model import paper_scores
from streamdash.classifier.studies import Contender
from streamdash.classifier.train import Judged
from streamdash.naming import class_colour
from streamdash.plots.classifier import METRICS, class_names
from streamdash.plots.classifier_studies import comparison_table

STYLE = """
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.4 Roboto, sans-serif; width: 100%; }
caption { text-align: left; padding: 4px 8px; font-weight: 500; }
th, td { padding: 5px 8px; text-align: right; vertical-align: top; white-space: nowrap; }
th[scope=row] { text-align: left; font-weight: 400; }
thead th { border-bottom: 1px solid #808080; }
tbody tr + tr > * { border-top: 1px solid #80808060; }
small { display: block; opacity: 0.8; font-size: 12px; }
"""


def scores_html(judged: Judged) -> str:
    """Precision, recall, F₁, accuracy and AUC per class with errors, the paper's beneath."""
    labels = judged.classifier.card.labels
    paper = paper_scores(labels) or {}
    values, errors = judged.scores.values, judged.scores.errors
    # The paper gives whole percents for two classes, and "≳" for three.
    sign = "" if len(labels) == 2 else "≳ "
    rows = []
    for c, name in enumerate(class_names(labels)):
        cells = []
        for metric in METRICS:
            given = paper.get(metric)
            note = f"<small>paper {sign}{given[c]:.2f}</small>" if isinstance(given, tuple) else ""
            cells.append(f"<td>{values[metric][c]:.3f} ± {errors[metric][c]:.3f}{note}</td>")
        square = f"<span style='color:{class_colour(c)}' aria-hidden='true'>■</span>"
        rows.append(f"<tr><th scope='row'>{square} {html.escape(name)}</th>{''.join(cells)}</tr>")
    head = "".join(f"<th scope='col'>{html.escape(words)}</th>" for words in METRICS.values())
    overall = f"{values['overall_accuracy']:.3f} ± {errors['overall_accuracy']:.3f}"
    note = f", paper {paper['overall_accuracy']:.2f}" if "overall_accuracy" in paper else ""
    return reachable(
        "Scores",
        f"<table><caption>Accuracy over all classes: {overall}{note}</caption>"
        f"<thead><tr><th scope='col'></th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>",
    )


def comparison_html(contenders: Sequence[Contender], labels: Sequence[str]) -> str:
    """One row per preset or network, best first, on one split."""
    table = comparison_table(contenders, labels)
    heads = ["Accuracy", "Log loss", "Calibration error", "Training", *class_names(labels)]
    rows = []
    for record in table.to_dict("records"):
        cells = [
            f"{100 * record['accuracy']:.1f} ± {100 * record['accuracy_error']:.1f} %",
            f"{record['log_loss']:.3f}",
            f"{record['calibration_error']:.3f}",
            f"{record['seconds']:.1f} s",
            *(f"{100 * record[f'recall {label}']:.1f} %" for label in labels),
        ]
        body = "".join(f"<td>{cell}</td>" for cell in cells)
        rows.append(f"<tr><th scope='row'>{html.escape(str(record['name']))}</th>{body}</tr>")
    head = "".join(f"<th scope='col'>{html.escape(words)}</th>" for words in heads)
    return reachable(
        "Classifiers compared",
        "<table><caption>Same streams, same split; the last columns are recalls</caption>"
        f"<thead><tr><th scope='col'></th>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>",
    )
