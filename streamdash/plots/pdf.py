"""PDF(Qρ) of each class with its scatter, and Π(y_α|M) of one of its bins (paper figs. 3–4)."""

from __future__ import annotations

from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash._moved import renamed
from streamdash.config import EnsembleConfig
from streamdash.naming import class_colour, class_names, model_labels
from streamdash.plots.elements import (
    frame_span,
    framed,
    grey_spans,
    hover_spans,
    nice_top,
    runs,
    step_area,
    step_line,
    steps,
)
from streamdash.plots.live import Backend, Columns, area_columns, use
from streamdash.statistics.evidence import RULES, Comparison, compare
from streamdash.statistics.pdf import y_distribution
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams
from streamdash.words import is_or_are, number_of

__getattr__ = renamed(__name__)
N_Y = 50
"""Bins of y in Π(y_α|M), as in the paper's figure 4."""
LEVEL = 0.1
"""A median within this share of its highest value is as high as that, for the eye."""
FLAT = 0.2
"""Where that holds over more than this share of the axis, there is no peak to speak of."""
EXCLUDED, SELECTED, BINS = "excluded", "selected", "bins"
Y_LABELS = {
    "bokeh": ("y: PDF(Qρ) in this bin", "Π(y|M)"),  # its text has no subscripts
    "matplotlib": ("y_α: PDF(Qρ) in this bin", "Π(y_α|M)"),
}
Q_LABEL = "Qρ = ρ / ρ̄"


def pdf_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    noise: float = 0.1,
    n_bin: int = 20,
    rules: str = "central",
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """PDF(Qρ) of each class: median and 68 % band over streams, excluded bins grey (paper fig. 3).

    Parameters
    ----------
    cache
        Where the ensembles and the stream's geometry are.
    ensembles
        Keys or configurations, lowest masses first.
    noise
        Shot noise σ_ε per bin.
    n_bin
        Number of bins in Qρ.
    rules
        Which bins count: a name of `streamdash.statistics.evidence.RULES`.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.
    """
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    comparison = compare(streams.noisy(noise), noise, n_bin, RULES[rules])
    # Plot
    return draw(comparison, streams.configs, backend)


def y_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    q: float = 1.0,
    noise: float = 0.1,
    n_bin: int = 20,
    rules: str = "central",
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """Π(y_α|M) of the bin α that holds the value ``q`` of Qρ (paper fig. 4).

    Other parameters as in `pdf_figure`.
    """
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    comparison = compare(streams.noisy(noise), noise, n_bin, RULES[rules])
    # Plot
    return draw_y(comparison, comparison.bin_at(q), streams.configs, backend)


# ---------------------------------------------------------------- plot: PDF(Qρ)


def draw(
    comparison: Comparison,
    configs: Sequence[EnsembleConfig],
    backend: Backend,
    selected: int | None = 0,
    title: str = "",
) -> hv.Overlay:
    """Declare the figure of PDF(Qρ); in the browser its data are then replaced by `columns`."""
    use(backend)
    edges, bands = comparison.edges, comparison.bands
    parts = [grey_spans(EXCLUDED, *runs(edges, excluded_bins(comparison)), backend)]
    for m, band in enumerate(bands):
        parts.append(step_area(f"band {m}", edges, band.low, band.high, class_colour(m, configs), backend))
    for m, band in enumerate(bands):
        parts.append(step_line(f"median {m}", edges, band.median, class_colour(m, configs), backend))
    if backend == "bokeh":
        if selected is not None:
            parts.append(frame_span(SELECTED, edges[selected], edges[selected + 1]))
        names = [(label, f"@text{m}") for m, label in enumerate(model_labels(configs))]
        where = [("bin α", "@number"), ("Qρ", "@x0{0.000} to @x1{0.000}")]
        tips = [*where, *names, ("counts for evidence", "@counts")]
        parts.append(hover_spans(BINS, columns(comparison, 0)[BINS], tips))
    ranges = frame(comparison)
    return framed(parts, Q_LABEL, "PDF(Qρ)", ranges["x"], ranges["y"], backend, title)


