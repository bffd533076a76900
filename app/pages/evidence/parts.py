"""The table of cumulative evidence as HTML: ours, all bins together, and the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from app import ui
from streamdash.config import EnsembleConfig
from streamdash.naming import class_colours, class_labels
from streamdash.plots.cumulative import row
from streamdash.plots.evidence import words
from streamdash.statistics.cumulative import paper_value

Cell = tuple[str, ...]
STYLE = (
    ui.TABLE_STYLE
    + """
th[scope=row] { white-space: normal; min-width: 130px; }
tbody tr:first-child th, tbody tr:first-child td { border-top: 1px solid #80808060; }
th[colspan] { text-align: left; font-weight: 500; padding-top: 8px; }
table.waiting { opacity: 0.45; }
"""
)


def evidence_table(
    tables: Sequence[dict[str, Any]],
    configs: Sequence[EnsembleConfig],
    fiducials: Sequence[int],
    paper: bool,
    waiting: bool = False,
) -> Markup:
    """Rows per fiducial and other model; columns per number of bins.

    Parameters
    ----------
    tables
        Result of `streamdash.statistics.cumulative.cumulative_tables`.
    configs
        Configurations of the classes, M0 first.
    fiducials
        Which fiducial models to list.
    paper
        Whether the classes are the paper's two.
    waiting
        Whether newer numbers are being computed: these are then dimmed.
    """
    labels = class_labels(configs)
    pairs = [(i, pair["j"]) for i in fiducials for pair in tables[0]["pairs"] if pair["i"] == i]
    return ui.render(
        "pages/evidence/cumulative.html",
        n_bins=[table["n_bin"] for table in tables],
        labels=labels,
        colours=class_colours(configs),
        bodies=[(i, j, _rows(tables, i, j, paper)) for i, j in pairs],
        waiting=waiting,
    )


def _rows(tables: Sequence[dict], i: int, j: int, paper: bool) -> list[tuple[Cell, list[Cell]]]:
    """Head and cells of each row; of both the text, then smaller lines."""
    pairs = [row(table, i, j) for table in tables]
    rows: list[tuple[Cell, list[Cell]]] = [
        (("Sum over bins", "the paper’s figure of merit"), [_sum(pair) for pair in pairs]),
        (("All bins together", "correlations included"), [_joint(pair) for pair in pairs]),
        (
            ("Held-out streams put right", "68 % interval; ln likelihood ratio"),
            [_held_out(pair) for pair in pairs],
        ),
    ]
    if paper:
        values = [paper_value(i, j, table["n_bin"]) for table in tables]
        cells: list[Cell] = [(f"{v:.1f}", words(v)) if v is not None else ("–",) for v in values]
        rows.append((("Paper, table 1",), cells))
    return rows


def _sum(pair: dict[str, Any]) -> Cell:
    if not pair["n_kept"]:
        return "–", "no bin can be compared"
    return f"{pair['sum']:z.1f} ± {pair['error']:.1f}", words(pair["sum"])


def _joint(pair: dict[str, Any]) -> Cell:
    if not pair["n_components"]:
        return ("–", "no overlap") if pair["n_unresolved"] else ("–",)
    mark = ("not all resolved",) if pair["n_unresolved"] else ()
    return (f"{pair['joint']:z.1f}", words(pair["joint"]), *mark)


def _held_out(pair: dict[str, Any]) -> Cell:
    low, high = 100 * pair["right_low"], 100 * pair["right_high"]
    return f"{100 * pair['right']:.1f} %", f"{low:.2f} to {high:.2f} %", f"ln ratio {pair['ln_ratio']:z.1f}"
