"""How a page is laid out: question, panel of controls, and figures with sentence, files and code."""

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

from app.ui.browser import Answer, DrawerButton, LiveText
from app.ui.templates import Html, fill, literally

WIDE = "stretch_width"
FIGURE_HEIGHT = "clamp(300px, calc(100vh - 400px), 620px)"
"""Height of a figure: what a screen has left beside what belongs to it."""
CODE_STYLE = "pre { margin: 0; padding: 4px 16px; overflow-x: auto; font-size: 13px; line-height: 1.45; }"
FORMULAS = frozenset("=+-@")
"""What a cell begins with that spreadsheets compute."""
CONTROLS = re.compile(r"[\x00-\x1f\x7f]+")
CARD = {"padding": "8px 16px 10px", "border": "1px solid var(--mui-palette-divider)", "border-radius": "6px"}
"""Frame of a figure and what belongs to it. A component's Paper looks the same, but the figures in it
are painted 0.3 s later."""
BODY = """
:host { display: grid !important; grid-template-columns: minmax(0, 1fr); gap: 0 20px; }
.sd-opening, .sd-panel, .sd-content { min-width: 0; }
@media (min-width: 1100px) {
  :host { grid-template: "panel opening" auto "panel content" 1fr / 276px minmax(0, 1fr); }
  .sd-panel { grid-area: panel; position: sticky !important; top: 8px; align-self: start;
              max-height: calc(100vh - 76px); overflow-y: auto; }
  .sd-opening { grid-area: opening; }
  .sd-content { grid-area: content; }
}
"""
"""A page: its controls beside everything where there is room for that, else between question and figure."""
BODY_OF_ONE = """
:host { display: grid !important; grid-template-columns: minmax(0, 1fr); gap: 0 20px; }
.sd-opening, .sd-panel, .sd-content { min-width: 0; }
@media (min-width: 1100px) {
  :host { grid-template: "opening panel" auto "content content" 1fr / minmax(0, 1fr) 340px; }
  .sd-panel { grid-area: panel; }
  .sd-opening { grid-area: opening; }
  .sd-content { grid-area: content; }
}
"""
"""A page of one control: beside its question."""
PANEL = """
@media (min-width: 1100px) {
  :host { --sd-ground: color-mix(in srgb, currentColor 4%, var(--mui-palette-background-default));
          background: var(--sd-ground); border-radius: 6px; padding: 6px 0 10px; }
}
@media (max-width: 1099px) {
  .sd-more { position: fixed !important; left: 0; right: 0; bottom: 0; z-index: 1250; max-height: 62vh;
             overflow-y: auto; padding: 8px 8px 20px; background: var(--mui-palette-background-paper, Canvas);
             border-top: 1px solid #80808080; box-shadow: 0 -8px 24px #00000040; border-radius: 12px 12px 0 0;
             visibility: var(--sd-drawer, hidden);
             /* What Panel itself calls visible inside is out of sight as well. */
             transform: translateY(var(--sd-drawer-below, 110%)); }
  .sd-drawer { position: fixed !important; right: 12px; bottom: 12px; z-index: 1240; }
}
@media (min-width: 1100px) { .sd-drawer { display: none !important; } }
"""
"""The controls: a column on wide screens; else those that matter most, and a drawer with the others."""
KEY = """
@media (max-width: 1099px) {
  :host { display: flex !important; flex-flow: row wrap !important; gap: 0 8px; align-items: center; }
  .sd-cell { flex: 1 1 150px; }
  .sd-cell.sd-row { flex-basis: 100%; }
}
"""
MORE = """
@media (min-width: 1100px) { .sd-drawer-close { display: none !important; } }
@media (min-width: 700px) and (max-width: 1099px) {
  :host { display: grid !important; grid-template-columns: 1fr 1fr; gap: 6px 16px; align-items: start; }
}
"""


