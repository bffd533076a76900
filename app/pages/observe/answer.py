"""The Observe page's answer, preview and lists as HTML; every text from a file is escaped."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from app.ui.layout import reachable
from streamdash.observe.table import Table, shown
from streamdash.plots.report_html import result_tables

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


def answer_html(result: dict[str, Any]) -> str:
    """The one sentence, large; in a warning's colour where the profile is unlike or unusual."""
    kind = result["resemblance"]["verdict"]
    return (
        f"<p class='answer {kind}' role='status'>{html.escape(result['answer'])}</p>"
        f"<p>{html.escape(result['agreement'])}</p>"
    )


def numbers_html(result: dict[str, Any]) -> str:
    """Resemblance, probabilities with evidence, and the held-out matrix."""
    return reachable("Numbers of the answer", result_tables(result))


def preview_html(table: Table) -> str:
    """The first rows of a table as it was read."""
    names = table.names[:COLUMNS_SHOWN]
    more = len(table.names) - len(names)
    head = "".join(f"<th scope='col'>{html.escape(shown(name))}</th>" for name in ("line", *names))
    rows = "".join(
        f"<tr><td>{line}</td>" + "".join(f"<td>{_cell(value)}</td>" for value in row[: len(names)]) + "</tr>"
        for line, row in zip(table.lines[:ROWS_SHOWN], table.values, strict=False)
    )
    rest = f"{table.n_rows} rows" + (f", {more} more columns" if more > 0 else "")
    table_html = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return (
        reachable("First rows of the file", table_html)
        + f"<p>{rest}; the first {min(ROWS_SHOWN, table.n_rows)} are shown.</p>"
    )


def list_html(title: str, sentences: Sequence[str]) -> str:
    """Sentences under a heading."""
    items = "".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences)
    return f"<h2>{html.escape(title)}</h2><ul>{items}</ul>"


def _cell(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:g}"
