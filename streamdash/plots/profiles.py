"""Profiles along the stream: all of an ensemble, a few highlighted, median and band (paper figs. 1–2).

Thousands of curves are drawn as an image of how many pass through each cell. Noise is added per bin
of the stream's description, whatever coordinate the profiles are drawn against.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig
from streamdash.naming import class_colours, class_labels, class_names
from streamdash.plots.live import TOOLS, Backend, area_columns, use
from streamdash.plots.style import INK, coordinate_label, rising_alpha
from streamdash.store.cache import Cache
from streamdash.streams import bin_text, longitude_symbol
from streamdash.survey.bands import Bands, compute, read_profiles
from streamdash.survey.observed import arm_keys
from streamdash.words import NEAR_PROGENITOR, PROGENITOR_WORDS

QUANTITY_LABELS = {
    "q_rho": "Qρ = ρ / ρ̄",
    "rho": "ρ (units of ρ̄ at the progenitor)",
    "omega": "⟨Ω∥⟩ (rad/Gyr)",
}
SHORT = {"q_rho": "Qρ", "rho": "ρ", "omega": "⟨Ω∥⟩"}
SMOOTH, MEDIAN, BAND_LABEL, HIGHLIGHTS, STREAMS = "smooth", "median", "band", "highlighted", "streams"
"""Labels of a panel's elements."""


def profiles_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    quantity: str = "q_rho",
    coordinate: str = "ell",
    noise: float = 0.0,
    highlight: int = 3,
    seed: int = 0,
    backend: Backend = "matplotlib",
    scale: str = "shared",
) -> hv.Layout:
    """One panel per ensemble: all profiles, some highlighted, median, 68 % band, smooth stream.

    Parameters
    ----------
    cache
        Where the ensembles and the stream's geometry are.
    ensembles
        Keys or configurations, lowest masses first; two keys joined by ``+`` are both arms.
    quantity
        ``q_rho``, ``rho`` or ``omega``.
    coordinate
        ``theta``, ``ell`` or the longitude of the stream's frame, such as ``phi1``.
    noise
        Shot noise σ_ε per bin; it does not act on ``omega``.
    highlight, seed
        How many random streams to highlight, and the seed that picks them.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.
    scale
        Vertical scale, one of `streamdash.survey.bands.SCALES`.

    Returns
    -------
    holoviews.Layout
    """
    # Collect
    profiles = read_profiles(cache, ensembles, quantity)
    # Compute
    numbers = [i for i, ensemble in enumerate(ensembles) for _ in arm_keys(ensemble)]
    panels = [
        compute(binned, i, coordinate, noise, highlight, seed, scale)
        for i, binned in zip(numbers, profiles, strict=True)
    ]
    # Plot
    return layout(panels, backend)


# ---------------------------------------------------------------- plot


def layout(panels: Sequence[Bands], backend: Backend, colour: str = "") -> hv.Layout:
    """All panels, two in a row, in the colours of their classes unless there is one for all."""
    told = zip(panels, names(panels), colours(panels), strict=True)
    figure = hv.Layout([draw(p, backend, name, colour or own) for p, name, own in told]).cols(2)
    if backend == "matplotlib":
        return figure.opts(sublabel_format="", hspace=0.3, vspace=0.2, backend=backend)
    return figure


def names(panels: Sequence[Bands]) -> list[str]:
    """Name of each panel's class, with its number among those compared."""
    labels = class_labels([panel.config for panel in panels])
    several = len({panel.config.stream.arm for panel in panels}) > 1
    arms = [f", {panel.config.stream.arm} arm" if several else "" for panel in panels]
    return [f"M{p.index} · {label}{arm}" for p, label, arm in zip(panels, labels, arms, strict=True)]


def colours(panels: Sequence[Bands]) -> list[str]:
    """Colour of each panel's class among those compared; both arms of a class have one."""
    classes = {panel.index: panel.config for panel in panels}
    by_index = dict(zip(classes, class_colours(list(classes.values())), strict=True))
    return [by_index[panel.index] for panel in panels]