def controls(*widgets: Viewable) -> Viewable:
    """Widgets side by side where there is room, below one another on a phone."""
    return pn.FlexBox(
        *widgets, align_items="center", gap="4px 12px", sizing_mode=WIDE, css_classes=["sd-controls"]
    )


class Opening:
    """What a page opens with: its question, and the answer now.

    Parameters
    ----------
    question
        One sentence, the page's heading.
    below
        What else stands above the figures.
    """

    def __init__(self, question: str, *below: Viewable) -> None:
        self._answer = Answer(sizing_mode=WIDE, margin=0, css_classes=["sd-answer-now"])
        line = fill('<h1 style="{{ style }}">{{ question }}</h1>', style=QUESTION_STYLE, question=question)
        self.view = pn.Column(
            Html(line, margin=0),
            self._answer,
            *below,
            sizing_mode=WIDE,
            margin=(2, 8, 4, 8),
            css_classes=["sd-opening"],
        )

    @property
    def answer(self) -> str:
        """The answer that is shown."""
        return self._answer.text

    def say(self, answer: str) -> None:
        """Give the answer as it is now; an empty one takes no room."""
        self._answer.text = answer


QUESTION_STYLE = "font: 500 clamp(17px, 1.1vw + 11px, 24px)/1.3 Roboto, sans-serif; margin: 0 0 2px"


def side_panel(key: Sequence[Viewable], more: Sequence[Viewable] = ()) -> Viewable:
    """A page's controls in one panel.

    Parameters
    ----------
    key
        The two or three that matter most: always in sight.
    more
        All others; on a narrow screen in a drawer.
    """
    cells = [
        pn.Column(
            _filling(widget),
            margin=0,
            sizing_mode=WIDE,
            min_width=0,
            css_classes=["sd-cell", "sd-row"] if isinstance(widget, pn.FlexBox) else ["sd-cell"],
        )
        for widget in key
    ]
    parts: list[Viewable] = [
        pn.Column(*cells, sizing_mode=WIDE, margin=0, stylesheets=[KEY], css_classes=["sd-key"])
    ]
    if more:
        parts.append(DrawerButton(margin=0, css_classes=["sd-drawer"]))
        close = DrawerButton(label="Done", opens=False, margin=(8, 10), css_classes=["sd-drawer-close"])
        others = [*(_filling(widget) for widget in more), close]
        parts.append(
            pn.Column(*others, sizing_mode=WIDE, margin=0, stylesheets=[MORE], css_classes=["sd-more"])
        )
    return pn.Column(
        *parts,
        sizing_mode=WIDE,
        margin=(4, 0),
        stylesheets=[PANEL] if more else [],
        css_classes=["sd-panel", "sd-controls"],
    )


def _filling(widget: Viewable) -> Viewable:
    """Let a widget be as wide as the panel that it stands in."""
    if isinstance(widget, pmui.Button):
        return widget
    widget.param.update(width=None, sizing_mode=WIDE, width_policy="auto")
    return widget


def page_layout(
    *parts: Viewable,
    opening: Opening | None = None,
    panel: Viewable | None = None,
    beside: bool = True,
) -> Viewable:
    """Question and answer, controls, and cards from top to bottom.

    ``beside`` is whether the controls stand beside the cards where there is room, or the question alone.
    """
    style = (BODY if beside else BODY_OF_ONE) if panel else ""
    content = pn.Column(*parts, sizing_mode=WIDE, margin=0, css_classes=["sd-content"])
    return pn.Column(
        *([opening.view] if opening else []),
        *([panel] if panel else []),
        content,
        sizing_mode=WIDE,
        margin=(4, 8),
        stylesheets=[style],
        css_classes=["sd-body"],
    )


