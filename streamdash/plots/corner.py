"""A posterior as a corner plot: every parameter, and every pair of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd
from scipy.ndimage import zoom

from streamdash.inference.cells import AGE
from streamdash.inference.posterior import Posterior
from streamdash.naming import SUPERSCRIPT, label_text
from streamdash.plots.elements import GREY, framed, level_lines, line, nice_top, points, step_area, steps
from streamdash.plots.live import Backend, Columns, area_columns, use
from streamdash.population import mass_label
from streamdash.populations import half_mode_mass
from streamdash.prior import Prior

BLUE, TRUTH_COLOUR = "#0072b2", "#c77c00"
PALETTE = [f"{BLUE}00", f"{BLUE}50", f"{BLUE}b0"]
"""Outside the 95 % region, within it, within the 68 % region."""
LEVELS = (0.95, 0.68)
FINER = 6
"""Sides of a cell are drawn in so many steps, so that regions have no stairs."""
KEV = (1, 2, 3, 5, 10, 20)
"""Ticks of the axis of the warm particle's mass."""
BEYOND = {"log10_rate": "none", "log10_half_mode_mass": "CDM", "log10_excess": "CDM"}
"""What lies beyond the left end of a logarithm: no subhalos; a half-mode mass or an excess of 0."""
FAR = 1e4
POSTERIOR, WITHIN, PRIOR, TRUTH, REGIONS = "posterior", "within 68 %", "prior", "truth", "regions"
Truth = Mapping[str, float]


def axis_label(name: str, prior: Prior) -> str:
    """Name and unit of a parameter on an axis."""
    halos, clusters = label_text(mass_label(prior.mass_range)), label_text(mass_label(prior.cluster_range))
    return {
        "log10_rate": f"{halos} (× CDM)",
        "log10_half_mode_mass": "half-mode mass (M☉)",
        "log10_excess": f"excess of {clusters} (× CDM)",
        "log10_rs_factor": "scale radius (× relation)",
        "slope": "slope of the mass function",
        AGE: "age (Gyr)",
    }[name]


def ticks(name: str, edges: np.ndarray, prior: Prior) -> list[tuple[float, str]]:
    """Where an axis is labelled, and with what."""
    low, high = float(edges[0]), float(edges[-1])
    if name == AGE:
        middles = 0.5 * (edges[1:] + edges[:-1])
        return [(float(x), f"{age:g}") for x, age in zip(middles, sorted(prior.ages_gyr), strict=True)]
    if not name.startswith("log10_"):
        return [(float(x), f"{x:.3g}") for x in np.linspace(low, high, 5)]
    decades = np.arange(np.ceil(low), np.floor(high) + 0.5)
    if name == "log10_half_mode_mass":
        found = [(float(x), "10" + f"{x:.0f}".translate(SUPERSCRIPT)) for x in decades]
    else:
        marks = np.union1d(decades, decades + np.log10(3)) if high - low <= 2.5 else decades
        found = [(float(x), f"{float(f'{10**x:.1g}'):g}") for x in marks if low <= x <= high]
    if name in BEYOND and found and np.isclose(found[0][0], low):
        found[0] = low, f"{found[0][1]}\n← {BEYOND[name]}"
    return found


def diagonal(
    posterior: Posterior, name: str, prior: Prior, backend: Backend, truth: Truth | None = None
) -> hv.Overlay:
    """Density of one parameter relative to the prior's, which is 1, with the most probable 68 % filled."""
    use(backend)
    edges = np.asarray(posterior.grid[name])
    height, within = _heights(posterior, name)
    parts: list[hv.Element] = [
        step_area(POSTERIOR, edges, np.zeros_like(height), height, BLUE, backend, outline=True),
        step_area(WITHIN, edges, np.zeros_like(height), within, BLUE, backend),
        level_lines(PRIOR, [1.0], backend),
        *_marks(name, backend),
        truth_line(name, truth, backend),
    ]
    top = diagonal_top(posterior, name)
    label = axis_label(name, prior)
    overlay = framed(parts, label, "relative to the prior", ends(edges), (0, top), backend)
    return ticked(overlay, name, edges, prior, backend)


def diagonal_top(posterior: Posterior, name: str) -> float:
    """Where the vertical axis of `diagonal` ends."""
    return nice_top(max(1.2, float(_heights(posterior, name)[0].max())))


def diagonal_columns(posterior: Posterior, name: str, truth: Truth | None = None) -> Columns:
    """New data of `diagonal`."""
    x = steps(np.asarray(posterior.grid[name]))
    height, within = _heights(posterior, name)
    zero = np.zeros(len(x))
    return {
        POSTERIOR: area_columns(x, zero, np.repeat(height, 2)),
        WITHIN: area_columns(x, zero, np.repeat(within, 2)),
        TRUTH: _truth_columns(name, truth),
    }


def pair(
    posterior: Posterior, x: str, y: str, prior: Prior, backend: Backend, truth: Truth | None = None
) -> hv.Overlay:
    """The regions of two parameters that hold 68 % and 95 % of the probability."""
    use(backend)
    xs, ys = np.asarray(posterior.grid[x]), np.asarray(posterior.grid[y])
    image = hv.Image(regions(posterior, x, y)[::-1], bounds=(xs[0], ys[0], xs[-1], ys[-1]), label=REGIONS)
    image = image.opts(cmap=PALETTE, clim=(0, 2), backend=backend)
    at = _pair_truth(x, y, truth)
    parts = [image, points(TRUTH, at["x"], at["y"], TRUTH_COLOUR, backend, size=11)]
    if x == "log10_rate":
        parts.append(upright("CDM", 0.0, backend))
    overlay = framed(parts, axis_label(x, prior), axis_label(y, prior), ends(xs), ends(ys), backend)
    return ticked(overlay, x, xs, prior, backend, y, ys)


