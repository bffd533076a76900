"""Histogram outlines, bands and spans, styled for both backends; used by the PDF and evidence figures.

Options are set on each element as it is made: option strings cannot address elements by label alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import holoviews as hv
import numpy as np

from streamdash.plots.live import Backend
from streamdash.plots.style import INK

GREY = "#808080"
FAR = 1e4
"""Beyond every axis: how far lines and spans reach in files."""
NICE = (1, 1.5, 2, 3, 4, 6, 8, 10)
"""Ends of axes, times a power of ten: a slider seldom moves the frame."""


def steps(edges: np.ndarray) -> np.ndarray:
    """Edges of bins as the corners of a histogram's outline, (2 n_bin,)."""
    return np.repeat(edges, 2)[1:-1]


def step_area(
    label: str,
    edges: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    colour: str,
    backend: Backend,
    outline: bool = False,
) -> hv.Area:
    """Filled region between two histograms; in the browser its columns are ``x, y``."""
    area = hv.Area((steps(edges), np.repeat(low, 2), np.repeat(high, 2)), "x", ["low", "high"], label=label)
    if backend == "matplotlib":
        return area.opts(
            facecolor=colour, edgecolor=colour, alpha=0.3, linewidth=1.2 if outline else 0, backend=backend
        )
    return area.opts(
        fill_color=colour,
        fill_alpha=0.28,
        line_color=colour,
        line_alpha=1.0 if outline else 0.0,
        line_width=1.8,
        backend=backend,
    )


def step_line(label: str, edges: np.ndarray, heights: np.ndarray, colour: str, backend: Backend) -> hv.Curve:
    """A histogram's outline; in the browser its columns are ``x, y``."""
    return line(label, steps(edges), np.repeat(heights, 2), colour, backend)


def line(
    label: str, x: np.ndarray, y: np.ndarray, colour: str, backend: Backend, dashed: bool = False
) -> hv.Curve:
    """A line; in the browser its columns are ``x, y``."""
    curve = hv.Curve((x, y), "x", "y", label=label)
    if backend == "matplotlib":
        return curve.opts(color=colour, linewidth=1.6, linestyle="--" if dashed else "-", backend=backend)
    return curve.opts(
        color=colour, line_width=2.2, line_dash="dashed" if dashed else "solid", backend=backend
    )


def points(
    label: str, x: np.ndarray, y: np.ndarray, colour: str, backend: Backend, size: float = 7
) -> hv.Scatter:
    """Dots; in the browser their columns are ``x, y``."""
    dots = hv.Scatter((x, y), "x", "y", label=label)
    if backend == "matplotlib":
        return dots.opts(color=colour, s=size * 2, backend=backend)
    return dots.opts(color=colour, size=size, backend=backend)


def error_bars(
    label: str, x: np.ndarray, low: np.ndarray, high: np.ndarray, colour: str, backend: Backend
) -> hv.ErrorBars:
    """Vertical bars from ``low`` to ``high``; in the browser their columns are ``base, lower, upper``."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    bars = hv.ErrorBars((x, middle, half), "x", ["y", "half"], label=label)
    if backend == "matplotlib":
        return bars.opts(edgecolor=colour, linewidth=1.2, capsize=2, backend=backend)
    return bars.opts(line_color=colour, line_width=1.4, upper_head=None, lower_head=None, backend=backend)


def level_lines(label: str, levels: Sequence[float], backend: Backend, dashed: bool = True) -> hv.Element:
    """Grey horizontal lines over the whole width that stay where they are."""
    if backend == "matplotlib":
        # HLines would take the axis labels from the first panel of a layout.
        x, y = np.tile([-FAR, FAR, np.nan], len(levels)), np.repeat(np.asarray(levels, dtype=float), 3)
        curve = hv.Curve((x, y), "x", "y", label=label)
        return curve.opts(color=GREY, linewidth=0.8, linestyle="--" if dashed else "-", backend=backend)
    lines = hv.HLines(list(levels), label=label)
    return lines.opts(color=GREY, line_width=1, line_dash="dashed" if dashed else "solid", backend=backend)


def grey_spans(label: str, left: np.ndarray, right: np.ndarray, backend: Backend) -> hv.Element:
    """Grey ranges of x over the whole height; in the browser their columns are ``x0, x1``."""
    if backend == "matplotlib":
        # VSpans would take the axis labels from the first panel of a layout.
        boxes = [(x0, -FAR, x1, FAR) for x0, x1 in zip(left, right, strict=True)]
        return hv.Rectangles(boxes, ["x", "y", "x1", "y1"], label=label).opts(
            facecolor=GREY, edgecolor="none", alpha=0.25, backend=backend
        )
    spans = hv.VSpans((left, right), kdims=["x0", "x1"], label=label)
    return spans.opts(color=GREY, alpha=0.25, line_alpha=0, backend=backend)


def frame_span(label: str, left: float, right: float) -> hv.VSpans:
    """One empty range of x with an outline in the page's ink (browser only); columns ``x0, x1``."""
    spans = hv.VSpans(([left], [right]), kdims=["x0", "x1"], label=label)
    return spans.opts(fill_alpha=0, line_color=INK["light"], line_width=2, backend="bokeh")


def hover_spans(
    label: str, columns: Mapping[str, np.ndarray], tooltips: Sequence[tuple[str, str]]
) -> hv.VSpans:
    """Invisible ranges ``x0`` to ``x1`` that show the other columns when pointed at (browser only)."""
    names = [name for name in columns if name not in ("x0", "x1")]
    values = (columns["x0"], columns["x1"], *(columns[name] for name in names))
    spans = hv.VSpans(values, kdims=["x0", "x1"], vdims=names, label=label)
    return spans.opts(
        fill_alpha=0, line_alpha=0, tools=["hover"], hover_tooltips=list(tooltips), backend="bokeh"
    )


def framed(
    parts: Sequence[hv.Element],
    xlabel: str,
    ylabel: str,
    x: tuple[float, float],
    y: tuple[float, float],
    backend: Backend,
    title: str = "",
    log: bool = False,
) -> hv.Overlay:
    """Elements over one another in a frame of fixed ranges, linear or logarithmic on both axes."""
    overlay = hv.Overlay(list(parts))
    both = {
        "logx": log,
        "logy": log,
        "xlabel": xlabel,
        "ylabel": ylabel,
        "xlim": x,
        "ylim": y,
        "show_legend": False,
        "backend": backend,
    }
    if backend == "matplotlib":
        return overlay.opts(hv.opts.Overlay(title=title, fig_inches=5, aspect=1.5, **both))
    return overlay.opts(responsive=True, height=340, toolbar="above", title=title, **both)


def nice_top(value: float) -> float:
    """The smallest of 1, 1.5, 2, 3, 4, 6, 8 (times a power of ten) with 5 % room above a value."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value * 1.05))
    return float(next(s * power for s in NICE if s * power >= value * 1.05))


def runs(edges: np.ndarray, marked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Left and right ends of the runs of marked bins."""
    changes = np.diff(np.concatenate([[0], marked.astype(np.int8), [0]]))
    return edges[np.flatnonzero(changes == 1)], edges[np.flatnonzero(changes == -1)]
