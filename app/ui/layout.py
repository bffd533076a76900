"""How a page is laid out: question, panel of controls, and figures with sentence, files and code."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import pandas as pd
import panel as pn
import panel_material_ui as pmui
from bokeh.models.ui import UIElement
from markupsafe import escape
from panel.viewable import Viewable

from app.page import Page
from app.ui.about import about
from app.ui.browser import Answer, DrawerButton, Links, LiveText
from app.ui.bundle import bundle
from app.ui.templates import Html, fill, from_markdown, subscripted
from streamdash.plots.files import About, publish
from streamdash.plots.legend import Mark

WIDE = "stretch_width"
FIGURE_HEIGHT = "clamp(300px, calc(100vh - 400px), 620px)"
"""Height of a figure: what a screen has left beside what belongs to it."""
CODE_STYLE = "pre { margin: 0; padding: 4px 16px; overflow-x: auto; font-size: 13px; line-height: 1.45; }"
FORMULAS = frozenset("=+-@")
"""What a cell begins with that spreadsheets compute."""
UNMARKED = str.maketrans({c: f"\\{c}" for c in "*[]`<>"})
"""What Markdown would make something of in a heading of ours."""
DOCUMENT_STYLE = """
:host { font: 15px/1.55 Roboto, sans-serif; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { padding: 3px 8px; text-align: left; border-bottom: 1px solid #80808040; }
sub { font-size: 0.75em; line-height: 0; }
"""
IMAGES = ("png", "svg", "pdf")
"""Kinds of files of a figure."""
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
    drawn
        Returns the figure as it is now, declared for Matplotlib.
    table
        Returns the figure's numbers as they are now, units in the column names.
    code
        Returns the lines of Python that make the figure as it is now.
    legend
        Shown under the figure, and in its files.
    bare
        Whether heading, files and code are left out.
    page
        The page it stands on: its files name the classes, the settings and the link.

    Attributes
    ----------
    files : dict
        By kind (``png``, ``svg``, ``pdf``, ``csv``), what a download calls for its bytes.
    """

    def __init__(
        self,
        title: str,
        figures: Any,
        *,
        name: str,
        drawn: Callable[[], Any],
        table: Callable[[], pd.DataFrame],
        code: Callable[[], str],
        legend: Viewable | None = None,
        bare: bool = False,
        page: Page | None = None,
    ) -> None:
        self.code = code
        self.name = name
        self._title, self._page = title, page
        if page is not None:
            page.bundled.append(self)
        marks = getattr(legend, "marks", ())
        self._sentence = LiveText(sizing_mode=WIDE, margin=(4, 0, 0, 0), css_classes=["sd-sentence"])
        figures = figures if isinstance(figures, list | tuple) else [figures]
        heading = pmui.Typography(subscripted(title.translate(UNMARKED)), variant="h6", margin=0)
        self.files: dict[str, Callable[[], bytes]] = {
            **{kind: partial(self._image, kind, drawn, marks) for kind in IMAGES},
            "csv": lambda: self.about().comments.encode() + csv_of(table()),
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
        self._pinner = pmui.Button(
            label="Pin",
            on_click=lambda _: self.pin(),
            variant="text",
            size="small",
            margin=0,
            disabled=True,
            css_classes=["sd-pin"],
            description="Keep this view beside the next one",
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        # Made when it is opened: few are, and a page with ten figures is there sooner.
        self._downloads: list[pmui.FileDownload] = []
        self._listing: Html | None = None
        self._bundle: pmui.FileDownload | None = None
        self._tray = pn.Column(sizing_mode=WIDE, margin=0, visible=False, css_classes=["sd-tray"])
        self._pinned = pn.Column(
            margin=0, visible=False, styles={"flex": "1 1 380px", "min-width": "0"}, css_classes=["sd-pinned"]
        )
        self._pins: dict[str, Any] = page.session.pinned if page is not None else {}
        self._show_pinned()
        head = pn.FlexBox(
            heading,
            pn.Row(self._pinner, self._opener, margin=0, styles={"flex": "none"}),
            align_items="center",
            justify_content="space-between",
            flex_wrap="nowrap",
            gap="4px 12px",
            sizing_mode=WIDE,
            margin=0,
        )
        self.view = pn.Column(
            *([] if bare else [head, self._tray]),
            pn.FlexBox(
                pn.Column(figure_grid(figures), margin=0, styles={"flex": "1 1 380px", "min-width": "0"}),
                self._pinned,
                gap="8px 12px",
                sizing_mode=WIDE,
                margin=0,
            ),
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
        for file in (self._opener, self._pinner, *self._downloads):
            file.disabled = not (sentence and ready)
        self._list()

    def pin(self) -> None:
        """Keep the figure as it is now, with what it says, beside what controls will make of it."""
        about = self.about()
        alt = f"Pinned: {' '.join(about.caption)}. {self.words}"
        search = self._page.session.search if self._page is not None else ""
        self._pins[self.name] = (self.files["png"](), alt, self.words, search)
        self._show_pinned()

    def unpin(self) -> None:
        """Let go of what is pinned."""
        self._pins.pop(self.name, None)
        self._show_pinned()

    def _show_pinned(self) -> None:
        """The view that was pinned, also where the page was built anew since."""
        pinned = self._pins.get(self.name)
        self._pinned.visible = pinned is not None
        if pinned is None:
            self._pinned.clear()
            return
        image, alt, words, search = pinned
        ground = {"background": "#ffffff", "border-radius": "4px"}
        away = pmui.Button(
            label="Take the pinned view away",
            on_click=lambda _: self.unpin(),
            variant="text",
            size="small",
            margin=0,
            css_classes=["sd-unpin"],
            sx={"textTransform": "none", "minHeight": "32px"},
        )
        self._pinned[:] = [
            away,
            pn.pane.PNG(image, alt_text=alt, sizing_mode=WIDE, styles=ground),
            Html(words, margin=0, styles={"font": "14px/1.5 Roboto, sans-serif"}),
            Links(links=[["Show these settings again", search]], margin=0),
        ]

    @property
    def words(self) -> str:
        """The sentence under the figure."""
        return self._sentence.text

    @property
    def ready(self) -> bool:
        """Whether there is something to download."""
        return not self._opener.disabled

    def about(self) -> About:
        """What the files say of themselves now."""
        return about(self._page, self._title)

    def filename(self, kind: str) -> str:
        """Name of a file as it would be now: it tells figure, classes and settings."""
        return f"{self.about().stem(self.name)}.{kind}"

    def _image(self, kind: str, drawn: Callable[[], Any], marks: Sequence[Mark]) -> bytes:
        return publish(drawn(), kind, self.about(), marks)

    def _toggle(self) -> None:
        """Show or hide the files and the code."""
        if self._listing is None:
            self._downloads = [download(self.filename(kind), kind, make) for kind, make in self.files.items()]
            self._listing = Html(stylesheets=[CODE_STYLE], margin=0, css_classes=["sd-code"])
            everything = []
            if self._page is not None:
                page = self._page
                self._bundle = download(self._bundle_name(), "zip", lambda: bundle(page.bundled))
                self._bundle.label = "All of this page (ZIP)"
                everything.append(self._bundle)
            row = pn.FlexBox(*self._downloads, *everything, gap="4px", sizing_mode=WIDE, margin=0)
            self._tray[:] = [row, self._listing]
        self._tray.visible = not self._tray.visible
        self._list()

    def _bundle_name(self) -> str:
        key = self._page.key if self._page is not None else self.name
        return f"{self.about().stem(key)}.zip"

    def _list(self) -> None:
        if self._tray.visible and self._listing is not None:
            if self._bundle is not None:
                self._bundle.filename = self._bundle_name()
            for file, kind in zip(self._downloads, self.files, strict=True):
                file.filename = self.filename(kind)
            self._listing.write(fill('<pre tabindex="0"><code>{{ code }}</code></pre>', code=self.code()))


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
    text = Html(from_markdown(markdown), stylesheets=[DOCUMENT_STYLE], margin=(0, 8))
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
