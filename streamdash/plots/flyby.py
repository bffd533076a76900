"""Single fly-bys: the kick along the stream, the gap opening frame by frame, and what is seen today."""

from __future__ import annotations

from typing import Any

import holoviews as hv
import numpy as np
import xarray as xr

from streamdash.config import StreamModel
from streamdash.engine.flyby import Film, Flyby, kick_along_stream
from streamdash.engine.geometry import Geometry
from streamdash.plots.elements import framed, level_lines, line, nice_top, points
from streamdash.plots.live import Backend, use
from streamdash.plots.style import HAND, INK, coordinate_label, rising_alpha
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey.flyby import Scene, Seen, drops, make_film, see, struck

NOW, SMOOTH, STRUCK, STRIP, GAP, RAIN = "now", "smooth", "struck", "strip", "gap", "rain"
Rain = tuple[np.ndarray, np.ndarray]
"""Angles (n,) of random fly-bys, and (n_frames, n) how far each still is, see "
"`streamdash.survey.flyby.drops`."""
ALONG, ACROSS, TURN = "along", "across", "turn"
CLEAN, NOISY, ALONE = "clean", "noisy", "alone"
"""Labels of elements."""
HAND_COLOUR = HAND
"""The fly-by in hand; none of the classes' colours."""
GREY = "#808080"
ANGLE_LABEL = "θ∥, angle from the progenitor (rad)"
SHADE_TOP = 2.0
"""Density of the darkest shade."""
TALL = 100.0
"""Height of the shade: beyond every axis."""
Q_TOP = 4.0
"""Highest end of an axis of Qρ; what piles up beyond it is cut."""


# ---------------------------------------------------------------- figures from nothing


def film_figure(
    cache: Cache,
    scene: Scene,
    frame: int = -1,
    stream: StreamModel | None = None,
    backend: Backend = "matplotlib",
) -> hv.Layout:
    """One frame of the film: the density along the stream, and relative to the smooth stream."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    shown = make_film(geometry, scene)
    marks = struck(geometry, scene.flybys, shown.time_gyr)
    # Plot
    return film_layout(shown, marks, frame, backend, rain_of(geometry, scene, shown))


def kick_figure(
    cache: Cache, flyby: Flyby, stream: StreamModel | None = None, backend: Backend = "matplotlib"
) -> hv.Layout:
    """Velocity and frequency kick of one fly-by along the stream."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    kick = kick_along_stream(geometry, flyby)
    # Plot
    return kick_layout(kick, backend)


