"""Σ ln B against the number of bins: the plain sum, all bins together, and the paper's (paper table 1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig
from streamdash.naming import class_colour, class_names, model_labels
from streamdash.plots.elements import error_bars, framed, level_lines, line, nice_top, points
from streamdash.plots.live import Backend, use
from streamdash.plots.style import INK
from streamdash.statistics.cumulative import paper_value
from streamdash.words import number_of

Tables = Sequence[dict[str, Any]]
"""Result of `streamdash.statistics.cumulative.cumulative_tables`."""

UNRESOLVED = " (not all components resolved)"
"""Said of evidence from all bins together when some components have too few streams in common."""


def draw(
    tables: Tables,
    fiducial: int,
    configs: Sequence[EnsembleConfig],
    backend: Backend,
    title: str = "",
    paper: bool = False,
) -> hv.Overlay:
    """Σ ln B for one fiducial against each other model, for several numbers of bins.

    Parameters
    ----------
    tables
        Cumulative evidence per number of bins.
    fiducial
        Number of the model the data are assumed to come from.
    configs
        Configurations of the classes, M0 first.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.
    title
    paper
        Whether the classes are the paper's two, so that its values can be shown (crosses).
    """
    use(backend)
    data = columns(tables, fiducial, paper)
    parts: list[hv.Element] = [level_lines("zero", [0.0], backend, dashed=False)]
    for j in rivals(tables, fiducial):
        colour = class_colour(j, configs)
        total, joint, bars = data[f"sum {j}"], data[f"joint {j}"], data[f"error {j}"]
        parts.append(error_bars(f"error {j}", bars["base"], bars["lower"], bars["upper"], colour, backend))
        parts.append(line(f"sum {j}", total["x"], total["y"], colour, backend))
        parts.append(points(f"dots {j}", total["x"], total["y"], colour, backend))
        parts.append(line(f"joint {j}", joint["x"], joint["y"], colour, backend, dashed=True))
        if paper:
            cross = data[f"paper {j}"]
            parts.append(_crosses(f"paper {j}", cross["x"], cross["y"], backend))
    ticks = [(place, str(table["n_bin"])) for place, table in enumerate(tables)]
    frame = ((-0.3, len(tables) - 0.7), y_frame(tables, fiducial, paper))
    overlay = framed(parts, "bins of Qρ", f"Σ ln B for M{fiducial}", *frame, backend, title)
    return overlay.opts(xticks=ticks, backend=backend)


def columns(tables: Tables, fiducial: int, paper: bool) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of the figure by element label and column name."""
    x = np.arange(len(tables), dtype=float)
    result: dict[str, dict[str, np.ndarray]] = {}
    for j in rivals(tables, fiducial):
        rows = [row(table, fiducial, j) for table in tables]
        total = np.array([r["sum"] for r in rows])
        error = np.array([r["error"] for r in rows])
        result[f"sum {j}"] = result[f"dots {j}"] = {"x": x, "y": total}
        result[f"joint {j}"] = {"x": x, "y": np.array([r["joint"] for r in rows])}
        result[f"error {j}"] = {"base": x, "lower": total - error, "upper": total + error}
        if paper:
            values = [paper_value(fiducial, j, table["n_bin"]) for table in tables]
            result[f"paper {j}"] = {"x": x, "y": np.array(values, dtype=float)}
    return result


def rivals(tables: Tables, fiducial: int) -> list[int]:
    """Models that a fiducial is compared with."""
    return [pair["j"] for pair in tables[0]["pairs"] if pair["i"] == fiducial]


def row(table: dict[str, Any], i: int, j: int) -> dict[str, Any]:
    """The row of a pair."""
    return next(pair for pair in table["pairs"] if (pair["i"], pair["j"]) == (i, j))


