"""Figures of the story: the stream on the sky, one stream of each class, and pieces against noise."""

from __future__ import annotations

from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.engine.flyby import Film, Flyby, film, flyby_impacts
from streamdash.engine.geometry import Geometry
from streamdash.naming import class_colours
from streamdash.plots.elements import GREY, error_bars, framed, level_lines, line, nice_top, points
from streamdash.plots.flyby import HAND_COLOUR, draw_density
from streamdash.plots.live import Backend, use
from streamdash.plots.style import COORDINATE_LABELS, INK, coordinate_label
from streamdash.simulation.geometry import load_geometry
from streamdash.statistics.evidence import RULES, compare
from streamdash.store.cache import Cache
from streamdash.survey.design import Design
from streamdash.survey.flyby import struck
from streamdash.survey.observed import ObservedStreams
from streamdash.survey.story import Odds, Pieces, Track, deviations, odds, pieces, track

NOISE = "noise"
THIS = "this"
DOTS = 240
"""Dots that make up the stream on the sky."""
PAIR_RANGE = (-0.5, 3.0)
"""Axis of Qρ in `draw_pair`."""


# ---------------------------------------------------------------- figures from nothing


def track_figure(
    cache: Cache, stream: StreamModel | None = None, backend: Backend = "matplotlib"
) -> hv.Overlay:
    """The smooth stream on the sky."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    shown = track(geometry)
    # Plot
    return draw_track(shown, backend)


def gap_figure(
    cache: Cache, flyby: Flyby, stream: StreamModel | None = None, backend: Backend = "matplotlib"
) -> hv.Overlay:
    """Today's density along the stream after one fly-by."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    shown = two_frames(geometry, flyby)
    # Plot
    return draw_density(shown, struck(geometry, [flyby], shown.time_gyr), -1, backend)


def pair_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    number: int,
    noise: float = 0.0,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """Stream ``number`` of each ensemble."""
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    clean, noisy = pair(streams, number, noise)
    # Plot
    return draw_pair(streams.design, clean, noisy, noise, streams.configs, backend)


def pieces_figure(
    cache: Cache, ensembles: Sequence[str | EnsembleConfig], noise: float, backend: Backend = "matplotlib"
) -> hv.Overlay:
    """Deviation of pieces of the stream from the smooth one, beside the shot noise."""
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    shown = pieces([deviations(q) for q in streams.q], noise, streams.design.step)
    # Plot
    return draw_pieces(shown, streams.configs, backend)


def odds_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    noise: float,
    number: int,
    n_bin: int = 20,
    rules: str = "central",
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """How common the share of the stream near Qρ = 1 is in each class, and in one stream of the last."""
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    data = compare(streams.noisy(noise, 0), noise, n_bin, RULES[rules])
    at = data.bin_at(1.0)
    heavy = data.sorted_y[-1][at]
    value = float(heavy[np.random.default_rng(number).integers(len(heavy))])
    # Plot
    ends = [streams.configs[0], streams.configs[-1]]
    return draw_odds(odds(data.sorted_y[0][at], heavy), value, ends, backend)


