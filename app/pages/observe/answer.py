"""The Observe page's answer, preview and lists as HTML; every text from a file is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from app.ui.templates import render
from streamdash.observe.table import Table, shown
from streamdash.plots.report_html import result_tables, robustness_table
from streamdash.words import number_of

ROWS_SHOWN = 4
COLUMNS_SHOWN = 8
STYLE = """
.wide { overflow-x: auto; }
:host { font: 15px/1.5 Roboto, sans-serif; }
h2 { font-size: 17px; font-weight: 500; margin: 16px 0 4px; }
p { margin: 4px 0; max-width: 110ch; }
ul { margin: 4px 0; padding-left: 22px; max-width: 110ch; }
table { border-collapse: collapse; font-size: 14px; margin: 6px 0; }
th, td { padding: 4px 12px 4px 0; text-align: right; vertical-align: top; }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
thead th { border-bottom: 1px solid #808080; font-weight: 500; }
tbody th { font-weight: 400; }
.aside { opacity: 0.5; }
.answer { font-size: 22px; line-height: 1.4; margin: 8px 0; padding: 10px 16px; max-width: 75ch;
          border-left: 6px solid #0072b2; background: #0072b21a; }
.unlike { border-color: #d64533; background: #d645331f; }
.unusual { border-color: #e69f00; background: #e69f001f; }
"""


def answer_html(result: dict[str, Any]) -> Markup:
    """The one sentence, large; in a warning's colour where the profile is unlike or unusual."""
    return render("pages/observe/answer.html", result=result)


def numbers_html(result: dict[str, Any]) -> Markup:
    """Resemblance, probabilities with evidence, and the held-out matrix."""
    return render("pages/observe/numbers.html", tables=result_tables(result))


def robustness_html(result: dict[str, Any]) -> Markup:
    """The table of robustness."""
    return render("pages/observe/numbers.html", tables=robustness_table(result))


def preview_html(table: Table) -> Markup:
    """The first rows of a table as it was read."""
    names = table.names[:COLUMNS_SHOWN]
    rows = zip(table.lines[:ROWS_SHOWN], table.values, strict=False)
    return render(
        "pages/observe/preview.html",
        names=["line", *map(shown, names)],
        rows=[(line, [_number(value) for value in row[: len(names)]]) for line, row in rows],
        number_of=number_of,
        n_rows=table.n_rows,
        n_more=len(table.names) - len(names),
    )


def list_html(title: str, sentences: Sequence[str]) -> Markup:
    """Sentences under a heading."""
    return render("pages/observe/list.html", title=title, sentences=sentences)


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:g}"
