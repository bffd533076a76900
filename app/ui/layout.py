"""How a page is laid out: question, panel of controls, and figures."""

from __future__ import annotations

from collections.abc import Sequence

import panel as pn
import panel_material_ui as pmui
from bokeh.models.ui import UIElement
from panel.viewable import Viewable

from app.ui.browser import Answer, DrawerButton
from app.ui.templates import Html, fill

WIDE = "stretch_width"
FIGURE_HEIGHT = "clamp(300px, calc(100vh - 400px), 620px)"
"""Height of a figure: what a screen has left beside what belongs to it."""
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