def pair(streams: ObservedStreams, number: int, noise: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Stream ``number`` of each class (n_bin,), counted on from the first where there are fewer.

    Returns
    -------
    clean, noisy : lists of arrays, without noise and with it.
    """
    rows = [number % len(q) for q in streams.q]
    clean = [q[row] for q, row in zip(streams.q, rows, strict=True)]
    draws = [d[row] for d, row in zip(streams.draws, rows, strict=True)]
    return clean, [q + noise * d for q, d in zip(clean, draws, strict=True)]


def two_frames(geometry: Geometry, flyby: Flyby) -> Film:
    """The moment of a fly-by, and today."""
    return film(geometry, flyby_impacts(geometry, [flyby]), n_frames=2)


# ---------------------------------------------------------------- plot


def draw_track(shown: Track, backend: Backend) -> hv.Overlay:
    """The stream on the sky, thicker where there are more stars."""
    use(backend)
    table = track_table(shown).iloc[:: max(1, len(shown.ell) // DOTS)]
    columns = ["b", "density", "distance", "theta"]
    dots = hv.Scatter(table.set_axis(["ell", *columns], axis=1), "ell", columns, label="track")
    thickness = hv.dim("density")
    if backend == "matplotlib":
        dots = dots.opts(s=8 + 60 * thickness, color=GREY, backend=backend)
    else:
        tips = [
            ("ℓ, latitude", "@ell{0.0}°, @b{0.0}°"),
            ("distance", "@distance{0.0} kpc"),
            ("θ∥", "@theta{0.00} rad"),
            ("ρ̄", "@density{0.00}"),
        ]
        dots = dots.opts(
            size=2 + 10 * thickness, color=GREY, tools=["hover"], hover_tooltips=tips, backend=backend
        )
    start = points("progenitor", shown.ell[:1], shown.b[:1], HAND_COLOUR, backend, size=16)
    pad = 3.0
    x = (float(shown.ell.min()) - pad, float(shown.ell.max()) + pad)
    y = (float(shown.b.min()) - pad, float(shown.b.max()) + pad)
    return framed([dots, start], COORDINATE_LABELS["ell"], "Galactic latitude (deg)", x, y, backend)


def draw_pair(
    design: Design,
    clean: Sequence[np.ndarray],
    noisy: Sequence[np.ndarray],
    noise: float,
    classes: Sequence[EnsembleConfig],
    backend: Backend,
) -> hv.Overlay:
    """One stream of each class: a line without noise, dots with noise if there is any."""
    use(backend)
    data, colours = pair_columns(design, clean, noisy, noise), class_colours(classes)
    parts: list[hv.Element] = [level_lines("one", [1.0], backend)]
    for i in range(len(clean)):
        dots, curve = data[f"noisy {i}"], data[f"clean {i}"]
        parts.append(points(f"noisy {i}", dots["x"], dots["y"], colours[i], backend, size=4))
        parts.append(line(f"clean {i}", curve["x"], curve["y"], colours[i], backend))
    x = (float(design.centers.min()), float(design.centers.max()))
    return framed(parts, coordinate_label(design.coordinate), "Qρ = ρ / ρ̄", x, PAIR_RANGE, backend)


def pair_columns(
    design: Design, clean: Sequence[np.ndarray], noisy: Sequence[np.ndarray], noise: float
) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of `draw_pair`, for `LiveFigure.patch`."""
    found = {}
    for i, (q, dots) in enumerate(zip(clean, noisy, strict=True)):
        found[f"clean {i}"] = {"x": design.centers, "y": q}
        found[f"noisy {i}"] = {"x": design.centers, "y": dots if noise > 0 else np.full(len(q), np.nan)}
    return found


def draw_odds(shown: Odds, value: float, classes: Sequence[EnsembleConfig], backend: Backend) -> hv.Overlay:
    """How common each value is for two explanations, and the value that was found."""
    use(backend)
    data = odds_columns(shown, value)
    parts: list[hv.Element] = [
        line(f"class {i}", shown.value, density, colour, backend)
        for i, (density, colour) in enumerate(zip(shown.density, class_colours(classes), strict=True))
    ]
    parts.append(line(THIS, data[THIS]["x"], data[THIS]["y"], INK["light"], backend, dashed=True))
    x = (float(shown.value[0]), float(shown.value[-1]))
    top = nice_top(float(shown.density.max()))
    return framed(parts, "density of Qρ near 1", "how common", x, (0, top), backend)


def odds_columns(shown: Odds, value: float) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of `draw_odds`, for `LiveFigure.patch`."""
    top = nice_top(float(shown.density.max()))
    found = {f"class {i}": {"x": shown.value, "y": density} for i, density in enumerate(shown.density)}
    return {**found, THIS: {"x": np.full(2, value), "y": np.array([0.0, top])}}


def odds_table(shown: Odds) -> pd.DataFrame:
    """The numbers of `draw_odds`."""
    return pd.DataFrame({"density_near_1": shown.value, "first": shown.density[0], "last": shown.density[1]})


def draw_pieces(shown: Pieces, classes: Sequence[EnsembleConfig], backend: Backend) -> hv.Overlay:
    """Typical deviation of each class (bars: 68 % of the streams) and the noise, by length of the pieces."""
    use(backend)
    data = pieces_columns(shown)
    parts: list[hv.Element] = []
    for i, (bars, colour) in enumerate(zip(shown.deviation, class_colours(classes), strict=True)):
        parts.append(line(f"class {i}", shown.width, bars[1], colour, backend))
        parts.append(error_bars(f"bars {i}", shown.width, bars[0], bars[2], colour, backend))
    parts.append(line(NOISE, data[NOISE]["x"], data[NOISE]["y"], INK["light"], backend, dashed=True))
    overlay = framed(
        parts,
        "length of the pieces (deg)",
        "typical |Qρ - 1|",
        (0.75 * float(shown.width[0]), 1.3 * float(shown.width[-1])),
        (3e-3, 1.5),
        backend,
    )
    return overlay.opts(logx=True, logy=True, backend=backend)


def pieces_columns(shown: Pieces) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of `draw_pieces` that the noise changes, for `LiveFigure.patch`."""
    # A logarithmic axis has no zero.
    return {NOISE: {"x": shown.width, "y": np.maximum(shown.noise, 1e-9)}}


# ---------------------------------------------------------------- numbers


def track_table(shown: Track) -> pd.DataFrame:
    """The track's numbers."""
    return pd.DataFrame(
        {
            "ell_deg": shown.ell,
            "b_deg": shown.b,
            "smooth_density": shown.density,
            "distance_kpc": shown.distance,
            "theta_rad": shown.theta,
        }
    )


def pair_table(
    design: Design, clean: Sequence[np.ndarray], noisy: Sequence[np.ndarray], labels: Sequence[str]
) -> pd.DataFrame:
    """The numbers of `draw_pair`."""
    table = pd.DataFrame({f"{design.coordinate}_deg": design.centers})
    for label, q, dots in zip(labels, clean, noisy, strict=True):
        table[f"q_rho_{label}"] = q
        table[f"q_rho_noisy_{label}"] = dots
    return table


def pieces_table(shown: Pieces, labels: Sequence[str]) -> pd.DataFrame:
    """The numbers of `draw_pieces`."""
    table = pd.DataFrame({"length_deg": shown.width, "noise": shown.noise})
    for label, bars in zip(labels, shown.deviation, strict=True):
        for name, values in zip(("quantile_16", "median", "quantile_84"), bars, strict=True):
            table[f"{name}_{label}"] = values
    return table