def pair_columns(posterior: Posterior, x: str, y: str, truth: Truth | None = None) -> Columns:
    """New data of `pair`."""
    return {
        REGIONS: {"image": np.asarray([regions(posterior, x, y)])},
        TRUTH: _pair_truth(x, y, truth),
    }


def regions(posterior: Posterior, x: str, y: str) -> np.ndarray:
    """0 outside the 95 % region, 1 within it, 2 within the 68 % region; rows go up along `y`."""
    p = posterior.marginal(y, x)
    density = zoom(p, FINER, order=1, mode="nearest", grid_mode=True)
    flat = np.sort(density, axis=None)[::-1]
    held = np.cumsum(flat) / flat.sum()
    found = np.zeros(density.shape, np.float32)
    for level in LEVELS:
        found += density >= flat[min(int(np.searchsorted(held, level)), len(flat) - 1)]
    return found


def layout(posterior: Posterior, prior: Prior, backend: Backend, truth: Truth | None = None) -> hv.Layout:
    """The whole corner plot, for a file."""
    names = posterior.names
    parts: list[Any] = []
    for row, y in enumerate(names):
        for column, x in enumerate(names):
            if column == row:
                parts.append(diagonal(posterior, x, prior, backend, truth))
            elif column < row:
                parts.append(pair(posterior, x, y, prior, backend, truth))
            else:
                parts.append(hv.Empty())
    return hv.Layout(parts).cols(len(names)).opts(hv.opts.Layout(backend=backend))


def corner_table(posterior: Posterior) -> pd.DataFrame:
    """Probability of every cell, a row each: ends of the cell in every parameter, prior and posterior."""
    index = np.indices(posterior.p.shape).reshape(posterior.p.ndim, -1)
    columns: dict[str, np.ndarray] = {}
    for cell, (name, edges) in zip(index, posterior.grid.items(), strict=True):
        columns[f"{name}_low"], columns[f"{name}_high"] = edges[cell], edges[cell + 1]
    columns["prior"], columns["posterior"] = posterior.prior.ravel(), posterior.p.ravel()
    return pd.DataFrame(columns)


def _heights(posterior: Posterior, name: str) -> tuple[np.ndarray, np.ndarray]:
    edges = np.asarray(posterior.grid[name])
    height = posterior.marginal(name) / (np.diff(edges) / np.ptp(edges))
    return height, np.where(posterior.cells_within((name,), 0.68), height, 0.0)


def _marks(name: str, backend: Backend) -> list[hv.Element]:
    """Cold dark matter, where it has a place on the axis."""
    return [upright("CDM", 0.0, backend)] if name == "log10_rate" else []


def upright(label: str, x: float, backend: Backend) -> hv.Curve:
    """A grey upright line over the whole height."""
    return line(label, np.array([x, x]), np.array([-FAR, FAR]), GREY, backend)


def truth_line(name: str, truth: Truth | None, backend: Backend) -> hv.Curve:
    """Where the true value of a parameter is, if it is known."""
    columns = _truth_columns(name, truth)
    return line(TRUTH, columns["x"], columns["y"], TRUTH_COLOUR, backend)


def _truth_columns(name: str, truth: Truth | None) -> dict[str, np.ndarray]:
    x = truth[name] if truth else np.nan
    return {"x": np.array([x, x]), "y": np.array([0.0, FAR])}


def _pair_truth(x: str, y: str, truth: Truth | None) -> dict[str, np.ndarray]:
    at = (truth[x], truth[y]) if truth else (np.nan, np.nan)
    return {"x": np.array([at[0]]), "y": np.array([at[1]])}


def ends(edges: np.ndarray) -> tuple[float, float]:
    """First and last edge."""
    return float(edges[0]), float(edges[-1])


def ticked(
    overlay: hv.Overlay,
    name: str,
    edges: np.ndarray,
    prior: Prior,
    backend: Backend,
    y: str | None = None,
    y_edges: np.ndarray | None = None,
) -> hv.Overlay:
    """Ticks in the parameter's own unit; above a half-mode mass, the particle's mass."""
    choices: dict[str, Any] = {"xticks": ticks(name, edges, prior)}
    if y is not None and y_edges is not None:
        choices["yticks"] = [(at, text.replace("←", "↓")) for at, text in ticks(y, y_edges, prior)]
    if name == "log10_half_mode_mass":
        choices["hooks"] = [_wdm_axis]
    return overlay.opts(hv.opts.Overlay(**choices, backend=backend))


def _wdm_axis(plot: Any, _element: Any) -> None:
    """An axis above with the mass of warm dark matter's particle in keV."""
    places = [float(np.log10(half_mode_mass(kev))) for kev in KEV]
    if plot.renderer.backend == "bokeh":
        below = plot.state.below[0]
        if not plot.state.above:  # hooks run again whenever a figure is updated
            labels = {place: str(kev) for place, kev in zip(places, KEV, strict=True)}
            twin = type(below)(ticker=places, major_label_overrides=labels, axis_label="warm particle (keV)")
            plot.state.add_layout(twin, "above")
        return
    axis = plot.handles["axis"].secondary_xaxis("top")
    axis.set_xticks(places, [str(kev) for kev in KEV])
    axis.set_xlabel("m_WDM (keV)")
