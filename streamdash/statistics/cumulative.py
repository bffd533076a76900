"""Cumulative evidence of every ordered pair of models for several N_bin: the paper's table 1, and more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from streamdash.statistics import held_out
from streamdash.statistics.evidence import (
    PAPER_N_BINS,
    PAPER_TABLE_1,
    Evidence,
    Rules,
    measured_evidence,
)
from streamdash.statistics.evidence_growth import CHECK_Y_BINS, bootstrap
from streamdash.statistics.joint import joint_evidence
from streamdash.statistics.pdf import Pdfs

N_RESAMPLES = 40
"""Resamplings behind the sampling errors: they give each to within about 11 %."""
N_REDRAWS = 6
"""Other draws of the noise behind the draw errors: they give each to within about 30 %."""

Redraw = Callable[[int], Sequence[np.ndarray]]
"""The same streams with other noise: from the number of the draw to profiles of every model."""


def cumulative_tables(
    profiles: Sequence[np.ndarray],
    noise: float,
    n_resamples: int = N_RESAMPLES,
    n_bins: Sequence[int] = PAPER_N_BINS,
    rules: Rules | None = None,
    redraw: Redraw | None = None,
) -> list[dict[str, Any]]:
    """Σ ln B^{fid i}_ij of every ordered pair, with its errors, and what held-out streams say.

    Parameters
    ----------
    profiles : sequence of ndarray (n_streams, n_longitudes)
        Qρ with noise, one array a model, lowest mass first.
    noise : float
        σ_ε that the profiles have.
    n_resamples : int
        Resamplings for the sampling errors.
    n_bins : sequence of int
        Numbers of bins in Qρ, one table each.
    rules : Rules, optional
    redraw : callable, optional
        Gives the profiles with other draws of their noise (0: the draw they have), for the scatter over
        draws; without it that part of the error is 0.

    Returns
    -------
    list of dict
        Per number of bins: ``n_bin``, ``range`` of Qρ, and ``pairs``: one dict per ordered pair
        with ``i`` (fiducial and numerator), ``j``, ``sum``, its ``error``, which is made of the
        ``sampling_error`` over streams, half the range ``low`` to ``high`` over numbers of bins in y,
        and the ``draw_error`` over draws of the noise; ``largest`` of one bin, ``n_kept``, Jeffreys'
        ``word``; from all bins together ``joint``, ``joint_low``, ``joint_high``, ``joint_word``,
        ``gaussian``, ``n_components``, ``n_unresolved`` (see `streamdash.statistics.joint`); and of
        held-out streams of i (`streamdash.statistics.held_out`) ``right``, the share put right, with
        ``right_low``, ``right_high``, and ``ln_ratio``, ``ln_ratio_low``, ``ln_ratio_high``.
    """
    rules = rules or Rules()
    few = replace(rules, y_bins=CHECK_Y_BINS)  # for scatters, which cost many evaluations
    draws = [redraw(number) for number in range(N_REDRAWS + 1)] if redraw and noise > 0 else []
    tables = []
    for n_bin in n_bins:
        pdfs, evidence = measured_evidence(profiles, noise, n_bin, rules)
        sampling = bootstrap(pdfs, evidence, n_resamples)
        drawn = [measured_evidence(part, noise, n_bin, few)[1] for part in draws]
        judged = held_out.pairs(profiles, n_bin)
        rows = []
        for i in range(pdfs.n_models):
            for j in range(i + 1, pdfs.n_models):
                for row in _both_ways(pdfs, evidence, i, j):
                    pair = row["i"], row["j"]
                    rows.append(row | _errors(row, float(sampling[pair]), drawn) | _held_out(judged[pair]))
        rows.sort(key=lambda row: (row["i"], row["j"]))
        tables.append({"n_bin": n_bin, "range": [float(e) for e in pdfs.edges[[0, -1]]], "pairs": rows})
    return tables


def paper_value(i: int, j: int, n_bin: int) -> float | None:
    """The paper's Σ ln B^{fid i}_ij for its two classes; None for what is not in its table 1."""
    if (i, j) not in PAPER_TABLE_1 or n_bin not in PAPER_N_BINS:
        return None
    return PAPER_TABLE_1[i, j][PAPER_N_BINS.index(n_bin)]


def _both_ways(pdfs: Pdfs, evidence: Evidence, i: int, j: int) -> list[dict[str, Any]]:
    """The rows of ln B_ij and of ln B_ji, each on its own fiducial."""
    # What is kept does not depend on which of the two is the fiducial.
    together = joint_evidence(pdfs.y[i], pdfs.y[j], evidence.kept(i, i, j))
    rows = []
    for (a, b), joint in zip(((i, j), (j, i)), together, strict=True):
        total = evidence.cumulative(a, a, b)
        rows.append(
            {
                "i": a,
                "j": b,
                "sum": total.value,
                "low": total.low,
                "high": total.high,
                "largest": total.largest,
                "n_kept": total.n_kept,
                "word": total.word,
                "joint": joint.value,
                "joint_low": joint.low,
                "joint_high": joint.high,
                "joint_word": joint.word,
                "gaussian": joint.gaussian,
                "n_components": joint.n_components,
                "n_unresolved": joint.n_unresolved,
            }
        )
    return rows


def _errors(row: dict[str, Any], sampling: float, drawn: Sequence[Evidence]) -> dict[str, float]:
    """The error of a sum and its parts; nothing to sum has none."""
    sums = [evidence.cumulative(row["i"], row["i"], row["j"]).value for evidence in drawn]
    draw = float(np.std(sums, ddof=1)) if sums else 0.0
    method = 0.5 * (row["high"] - row["low"])
    return {
        "sampling_error": sampling,
        "draw_error": draw,
        "error": float(np.sqrt(np.nan_to_num(sampling) ** 2 + method**2 + draw**2)),
    }


def _held_out(judged: held_out.HeldOut) -> dict[str, float]:
    low, middle, high = judged.quantiles
    share_low, share_high = judged.right_interval
    return {
        "right": judged.right,
        "right_low": share_low,
        "right_high": share_high,
        "ln_ratio": middle,
        "ln_ratio_low": low,
        "ln_ratio_high": high,
    }
