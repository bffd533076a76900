"""Guess the mass: the observed stream of one round, and the number that gives it away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import holoviews as hv
import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from streamdash.classifier.quiz import Clue, draw_rounds, find_clue, learn, quiz_split
from streamdash.config import EnsembleConfig
from streamdash.naming import class_colour, class_labels
from streamdash.observe.wording import percent
from streamdash.plots.elements import framed, level_lines, line, nice_top, points, step_line
from streamdash.plots.live import Backend, use
from streamdash.plots.style import INK, coordinate_label
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

OBSERVED, AVERAGED, TRUTH = "observed", "averaged", "truth {}"
"""Labels of a round's elements; one for each class's truth, of which at most one is shown."""
GREY = "#808080"
RANGE = (-1.0, 4.0)
CELLS = 40
"""Cells of a clue's histograms."""


@dataclass(frozen=True, eq=False)
class Round:
    """One stream to be guessed.

    Attributes
    ----------
    position : (n_bin,) array, deg
        Middle of every bin in `coordinate`.
    coordinate : str
    observed, clean : (n_bin,) arrays
        Qρ with and without noise.
    truth : int
        Its class.
    n_impacts : int
        How many objects hit it.
    names : tuple of str
        Mass range of each class.
    noise : float
    """

    position: np.ndarray
    coordinate: str
    observed: np.ndarray
    clean: np.ndarray
    truth: int
    n_impacts: int
    names: tuple[str, ...]
    noise: float


def quiz_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    noise: float,
    game: int,
    number: int,
    average: int = 1,
    reveal: bool = False,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """The stream of round ``number``, from 1; with ``reveal`` also without noise, in its class's colour."""
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    rows = draw_rounds(streams, quiz_split(streams), game)
    shown = make_round(streams, streams.observed(noise), int(rows[number - 1]), noise)
    # Plot
    return draw_round(shown, average, reveal, backend)


def clue_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    noise: float,
    game: int,
    number: int,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """What gives the stream of one round away."""
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    sets = quiz_split(streams)
    row = int(draw_rounds(streams, sets, game)[number - 1])
    clue = find_clue(learn(streams, sets, noise), streams.observed(noise)[row], int(streams.y[row]))
    # Plot
    return draw_clue(clue, streams.design.step, backend, class_labels(streams.configs))


def make_round(streams: ObservedStreams, observed: np.ndarray, row: int, noise: float) -> Round:
    """The stream of a row number of the pooled streams; ``observed`` are all of them with noise."""
    truth, index = (int(part) for part in streams.locate(np.array(row)))
    n_impacts = int(streams.n_impacts[truth][index]) if streams.n_impacts else 0
    names = tuple(class_labels(streams.configs))
    design = streams.design
    return Round(
        design.centers, design.coordinate, observed[row], streams.clean[row], truth, n_impacts, names, noise
    )


# ---------------------------------------------------------------- plot


def draw_round(shown: Round, average: int, reveal: bool, backend: Backend) -> hv.Overlay:
    """Dots as observed, a line averaged over bins, and once revealed the stream without noise."""
    use(backend)
    data = round_columns(shown, average, reveal)
    parts: list[hv.Element] = [
        level_lines("one", [1.0], backend),
        points(OBSERVED, data[OBSERVED]["x"], data[OBSERVED]["y"], GREY, backend, size=4),
        line(AVERAGED, data[AVERAGED]["x"], data[AVERAGED]["y"], INK["light"], backend),
    ]
    for i in range(len(shown.names)):
        label = TRUTH.format(i)
        parts.append(line(label, data[label]["x"], data[label]["y"], class_colour(i, shown.names), backend))
    x = (float(shown.position.min()), float(shown.position.max()))
    return framed(parts, coordinate_label(shown.coordinate), "Qρ = ρ / ρ̄", x, RANGE, backend)


