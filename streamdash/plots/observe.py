"""A measured profile over what the simulated classes look like when observed in the same way."""

from __future__ import annotations

from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig
from streamdash.naming import class_colours
from streamdash.observe.observation import Observation
from streamdash.plots.elements import error_bars, framed, hover_spans, level_lines, nice_top, points
from streamdash.plots.live import Backend, use
from streamdash.plots.style import INK, coordinate_label
from streamdash.streams import longitude_symbol
from streamdash.words import number_of

TOP = 6.0
"""Highest value shown, in units of the smooth curve."""
OBSERVED, BARS = "observed", "errors"


def draw(
    observation: Observation,
    bands: np.ndarray | None,
    classes: Sequence[EnsembleConfig | str],
    backend: Backend,
    dark: bool = False,
) -> hv.Overlay:
    """The measured values with their errors, over the 68 % band and median of every class.

    Parameters
    ----------
    observation : Observation
    bands : ndarray (n_classes, 3, n_bin) or None
        `streamdash.observe.verdict.Prepared.bands`; None draws the measurement alone.
    classes : sequence of EnsembleConfig or str
        The classes, or their names, for their colours.
    backend : {"bokeh", "matplotlib"}
    dark : bool
        Whether the page is dark.
    """
    use(backend)
    design, q = observation.design, observation.q
    ink = INK["dark" if dark else "light"]
    parts: list[hv.Element] = [level_lines("smooth", [1.0], backend)]
    for m, (low, median, high) in enumerate(bands if bands is not None else ()):
        parts += _class(m, class_colours(classes)[m], design.low, design.high, low, median, high, backend)
    parts.append(error_bars(BARS, design.centers, q - design.sigma, q + design.sigma, ink, backend))
    parts.append(points(OBSERVED, design.centers, q, ink, backend, size=6))
    if backend == "bokeh":
        parts.append(_hover(observation, bands))
    x = (float(design.low[0]), float(design.high[-1]))
    label = coordinate_label(design.coordinate)
    return framed(parts, label, value_label(observation), x, _y_frame(observation, bands), backend)


def value_label(observation: Observation) -> str:
    """Label of the vertical axis."""
    divided = {-1: "as given", 0: "mean"}.get(
        observation.design.order, f"order-{observation.design.order} fit"
    )
    kind = "Qρ" if observation.design.quantity == "q_rho" else "density"
    return f"{kind} ({divided})" if observation.design.order < 0 else f"{kind} / {divided}"


def table(observation: Observation, bands: np.ndarray | None, labels: Sequence[str]) -> pd.DataFrame:
    """The numbers of the figure: a row per bin."""
    design = observation.design
    columns = {
        f"{design.coordinate}_low_deg": design.low,
        f"{design.coordinate}_high_deg": design.high,
        "value": observation.q,
        "error": design.sigma,
    }
    for label, band in zip(labels, bands if bands is not None else (), strict=False):
        for name, quantile in zip(("q16", "median", "q84"), band, strict=True):
            columns[f"{label}_{name}"] = quantile
    return pd.DataFrame(columns)


def sentence(observation: Observation, bands: np.ndarray | None, names: Sequence[str]) -> str:
    """What the figure shows now, in words."""
    design, q = observation.design, observation.q
    lowest, highest = int(np.argmin(q)), int(np.argmax(q))
    where = "ℓ" if design.coordinate == "ell" else longitude_symbol(design.coordinate)
    words = (
        f"{number_of(design.n_bin, 'measured bin')}, from {q[lowest]:.2f} ± {design.sigma[lowest]:.2f} at "
        f"{where} = {design.centers[lowest]:.1f}° to {q[highest]:.2f} ± {design.sigma[highest]:.2f} at "
        f"{design.centers[highest]:.1f}°."
    )
    if bands is None:
        return words
    inside = [np.mean((q >= low) & (q <= high)) for low, _, high in bands]
    shares = "; ".join(f"{name}: {100 * share:.0f} %" for name, share in zip(names, inside, strict=True))
    return f"{words} Share of them within the band that holds 68 % of the streams of a class: {shares}."


def _class(
    m: int,
    colour: str,
    left: np.ndarray,
    right: np.ndarray,
    low: np.ndarray,
    middle: np.ndarray,
    high: np.ndarray,
    backend: Backend,
) -> list[hv.Element]:
    """Band and median of a class, bin by bin, so that gaps stay empty."""
    boxes = hv.Rectangles((left, low, right, high), label=f"band {m}")
    medians = hv.Segments((left, middle, right, middle), label=f"median {m}")
    if backend == "matplotlib":
        return [
            boxes.opts(facecolor=colour, edgecolor="none", alpha=0.28, backend=backend),
            medians.opts(color=colour, linewidth=1.6, backend=backend),
        ]
    return [
        boxes.opts(fill_color=colour, fill_alpha=0.28, line_alpha=0, backend=backend),
        medians.opts(color=colour, line_width=2.2, backend=backend),
    ]


def _hover(observation: Observation, bands: np.ndarray | None) -> hv.VSpans:
    design = observation.design
    columns = {
        "x0": design.low,
        "x1": design.high,
        "value": observation.q,
        "error": design.sigma,
    }
    tips = [("bin", "@x0{0.0}° to @x1{0.0}°"), ("measured", "@value{0.00} ± @error{0.00}")]
    for m, (low, median, high) in enumerate(bands if bands is not None else ()):
        triples = zip(low, median, high, strict=True)
        columns[f"text{m}"] = np.array([f"{b:.2f} (68 %: {a:.2f}–{c:.2f})" for a, b, c in triples])
        tips.append((f"M{m}", f"@text{m}"))
    return hover_spans("bins", columns, tips)


def _y_frame(observation: Observation, bands: np.ndarray | None) -> tuple[float, float]:
    q, sigma = observation.q, observation.design.sigma
    top = float(np.max(q + sigma))
    bottom = float(np.min(q - sigma))
    if bands is not None:
        top = max(top, float(np.quantile(bands[:, 2], 0.95)))
    return max(min(0.0, np.floor(bottom * 4) / 4), -TOP / 2), min(nice_top(top), TOP)
