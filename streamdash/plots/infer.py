"""What belongs to a posterior: its streams over the data, what moves it, and whether it is calibrated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd
from scipy.stats import binom

from streamdash.inference.posterior import Posterior
from streamdash.plots.corner import BLUE, Truth, axis_label, ends, ticked, truth_line, upright
from streamdash.plots.elements import (
    GREY,
    error_bars,
    framed,
    level_lines,
    nice_top,
    points,
    step_area,
    step_line,
)
from streamdash.plots.live import Backend, Columns, use
from streamdash.plots.style import INK, coordinate_label
from streamdash.prior import Prior
from streamdash.survey.design import Design

BANDS, INNER, MEDIAN, DATA, BARS = "95 %", "68 %", "median", "data", "errors"
TOP = 6.0
"""Highest value shown, in units of the smooth curve."""


# ------------------------------------------------------------ data and predictive bands


def predictive(
    design: Design, q: np.ndarray, sigma: np.ndarray, bands: np.ndarray, backend: Backend, dark: bool = False
) -> hv.Overlay:
    """The data over what streams of the posterior look like, observed alike.

    Parameters
    ----------
    q, sigma : ndarray (n_bin,)
    bands : ndarray (5, n_bin)
        `streamdash.inference.predictive.weighted_bands`.
    """
    use(backend)
    ink = INK["dark" if dark else "light"]
    low, high = np.minimum(design.low, design.high), np.maximum(design.low, design.high)
    parts: list[hv.Element] = [
        _boxes(BANDS, low, high, bands[0], bands[4], 0.18, backend),
        _boxes(INNER, low, high, bands[1], bands[3], 0.3, backend),
        level_lines("smooth", [1.0], backend),
        _medians(low, high, bands[2], backend),
    ]
    few = design.n_bin <= 120
    if few:
        parts.append(error_bars(BARS, design.centers, q - sigma, q + sigma, ink, backend))
    parts.append(points(DATA, design.centers, q, ink, backend, size=5 if few else 3))
    x = (float(low.min()), float(high.max()))
    label = "density / smooth curve" if design.order >= 0 else "Qρ"
    return framed(
        parts, coordinate_label(design.coordinate), label, x, (0, predictive_top(q, bands)), backend
    )


def predictive_columns(design: Design, q: np.ndarray, sigma: np.ndarray, bands: np.ndarray) -> Columns:
    """New data of `predictive`."""
    found: dict[str, dict[str, np.ndarray]] = {
        BANDS: {"bottom": bands[0], "top": bands[4]},
        INNER: {"bottom": bands[1], "top": bands[3]},
        MEDIAN: {"y0": bands[2], "y1": bands[2]},
        DATA: {"y": np.asarray(q)},
    }
    if design.n_bin <= 120:
        found[BARS] = {"lower": q - sigma, "upper": q + sigma}
    return found


def predictive_top(q: np.ndarray, bands: np.ndarray) -> float:
    """Where the vertical axis of `predictive` ends."""
    return min(nice_top(float(max(np.max(q), np.quantile(bands[4], 0.98)))), TOP)


def predictive_table(design: Design, q: np.ndarray, sigma: np.ndarray, bands: np.ndarray) -> pd.DataFrame:
    """The numbers of `predictive`: a row per bin."""
    names = ("q2.5", "q16", "median", "q84", "q97.5")
    return pd.DataFrame(
        {
            f"{design.coordinate}_low_deg": design.low,
            f"{design.coordinate}_high_deg": design.high,
            "value": q,
            "error": sigma,
            **dict(zip(names, bands, strict=True)),
        }
    )


def predictive_sentence(q: np.ndarray, bands: np.ndarray) -> str:
    """How many of the bins lie within the bands."""
    inside = [np.mean((q >= low) & (q <= high)) for low, high in ((bands[1], bands[3]), (bands[0], bands[4]))]
    return (
        f"{inside[0]:.0%} of the {len(q)} bins lie within the band that holds 68 % of the posterior’s "
        f"streams, {inside[1]:.0%} within that of 95 %."
    )


def _boxes(
    label: str,
    left: np.ndarray,
    right: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    alpha: float,
    backend: Backend,
) -> hv.Rectangles:
    boxes = hv.Rectangles((left, low, right, high), label=label)
    if backend == "matplotlib":
        return boxes.opts(facecolor=BLUE, edgecolor="none", alpha=alpha, backend=backend)
    return boxes.opts(fill_color=BLUE, fill_alpha=alpha, line_alpha=0, backend=backend)


def _medians(left: np.ndarray, right: np.ndarray, middle: np.ndarray, backend: Backend) -> hv.Segments:
    medians = hv.Segments((left, middle, right, middle), label=MEDIAN)
    if backend == "matplotlib":
        return medians.opts(color=BLUE, linewidth=1.4, backend=backend)
    return medians.opts(color=BLUE, line_width=2, backend=backend)


# ------------------------------------------------------------ intervals side by side


def intervals(
    rows: Sequence[tuple[str, Posterior]],
    name: str,
    prior: Prior,
    backend: Backend,
    truth: Truth | None = None,
) -> hv.Overlay:
    """Median, 68 % and 95 % interval of one parameter under several assumptions, one below the other."""
    use(backend)
    table = interval_table(rows, name)
    y = np.arange(len(rows))[::-1].astype(float)
    edges = np.asarray(rows[0][1].grid[name])
    parts: list[hv.Element] = [
        upright("CDM", 0.0, backend) if name == "log10_rate" else level_lines("none", [], backend),
        _across("95 %", table["low95"], table["high95"], y, 1.6, backend),
        _across("68 %", table["low68"], table["high68"], y, 6.0, backend),
        points("median", table["median"].to_numpy(), y, BLUE, backend, size=11),
        truth_line(name, truth, backend),
    ]
    overlay = framed(parts, axis_label(name, prior), "", ends(edges), (-0.7, len(rows) - 0.3), backend)
    height = 90 + 34 * len(rows)
    labels = [(float(place), label) for place, (label, _) in zip(y, rows, strict=True)]
    choices: dict[str, Any] = {"yticks": labels}
    if backend == "bokeh":
        choices["height"] = height
    return ticked(overlay, name, edges, prior, backend).opts(hv.opts.Overlay(**choices, backend=backend))


def interval_table(rows: Sequence[tuple[str, Posterior]], name: str) -> pd.DataFrame:
    """The numbers of `intervals`."""
    found = []
    for label, posterior in rows:
        q = posterior.quantile(name, np.array([0.025, 0.16, 0.5, 0.84, 0.975]))
        found.append((label, *q, posterior.information_on(name)))
    return pd.DataFrame(
        found, columns=["assumption", "low95", "low68", "median", "high68", "high95", "information_bits"]
    )


def intervals_sentence(rows: Sequence[tuple[str, Posterior]], name: str) -> str:
    """Median and 68 % interval of every row."""
    unit = " × CDM" if name == "log10_rate" else ""
    words = []
    for label, posterior in rows:
        low, high = posterior.interval(name)
        words.append(f"{label}: {10 ** posterior.median(name):.2g} ({10**low:.2g} to {10**high:.2g})")
    return "; ".join(words) + f"{unit}."


def _across(
    label: str, low: pd.Series, high: pd.Series, y: np.ndarray, width: float, backend: Backend
) -> hv.Segments:
    bars = hv.Segments((low.to_numpy(), y, high.to_numpy(), y), label=label)
    if backend == "matplotlib":
        return bars.opts(color=BLUE, linewidth=width * 0.7, backend=backend)
    return bars.opts(color=BLUE, line_width=width, backend=backend)


# ------------------------------------------------------------ calibration


def rank_histogram(ranks: np.ndarray, backend: Backend, n_bin: int = 10) -> hv.Overlay:
    """Ranks of the truth in held-out streams' posteriors, over what a calibrated estimator gives."""
    use(backend)
    edges = np.linspace(0, 1, n_bin + 1)
    counts = np.histogram(ranks, edges)[0].astype(float)
    low, high = (np.full(n_bin, binom.ppf(p, len(ranks), 1 / n_bin)) for p in (0.025, 0.975))
    parts = [
        step_area("calibrated", edges, low, high, GREY, backend),
        step_line("ranks", edges, counts, BLUE, backend),
    ]
    top = nice_top(float(max(counts.max(), high[0])))
    return framed(
        parts, "posterior probability below the truth", "held-out streams", (0, 1), (0, top), backend
    )


def rank_table(ranks: np.ndarray, n_bin: int = 10) -> pd.DataFrame:
    """The numbers of `rank_histogram`."""
    edges = np.linspace(0, 1, n_bin + 1)
    low, high = (binom.ppf(p, len(ranks), 1 / n_bin) for p in (0.025, 0.975))
    return pd.DataFrame(
        {
            "rank_low": edges[:-1],
            "rank_high": edges[1:],
            "streams": np.histogram(ranks, edges)[0],
            "calibrated_low95": low,
            "calibrated_high95": high,
        }
    )
