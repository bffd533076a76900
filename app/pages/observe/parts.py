"""What the Observe page is made of: the widgets of the assumptions; what was read and answered, as HTML.

Every text from a file is escaped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import panel as pn
from markupsafe import Markup
from panel.viewable import Viewable

from app import ui
from app.pages.observe.reading import Reading
from app.pages.observe.state import AUTO, LINKED, ORDERS, ObserveState
from app.ui.templates import render
from streamdash.config import StreamModel
from streamdash.observe.guess import ERROR_UNITS, KINDS, NOTHING, Assumptions
from streamdash.observe.observation import NAMES
from streamdash.observe.table import Table, shown
from streamdash.observe.verdict import COSTS
from streamdash.plots.report_html import result_tables, robustness_table
from streamdash.streams import stream_of, stream_text
from streamdash.words import number_of

NONE = "none"
ASK = "?"
CHOOSE = "choose …"
"""What a menu shows where nothing in the table decides; nothing is classified before it is chosen."""
OF_VALUE = ("error", "error_kind", "error_unit", "constant")
ERRORS = {"a column": "column", "constant": "constant", "Poisson (√counts)": "poisson"}
STEPS = {
    "train": "Learning to tell the classes apart",
    "free": "Learning them with their abundance free",
    "misfit": "Learning what mistakes in a table look like",
    "likeness": "Asking whether any simulated stream looks like this one",
    "resampled": "Learning anew from other streams, to see how sure it is",
    "pdfs": "Computing the evidence",
    "replicas": "Asking how often the answer is right at this quality",
    "wrong errors": "Trying errors that are wrong",
}
"""Steps of an answer (`streamdash.observe.verdict.COSTS`) in words."""
ROWS_SHOWN = 4
COLUMNS_SHOWN = 8
STYLE = (
    ui.SCROLLS
    + """
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
)


CHIP = """
:host { margin: 0 !important; max-width: 100% !important; min-width: 0 !important; }
:host(.sd-asked) .bk-input-group { border-color: #e69f00; border-width: 2px; background: #e69f0026; }
.bk-input-group { display: inline-flex !important; flex-direction: row !important; align-items: center;
  gap: 4px; border: 1px solid #80808099; border-radius: 17px; padding: 0 4px 0 12px; width: auto !important;
  max-width: 100%; box-sizing: border-box; }
.bk-input-group > label, .bk-input-group > .bk-label {
  position: static !important; transform: none !important;
  padding: 0 !important; margin: 0 !important; background: none !important; white-space: nowrap;
  font: 13px/1.4 Roboto, sans-serif; opacity: 0.85; }
.bk-input { border: 0 !important; background-color: transparent !important; height: 32px !important;
  min-height: 32px !important; padding: 2px 22px 2px 6px !important; margin: 0 !important;
  font: 500 14px/1.4 Roboto, sans-serif; width: auto !important; max-width: 260px; color: inherit;
  min-width: 0; flex: 0 1 auto !important; text-overflow: ellipsis; }
.bk-spin-btn { display: none !important; }  /* they have no names; arrow keys do the same */
input.bk-input { max-width: 76px; padding-right: 4px !important; }
"""
"""An assumption as a pill: what it is, and a menu or number that changes it."""