def round_columns(shown: Round, average: int, reveal: bool) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of `draw_round`, for `LiveFigure.patch`."""
    nothing = np.full(len(shown.position), np.nan)
    averaged = uniform_filter1d(shown.observed, average, mode="nearest") if average > 1 else nothing
    values = {OBSERVED: shown.observed, AVERAGED: averaged}
    for i in range(len(shown.names)):
        values[TRUTH.format(i)] = shown.clean if reveal and i == shown.truth else nothing
    return {label: {"x": shown.position, "y": y} for label, y in values.items()}


def draw_clue(clue: Clue, degrees: float, backend: Backend, names: Sequence[str]) -> hv.Overlay:
    """How common the telling number is in each class, and what this stream has (the vertical line)."""
    use(backend)
    edges, heights = _histograms(clue)
    top = nice_top(float(heights.max()))
    parts: list[hv.Element] = [
        step_line(f"class {i}", edges, height, class_colour(i, names), backend)
        for i, height in enumerate(heights)
    ]
    parts.append(line("this", np.full(2, clue.value), np.array([0, top]), INK["light"], backend, dashed=True))
    label = clue_words(clue, degrees)
    overlay = framed(
        parts,
        label[0].upper() + label[1:],
        "share of streams",
        (float(edges[0]), float(edges[-1])),
        (0, top),
        backend,
    )
    return overlay if backend == "matplotlib" else overlay.opts(height=280, backend="bokeh")


def _histograms(clue: Clue) -> tuple[np.ndarray, np.ndarray]:
    values = np.concatenate([*clue.samples, [clue.value]])
    low, high = np.quantile(values, [0.002, 0.998])
    edges = np.linspace(min(low, clue.value), max(high, clue.value), CELLS + 1)
    return edges, np.array([np.histogram(x, edges)[0] / len(x) for x in clue.samples])


def _degrees(position: np.ndarray) -> float:
    """Width of a bin, deg."""
    return float(np.abs(np.diff(position)).mean())


# ---------------------------------------------------------------- words and numbers


def clue_words(clue: Clue, degrees: float) -> str:
    """Name of the telling number."""
    sizes = [f"{width * degrees:.1f}°" for width in clue.widths]
    if clue.kind == "ripple":
        return f"size of the ups and downs between {sizes[0]} and {sizes[1]} wide"
    smoothed = "bin by bin" if clue.widths == (1,) else f"averaged over {sizes[0]}"
    names = {
        "scatter": "scatter of Qρ",
        "deepest": "Qρ of the emptiest place",
        "highest": "Qρ of the densest place",
    }
    return f"{names[clue.kind]}, {smoothed}"


def clue_sentence(clue: Clue, shown: Round) -> str:
    """What gave the stream away."""
    usual = "; ".join(
        f"{low:.2g} to {high:.2g} for {name}"
        for name, (low, high) in zip(shown.names, clue.usual, strict=True)
    )
    sure = percent(float(clue.probability[shown.truth]))
    opening = (
        "What gave it away"
        if clue.probability[shown.truth] >= 0.75
        else "Nothing gave it away clearly; at best"
    )
    name = clue_words(clue, _degrees(shown.position))
    return (
        f"{opening}: the {name} is {clue.value:.2g}. Most streams (68 %) have {usual}. "
        f"From this number alone one could be {sure} sure of {shown.names[shown.truth]}."
    )


def round_sentence(shown: Round, number: int, rounds: int) -> str:
    """What the figure asks."""
    low, high = float(shown.observed.min()), float(shown.observed.max())
    return (
        f"Stream {number} of {rounds}, observed with shot noise σ_ε = {shown.noise:g} per bin: Qρ goes from "
        f"{low:.2f} to {high:.2f}. Single dots off by about σ_ε mean nothing; averages over many bins do."
    )


def truth_sentence(shown: Round, number: int, rounds: int) -> str:
    """What the figure shows once the truth is out."""
    pattern = float((shown.clean - 1).std())
    return (
        f"Stream {number} of {rounds} was hit by {shown.n_impacts} objects of {shown.names[shown.truth]}. "
        f"Without noise (coloured line) its Qρ scatters by {pattern:.2g}; one bin's noise is {shown.noise:g}."
    )


def round_table(shown: Round, reveal: bool) -> pd.DataFrame:
    """The stream's numbers; the ones without noise only once revealed."""
    table = pd.DataFrame({f"{shown.coordinate}_deg": shown.position, "q_rho_observed": shown.observed})
    return table.assign(q_rho=shown.clean) if reveal else table


def clue_table(clue: Clue, names: Sequence[str]) -> pd.DataFrame:
    """Histograms of the telling number."""
    edges, heights = _histograms(clue)
    columns = {f"share_{name}": height for name, height in zip(names, heights, strict=True)}
    return pd.DataFrame({"from": edges[:-1], "to": edges[1:], **columns})