def columns(comparison: Comparison, selected: int) -> Columns:
    """Arrays of the figure of PDF(Qρ) by element label and column name, for `LiveFigure.patch`."""
    edges = comparison.edges
    excluded = excluded_bins(comparison)
    left, right = runs(edges, excluded)
    bins = {
        "x0": edges[:-1],
        "x1": edges[1:],
        "number": np.arange(1, len(edges)),
        "counts": np.where(excluded, "no (grey)", "yes"),
    }
    result = {EXCLUDED: {"x0": left, "x1": right}, BINS: bins, **selected_columns(comparison, selected)}
    corners = steps(edges)
    for m, band in enumerate(comparison.bands):
        low, high = np.repeat(band.low, 2), np.repeat(band.high, 2)
        result[f"band {m}"] = area_columns(corners, low, high)
        result[f"median {m}"] = {"x": corners, "y": np.repeat(band.median, 2)}
        triples = zip(band.low, band.median, band.high, strict=True)
        bins[f"text{m}"] = np.array([f"{b:.3g} (68 %: {a:.3g}–{c:.3g})" for a, b, c in triples])
    return result


def selected_columns(comparison: Comparison, selected: int) -> Columns:
    """Arrays of the outline of the selected bin."""
    edges = comparison.edges
    return {SELECTED: {"x0": edges[[selected]], "x1": edges[[selected + 1]]}}


def excluded_bins(comparison: Comparison) -> np.ndarray:
    """Bins α that count in no comparison of these models, (n_bin,) of bool."""
    evidence, n = comparison.evidence, comparison.n_models
    kept = [evidence.kept(i, i, j) for i in range(n) for j in range(n) if i != j]
    return ~np.any(kept, axis=0)


def frame(comparison: Comparison) -> dict[str, tuple[float, float]]:
    """Ranges of the axes of PDF(Qρ); they move in steps."""
    low, high = comparison.edges[[0, -1]]
    top = max(float(band.high.max()) for band in comparison.bands)
    return {"x": (np.floor(low * 4) / 4, np.ceil(high * 4) / 4), "y": (0.0, nice_top(top))}


# ---------------------------------------------------------------- plot: Π(y_α|M)


def draw_y(
    comparison: Comparison,
    selected: int,
    configs: Sequence[EnsembleConfig],
    backend: Backend,
    title: str = "",
) -> hv.Overlay:
    """Declare the figure of Π(y_α|M); in the browser its data are then replaced by `y_columns`."""
    use(backend)
    edges, heights = y_heights(comparison, selected)
    zero = np.zeros(len(edges) - 1)
    parts: list[hv.Element] = [
        step_area(f"y {m}", edges, zero, h, class_colour(m, configs), backend, outline=True)
        for m, h in enumerate(heights)
    ]
    if backend == "bokeh":
        names = [(label, f"@height{m}{{0.000}}") for m, label in enumerate(model_labels(configs))]
        tips = [("y in this bin", "@x0{0.000} to @x1{0.000}"), *names]
        parts.append(hover_spans(BINS, y_columns(comparison, selected)[BINS], tips))
    ranges = y_frame(comparison, selected)
    return framed(parts, Y_LABELS[backend][0], Y_LABELS[backend][1], ranges["x"], ranges["y"], backend, title)


