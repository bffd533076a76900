"""Lists of stars, counted in bins along the stream."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from streamdash.observe.table import ObservationError, Table, shown

if TYPE_CHECKING:
    from streamdash.observe.guess import Assumptions

COUNTS = "stars in the bin"
"""Name of the column that is made."""


def counted(
    table: Table, a: Assumptions, limits: tuple[float, float], notes: list[str]
) -> tuple[Table, Assumptions]:
    """Count the rows of a table in equal bins, which become the rows of another.

    Bins begin at the lower end of the simulated stretch, or of the list where that begins later, and go
    as far as both; a bin that would reach beyond the last star is not made, since stars farther out may
    not have been looked for.

    Parameters
    ----------
    table : rows are stars.
    a : with the width of the bins.
    limits : ends of the simulated stretch in the coordinate of the positions (deg).
    notes : what was done is added.

    Raises
    ------
    ObservationError
        When no whole bin fits.
    """
    assert a.bin is not None
    x = table.column(a.position)
    x = x - 360.0 * np.round((x - 0.5 * (limits[0] + limits[1])) / 360.0)
    start, stop = max(limits[0], x.min()), min(limits[1], x.max())
    n = int(np.floor((stop - start) / a.bin * (1 + 1e-9)))
    if n < 1:
        raise ObservationError(
            f"No bin of {a.bin:g}° fits between the stars of “{shown(a.position)}” and the simulated "
            f"stretch, {limits[0]:.1f}° to {limits[1]:.1f}°; choose narrower bins."
        )
    if n > len(table.values):
        raise ObservationError(f"Bins of {a.bin:g}° are more than there are stars; choose wider ones.")
    edges = start + a.bin * np.arange(n + 1)
    counts, _ = np.histogram(x, edges)
    notes.append(
        f"{counts.sum()} of {len(x)} rows were counted as stars in {n} bins of {a.bin:g}°; no background was "
        "taken off, and every star counts alike."
    )
    middles = 0.5 * (edges[1:] + edges[:-1])
    made = Table(
        (a.position, COUNTS) if a.position != COUNTS else (a.position, "stars"),
        np.stack([middles, counts], axis=1).astype(float),
        np.arange(1, n + 1),
        True,
        {},
    )
    as_counts = {"upper": None, "width": a.bin, "bin": None, "value": made.names[1], "kind": "counts"}
    errors = {"smooth": None, "error_kind": "poisson", "error": None, "undecided": ()}
    # Of stars the smooth number is never known: something is divided out.
    return made, a.model_copy(update={**as_counts, **errors, "order": max(a.order, 0)})