def draw(panel: Bands, backend: Backend, title: str = "", colour: str = "") -> hv.Overlay:
    """Declare one panel; in the browser its data are then replaced by `columns`.

    The title stands in files only: on the page it is the figure's heading. The colour is that of
    the class where it stands alone, unless given.
    """
    use(backend)
    x_name, y_name = panel.coordinate, panel.quantity
    x = hv.Dimension(x_name, label=x_name)
    y = hv.Dimension(y_name, label=y_name)
    data = columns(panel)
    image = hv.Image(panel.image[::-1], bounds=panel.extent, kdims=[x, y], vdims=["shade"], label=STREAMS)
    band = hv.Area((panel.x, panel.low, panel.high), x, ["low", "high"], label=BAND_LABEL)
    smooth = hv.Curve((panel.x, panel.smooth), x, y, label=SMOOTH)
    median = hv.Curve(data[MEDIAN], x_name, [y_name, "low", "high", "smooth"], label=MEDIAN)
    chosen = hv.Curve(data[HIGHLIGHTS], x_name, [y_name, "stream", "impacts"], label=HIGHLIGHTS)
    # Not by group and label: a specification that fits nothing is ignored without a word.
    styles = _styles(panel, backend, title, colour or class_colours([panel.config])[0])
    parts = [image, band, chosen, smooth, median]
    overlay = hv.Overlay([part.opts(backend=backend, **styles[part.label]) for part in parts])
    return overlay.opts(backend=backend, **styles["frame"])


def columns(panel: Bands) -> dict[str, dict[str, Any]]:
    """A panel's arrays by element label and column name, for `LiveFigure.patch`."""
    x_name, y_name = panel.coordinate, panel.quantity
    length = len(panel.x) + 1  # a NaN after each profile lifts the pen
    lines = np.full((len(panel.streams), length), np.nan)
    lines[:, :-1] = panel.highlighted
    return {
        STREAMS: {"image": [panel.image]},
        BAND_LABEL: area_columns(panel.x, panel.low, panel.high),
        SMOOTH: {x_name: panel.x, y_name: panel.smooth},
        MEDIAN: {
            x_name: panel.x,
            y_name: panel.median,
            "low": panel.low,
            "high": panel.high,
            "smooth": panel.smooth,
        },
        HIGHLIGHTS: {
            x_name: np.tile(np.append(panel.x, np.nan), len(panel.streams)),
            y_name: lines.ravel(),
            "stream": np.repeat(panel.streams, length).astype(np.int32),
            "impacts": np.repeat(panel.impacts, length).astype(np.int32),
        },
    }


def scale_label(panel: Bands) -> str:
    """Label of the vertical axis."""
    label = QUANTITY_LABELS[panel.quantity]
    short = SHORT[panel.quantity]
    return {"log": f"log₁₀ {short}", "residual": f"{short} − median of the class"}.get(panel.scale, label)


def _styles(panel: Bands, backend: Backend, title: str, colour: str) -> dict[str, dict]:
    """HoloViews options of each element, by label, and of the ``frame``."""
    ink = INK["light"]
    shades = {"cmap": rising_alpha(), "clim": (0, 255)}
    left, low, right, high = panel.extent
    frame: dict[str, Any] = {
        "xlabel": coordinate_label(panel.coordinate),
        "ylabel": scale_label(panel),
        "xlim": (left, right),
        "ylim": (low, high),
        "show_legend": False,
    }
    if backend == "matplotlib":
        return {
            STREAMS: shades,
            BAND_LABEL: {"facecolor": colour, "alpha": 0.25, "linewidth": 0},
            HIGHLIGHTS: {"color": colour, "linewidth": 0.8},
            SMOOTH: {"color": ink, "linestyle": "--", "linewidth": 1},
            MEDIAN: {"color": ink, "linewidth": 1.6},
            "frame": {**frame, "title": title, "fig_inches": 5, "aspect": 1.8},
        }
    where = (coordinate_label(panel.coordinate), f"@{{{panel.coordinate}}}{{0.00}}")
    value = f"@{{{panel.quantity}}}{{0.000}}"
    return {
        STREAMS: shades,
        BAND_LABEL: {"color": colour, "alpha": 0.3, "line_alpha": 0},
        HIGHLIGHTS: {
            "color": colour,
            "line_width": 1.2,
            "tools": ["hover"],
            "hover_tooltips": [
                ("stream number", "@stream"),
                ("impacts", "@impacts"),
                where,
                (frame["ylabel"], value),
            ],
        },
        SMOOTH: {"color": ink, "line_dash": "dashed", "line_width": 1.5},
        MEDIAN: {
            "color": ink,
            "line_width": 2,
            "tools": ["hover"],
            "hover_mode": "vline",
            "hover_tooltips": [
                where,
                (f"median {frame['ylabel']}", value),
                ("68 % of streams", "@low{0.000} to @high{0.000}"),
                ("smooth stream", "@smooth{0.000}"),
            ],
        },
        "frame": {**frame, "responsive": True, "height": 330, **TOOLS},
    }