def seen_figure(
    cache: Cache,
    scene: Scene,
    noise: float,
    stream: StreamModel | None = None,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """Today's Qρ along Galactic longitude with and without shot noise."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    seen = see(geometry, scene, noise)
    # Plot
    return draw_seen(seen, backend)


def rain_of(geometry: Geometry, scene: Scene, shown: Film) -> Rain:
    """Where the random fly-bys of a scene pass, and how far each still is in every frame."""
    impacts = scene.random(geometry)
    return np.asarray(impacts.theta), drops(impacts, shown.time_gyr)


# ---------------------------------------------------------------- plot


def film_frames(
    shown: Film, marks: np.ndarray, rain: Rain | None = None
) -> dict[tuple[str, str], np.ndarray]:
    """What changes from frame to frame: element label and column → values of every frame."""
    falling = {} if rain is None else {(RAIN, "y"): film_tops(shown)[0] * rain[1]}
    return {
        **falling,
        (STRIP, "image"): np.minimum(shown.density, SHADE_TOP),
        (NOW, "y"): shown.density,
        (SMOOTH, "y"): shown.smooth,
        (STRUCK, "x"): marks,
        (GAP, "y"): shown.q_rho,
    }


def film_tops(shown: Film) -> tuple[float, float]:
    """Upper ends of the axes of ρ and of Qρ that hold all frames."""
    q = shown.q_rho
    return nice_top(float(shown.density.max())), min(nice_top(float(np.nanmax(q))), Q_TOP)


def draw_density(
    shown: Film, marks: np.ndarray, frame: int, backend: Backend, rain: Rain | None = None
) -> hv.Overlay:
    """ρ and ρ̄ at one moment, and random fly-bys as drops that fall until they pass."""
    use(backend)
    ink = INK["light"]
    parts = [
        _shade(shown, frame, backend),
        line(SMOOTH, shown.theta, shown.smooth[frame], GREY, backend, dashed=True),
        line(NOW, shown.theta, shown.density[frame], ink, backend),
        points(STRUCK, marks[frame], _mark_heights(shown, marks), HAND_COLOUR, backend, size=10),
    ]
    top = film_tops(shown)[0]
    if rain is not None:
        parts.append(points(RAIN, rain[0], top * rain[1][frame], GREY, backend, size=8))
    end = float(shown.theta[-1])
    overlay = framed(parts, ANGLE_LABEL, "ρ (1: near the progenitor)", (0, end), (0, top), backend)
    return _lower(overlay, backend)


def density_columns(
    shown: Film, marks: np.ndarray, frame: int, rain: Rain | None = None
) -> dict[str, dict[str, Any]]:
    """Arrays of `draw_density`, for `LiveFigure.patch`."""
    falling = {} if rain is None else {RAIN: {"x": rain[0], "y": film_tops(shown)[0] * rain[1][frame]}}
    return {
        **falling,
        STRIP: {"image": [shade(shown, frame)]},
        NOW: {"x": shown.theta, "y": shown.density[frame]},
        SMOOTH: {"x": shown.theta, "y": shown.smooth[frame]},
        STRUCK: {"x": marks[frame], "y": _mark_heights(shown, marks)},
    }


def shade(shown: Film, frame: int) -> np.ndarray:
    """The one row (1, n_theta) of the image behind `draw_density`."""
    return np.minimum(shown.density[frame], SHADE_TOP)[None, :]


def draw_gap(shown: Film, frame: int, backend: Backend) -> hv.Overlay:
    """Qρ at one moment."""
    use(backend)
    parts = [
        level_lines("one", [1.0], backend),
        line(GAP, shown.theta, shown.q_rho[frame], INK["light"], backend),
    ]
    end = float(shown.theta[-1])
    overlay = framed(parts, ANGLE_LABEL, "Qρ = ρ / ρ̄", (0, end), (0, film_tops(shown)[1]), backend)
    return _lower(overlay, backend)


def film_layout(
    shown: Film, marks: np.ndarray, frame: int, backend: Backend, rain: Rain | None = None
) -> hv.Layout:
    """One frame for a file."""
    parts = [draw_density(shown, marks, frame, backend, rain), draw_gap(shown, frame, backend)]
    title = f"{shown.time_gyr[frame]:.2f} Gyr before today"
    parts = [part.opts(hv.opts.Overlay(title=title, backend=backend)) for part in parts]
    return hv.Layout(parts).cols(2).opts(sublabel_format="", hspace=0.3, backend="matplotlib")


def draw_kick(kick: xr.Dataset, backend: Backend) -> hv.Overlay:
    """Velocity kick along the stream (km/s)."""
    use(backend)
    data = kick_columns(kick)
    parts = [
        level_lines("zero", [0.0], backend, dashed=False),
        line(ACROSS, data[ACROSS]["x"], data[ACROSS]["y"], GREY, backend, dashed=True),
        line(ALONG, data[ALONG]["x"], data[ALONG]["y"], HAND_COLOUR, backend),
    ]
    x, y = kick_frame(kick)[0]
    return _lower(framed(parts, "θ∥ then (rad)", "δv (km/s)", x, y, backend), backend)


def draw_turn(kick: xr.Dataset, backend: Backend) -> hv.Overlay:
    """Change of parallel frequency along the stream (rad/Gyr)."""
    use(backend)
    data = kick_columns(kick)[TURN]
    parts = [
        level_lines("zero", [0.0], backend, dashed=False),
        line(TURN, data["x"], data["y"], HAND_COLOUR, backend),
    ]
    x, y = kick_frame(kick)[1]
    return _lower(framed(parts, "θ∥ then (rad)", "δΩ∥ (rad/Gyr)", x, y, backend), backend)


def kick_layout(kick: xr.Dataset, backend: Backend) -> hv.Layout:
    """Both kicks for a file."""
    parts = [draw_kick(kick, backend), draw_turn(kick, backend)]
    return hv.Layout(parts).cols(2).opts(sublabel_format="", hspace=0.3, backend="matplotlib")


def kick_columns(kick: xr.Dataset) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of both kick figures, for `LiveFigure.patch`."""
    names = {ALONG: "dv_along", ACROSS: "dv_across", TURN: "d_omega"}
    return {label: {"x": kick.theta.values, "y": kick[name].values} for label, name in names.items()}


def kick_columns_of(kick: xr.Dataset, *labels: str) -> dict[str, dict[str, np.ndarray]]:
    """Those of `kick_columns` that belong to one figure."""
    return {label: columns for label, columns in kick_columns(kick).items() if label in labels}


def kick_frame(kick: xr.Dataset) -> tuple[tuple, tuple]:
    """Axes (x, y) of the velocity and of the frequency kick."""
    x = (0.0, float(kick.theta[-1]))
    dv = nice_top(max(float(np.abs(kick.dv_along).max()), float(kick.dv_across.max())))
    turn = nice_top(float(np.abs(kick.d_omega).max()))
    return (x, (-dv, dv)), (x, (-turn, turn))


def draw_seen(seen: Seen, backend: Backend) -> hv.Overlay:
    """Qρ per bin of longitude: with noise as dots, without as a line, the fly-by in hand alone dashed."""
    use(backend)
    parts = [
        level_lines("one", [1.0], backend),
        points(NOISY, seen.position, seen.noisy, GREY, backend, size=4),
        line(CLEAN, seen.position, seen.clean, INK["light"], backend),
        line(ALONE, seen.position, seen.alone, HAND_COLOUR, backend, dashed=True),
    ]
    x = (float(seen.position.min()), float(seen.position.max()))
    return framed(parts, coordinate_label(seen.coordinate), "Qρ = ρ / ρ̄", x, seen_range(seen), backend)


def seen_range(seen: Seen) -> tuple[float, float]:
    """Ends of the axis of Qρ."""
    return -0.5, min(nice_top(max(2.0, float(seen.clean.max()))), Q_TOP)


def seen_columns(seen: Seen) -> dict[str, dict[str, Any]]:
    """Arrays of `draw_seen`, for `LiveFigure.patch`."""
    values = {NOISY: seen.noisy, CLEAN: seen.clean, ALONE: seen.alone}
    return {label: {"x": seen.position, "y": y} for label, y in values.items()}


def _lower(overlay: hv.Overlay, backend: Backend) -> hv.Overlay:
    """Lower than other figures in the browser, so that several are in sight together."""
    return overlay if backend == "matplotlib" else overlay.opts(height=250, backend="bokeh")


def _mark_heights(shown: Film, marks: np.ndarray) -> np.ndarray:
    return np.full(marks.shape[1], 0.04 * film_tops(shown)[0])


def _shade(shown: Film, frame: int, backend: Backend) -> hv.Image:
    """The stream as it would look: the more stars, the darker (on a dark page: the lighter)."""
    half = 0.5 * (shown.theta[1] - shown.theta[0])
    bounds = (shown.theta[0] - half, 0, shown.theta[-1] + half, TALL)
    image = hv.Image(shade(shown, frame), bounds=bounds, kdims=["x", "y"], vdims=["shade"], label=STRIP)
    return image.opts(cmap=rising_alpha(highest=0.7), clim=(0, SHADE_TOP), backend=backend)
