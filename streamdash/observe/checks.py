"""Checks of a measured profile's columns; each raises one sentence with line and column."""

from __future__ import annotations

import numpy as np

from streamdash.observe.guess import Assumptions, Kind
from streamdash.observe.names import is_right_ascension
from streamdash.observe.table import ObservationError, shown
from streamdash.words import is_or_are, number_of

RADIANS = 7.0
"""Positions that are all smaller than this are not degrees on the stream."""
DEGREES = frozenset({"", "deg", "degree", "degrees", "degr", "°"})
"""Units of positions that are read."""
N_SIGMA = 3.0
"""How far below zero, in errors, a measured density may lie."""


def check_positions(x: np.ndarray, lines: np.ndarray, name: str) -> None:
    """Positions must be finite, and degrees rather than right ascensions."""
    wrong = ~(np.abs(x) <= 1e6)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ObservationError(
            f"Line {lines[i]}, column “{shown(name)}”: {_said(x[i])} is not a position in degrees."
        )
    if is_right_ascension(name):
        raise ObservationError(
            f"Column “{shown(name)}” is a right ascension; give Galactic longitude l or, as the stream has "
            "it, φ1 or ξ instead."
        )


def check_unit(unit: str | None, name: str) -> None:
    """Positions must be in degrees, where the file states their unit."""
    if (unit or "").strip().lower() not in DEGREES:
        raise ObservationError(
            f"Column “{shown(name)}” is in {shown(unit or '')}; positions are given in degrees."
        )


def rising(x: np.ndarray, lines: np.ndarray, name: str, notes: list[str]) -> np.ndarray:
    """Rows in rising order of the position; each must be given once, in whatever order."""
    rows = np.argsort(x, kind="stable")
    repeated = np.flatnonzero(np.diff(x[rows]) == 0)
    if len(repeated):
        i = rows[int(repeated[0]) + 1]
        raise ObservationError(
            f"Line {lines[i]}, column “{shown(name)}”: {x[i]:g} is there twice; each bin must be given once."
        )
    steps = np.diff(x)
    if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
        notes.append(f"The rows were not in order of “{shown(name)}” and were sorted by it.")
    return rows


def inside_window(
    low: np.ndarray, high: np.ndarray, limits: tuple[float, float], a: Assumptions, words: str
) -> np.ndarray:
    """Which bins lie wholly within the simulated stretch, (n_rows,) of bool.

    Raises
    ------
    ObservationError
        When none does; with the likely reason.
    """
    slack = 1e-3
    inside = (low >= limits[0] - slack) & (high <= limits[1] + slack)
    if inside.any():
        np.clip(low, *limits, out=low, where=inside)
        np.clip(high, *limits, out=high, where=inside)
        return inside
    name = shown(a.position)
    span = f"“{name}” runs from {low.min():.4g} to {high.max():.4g}"
    wanted = f"{words} = {limits[0]:.1f}° to {limits[1]:.1f}°"
    if np.abs([low.min(), high.max()]).max() <= RADIANS:
        raise ObservationError(f"{span}, which looks like radians: give degrees, {wanted}.")
    if high.min() >= limits[0] and low.max() <= limits[1]:
        raise ObservationError(f"{span}, but no bin lies wholly within the simulated stretch, {wanted}.")
    other = "φ1" if a.coordinate == "ell" else "Galactic longitude l"
    raise ObservationError(
        f"{span} and does not overlap the simulated stretch, {wanted}; is it {other}, or a right ascension?"
    )


def check_values(
    value: np.ndarray, error: np.ndarray | None, lines: np.ndarray, name: str, kind: Kind, notes: list[str]
) -> None:
    """Values must be finite, and not negative beyond their errors; counts must be whole numbers."""
    column = f"column “{shown(name)}”"
    for wrong, words in (
        (~np.isfinite(value), "is not a finite number; write nan where there is no value"),
        ((value < 0) & (kind == "counts"), "is negative, and counts cannot be; choose another kind of value"),
        (
            (value != np.round(value)) & (kind == "counts"),
            "is not a whole number, and counts are; choose “linear density” if it is one",
        ),
        (
            value < -N_SIGMA * (error if error is not None else 0.0 * np.abs(value)),
            f"is negative by more than {N_SIGMA:g} errors, and a density cannot be",
        ),
    ):
        if wrong.any():
            i = int(np.argmax(wrong))
            raise ObservationError(f"Line {lines[i]}, {column}: {_said(value[i])} {words}.")
    if not (value > 0).any():
        raise ObservationError(f"No value of {column} is positive: there is no stream in it.")
    n_low = int(np.count_nonzero(value <= 0))
    if n_low:
        notes.append(
            f"{number_of(n_low, 'value')} of “{shown(name)}” {is_or_are(n_low)} zero or negative within the "
            "errors; kept."
        )


def check_errors(error: np.ndarray, lines: np.ndarray, name: str) -> None:
    """Errors must be positive numbers."""
    column = f"column “{shown(name)}”"
    if not np.any(error):
        raise ObservationError(
            f"All errors in {column} are zero; give one standard deviation per bin, or choose a constant "
            "error."
        )
    wrong = ~(np.isfinite(error) & (error > 0))
    if wrong.any():
        i = int(np.argmax(wrong))
        raise ObservationError(
            f"Line {lines[i]}, {column}: the error {_said(error[i])} is not a positive number; correct it, "
            "or write nan for the value to leave the bin out."
        )


def _said(value: float) -> str:
    return "an empty cell" if np.isnan(value) else f"{value:g}"