def figure_pane(figure: UIElement, height: str = FIGURE_HEIGHT, square: bool = False) -> Viewable:
    """A figure as wide and as high as there is room; ``height`` is a length of CSS.

    A ``square`` one is no wider than high: its two axes are one space.
    """
    style = f".bk-Figure, .bk-GridPlot {{ height: {height} !important; flex: none !important; }}"
    if square:
        style += f" .bk-Figure {{ width: min(100%, {height}) !important; margin: 0 auto !important; }}"
    pane = pn.pane.Bokeh(figure, sizing_mode=WIDE, margin=0)
    # From outside: Panel gives what it puts into a pane the pane's own style.
    return pn.Column(pane, sizing_mode=WIDE, margin=0, stylesheets=[style])


def figure_cell(heading: Viewable, figure: UIElement, height: str = FIGURE_HEIGHT) -> Viewable:
    """A figure under its heading, for `figure_grid`."""
    return pn.Column(heading, figure_pane(figure, height), sizing_mode=WIDE, margin=0)


def figure_grid(figures: Sequence[UIElement | Viewable], narrowest: int = 330) -> Viewable:
    """Figures side by side, as many as fit at ``narrowest`` pixels each."""
    panes = [figure if isinstance(figure, Viewable) else figure_pane(figure) for figure in figures]
    cells = [
        pn.Column(pane, margin=0, styles={"flex": f"1 1 {narrowest}px", "min-width": "0"}) for pane in panes
    ]
    return pn.FlexBox(*cells, gap="8px 12px", sizing_mode=WIDE, margin=0)


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
        Shown under the figure.
    bare
        Whether heading, files and code are left out.

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
        bare: bool = False,
    ) -> None:
        self._code = code
        self._name = name
        self._sentence = LiveText(sizing_mode=WIDE, margin=(4, 0, 0, 0), css_classes=["sd-sentence"])
        figures = figures if isinstance(figures, list | tuple) else [figures]
        heading = pmui.Typography(literally(title), variant="h6", margin=0)
        self.files = {
            "png": lambda: image("png"),
            "svg": lambda: image("svg"),
            "csv": lambda: csv_of(table()),
        }
        self._opener = pmui.Button(
            label="⤓ Export",
            on_click=lambda _: self._toggle(),
            variant="text",
            size="small",
            margin=0,
            disabled=True,
            css_classes=["sd-export"],
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        # Made when it is opened: few are, and a page with ten figures is there sooner.
        self._downloads: list[pmui.FileDownload] = []
        self._listing: Html | None = None
        self._tray = pn.Column(sizing_mode=WIDE, margin=0, visible=False, css_classes=["sd-tray"])
        head = pn.FlexBox(
            heading,
            self._opener,
            align_items="center",
            justify_content="space-between",
            flex_wrap="nowrap",
            gap="4px 12px",
            sizing_mode=WIDE,
            margin=0,
        )
        self.view = pn.Column(
            *([] if bare else [head, self._tray]),
            figure_grid(figures),
            *([legend] if legend else []),
            self._sentence,
            sizing_mode=WIDE,
            margin=(4, 0, 8, 0),
            styles=CARD,
            css_classes=["sd-card", f"sd-card-{name}"],
        )

    def say(self, sentence: str, *, ready: bool = True) -> None:
        """Set the sentence under the figure; also refreshes the code where it is open.

        The files can be had while there is a sentence, unless ``ready`` says otherwise:
        a figure that is not there yet has none.
        """
        self._sentence.text = sentence
        for file in (self._opener, *self._downloads):
            file.disabled = not (sentence and ready)
        self._list()

    def _toggle(self) -> None:
        """Show or hide the files and the code."""
        if self._listing is None:
            self._downloads = [
                download(f"streamdash-{self._name}.{kind}", kind, make) for kind, make in self.files.items()
            ]
            self._listing = Html(stylesheets=[CODE_STYLE], margin=0, css_classes=["sd-code"])
            self._tray[:] = [pn.Row(*self._downloads, margin=0), self._listing]
        self._tray.visible = not self._tray.visible
        self._list()

    def _list(self) -> None:
        if self._tray.visible and self._listing is not None:
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
