"""The comparison of statistics as an HTML table."""

from __future__ import annotations

import html
from collections.abc import Sequence

from app.pages.classifier.tables import STYLE as TABLE_STYLE
from app.ui.layout import reachable
from streamdash.paper.statistics import Kept, ln_b_text
from streamdash.plots.evidence import words

STYLE = TABLE_STYLE.replace(":host {", ".wide {")


def statistics_html(rows: Sequence[Kept]) -> str:
    """One row per statistic: accuracy and information of its classifier, and its evidence."""
    pairs = sorted(rows[0].evidence)
    heads = "".join(f"<th scope='col'>ln B<small>truth M{i}, against M{j}</small></th>" for i, j in pairs)
    lines = []
    for row in rows:
        values, errors = row.judged.scores.values, row.judged.scores.errors
        accuracy = 100 * values["overall_accuracy"], 100 * errors["overall_accuracy"]
        cells = [
            f"{len(row.judged.classifier.features.names)}",
            f"{accuracy[0]:.1f} ± {accuracy[1]:.1f} %",
            f"{row.bits:.3f} ± {row.bits_error:.3f}",
        ]
        cells += [_ln_b(row, pair) for pair in pairs]
        body = "".join(f"<td>{cell}</td>" for cell in cells)
        lines.append(f"<tr><th scope='row'>{html.escape(row.name)}</th>{body}</tr>")
    return reachable(
        "Comparison of statistics",
        f"<table><caption>One classifier, one split, {len(rows[0].judged.y)} held-out streams</caption>"
        "<thead><tr><th scope='col'></th><th scope='col'>Features</th><th scope='col'>Accuracy</th>"
        f"<th scope='col'>Information<small>bits per stream</small></th>{heads}</tr></thead>"
        f"<tbody>{''.join(lines)}</tbody></table>",
    )


def _ln_b(row: Kept, pair: tuple[int, int]) -> str:
    found = row.evidence.get(pair)
    if found is None:
        return "–"
    return f"{ln_b_text(found.value, found.n_unresolved)}<small>{words(found.value)}</small>"
