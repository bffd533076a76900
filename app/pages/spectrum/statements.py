"""The paper's statements on spectra, tested, as HTML."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from app.ui.layout import reachable
from streamdash.config import EnsembleConfig
from streamdash.plots.spectrum import statement_text
from streamdash.statistics.spectra_in_noise import Shown

STYLE = """
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.4 Roboto, sans-serif; width: 100%; }
caption { text-align: left; padding: 4px 8px; font-weight: 500; }
th, td { padding: 4px 8px; text-align: left; vertical-align: top; border-top: 1px solid #80808060; }
thead th { border-bottom: 1px solid #808080; border-top: 0; font-weight: 500; }
th[scope=row] { font-weight: 400; }
td { white-space: nowrap; }
small { display: block; opacity: 0.8; font-size: 12px; white-space: normal; }
"""


def statements_html(shown: Shown, configs: Sequence[EnsembleConfig]) -> str:
    """One row per statement: what the paper says, without noise as in its figure, and as observed."""
    rows = []
    for s in shown.statements:
        rows.append(
            f"<tr><th scope='row'>{html.escape(statement_text(s, configs))}</th>"
            f"<td>above {s.limit:g}°</td>"
            f"<td>{_found(s.clean_from, s.clean_true)}</td>"
            f"<td>{_found(s.observed_from, s.observed_true)}</td></tr>"
        )
    return reachable(
        "The paper’s statements",
        f"<table><caption>The paper’s statements, tested at σ_ε = {shown.sigma:g}</caption>"
        "<thead><tr><th scope='col'>Statement</th><th scope='col'>Paper</th>"
        "<th scope='col'>Without noise<small>as the paper’s figure: median against the noise’s</small></th>"
        "<th scope='col'>As observed<small>noise included: its median against the noise’s band</small></th>"
        "</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>",
    )


def _found(scale: float, true: bool) -> str:
    since = "at no scale" if math.isnan(scale) else f"from {scale:.1f}° up"
    return f"{'✓ true' if true else '✗ not true'}<small>{since}</small>"
