"""Full range: what one stream tells on an excess of clusters, by its size and the noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.naming import CLASS_COLOURS
from streamdash.paper.full_range import SEEN
from streamdash.plots.elements import GREY, framed, line, points
from streamdash.plots.live import TOOLS, Backend, use

NOISE_COLOURS = CLASS_COLOURS[4:] + CLASS_COLOURS[2:4]
"""Of the lines of one noise each: none of a class that stands beside them."""


def draw_full_range(results: Mapping[str, Any], backend: Backend) -> hv.Overlay:
    """Information in bits per stream against the excess, one line a noise, with errors.

    Parameters
    ----------
    results : as `streamdash.paper.full_range.full_range_results` gives them.
    """
    use(backend)
    table = full_range_table(results)
    parts: list[hv.Element] = []
    for i, (noise, rows) in enumerate(table.groupby("noise", sort=False)):
        x, y = rows.excess.to_numpy(float), rows.information_bits.to_numpy(float)
        errors = rows.information_error_bits.to_numpy(float)
        ends = [np.array([[a, b - e], [a, b + e]]) for a, b, e in zip(x, y, errors, strict=True)]
        colour, label = NOISE_COLOURS[i % len(NOISE_COLOURS)], f"shot noise {noise:g}"
        dots = points(f"at {noise:g}", x, y, colour, backend).opts(show_legend=False, backend=backend)
        bars = hv.Path(ends, label=f"errors {noise:g}").opts(color=colour, show_legend=False, backend=backend)
        parts += [bars, line(label, x, y, colour, backend), dots]
    measured = sorted(set(table.excess))
    around = (measured[0] / 1.3, measured[-1] * 1.3)
    parts.append(line("half a bit", np.array(around), np.full(2, SEEN), GREY, backend, dashed=True))
    overlay = framed(
        parts,
        "excess of 10³–10⁵ M☉ clusters (times cold dark matter's number)",
        "information (bits per stream)",
        around,
        (0.0, 1.02),
        backend,
    )
    look = {"logx": True, "xticks": [(x, f"{x:g}") for x in measured], "show_legend": True}
    if backend == "bokeh":
        return overlay.opts(**look, **TOOLS, legend_position="top_left", backend=backend)
    return overlay.opts(hv.opts.Overlay(legend_position="top_left", backend=backend, **look))


def full_range_table(results: Mapping[str, Any]) -> pd.DataFrame:
    """One row per excess and noise: accuracy and information, all features and spectrum alone, and ln B."""
    records = []
    for row in results["rows"]:
        records.append(
            {
                "excess": row["excess"],
                "noise": row["noise"],
                "n_test_streams": row["n_test"],
                "accuracy": row["best"]["accuracy"],
                "accuracy_error": row["best"]["accuracy_error"],
                "information_bits": row["best"]["bits"],
                "information_error_bits": row["best"]["bits_error"],
                "spectrum_accuracy": row["spectrum"]["accuracy"],
                "spectrum_information_bits": row["spectrum"]["bits"],
                "ln_bayes_pdf_truth_cold": row["evidence"][0]["ln_b"],
                "ln_bayes_pdf_truth_excess": row["evidence"][1]["ln_b"],
                "ln_bayes_spectrum_truth_cold": row["spectrum_evidence"][0]["ln_b"],
                "ln_bayes_spectrum_truth_excess": row["spectrum_evidence"][1]["ln_b"],
            }
        )
    return pd.DataFrame(records)
