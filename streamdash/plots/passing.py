"""Films of orbits: an object crossing the sky near a stream, and stars pulled forward and back."""

from __future__ import annotations

from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import StreamModel
from streamdash.engine.flyby import Flyby
from streamdash.plots.elements import GREY, framed, line, points
from streamdash.plots.flyby import HAND_COLOUR
from streamdash.plots.live import Backend, use
from streamdash.plots.style import INK
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey.passing import Passing, Pulled, passing, pulled

STARS, OBJECT = "stars", "object"
FREE, FORWARD, BACK = "free", "forward", "back"
PATH = "path of {}"
"""Labels of elements."""
BACK_COLOUR = "#7F6FC0"
PULLED_COLOURS = {FREE: INK["light"], FORWARD: HAND_COLOUR, BACK: BACK_COLOUR}
REACH = 35.0
"""How far the sky is shown around the stars that are hit (deg)."""


# ---------------------------------------------------------------- figures from nothing


def passing_figure(
    cache: Cache,
    flyby: Flyby,
    frame: int = -1,
    stream: StreamModel | None = None,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """One frame of an object passing the stream, on the sky."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    shown = passing(geometry, flyby)
    # Plot
    return draw_passing(shown, frame, backend)


def pulled_figure(
    cache: Cache,
    flyby: Flyby,
    frame: int = -1,
    stream: StreamModel | None = None,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """One frame of three stars that were at one place, one of them pulled forward, one held back."""
    # Collect
    geometry = load_geometry(stream or StreamModel(), cache)
    # Compute
    shown = pulled(geometry, flyby)
    # Plot
    return draw_pulled(shown, frame, backend)


# ---------------------------------------------------------------- plot


def draw_passing(shown: Passing, frame: int, backend: Backend) -> hv.Overlay:
    """Stars of the stream as dots, the object as a large one."""
    use(backend)
    data = {label: columns[frame] for label, columns in passing_frames(shown).items()}
    parts = [
        points(STARS, data[STARS, "x"], data[STARS, "y"], GREY, backend, size=4),
        points(OBJECT, data[OBJECT, "x"], data[OBJECT, "y"], HAND_COLOUR, backend, size=16),
    ]
    ends = (-REACH, REACH)
    return framed(parts, "along the stream (deg)", "across it (deg)", ends, (-REACH / 2, REACH / 2), backend)


def passing_frames(shown: Passing) -> dict[tuple[str, str], np.ndarray]:
    """What changes from frame to frame: element label and column → values of every frame."""
    return {
        (STARS, "x"): shown.along,
        (STARS, "y"): shown.across,
        (OBJECT, "x"): shown.object_along[:, None],
        (OBJECT, "y"): shown.object_across[:, None],
    }


def draw_pulled(shown: Pulled, frame: int, backend: Backend) -> hv.Overlay:
    """Three stars in the plane of their orbits, and the way they went."""
    use(backend)
    parts: list[hv.Element] = []
    for i, (label, colour) in enumerate(PULLED_COLOURS.items()):
        x, y = shown.place[:, i].T
        parts.append(line(PATH.format(label), x, y, colour, backend, dashed=True))
    for i, (label, colour) in enumerate(PULLED_COLOURS.items()):
        x, y = shown.place[frame, i]
        parts.append(points(label, np.array([x]), np.array([y]), colour, backend, size=15))
    reach = 1.08 * float(np.abs(shown.place).max())
    ends = (-reach, reach)
    overlay = framed(parts, "in the plane of the orbit (kpc)", "(kpc)", ends, ends, backend)
    return overlay if backend == "matplotlib" else overlay.opts(hooks=[_even_borders], backend="bokeh")


def _even_borders(plot: Any, element: Any) -> None:
    """As much beside the frame as above and below it: in a square figure both axes have one scale."""
    plot.state.update(min_border_left=80, min_border_right=20, min_border_top=30, min_border_bottom=70)


def pulled_frames(shown: Pulled) -> dict[tuple[str, str], np.ndarray]:
    """What changes from frame to frame: element label and column → values of every frame."""
    return {
        (label, column): shown.place[:, i, axis][:, None]
        for i, label in enumerate(PULLED_COLOURS)
        for axis, column in enumerate("xy")
    }


# ---------------------------------------------------------------- words and numbers


def passing_captions(shown: Passing) -> list[str]:
    """What is said of each frame."""
    return [
        "the fly-by"
        if abs(time) < 1e-9
        else f"{abs(time):.0f} million years {'before' if time < 0 else 'after'} the fly-by"
        for time in shown.time_myr
    ]


def passing_sentence(shown: Passing) -> str:
    """What the film shows."""
    speed = np.hypot(np.diff(shown.object_along), np.diff(shown.object_across)) / np.diff(shown.time_myr)
    middle = len(shown.time_myr) // 2
    return (
        "Seen from where the Sun is, with the stars that are hit kept in the middle: the object crosses the "
        f"stream at {speed[middle]:.2g}° per million years. Nothing is seen of it but what it leaves behind."
    )


def passing_table(shown: Passing) -> pd.DataFrame:
    """Where the object is in every frame."""
    return pd.DataFrame(
        {
            "myr_after_flyby": shown.time_myr,
            "along_deg": shown.object_along,
            "across_deg": shown.object_across,
        }
    )


def pulled_captions(shown: Pulled) -> list[str]:
    """What is said of each frame."""
    return [
        f"{1000 * time:.0f} million years: pulled forward, it is {ahead(lead)}"
        for time, lead in zip(shown.time_gyr, shown.lead[:, 0], strict=True)
    ]


def ahead(lead: float) -> str:
    """How far ahead of the star that was left alone, in words."""
    return "level" if abs(lead) < 0.05 else f"{abs(lead):.1f}° {'ahead' if lead > 0 else 'behind'}"


def pulled_table(shown: Pulled) -> pd.DataFrame:
    """Where the stars are in every frame."""
    table = pd.DataFrame({"gyr_after_pull": shown.time_gyr})
    for i, label in enumerate(PULLED_COLOURS):
        table[f"x_{label}_kpc"], table[f"y_{label}_kpc"] = shown.place[:, i].T
    return table.assign(lead_forward_deg=shown.lead[:, 0], lead_back_deg=shown.lead[:, 1])
