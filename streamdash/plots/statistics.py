"""How much of the information on the mass each statistic keeps: figure, table and words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.naming import ACCENT
from streamdash.paper.statistics import PDF, POWER, PROFILE, Kept
from streamdash.plots.elements import GREY, framed, points
from streamdash.plots.live import TOOLS, Backend, use


def draw_statistics(rows: Sequence[Kept], backend: Backend) -> hv.Overlay:
    """Information on the class in bits per stream, one row per statistic, with its error."""
    use(backend)
    ordered = list(rows)[::-1]
    place = np.arange(len(ordered), dtype=float)
    bits = np.array([row.bits for row in ordered])
    errors = np.array([row.bits_error for row in ordered])
    possible = possible_bits(rows)
    ends = [np.array([[b - e, y], [b + e, y]]) for b, e, y in zip(bits, errors, place, strict=True)]
    bars = hv.Path(ends, label="errors").opts(color=GREY, backend=backend)
    limit = hv.Curve(([possible, possible], [-1.0, len(ordered)]), "x", "y", label="possible")
    limit = limit.opts(color=GREY, backend=backend)
    dots = points("bits", bits, place, ACCENT, backend, size=9)
    low = max(0.0, float((bits - errors).min()) - 0.05 * possible)
    overlay = framed(
        [limit, bars, dots],
        "information on the mass range (bits per stream)",
        "",
        (low, 1.02 * possible),
        (-0.5, len(ordered) - 0.5),
        backend,
    )
    ticks = {"yticks": [(i, row.name) for i, row in enumerate(ordered)], "backend": backend}
    return overlay.opts(**(TOOLS if backend == "bokeh" else {}), **ticks)


def possible_bits(rows: Sequence[Kept]) -> float:
    """Bits that would be certainty."""
    return math.log2(rows[0].judged.probability.shape[1])


def statistics_table(rows: Sequence[Kept], labels: Sequence[str]) -> pd.DataFrame:
    """One row per statistic: accuracy, information, and ln B of every ordered pair of classes."""
    records = []
    for row in rows:
        values, errors = row.judged.scores.values, row.judged.scores.errors
        record = {
            "statistic": row.name,
            "n_features": len(row.judged.classifier.features.names),
            "n_test_streams": len(row.judged.y),
            "accuracy": values["overall_accuracy"],
            "accuracy_error": errors["overall_accuracy"],
            "information_bits": row.bits,
            "information_error_bits": row.bits_error,
        }
        for (i, j), found in sorted(row.evidence.items()):
            record[f"ln_bayes truth {labels[i]} against {labels[j]}"] = found.value
            record[f"unresolved truth {labels[i]} against {labels[j]}"] = found.n_unresolved
        records.append(record)
    return pd.DataFrame(records)


def statistics_sentence(rows: Sequence[Kept]) -> str:
    """What the comparison says, in words."""
    bits = {row.name: row for row in rows}
    possible = possible_bits(rows)
    shares = ", ".join(
        f"the {name} {bits[name].bits:.3f} ± {bits[name].bits_error:.3f}" for name in (PDF, POWER, PROFILE)
    )
    both = bits[f"{PDF} and {POWER}"]
    alone = max(bits[PDF].bits, bits[POWER].bits)
    more = both.bits - alone > 2 * both.bits_error
    together = (
        f"Together, PDF and power spectrum hold {both.bits:.3f}, "
        f"{'more' if more else 'not measurably more'} than the better of the two alone"
    )
    return (
        f"Of the {possible:.3f} bits that would be certainty, classifiers find in unseen streams: {shares}. "
        f"{together}. The evidence averages over the broad distributions of massive perturbers, which are a "
        f"poor bet even when true: its ln B may be small or negative where the classifier is sure."
    )
