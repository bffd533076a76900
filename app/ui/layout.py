"""Layout without Material components: grids, headings, legends, plain text."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import panel as pn
from bokeh.models.ui import UIElement
from panel.viewable import Viewable

from app.session.catalog import Choice
from streamdash.naming import class_colour

WIDE = "stretch_width"
CODE_STYLE = "pre { margin: 0; padding: 4px 16px; overflow-x: auto; font-size: 13px; line-height: 1.45; }"
LEGEND_STYLE = """
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font: 13px/1.5 Roboto, sans-serif; }
.item { display: inline-flex; align-items: center; gap: 6px; }
.swatch { display: inline-block; width: 24px; height: 2px; }
.image { height: 10px; background: linear-gradient(#8080801a, #808080e0, #8080801a); }
.band { height: 10px; background: var(--classes); opacity: 0.4; }
.line { background: var(--classes); }
.ink { height: 3px; background: currentColor; }
.dashes { height: 0; border-top: 2px dashed currentColor; }
.grey { height: 10px; background: #80808040; }
.frame { height: 8px; border: 2px solid currentColor; border-width: 0 2px; width: 12px; }
.none { display: none; }
.hand { height: 3px; background: #C77C00; }
.dots-grey { height: 6px; width: 6px; border-radius: 3px; background: #808080; }
.dots { height: 8px; border-radius: 4px; background: var(--classes); }
"""


def plain_text(text: str, **params: Any) -> pn.pane.HTML:
    """Text that is never read as HTML, whoever wrote it."""
    return pn.pane.HTML(html.escape(text), **{"sizing_mode": WIDE, **params})


def reachable(name: str, table: str) -> str:
    """A table in a frame of class ``wide`` that scrolls sideways where it must, by keyboard too."""
    return f"<div class='wide' tabindex='0' role='region' aria-label='{html.escape(name)}'>{table}</div>"


def controls(*widgets: Viewable) -> Viewable:
    """A page's controls: side by side where there is room, below one another on a phone."""
    return pn.FlexBox(
        *widgets, align_items="center", gap="4px 12px", sizing_mode=WIDE, css_classes=["sd-controls"]
    )


def page_layout(*parts: Viewable) -> Viewable:
    """Controls, then cards, from top to bottom."""
    return pn.Column(*parts, sizing_mode=WIDE, margin=(8, 8), css_classes=["sd-body"])


def class_heading(index: int, choice: Choice) -> pn.pane.HTML:
    """Name of a class with its colour: ``■ M0 · 10³–10⁵ M☉ · 2000 streams``."""
    words = f"M{index} · {choice.label} · {choice.config.n_streams} streams"
    return pn.pane.HTML(
        f"<div style='font: 500 15px/1.5 Roboto, sans-serif'>"
        f"<span style='color:{class_colour(index)}' aria-hidden='true'>■</span> {html.escape(words)}</div>",
        margin=(6, 0, 0, 0),
        css_classes=["sd-class"],
    )


def heading(text: str) -> pn.pane.HTML:
    """Heading of a part of a page."""
    words = html.escape(text)
    return pn.pane.HTML(
        f"<h2 style='font: 500 22px/1.4 Roboto, sans-serif; margin: 0'>{words}</h2>", margin=4
    )


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


def legend(entries: Sequence[tuple[str, str]], classes: int) -> pn.pane.HTML:
    """A line of swatches and words above a figure.

    Parameters
    ----------
    entries
        Kind of swatch and words; kinds are ``image``, ``band``, ``line``, ``ink``, ``dashes``,
        ``grey``, ``frame``, ``dots``, ``dots-grey``, ``hand`` (a fly-by chosen by hand) and ``none``.
        Bands, lines and dots show the colours of all classes.
    classes
        Number of classes shown.
    """
    items = "".join(
        f"<span class='item'><span class='swatch {html.escape(kind)}'></span>{html.escape(words)}</span>"
        for kind, words in entries
    )
    share = 100 / max(classes, 1)
    stripes = ", ".join(
        f"{class_colour(i)} {i * share:.0f}% {(i + 1) * share:.0f}%" for i in range(max(classes, 1))
    )
    return pn.pane.HTML(
        f"<div class='legend' style='--classes: linear-gradient(90deg, {stripes})'>{items}</div>",
        stylesheets=[LEGEND_STYLE],
        sizing_mode=WIDE,
        margin=(4, 0),
    )
