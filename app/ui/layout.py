"""How a page is laid out: controls, grids, and a figure with heading, sentence, downloads and code."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd
import panel as pn
import panel_material_ui as pmui
from bokeh.models.ui import UIElement
from markupsafe import escape
from panel.viewable import Viewable

from app.ui.browser import LiveText
from app.ui.templates import Html, fill, literally

WIDE = "stretch_width"
CODE_STYLE = "pre { margin: 0; padding: 4px 16px; overflow-x: auto; font-size: 13px; line-height: 1.45; }"
FORMULAS = frozenset("=+-@")
"""What a cell begins with that spreadsheets compute."""
CONTROLS = re.compile(r"[\x00-\x1f\x7f]+")
CARD = {"padding": "12px 16px", "border": "1px solid var(--mui-palette-divider)", "border-radius": "4px"}
"""Frame of a figure and what belongs to it. A component's Paper looks the same, but the figures in it
are painted 0.3 s later."""


def controls(*widgets: Viewable) -> Viewable:
    """A page's controls: side by side where there is room, below one another on a phone."""
    return pn.FlexBox(
        *widgets, align_items="center", gap="4px 12px", sizing_mode=WIDE, css_classes=["sd-controls"]
    )


def page_layout(*parts: Viewable) -> Viewable:
    """Controls, then cards, from top to bottom."""
    return pn.Column(*parts, sizing_mode=WIDE, margin=(8, 8), css_classes=["sd-body"])


def figure_cell(heading: Viewable, figure: UIElement) -> Viewable:
    """A figure under its heading, for `figure_grid`."""
    return pn.Column(heading, pn.pane.Bokeh(figure, sizing_mode=WIDE, margin=0), sizing_mode=WIDE, margin=0)


def figure_grid(figures: Sequence[UIElement | Viewable], narrowest: int = 330) -> Viewable:
    """Figures side by side, as many as fit at ``narrowest`` pixels each."""
    panes = [
        figure if isinstance(figure, Viewable) else pn.pane.Bokeh(figure, sizing_mode=WIDE, margin=0)
        for figure in figures
    ]
    cells = [
        pn.Column(pane, margin=0, styles={"flex": f"1 1 {narrowest}px", "min-width": "0"}) for pane in panes
    ]
    return pn.FlexBox(*cells, gap="12px", sizing_mode=WIDE, margin=0)


def csv_of(table: pd.DataFrame) -> bytes:
    """A table as CSV that spreadsheets show: a text that they would compute begins with an apostrophe.

    Names of ensembles come from imported files, and ``=HYPERLINK(…)`` in a cell is a formula.
    """
    plain = table.rename(columns=_not_a_formula)
    for i in range(plain.shape[1]):
        if not pd.api.types.is_numeric_dtype(plain.dtypes.iloc[i]):
            plain.isetitem(i, [_not_a_formula(value) for value in plain.iloc[:, i]])
    return plain.to_csv(index=False, float_format="%.6g").encode()


def _not_a_formula(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    line = CONTROLS.sub(" ", value)  # a lone carriage return would begin a new row
    return f"'{line}" if line[:1] in FORMULAS and line[1:] else line


class FigureCard:
    """A figure with heading, sentence, downloads and the code that makes it.

    Parameters
    ----------
    title
        Heading.
    figures
        One Bokeh figure or Panel object, or several shown side by side.
    name
        Stem of the downloaded files' names; ``sd-card-<name>`` is the card's CSS class.
    image
        Called with ``"png"`` or ``"svg"``; returns the bytes of the figure as it is now.
    table
        Returns the figure's numbers as they are now, units in the column names.
    code
        Returns the lines of Python that make the figure as it is now.
    legend
        Shown between heading and figure.

    Attributes
    ----------
    files : dict
        By kind (``png``, ``svg``, ``csv``), what a download calls for its bytes.
    """

    def __init__(
        self,
        title: str,
        figures: Any,
        *,
        name: str,
        image: Callable[[str], bytes],
        table: Callable[[], pd.DataFrame],
        code: Callable[[], str],
        legend: Viewable | None = None,
    ) -> None:
        self._code = code
        self._sentence = LiveText(sizing_mode=WIDE, margin=(6, 0), css_classes=["sd-sentence"])
        self._listing = Html(stylesheets=[CODE_STYLE], margin=0, css_classes=["sd-code"])
        figures = figures if isinstance(figures, list | tuple) else [figures]
        heading = pmui.Typography(literally(title), variant="h6", margin=0, sx={"flex": "1 1 auto"})
        self.files = {
            "png": lambda: image("png"),
            "svg": lambda: image("svg"),
            "csv": lambda: csv_of(table()),
        }
        self._downloads = [
            download(f"streamdash-{name}.{kind}", kind, make, disabled=True)
            for kind, make in self.files.items()
        ]
        self._accordion = pmui.Accordion(
            ("Show the code", self._listing),
            title_variant="body2",
            disable_gutters=True,
            sizing_mode=WIDE,
            margin=0,
            elevation=0,
            css_classes=["sd-show-code"],
        )
        self._accordion.param.watch(lambda _: self._list(), "active")
        kinds = pn.Row(*self._downloads, margin=0)
        head = pn.FlexBox(heading, kinds, align_items="center", gap="4px 12px", sizing_mode=WIDE, margin=0)
        self.view = pn.Column(
            head,
            *([legend] if legend else []),
            figure_grid(figures),
            self._sentence,
            self._accordion,
            sizing_mode=WIDE,
            margin=(8, 0),
            styles=CARD,
            css_classes=["sd-card", f"sd-card-{name}"],
        )

    def say(self, sentence: str, *, ready: bool = True) -> None:
        """Set the sentence under the figure; also refreshes the code where it is open.

        The downloads can be pressed while there is a sentence, unless ``ready`` says otherwise:
        a figure that is not there yet has none.
        """
        self._sentence.text = sentence
        for file in self._downloads:
            file.disabled = not (sentence and ready)
        self._list()

    def _list(self) -> None:
        if self._accordion.active:
            self._listing.write(fill('<pre tabindex="0"><code>{{ code }}</code></pre>', code=self._code()))


def folded(title: str, parts: Sequence[Viewable], name: str, **params: Any) -> Viewable:
    """What few need, closed until somebody opens it; ``sd-<name>`` is its class."""
    return pmui.Accordion(
        (str(escape(title)), pn.Column(*parts, sizing_mode=WIDE, margin=0, styles={"overflow-x": "auto"})),
        disable_gutters=True,
        elevation=0,
        css_classes=[f"sd-{name}"],
        **{"sizing_mode": WIDE, "margin": (8, 0), **params},
    )


def document(title: str, markdown: str, name: str) -> Viewable:
    """A longer text of ours, closed until somebody opens it; ``sd-<name>`` is its class."""
    text = pn.pane.Markdown(markdown, renderer_options={"html": False}, sizing_mode=WIDE, margin=(0, 8))
    return folded(title, [text], name)


def download(filename: str, kind: str, make: Callable[[], bytes], **params: Any) -> pmui.FileDownload:
    """A button that downloads what ``make()`` returns then; ``sd-download-<kind>`` is its class."""
    return pmui.FileDownload(
        callback=lambda: io.BytesIO(make()),
        filename=filename,
        label=kind.upper(),
        variant="text",
        size="small",
        margin=0,
        css_classes=[f"sd-download-{kind}"],
        **params,
    )
