"""Cumulative evidence of every ordered pair of models for several N_bin: the paper's table 1, and more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from streamdash.statistics.evidence import (
    PAPER_N_BINS,
    PAPER_TABLE_1,
    Evidence,
    Rules,
    measure_evidence,
    measured_width,
)
from streamdash.statistics.evidence_growth import bootstrap
from streamdash.statistics.joint import joint_evidence
from streamdash.statistics.pdf import Pdfs, measure_pdfs

N_RESAMPLES = 40
"""Resamplings behind the sampling errors: they give each to within about 11 %."""


def cumulative_tables(
    profiles: Sequence[np.ndarray],
    noise: float,
    n_resamples: int = N_RESAMPLES,
    measured: bool = False,
    n_bins: Sequence[int] = PAPER_N_BINS,
    rules: Rules | None = None,
) -> list[dict[str, Any]]:
    """Σ ln B^{fid i}_ij of every ordered pair, with its errors and with correlations included.

    Parameters
    ----------
    profiles : sequence of ndarray (n_streams, n_longitudes)
        Qρ with noise, one array a model, lowest mass first.
    noise : float
        σ_ε that the profiles have.
    n_resamples : int
        Resamplings for the sampling errors.
    measured : bool
        Whether rule 1 takes the measured width of the lowest-mass PDF instead of σ_ε.
    n_bins : sequence of int
        Numbers of bins in Qρ, one table each.
    rules : Rules, optional

    Returns
    -------
    list of dict
        Per number of bins: ``n_bin``, ``range`` of Qρ, and ``pairs``: one dict per ordered pair
        with ``i`` (fiducial and numerator), ``j``, ``sum`` with its method error ``low``, ``high``,
        ``sampling_error``, ``largest`` of one bin, ``n_kept``, Jeffreys' ``word``; and from all bins
        together ``joint``, ``joint_low``, ``joint_high``, ``joint_word``, ``gaussian``,
        ``n_components``, ``n_unresolved`` (see `streamdash.statistics.joint`).
    """
    width = measured_width(profiles[0]) if measured else None
    tables = []
    for n_bin in n_bins:
        pdfs = measure_pdfs(profiles, n_bin)
        evidence = measure_evidence(pdfs, noise, rules, width=width)
        errors = bootstrap(pdfs, evidence, n_resamples)
        rows = [
            row
            for i in range(pdfs.n_models)
            for j in range(i + 1, pdfs.n_models)
            for row in _both_ways(pdfs, evidence, i, j, errors)
        ]
        rows.sort(key=lambda row: (row["i"], row["j"]))
        tables.append({"n_bin": n_bin, "range": [float(e) for e in pdfs.edges[[0, -1]]], "pairs": rows})
    return tables


def paper_value(i: int, j: int, n_bin: int) -> float | None:
    """The paper's Σ ln B^{fid i}_ij for its two classes; None for what is not in its table 1."""
    if (i, j) not in PAPER_TABLE_1 or n_bin not in PAPER_N_BINS:
        return None
    return PAPER_TABLE_1[i, j][PAPER_N_BINS.index(n_bin)]


def _both_ways(pdfs: Pdfs, evidence: Evidence, i: int, j: int, errors: np.ndarray) -> list[dict[str, Any]]:
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
                "sampling_error": float(errors[a, b]),
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