# ---------------------------------------------------------------- words and numbers


def table(panels: Sequence[Bands]) -> pd.DataFrame:
    """The numbers of a figure: per class and bin the quantiles, the smooth stream, the highlights."""
    parts = []
    masses = class_names([panel.config for panel in panels])
    several = len({panel.config.stream.arm for panel in panels}) > 1
    for panel, mass in zip(panels, masses, strict=True):
        part = {
            "model": f"M{panel.index}",
            "mass_range_msun": mass,
            **({"arm": panel.config.stream.arm} if several else {}),
            f"{panel.coordinate}_{'rad' if panel.coordinate == 'theta' else 'deg'}": panel.x,
            "smooth": panel.smooth,
            "quantile_16": panel.low,
            "median": panel.median,
            "quantile_84": panel.high,
        }
        # Numbered by rank: the numbers of the streams differ between classes.
        for rank, line in enumerate(panel.highlighted):
            part[f"highlight_{rank + 1}"] = line
            part[f"highlight_{rank + 1}_stream"] = panel.streams[rank]
            part[f"highlight_{rank + 1}_impacts"] = panel.impacts[rank]
        parts.append(pd.DataFrame(part))
    return pd.concat(parts, ignore_index=True)


def sentence(panels: Sequence[Bands]) -> str:
    """What the figure shows now, in words."""
    first = panels[0]
    quantities = {
        "q_rho": "density relative to the smooth stream, Qρ,",
        "rho": "density ρ",
        "omega": "mean parallel frequency ⟨Ω∥⟩",
    }
    axes = {"ell": "Galactic longitude ℓ", "theta": "parallel angle θ∥"}
    own = f"longitude {longitude_symbol(first.coordinate)} of the stream's own frame"
    noise = (
        f" with shot noise σ_ε = {first.noise:g} per {bin_text(first.config.stream)}"
        if first.quantity != "omega"
        else " (shot noise does not act on it)"
    )
    unit = " rad/Gyr" if first.quantity == "omega" else ""
    widths = []
    for panel, name in zip(panels, names(panels), strict=True):
        half = float(np.mean(panel.high - panel.low)) / 2
        widths.append(f"{name}: ±{half:.2g}{unit}")
    off = max(panel.off for panel in panels)
    scale = {"log": " Shown is log₁₀ of it.", "residual": " Shown is what is left after each class's median."}
    beyond = f" Up to {100 * off:.1f} % of the values of a class lie off the scale." if off >= 5e-4 else ""
    chosen = f" Coloured: {len(first.streams)} random streams of each class." if len(first.streams) else ""
    return (
        f"The {quantities[first.quantity]} along {axes.get(first.coordinate, own)}{noise}. "
        f"Half-width of the band that holds 68 % of the streams, averaged along the stream: "
        f"{'; '.join(widths)}.{scale.get(first.scale, '')}{beyond}{chosen} "
        f"Mind the end at θ∥ below about {NEAR_PROGENITOR:g}. {PROGENITOR_WORDS}"
    )
