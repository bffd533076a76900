"""Legends: which mark of a figure means what, once for the page and for the files.

An entry is a kind and its words. A kind is a shape, with a colour behind a hyphen where it is not that
of the classes: ``line``, ``dashes-ink``, ``dots-grey``, ``line-dots``, ``bars-hand``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.lines
import matplotlib.patches

from streamdash.naming import ACCENT
from streamdash.plots.style import HAND, INK

SHAPES = ("line-dots", "line", "dashes", "dots", "bars", "band", "image", "frame", "cross", "none")
"""``bars`` are dots with error bars, ``line-dots`` the same on a line."""
GREY = "#808080"
INKED = "currentColor"
"""Of marks in the page's ink."""
FIXED = {"ink": INKED, "grey": GREY, "hand": HAND, "accent": ACCENT}
"""Colours that a kind can name."""
OWN_COLOUR = {"image": "grey", "frame": "ink", "cross": "ink"}
"""Of shapes that never have the colours of the classes."""


@dataclass(frozen=True)
class Mark:
    """One entry of a legend: shape, colours (one, or one for each class), and words."""

    kind: str
    colours: tuple[str, ...]
    words: str


def marks(entries: Sequence[tuple[str, str]], colours: Sequence[str] = ()) -> tuple[Mark, ...]:
    """Entries of a legend with their colours.

    Parameters
    ----------
    entries
        Kind and words of each.
    colours
        Of the classes that are shown; `ACCENT` where there are none.

    Raises
    ------
    ValueError
        For a kind that there is not.
    """
    return tuple(_mark(kind, words, tuple(colours) or (ACCENT,)) for kind, words in entries)


def _mark(kind: str, words: str, colours: tuple[str, ...]) -> Mark:
    shape = next((s for s in SHAPES if kind == s or kind.startswith(f"{s}-")), "")
    name = kind.removeprefix(shape).lstrip("-") or OWN_COLOUR.get(shape, "")
    if not shape or (name and not (name in FIXED or name.startswith("#"))):
        raise ValueError(f"{kind} is no mark of a legend")
    return Mark(shape, (FIXED.get(name, name),) if name else colours, words)


def handles(shown: Sequence[Mark]) -> list[Any]:
    """The marks as Matplotlib's legend takes them."""
    found: list[Any] = []
    for mark in shown:
        if mark.kind == "none":
            found.append(matplotlib.lines.Line2D([], [], linestyle="none"))
            continue
        colours = [INK["light"] if c == INKED else c for c in mark.colours]
        found.append(tuple(_handle(mark.kind, colour) for colour in colours))
    return found


def _handle(kind: str, colour: str) -> Any:
    if kind in ("band", "image"):
        return matplotlib.patches.Patch(facecolor=colour, alpha=0.35, edgecolor="none")
    look: dict[str, Any] = {"color": colour, "markersize": 5, "linewidth": 1.6}
    look["linestyle"] = {"line": "-", "line-dots": "-", "dashes": "--"}.get(kind, "none")
    look["marker"] = {"dots": "o", "bars": "o", "line-dots": "o", "cross": "x", "frame": "s"}.get(kind, "")
    look["fillstyle"] = "none" if kind == "frame" else "full"
    return matplotlib.lines.Line2D([], [], **look)
