"""Tables and text about the reproduction, rendered from its results and from nothing else."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any

from streamdash.statistics.evidence import jeffreys

COLUMNS = (
    "classes",
    "n_bin",
    "fiducial",
    "against",
    "sum",
    "method_error_16",
    "method_error_84",
    "sampling_error",
    "draw_error",
    "error",
    "word",
    "paper",
    "paper_word",
    "joint",
    "joint_word",
    "joint_is_resolved",
    "gaussian",
    "largest",
    "bins_kept",
)


def table_rows(results: dict[str, Any]) -> list[dict[str, Any]]:
    """Table 1 for the two and the three classes, one row per N_bin and ordered pair; see `COLUMNS`."""
    rows = []
    for name in ("two_classes", "three_classes"):
        labels = results[name]["labels"]
        for table in results[name]["tables"]:
            for pair in table["pairs"]:
                paper = pair.get("paper")
                values = (
                    name,
                    table["n_bin"],
                    labels[pair["i"]],
                    labels[pair["j"]],
                    pair["sum"],
                    pair["low"],
                    pair["high"],
                    pair["sampling_error"],
                    pair["draw_error"],
                    pair["error"],
                    pair["word"],
                    paper,
                    None if paper is None else jeffreys(paper),
                    pair["joint"],
                    pair["joint_word"],
                    pair["n_unresolved"] == 0,
                    pair["gaussian"],
                    pair["largest"],
                    pair["n_kept"],
                )
                rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def table_csv(results: dict[str, Any]) -> str:
    """Table 1 as CSV, all numbers of `table_rows`."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in table_rows(results):
        writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in row.items()})
    return buffer.getvalue()


def table_markdown(results: dict[str, Any]) -> str:
    """Table 1 as Markdown: sums with their sampling errors, the paper's numbers, all bins together."""
    parts = [pairs_markdown(results["two_classes"], ((0, 1), (1, 0)))]
    every = tuple((i, j) for i in range(3) for j in range(3) if i != j)
    parts.append(pairs_markdown(results["three_classes"], every))
    return "\n\n".join(parts) + "\n"


def pairs_markdown(part: dict[str, Any], pairs: Sequence[tuple[int, int]]) -> str:
    """One part's table: per ordered pair the sum, the paper's where there is one, and all bins together."""
    head = [str(table["n_bin"]) for table in part["tables"]]
    lines = [["N_bin", *head], ["---", *["---:"] * len(head)]]
    for i, j in pairs:
        rows = [next(p for p in t["pairs"] if (p["i"], p["j"]) == (i, j)) for t in part["tables"]]
        name = f"fiducial {part['labels'][i]}, against {part['labels'][j]}"
        lines.append([f"Σ ln B, {name}", *(f"{r['sum']:z.1f} ± {r['error']:.1f}" for r in rows)])
        if "paper" in rows[0]:
            lines.append(["the paper’s", *(f"{r['paper']:.1f}" for r in rows)])
        lines.append(["all bins together, correlations included", *(joint_text(r) for r in rows)])
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def joint_text(pair: dict[str, Any]) -> str:
    """Evidence from all bins together, marked where not all of its components are resolved."""
    if not pair["n_components"]:
        return "no overlap"
    return f"{pair['joint']:z.1f}{'*' if pair['n_unresolved'] else ''}"
