"""The table of cumulative evidence as HTML: ours, all bins together, and the paper's."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

from app.ui.layout import reachable
from streamdash.config import EnsembleConfig
from streamdash.naming import class_colour, class_labels
from streamdash.plots.cumulative import row
from streamdash.plots.evidence import words
from streamdash.statistics.cumulative import paper_value

STYLE = """
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.4 Roboto, sans-serif; width: 100%; }
caption { text-align: left; padding: 4px 8px; font-weight: 500; }
th, td { padding: 4px 8px; text-align: right; vertical-align: top; white-space: nowrap; }
th[scope=row] { text-align: left; font-weight: 400; white-space: normal; min-width: 130px; }
thead th { border-bottom: 1px solid #808080; }
tbody tr:first-child th, tbody tr:first-child td { border-top: 1px solid #80808060; }
th[colspan] { text-align: left; font-weight: 500; padding-top: 8px; }
small { display: block; opacity: 0.8; font-size: 12px; }
table.waiting { opacity: 0.45; }
"""


def evidence_table(
    tables: Sequence[dict[str, Any]],
    configs: Sequence[EnsembleConfig],
    fiducials: Sequence[int],
    paper: bool,
    waiting: bool = False,
) -> str:
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
    head = "".join(f"<th scope='col'>{table['n_bin']}</th>" for table in tables)
    bodies = []
    for i in fiducials:
        for pair in (p for p in tables[0]["pairs"] if p["i"] == i):
            bodies.append(_body(tables, configs, i, pair["j"], paper))
    return reachable(
        "Cumulative evidence",
        f"<table class='{'waiting' if waiting else 'ready'}' aria-busy='{str(waiting).lower()}'>"
        "<caption>Cumulative ln B, by number of bins of Qρ</caption>"
        f"<thead><tr><th scope='row'>N_bin</th>{head}</tr></thead>{''.join(bodies)}</table>",
    )


def _body(tables: Sequence[dict], configs: Sequence[EnsembleConfig], i: int, j: int, paper: bool) -> str:
    pairs = [row(table, i, j) for table in tables]
    title = f"Truth {_name(i, configs)}, against {_name(j, configs)}"
    lines = [
        f"<tr><th colspan='{len(tables) + 1}'>{title}</th></tr>",
        _line("Sum over bins<small>the paper’s figure of merit</small>", [_sum(pair) for pair in pairs]),
        _line("All bins together<small>correlations included</small>", [_joint(pair) for pair in pairs]),
        _line(
            "Held-out streams put right<small>68 % interval; ln likelihood ratio</small>",
            [_held_out(pair) for pair in pairs],
        ),
    ]
    if paper:
        values = [paper_value(i, j, table["n_bin"]) for table in tables]
        lines.append(
            _line(
                "Paper, table 1",
                [f"{v:.1f}<small>{words(v)}</small>" if v is not None else "–" for v in values],
            )
        )
    return f"<tbody>{''.join(lines)}</tbody>"


def _sum(pair: dict[str, Any]) -> str:
    if not pair["n_kept"]:
        return "–<small>no bin can be compared</small>"
    return f"{pair['sum']:.1f} ± {pair['error']:.1f}<small>{words(pair['sum'])}</small>"


def _joint(pair: dict[str, Any]) -> str:
    if not pair["n_components"]:
        return "–<small>no overlap</small>" if pair["n_unresolved"] else "–"
    mark = "<small>not all resolved</small>" if pair["n_unresolved"] else ""
    return f"{pair['joint']:.1f}<small>{words(pair['joint'])}</small>{mark}"


def _held_out(pair: dict[str, Any]) -> str:
    low, high = 100 * pair["right_low"], 100 * pair["right_high"]
    return (
        f"{100 * pair['right']:.1f} %<small>{low:.2f} to {high:.2f} %</small>"
        f"<small>ln ratio {pair['ln_ratio']:.1f}</small>"
    )


def _line(name: str, cells: Sequence[str]) -> str:
    return f"<tr><th scope='row'>{name}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _name(model: int, configs: Sequence[EnsembleConfig]) -> str:
    text = html.escape(class_labels(configs)[model])
    return f"<span style='color:{class_colour(model)}' aria-hidden='true'>■</span> M{model} {text}"