def y_frame(tables: Tables, fiducial: int, paper: bool) -> tuple[float, float]:
    """Range of Σ ln B shown; it moves in steps."""
    parts = columns(tables, fiducial, paper).values()
    values = np.concatenate([v for part in parts for name, v in part.items() if name not in ("x", "base")])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return (-nice_top(-low) if low < 0 else 0.0), nice_top(max(high, 1.0))


def table(tables: Tables, configs: Sequence[EnsembleConfig], paper: bool) -> pd.DataFrame:
    """All numbers of the cumulative evidence, one line per pair and number of bins."""
    lines, masses = [], class_names(configs)
    for entry in tables:
        for pair in entry["pairs"]:
            names = {
                "n_bin": entry["n_bin"],
                "fiducial": f"M{pair['i']}",
                "against": f"M{pair['j']}",
                "fiducial_mass_range_msun": masses[pair["i"]],
                "against_mass_range_msun": masses[pair["j"]],
            }
            numbers = {name: value for name, value in pair.items() if name not in ("i", "j", "paper")}
            published = {"paper": paper_value(pair["i"], pair["j"], entry["n_bin"])} if paper else {}
            lines.append({**names, **numbers, **published})
    return pd.DataFrame(lines)


def sentence(tables: Tables, fiducial: int, configs: Sequence[EnsembleConfig]) -> str:
    """What the table and figure of cumulative evidence say now, in words."""
    parts, labels = [], model_labels(configs)
    for j in rivals(tables, fiducial):
        name = labels[j]
        ends = [row(table, fiducial, j) for table in (tables[0], tables[-1])]
        if not all(end["n_kept"] for end in ends):
            parts.append(f"against {name} nothing can be compared at some N_bin")
            continue
        low, high = tables[0]["n_bin"], tables[-1]["n_bin"]
        parts.append(
            f"against {name} the plain sum goes from {ends[0]['sum']:z.1f} at {number_of(low, 'bin')} to "
            f"{ends[1]['sum']:z.1f} at {high}, all bins together from {_joint(ends[0])} to "
            f"{_joint(ends[1])}"
        )
    return (
        f"If the perturbers are {labels[fiducial]}: {'; '.join(parts)}. The plain sum counts correlated "
        "bins several times; all bins together do not. Both are the paper’s figure of merit, not the "
        f"probability of any data: it falls where the truth is broad. {_held_out_words(tables, fiducial)}"
    )


def _joint(pair: dict[str, Any]) -> str:
    """Evidence from all bins together, marked where it hangs on bins that the streams hardly fill."""
    return f"{pair['joint']:z.1f}{UNRESOLVED if pair['n_unresolved'] else ''}"


def _held_out_words(tables: Tables, fiducial: int) -> str:
    """What streams that were held out say at the number of bins nearest to 20."""
    table = min(tables, key=lambda t: abs(t["n_bin"] - 20))
    parts = [
        f"{share(pair)} are put right against M{pair['j']} (ln likelihood ratio {pair['ln_ratio']:z.1f}, "
        f"{pair['ln_ratio_low']:z.1f} to {pair['ln_ratio_high']:z.1f})"
        for pair in table["pairs"]
        if pair["i"] == fiducial
    ]
    return f"Of held-out streams of M{fiducial}, {' and '.join(parts)} at N_bin = {table['n_bin']}."


def share(pair: dict[str, Any]) -> str:
    """Share of held-out streams put right, with its 68 % interval."""
    low, high = 100 * pair["right_low"], 100 * pair["right_high"]
    return f"{100 * pair['right']:.1f} % ({low:.2f} to {high:.2f})"


def _crosses(label: str, x: np.ndarray, y: np.ndarray, backend: Backend) -> hv.Scatter:
    crosses = hv.Scatter((x, y), "x", "y", label=label)
    if backend == "matplotlib":
        return crosses.opts(color=INK["light"], marker="x", s=40, backend=backend)
    return crosses.opts(line_color=INK["light"], marker="x", size=11, line_width=2, backend=backend)