def y_heights(comparison: Comparison, selected: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges (N_Y + 1,) and heights (n_models, N_Y) of Π(y_α|M) of one bin."""
    return y_distribution([y[selected] for y in comparison.sorted_y], N_Y)


def y_columns(comparison: Comparison, selected: int) -> Columns:
    """Arrays of the figure of Π(y_α|M) by element label and column name."""
    edges, heights = y_heights(comparison, selected)
    corners = steps(edges)
    zero = np.zeros(len(corners))
    areas = {f"y {m}": area_columns(corners, zero, np.repeat(h, 2)) for m, h in enumerate(heights)}
    bins = {"x0": edges[:-1], "x1": edges[1:], **{f"height{m}": h for m, h in enumerate(heights)}}
    return {**areas, BINS: bins}


def y_frame(comparison: Comparison, selected: int) -> dict[str, tuple[float, float]]:
    """Ranges of the axes of Π(y_α|M)."""
    edges, heights = y_heights(comparison, selected)
    return {"x": (min(0.0, float(edges[0])), float(edges[-1])), "y": (0.0, nice_top(float(heights.max())))}


# ---------------------------------------------------------------- words and numbers


def table(comparison: Comparison, configs: Sequence[EnsembleConfig]) -> pd.DataFrame:
    """The numbers of PDF(Qρ): per class and bin the median, the band, and whether the bin counts."""
    excluded = excluded_bins(comparison)
    parts = [
        pd.DataFrame(
            {
                "model": f"M{m}",
                "mass_range_msun": mass,
                "bin": np.arange(1, len(comparison.edges)),
                "q_rho_from": comparison.edges[:-1],
                "q_rho_to": comparison.edges[1:],
                "quantile_16": band.low,
                "median": band.median,
                "quantile_84": band.high,
                "excluded": excluded,
            }
        )
        for m, (mass, band) in enumerate(zip(class_names(configs), comparison.bands, strict=True))
    ]
    return pd.concat(parts, ignore_index=True)


def y_table(comparison: Comparison, selected: int, configs: Sequence[EnsembleConfig]) -> pd.DataFrame:
    """The numbers of Π(y_α|M): per class and bin of y the density."""
    edges, heights = y_heights(comparison, selected)
    parts = [
        pd.DataFrame(
            {
                "model": f"M{m}",
                "mass_range_msun": mass,
                "bin": selected + 1,
                "y_from": edges[:-1],
                "y_to": edges[1:],
                "density": height,
            }
        )
        for m, (mass, height) in enumerate(zip(class_names(configs), heights, strict=True))
    ]
    return pd.concat(parts, ignore_index=True)


def sentence(comparison: Comparison, configs: Sequence[EnsembleConfig]) -> str:
    """What the figure of PDF(Qρ) shows now, in words."""
    centers = comparison.centers
    peaks = []
    for label, band in zip(model_labels(configs), comparison.bands, strict=True):
        top = int(np.argmax(band.median))
        height = f"{band.median[top]:.2f} ({band.low[top]:.2f}–{band.high[top]:.2f})"
        ends = centers[band.median >= (1 - LEVEL) * band.median[top]][[0, -1]]
        if np.ptp(ends) > FLAT * np.ptp(comparison.edges[[0, -1]]):
            peaks.append(
                f"{label} is flat: within a tenth of its highest value, {height}, at Qρ from "
                f"{ends[0]:.2f} to {ends[1]:.2f}"
            )
        else:
            peaks.append(f"{label} peaks at Qρ = {centers[top]:.2f} with {height}")
    grey = int(excluded_bins(comparison).sum())
    do = "it does" if grey == 1 else "they do"
    apart = f"{grey} of {len(centers)} bins {is_or_are(grey)} grey: {do} not count for the evidence."
    return (
        f"How often each Qρ occurs along a stream, in {number_of(len(centers), 'bin')} at "
        f"σ_ε = {comparison.noise:g}: "
        f"median over streams and the band that holds 68 % of them. {'; '.join(peaks)}. {apart}"
    )


def y_sentence(comparison: Comparison, selected: int, configs: Sequence[EnsembleConfig]) -> str:
    """What the figure of Π(y_α|M) shows now, in words."""
    low, high = comparison.edges[selected : selected + 2]
    parts = []
    for m, label in enumerate(model_labels(configs)):
        y = comparison.sorted_y[m][selected]
        share = np.count_nonzero(y > 0) / len(y)
        parts.append(f"{label}: median {np.median(y):.3g}, {100 * share:.0f} % of the streams reach this bin")
    grey = " The bin is grey: it does not count." if excluded_bins(comparison)[selected] else ""
    return (
        f"Bin α = {selected + 1}, Qρ from {low:.3f} to {high:.3f}: how y_α is distributed over the streams "
        f"of each class. {'; '.join(parts)}.{grey}"
    )
