"""What classifiers say of streams that were made otherwise: a row a setting, a colour a set of classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.classifier.other_streams import USUAL, chosen_rows
from streamdash.naming import CLASS_COLOURS
from streamdash.plots.elements import GREY, framed, points
from streamdash.plots.live import TOOLS, Backend, use
from streamdash.statistics.scores import share_interval

SET_COLOURS = CLASS_COLOURS[4:] + CLASS_COLOURS[2:4]
"""Of sets of classes: none that a usual class has."""


def draw_other_streams(results: Mapping[str, Any], groups: Sequence[str], backend: Backend) -> hv.Overlay:
    """Share put right in every setting of some groups, two classes and three, with 68 % intervals.

    Parameters
    ----------
    results : as `streamdash.classifier.other_streams.other_streams_results` gives them.
    groups : keys of `streamdash.classifier.other_streams.GROUPS`; the usual streams stand at the top.
    """
    use(backend)
    table = other_streams_table(results, groups)
    names = list(dict.fromkeys(table.streams))[::-1]
    parts: list[hv.Element] = []
    for i, (number, rows) in enumerate(table.groupby("n_classes", sort=True)):
        place = np.array([names.index(name) for name in rows.streams]) + 0.12 * (1 - 2 * i)
        x, colour, label = rows.accuracy.to_numpy(float), SET_COLOURS[i], f"{number} classes"
        ends = zip(rows.accuracy_low, rows.accuracy_high, place, strict=True)
        bars = hv.Path([np.array([[a, y], [b, y]]) for a, b, y in ends], label=f"intervals {number}")
        parts.append(bars.opts(color=colour, show_legend=False, backend=backend))
        parts.append(points(label, x, place, colour, backend, size=9))
        usual = float(rows.accuracy[rows.group == USUAL].iloc[0])
        line = hv.VLine(usual, label=f"usual {number}")
        parts.append(
            line.opts(color=GREY, line_dash="dashed", backend=backend)
            if backend == "bokeh"
            else line.opts(color=GREY, linestyle="dashed", backend=backend)
        )
    least = max(0.0, float(table.accuracy_low.min()) - 0.03)
    overlay = framed(parts, "Share that is right", "", (least, 1.01), (-0.6, len(names) - 0.4), backend)
    look = {"yticks": list(enumerate(names)), "show_legend": True}
    if backend == "bokeh":
        return overlay.opts(**look, **TOOLS, legend_position="bottom_left", backend=backend)
    return overlay.opts(hv.opts.Overlay(legend_position="bottom_left", backend=backend, **look))


def other_streams_table(results: Mapping[str, Any], groups: Sequence[str]) -> pd.DataFrame:
    """One row per setting and set of classes: shares put right with intervals, mean probability, Σ ln B."""
    records = []
    for row in chosen_rows(results, groups):
        n = results["n_streams"] * len(row["classes"])
        low, high = (float(end) for end in share_interval(row["accuracy"] * n, n))
        record = {
            "group": row["group"],
            "streams": row["label"],
            "n_classes": len(row["classes"]),
            "n_streams": n,
            "accuracy": row["accuracy"],
            "accuracy_low": low,
            "accuracy_high": high,
            "mean_probability": row["confidence"],
        }
        for label, found in zip(row["classes"], row["evidence"], strict=False):
            record |= {f"sum_ln_b_truth_{label}": found["sum"], f"error_{label}": found["error"]}
        records.append(record)
    return pd.DataFrame(records)
