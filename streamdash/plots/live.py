"""HoloViews figures that stay: declared once, then fed new arrays; and the same figures as files."""

from __future__ import annotations

import functools
import io
import threading
from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import holoviews as hv
import numpy as np
from cachetools import LRUCache
from numpy.typing import ArrayLike

from streamdash.plots.style import INK

if TYPE_CHECKING:
    from streamdash.plots.copies import Template

Backend = Literal["bokeh", "matplotlib"]
Columns = Mapping[str, Mapping[str, np.ndarray]]
"""New data of a figure: element label → column name → array."""


DOTS_PER_INCH = 300
"""Resolution of PNG files."""


DRAWN = 96
"""Figures whose templates are kept; with their arrays up to a megabyte each."""


@functools.cache
def use(backend: Backend) -> Any:
    """Load a HoloViews backend once and return its renderer (Matplotlib takes a second)."""
    hv.extension(backend, logo=False)
    renderer = hv.renderer(backend)
    if backend == "bokeh":
        renderer.webgl = False  # without a GPU one paint takes 15 s
    else:
        renderer.dpi = DOTS_PER_INCH
    return renderer


TOOLS = {"default_tools": ["pan", "box_zoom", "wheel_zoom", "reset"], "active_tools": [], "toolbar": "above"}
"""HoloViews options of an overlay for the browser: nothing grabs a page that is being scrolled."""


class _Part(NamedTuple):
    """What of an element's models is needed later."""

    label: str
    source: Any
    glyph: Any


class _Drawn(NamedTuple):
    """A figure to be made again: its template, and of every element the label and its models' ids."""

    template: Template
    root: str
    parts: tuple[_Part, ...]


_drawn: LRUCache[Hashable, _Drawn | None] = LRUCache(DRAWN)
"""Figures by what they depend on; None for those that were asked for once."""
_drawing = threading.Lock()


def _models(overlay: hv.Element | hv.Overlay) -> tuple[Any, tuple[_Part, ...]]:
    """Bokeh's figure of an overlay, and its parts: drawn by HoloViews, or made again if it was twice."""
    from streamdash.plots.copies import Template, Unknown, signature  # Bokeh, which files do not need

    renderer = use("bokeh")
    try:
        key = signature(overlay)
    except Unknown:
        return _draw(renderer, overlay)
    with _drawing:
        known = _drawn.get(key)
        again = key in _drawn
        _drawn[key] = known
    if known is not None:
        made = known.template.make()
        parts = tuple(_Part(p.label, made[p.source], made.get(p.glyph)) for p in known.parts)
        return made[known.root], parts
    figure, parts = _draw(renderer, overlay)
    if again:
        template = Template(figure)
        ids = tuple(_Part(p.label, p.source.id, getattr(p.glyph, "id", None)) for p in parts)
        # Spans have a source that their figure does not hold: such a figure is drawn each time.
        if all(part.source in template for part in ids):
            with _drawing:
                _drawn[key] = _Drawn(template, figure.id, ids)
    return figure, parts


def _draw(renderer: Any, overlay: hv.Element | hv.Overlay) -> tuple[Any, tuple[_Part, ...]]:
    plot = renderer.get_plot(overlay)
    subplots = list(plot.subplots.values()) if getattr(plot, "subplots", None) else [plot]
    # Nothing grabs a page that is being scrolled until somebody asks for it.
    plot.state.toolbar.update(logo=None, active_drag=None, active_scroll=None)
    parts = tuple(
        _Part(part.hmap.last.label, part.handles["source"], part.handles.get("glyph")) for part in subplots
    )
    return plot.state, parts


class LiveFigure:
    """A Bokeh figure made once from HoloViews elements, whose data can be replaced.

    Parameters
    ----------
    overlay
        Element or overlay; every element that is to be patched needs a label of its own.
    ink
        Labels of elements drawn in the page's ink, to be recoloured with `set_ink`.

    Attributes
    ----------
    figure : bokeh.plotting.figure
    sources : dict of str to ColumnDataSource
        By element label. HoloViews owns the column names: dimension names for a Curve,
        ``x, y`` for an Area (upper edge, then lower edge backwards), ``image`` for an Image.
    """

    def __init__(self, overlay: hv.Element | hv.Overlay, ink: Sequence[str] = ()) -> None:
        self.figure, parts = _models(overlay)
        self.sources: dict[str, Any] = {part.label: part.source for part in parts}
        self._inked = [part.glyph for part in parts if part.label in ink]

    def patch(self, columns: Columns) -> None:
        """Write new arrays; columns that are not named keep their data.

        Raises
        ------
        KeyError
            When the figure has no such element or column.
        """
        for label, new in columns.items():
            source = self.sources[label]
            unknown = new.keys() - source.data.keys()
            if unknown:
                raise KeyError(f"{label!r} has no column {sorted(unknown)}, only {sorted(source.data)}")
            # Every array is two WebSocket frames: send those that differ.
            changed = {name: array for name, array in new.items() if not _same(array, source.data[name])}
            if changed:
                source.data.update(changed)

    def move(self, x: tuple[float, float] | None = None, y: tuple[float, float] | None = None) -> None:
        """Give the axes other ends; an axis without any stays, and nothing is sent for the same ends."""
        for axis, ends in ((self.figure.x_range, x), (self.figure.y_range, y)):
            if ends is not None and (axis.start, axis.end) != ends:
                axis.update(start=ends[0], end=ends[1])

    def show(self, label: str, visible: bool) -> None:
        """Show or hide one element."""
        source = self.sources[label]
        for renderer in self.figure.renderers:
            if getattr(renderer, "data_source", None) is source and renderer.visible != visible:
                renderer.visible = visible

    def set_ink(self, dark: bool) -> None:
        """Recolour the inked elements for a dark or a light page."""
        for glyph in self._inked:
            glyph.line_color = INK["dark" if dark else "light"]


def _same(one: ArrayLike, other: ArrayLike) -> bool:
    one, other = np.asarray(one), np.asarray(other)
    floats = one.dtype.kind == other.dtype.kind == "f"
    return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=floats)


def area_columns(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of an Area between two curves: out along the upper one, back along the lower one."""
    return {"x": np.concatenate([x, x[::-1]]), "y": np.concatenate([high, low[::-1]])}


def export(figure: hv.Element | hv.Overlay | hv.Layout, kind: str) -> bytes:
    """A figure declared for Matplotlib as the bytes of a ``png`` or ``svg`` file."""
    buffer = io.BytesIO()
    use("matplotlib").save(figure, buffer, fmt=kind)
    return buffer.getvalue()