class AssumptionControls:
    """Chips, one for each assumption, that follow what was read and change the session.

    Browsers' own menus: panel-material-ui's cannot be opened with the keyboard.
    """

    def __init__(self, session: ObserveState) -> None:
        self.session = session
        self.view = pn.FlexBox(
            align_items="center",
            gap="6px 8px",
            margin=(4, 10),
            sizing_mode=ui.WIDE,
            css_classes=["sd-assumptions"],
        )
        self.widgets: dict[str, Any] = {}
        self.options: dict[str, dict[str, str]] = {}
        self._table: Table | None = None
        self._showing = False

    def show(self, reading: Reading) -> None:
        """Show the assumptions of a reading; another table gets widgets of its own."""
        if reading.table is None or reading.assumptions is None:
            self._table = None
            self.view.clear()
            return
        if self._table is None or self._table.names != reading.table.names:
            self._build(reading.table)
        self._table = reading.table
        a = reading.assumptions
        open_fields = {*a.undecided, *(["error_kind"] if "error" in a.undecided else [])}
        self._showing = True
        try:
            for name, value in _values(a).items():
                widget, plain = self.widgets[name], self.options.get(name)
                widget.css_classes = ["sd-chip", *(["sd-asked"] if name in open_fields else [])]
                if plain is None:
                    widget.value = value
                elif name in open_fields:
                    widget.param.update(options={CHOOSE: ASK, **plain}, value=ASK)
                else:
                    widget.param.update(options=plain, value=value)
            self.widgets["bin"].visible = a.bin is not None or "bin" in a.undecided
        finally:
            self._showing = False
        columns = a.error_kind == "column" or "error" in a.undecided
        self.widgets["error"].visible = columns and a.bin is None
        self.widgets["error_unit"].visible = a.error_kind == "column" and a.bin is None
        self.widgets["constant"].visible = a.error_kind == "constant" and "error" not in a.undecided
        for name in ("value", "kind", "smooth", "upper", "width", "error_kind"):
            self.widgets[name].visible = a.bin is None

    def _build(self, table: Table) -> None:
        names = {name: name for name in table.names}
        optional = {NONE: NOTHING, **names}
        orders = {f"order {order}": order for order in ORDERS if int(order) > 0}
        self.widgets = {
            "coordinate": _menu("Positions are", {words: key for key, words in NAMES.items()}),
            "position": _menu("Position (deg)", names),
            "upper": _menu("Upper end of the bins", optional),
            "width": _number("Width (deg, 0: spacing)"),
            "bin": _number("Count stars in bins of (deg)"),
            "value": _menu("Value", names),
            "kind": _menu("The value is", {words: key for key, words in KINDS.items()}),
            "smooth": _menu("Smooth profile", optional),
            "order": _menu("Divide by polynomial", {"mean (order 0)": "0", **orders, "nothing": "-1"}),
            "error_kind": _menu("Error from", ERRORS),
            "error": _menu("Error column", optional),
            "error_unit": _menu("Errors are", {words: key for key, words in ERROR_UNITS.items()}),
            "constant": _number("Relative error"),
        }
        self.options = {
            name: dict(widget.options) for name, widget in self.widgets.items() if hasattr(widget, "options")
        }
        for name, widget in self.widgets.items():
            widget.param.watch(lambda event, name=name: self._changed(name, event.new), "value")
        self.view[:] = list(self.widgets.values())

    def _changed(self, name: str, value: Any) -> None:
        if self._showing or value is None or value == ASK:
            return
        if name in LINKED:
            setattr(self.session, LINKED[name], value)
        elif name == "value":  # what was said of another column's kind and errors is not said of this one
            kept = {n: v for n, v in self.session.columns.items() if n not in OF_VALUE}
            self.session.param.update(columns={**kept, name: value}, **{LINKED["kind"]: AUTO})
        else:
            self.session.columns = {**self.session.columns, name: value}


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
        rows=[(line, [_cell(value) for value in row[: len(names)]]) for line, row in rows],
        number_of=number_of,
        n_rows=table.n_rows,
        n_more=len(table.names) - len(names),
    )


def step_words(fraction: float, seconds: float) -> str:
    """Which step of an answer runs, how much is done, and about how long the rest takes.

    Parameters
    ----------
    fraction
        Share of the work that is done.
    seconds
        Since it began.
    """
    before, step = 0.0, ""
    total = sum(COSTS.values())
    for name, cost in COSTS.items():
        step = STEPS.get(name, step)
        before += cost / total
        if fraction < before:
            break
    words = f"{step}: {5 * int(20 * fraction)} % done"
    if fraction < 0.05 or seconds < 1:
        return f"{words}."
    left = seconds * (1 - fraction) / fraction
    return f"{words}, about {max(5, 5 * round(left / 5))} s left."


def list_html(title: str, sentences: Sequence[str]) -> Markup:
    """Sentences under a heading."""
    return render("pages/observe/list.html", title=title, sentences=sentences)


def _values(assumptions: Assumptions) -> dict[str, Any]:
    """What the widgets show."""
    values = {name: NOTHING if value is None else value for name, value in assumptions}
    del values["undecided"]
    sizes = {"width": assumptions.width or 0.0, "bin": assumptions.bin or 0.0}
    return {**values, "order": str(assumptions.order), **sizes}


def _menu(label: str, options: dict[str, str]) -> Viewable:
    return pn.widgets.Select(label=label, options=options, stylesheets=[ui.MENU_STYLE, CHIP], margin=0)


def _number(label: str) -> Viewable:
    return pn.widgets.FloatInput(label=label, start=0, step=0.1, stylesheets=[CHIP], margin=0)


def _cell(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:g}"


def introduction(model: StreamModel) -> str:
    """What to upload, and what becomes of it."""
    longitude = stream_of(model).frame.longitude_symbol
    return (
        f"Upload the density of {stream_text(model)}, along the stream as you measured it: a text table with "
        f"a position ({longitude} or Galactic longitude), a value and, best, an error for each bin. "
        "Simulated streams are then observed with your bins, errors and gaps, and the answer comes with how "
        "often it is right at that quality. The file stays in this session’s memory and is gone when you "
        "close the page."
    )


def html(css_class: str) -> ui.Html:
    """Text of this page."""
    return ui.Html(stylesheets=[STYLE], css_classes=[css_class], margin=(0, 10))
