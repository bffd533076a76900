"""A measured density profile of the stream: checked, cut to the simulated stretch, divided.

`read_observation` takes the bytes of a table and, optionally, what its columns are
(`streamdash.observe.guess.Assumptions`); what comes out has everything that simulated streams
need to be observed in the same way (`streamdash.survey.design.Design`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from streamdash.engine.geometry import Geometry
from streamdash.observe.checks import (
    RADIANS,
    check_errors,
    check_positions,
    check_unit,
    check_values,
    inside_window,
    rising,
)
from streamdash.observe.guess import ERROR_UNITS, KINDS, Assumptions, assume, open_questions
from streamdash.observe.names import other_side
from streamdash.observe.stars import counted
from streamdash.observe.table import ObservationError, Table, read_table, shown
from streamdash.survey.design import AS_IS, Design, Quantity, divisible, polynomial_fit, smooth_curve, window
from streamdash.survey.sky import coordinates, to_theta
from streamdash.words import NEAR_PROGENITOR, is_or_are, number_of

MIN_BINS = 8
"""Fewest bins a profile must have within the simulated stretch."""
MAX_BINS = 400
"""Most bins: simulated profiles are known at no more angles."""
GAP = 1.5
"""Neighbouring bins farther apart than this many usual spacings have a gap between them."""
NAMES = {"ell": "Galactic longitude l", "phi1": "φ1 of GD-1", "xi": "ξ from the progenitor"}


@dataclass(frozen=True, eq=False)
class Observation:
    """A measured profile, ready to be compared.

    Attributes
    ----------
    assumptions : Assumptions
        What the columns were taken to be.
    used : Assumptions
        The same for what was compared: of stars, for their counts.
    design : Design
        Bins and errors; all that simulated streams need to be observed alike.
    q : ndarray (n_bin,)
        The measured values, divided as the design says.
    notes : tuple of str
        What was left out or changed, one sentence each.
    n_rows : int
        Bins of the table, used or not.
    n_outside : int
        Bins beyond the simulated stretch of the stream.
    n_missing : int
        Bins within it that have no value.
    n_near : int
        Bins with a part nearer to the progenitor than `NEAR_PROGENITOR`.
    value, error : ndarray (n_bin,)
        The measured values before any division, and their errors; no error where it is relative to the
        smooth curve.
    """

    assumptions: Assumptions
    used: Assumptions
    design: Design
    q: np.ndarray
    notes: tuple[str, ...]
    n_rows: int
    n_outside: int
    n_missing: int
    n_near: int = 0
    value: np.ndarray | None = None
    error: np.ndarray | None = None

    @property
    def stated(self) -> tuple[str, ...]:
        """Every assumption in words, then the notes."""
        return (*in_words(self.used, self.design), *self.notes)


def read_observation(
    data: bytes, geometry: Geometry, assumptions: Assumptions | None = None
) -> tuple[Table, Observation]:
    """Read, check and interpret a table of a measured profile.

    Parameters
    ----------
    data : the bytes of the file, see `read_table`.
    geometry : of the stream that is simulated.
    assumptions : what the columns are; by default what `assume` says.

    Raises
    ------
    ObservationError
        In one sentence: what is wrong, in which line and column, and what to do.
    """
    table = read_table(data)
    return table, interpret(table, assumptions or assume(table), geometry)


@np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore")
def interpret(table: Table, assumptions: Assumptions, geometry: Geometry) -> Observation:
    """Turn a table into an observation, with stated assumptions.

    Raises
    ------
    Undecided
        When something must be chosen that the table does not decide.
    ObservationError
        In one sentence: what is wrong, in which line and column, and what to do.
    """
    a = assumptions
    notes = list(table.notes)
    check_positions(table.column(a.position), table.lines, a.position)
    check_unit(table.units.get(a.position), a.position)
    _ask(table, a, "bin", "coordinate")
    along = coordinates(geometry)
    if a.coordinate not in along:
        raise ObservationError(
            f"Column “{shown(a.position)}” is taken to be {NAMES[a.coordinate]}, which this stream does not "
            f"have; give {NAMES[along[0]]} or {NAMES[along[1]]}, or choose the stream that was measured."
        )
    limits = window(geometry, a.coordinate)
    if a.bin is not None:
        table, a = counted(table, a, limits, notes)
    rows = rising(table.column(a.position), table.lines, a.position, notes)
    low, high = _bins(table, a, rows, limits, notes)
    value, lines = table.column(a.value)[rows], table.lines[rows]
    inside = inside_window(low, high, limits, a, NAMES[a.coordinate])
    n_outside = int(np.count_nonzero(~inside))
    if n_outside:
        notes.append(
            f"{n_outside} of {number_of(len(low), 'row')} {'lies' if n_outside == 1 else 'lie'} outside the "
            "simulated stretch of the stream, "
            f"{NAMES[a.coordinate]} = {limits[0]:.1f}° to {limits[1]:.1f}°, and "
            f"{is_or_are(n_outside)} left out."
        )
    present = ~np.isnan(value)
    n_missing = int(np.count_nonzero(inside & ~present))
    if n_missing:
        notes.append(
            f"{number_of(n_missing, 'row')} {'has' if n_missing == 1 else 'have'} no value of "
            f"“{shown(a.value)}” and {is_or_are(n_missing)} "
            f"treated as {'a gap' if n_missing == 1 else 'gaps'}."
        )
    used = inside & present
    _check_count(int(used.sum()), n_outside)
    _ask(table, a, *a.undecided)
    rows, low, high, value, lines = rows[used], low[used], high[used], value[used], lines[used]
    relative, error = _values_and_errors(table, a, rows, high - low, notes)
    design, q = _design(a, low, high, relative, error, notes)
    other = other_side(a.error, table.names) if a.error else None
    named = f"mean of {a.error} and {other}" if other else a.error
    a = a.model_copy(update={"order": design.order, "error": named})
    ends = [to_theta(geometry, end, design.coordinate) for end in (design.low, design.high)]
    n_near = int(np.count_nonzero(np.min(ends, axis=0) < NEAR_PROGENITOR))
    counts = (len(present), n_outside, n_missing, n_near)
    return Observation(assumptions, a, design, q, tuple(notes), *counts, relative, error)


def cut(observation: Observation, bins: slice) -> Observation:
    """Some of the bins as if no others had been measured: divided by a polynomial of their own.

    Raises
    ------
    ObservationError
        In one sentence, when they are too few or cannot be divided.
    """
    low, high = observation.design.low[bins], observation.design.high[bins]
    if observation.value is None or len(low) < MIN_BINS:
        raise ObservationError(f"Half of the stretch has {len(low)} bins; at least {MIN_BINS} are needed.")
    value, notes = observation.value[bins], list(observation.notes)
    error = None if observation.error is None else observation.error[bins]
    used = observation.used.model_copy(update={"order": observation.assumptions.order})
    design, q = _design(used, low, high, value, error, notes)
    used = used.model_copy(update={"order": design.order})
    return replace(observation, used=used, design=design, q=q, notes=tuple(notes), value=value, error=error)


def _ask(table: Table, a: Assumptions, *fields: str) -> None:
    asked = open_questions(table, a, fields)
    if asked is not None:
        raise asked


def in_words(a: Assumptions, design: Design) -> list[str]:
    """What is assumed, one sentence for each assumption."""
    widths = design.high - design.low
    gaps = int(np.count_nonzero(design.low[1:] - design.high[:-1] > 1e-6))
    bins = f"{widths.min():.3g}°" if np.ptp(widths) < 1e-6 else f"{widths.min():.3g}° to {widths.max():.3g}°"
    how = (
        f"from “{shown(a.position)}” to “{shown(a.upper)}”"
        if a.upper
        else f"centred on “{shown(a.position)}”, as wide as {'stated' if a.width else 'their spacing'}"
    )
    sentences = [
        f"“{shown(a.position)}” is {NAMES[a.coordinate]} in degrees; {design.n_bin} bins of {bins}, {how}"
        f"{f', with {gaps} gaps' if gaps > 1 else ', with one gap' if gaps else ', without gaps'}.",
        f"“{shown(a.value)}” is {KINDS[a.kind]}"
        f"{f', divided by the smooth profile “{shown(a.smooth)}”' if a.smooth else ''}.",
    ]
    if a.kind == "detrended":
        order = f"The polynomial already divided out was of order {a.order}"
        sentences.append(f"{order}; the simulated densities are divided by one of that order.")
    elif a.order == AS_IS:
        sentences.append("Nothing is divided out: the values are compared as they are, level included.")
    elif a.order == 0:
        sentences.append("The overall level is unknown: data and simulations are divided by their mean.")
    else:
        sentences.append(
            "The smooth profile is unknown: data and simulations are divided by a polynomial of order "
            f"{a.order} fitted to each."
        )
    typical = f"typically {np.median(design.sigma):.2g} of the smooth curve"
    sentences.append(
        {
            "column": f"The error is “{shown(a.error or '')}”, one standard deviation "
            f"{ERROR_UNITS[a.error_unit]}: {typical}.",
            "constant": f"The error is taken to be {a.constant:g} of the smooth curve in every bin.",
            "poisson": f"The error is Poisson’s, the square root of the counts: {typical}.",
        }[a.error_kind]
    )
    return sentences


# ---------------------------------------------------------------- bins


def _bins(
    table: Table, a: Assumptions, rows: np.ndarray, limits: tuple[float, float], notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the bin of each row (deg), on the turn that the simulated stretch is on."""
    x = table.column(a.position)[rows]
    middle = 0.5 * (limits[0] + limits[1])
    turns = 360.0 * np.round((x.mean() - middle) / 360.0) if np.abs(x).max() > RADIANS else 0.0
    if turns:
        notes.append(f"{turns:+.0f}° were taken off “{shown(a.position)}”, a full turn.")
    x = x - turns
    if a.upper:
        top = table.column(a.upper)[rows] - turns
        lines = table.lines[rows]
        check_positions(top, lines, a.upper)
        low, high = np.minimum(x, top), np.maximum(x, top)
        _refuse_first(low >= high, lines, a.upper, "the bin has no width; its two ends must differ")
    else:
        low, high = _around(x, a.width, a.position)
    overlap = np.flatnonzero(low[1:] < high[:-1] - 1e-6 * (high - low)[:-1])
    if len(overlap):
        i = int(overlap[0])
        line = table.lines[rows][i + 1]
        raise ObservationError(
            f"Line {line}, column “{shown(a.position)}”: the bin overlaps the one before it; give the bins' "
            "width, or narrower ones."
        )
    high[:-1] = np.where(np.abs(low[1:] - high[:-1]) < 1e-6, low[1:], high[:-1])
    return low, high


def _around(x: np.ndarray, width: float | None, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Ends of bins around their middles: of a given width, or half way to their neighbours."""
    if width is not None:
        return x - 0.5 * width, x + 0.5 * width
    if len(x) < 2:
        raise ObservationError(
            f"One row is not a profile; at least {MIN_BINS} bins of “{shown(name)}” are needed."
        )
    steps = np.diff(x)
    usual = float(np.median(steps))
    half = 0.5 * np.where(steps > GAP * usual, usual, steps)
    return x - np.concatenate([half[:1], half]), x + np.concatenate([half, half[-1:]])


def _refuse_first(wrong: np.ndarray, lines: np.ndarray, name: str, words: str) -> None:
    if wrong.any():
        raise ObservationError(f"Line {lines[int(np.argmax(wrong))]}, column “{shown(name)}”: {words}.")


def _check_count(n: int, n_outside: int) -> None:
    if n < MIN_BINS:
        lie, lies = (("lies" if many == 1 else "lie") for many in (n, n_outside))
        raise ObservationError(
            f"Only {number_of(n, 'bin')} with a value {lie} within the simulated stretch of the stream"
            f"{f' ({n_outside} {lies} outside)' if n_outside else ''}; at least {MIN_BINS} are needed."
        )
    if n > MAX_BINS:
        raise ObservationError(f"{n} bins are more than the {MAX_BINS} that are compared; average some.")


# ---------------------------------------------------------------- values


def _one_error(table: Table, name: str) -> np.ndarray:
    """The column of errors; where it is one of a lower and an upper error, the mean of their sizes.

    The noise of simulated streams is Gaussian, which has one width. A lower error may be given as a negative
    number.
    """
    other = other_side(name, table.names)
    if other is None:
        return table.column(name)
    sides = [table.column(side) for side in (name, other)]
    return np.mean([-side if (side[np.isfinite(side)] <= 0).all() else side for side in sides], axis=0)


def _values_and_errors(
    table: Table, a: Assumptions, rows: np.ndarray, width: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray | None]:
    """What was measured and its error, in one unit; no error where it is relative to a smooth curve."""
    value, lines = table.column(a.value)[rows], table.lines[rows]
    error = None
    if a.error_kind == "column":
        if a.error is None:
            raise ObservationError("Name the column with the errors, or choose constant or Poisson errors.")
        error = _one_error(table, a.error)[rows]
        if a.error_unit != "value":
            error = error * value / (100.0 if a.error_unit == "percent" else 1.0)
        check_errors(error, lines, a.error)
    elif a.error_kind == "poisson":
        if a.kind != "counts":
            raise ObservationError(
                f"Poisson errors need counts, and “{shown(a.value)}” is {KINDS[a.kind]}: give an error "
                "column or a constant error."
            )
        error = np.sqrt(np.maximum(value, 1.0))
    check_values(value, error, lines, a.value, a.kind, notes)
    unit = np.ones(len(value))
    if a.smooth is not None:
        unit = table.column(a.smooth)[rows]
        _refuse_first(
            ~(np.isfinite(unit) & (unit > 0)),
            lines,
            a.smooth,
            "the smooth profile must be a positive number wherever there is a value",
        )
    elif a.kind == "counts":
        unit = width
    scaled = value / unit
    scaled_error = None if error is None else error / unit
    if a.kind in ("density", "counts") and a.smooth is None:
        # Any unit will do; numbers around one keep every later step exact.
        size = np.abs(scaled).mean()
        scaled, scaled_error = scaled / size, None if scaled_error is None else scaled_error / size
    finite = np.isfinite(scaled).all() and (scaled_error is None or np.isfinite(scaled_error).all())
    if not finite or np.abs(scaled).max() > 1e6:
        raise ObservationError(
            f"Column “{shown(a.value)}” holds values that no {KINDS[a.kind]} has; check its unit and kind."
        )
    return scaled, scaled_error


def _design(
    a: Assumptions,
    low: np.ndarray,
    high: np.ndarray,
    value: np.ndarray,
    error: np.ndarray | None,
    notes: list[str],
) -> tuple[Design, np.ndarray]:
    """The design and the divided values; errors become relative to the smooth curve.

    Where a polynomial of the order that was asked for follows the bins too closely or comes close to zero,
    the highest lower order that does not is taken, and a note says so.
    """
    ratio = a.kind == "q_rho" or a.smooth is not None
    if a.order == AS_IS and not ratio:
        raise ObservationError(
            f"“{shown(a.value)}” is {KINDS[a.kind]}, of which only the shape can be compared: choose the "
            "order of the polynomial, 0 for the mean."
        )
    quantity: Quantity = "q_rho" if ratio else "density"
    curve = np.ones(len(value))
    order = a.order
    if a.order != AS_IS and a.kind != "detrended":
        order = _usable_order(a, 0.5 * (low + high), value, notes)
        curve = smooth_curve(value, polynomial_fit(0.5 * (low + high), order))
    sigma = np.full(len(value), a.constant) if error is None else error / curve
    if not np.median(sigma) <= 1.0:
        raise ObservationError(
            f"The errors are larger than the values (typically {np.median(sigma):.3g} of the smooth curve): "
            "nothing can be learnt from this profile; check the error's unit."
        )
    if sigma.max() > 100 or sigma.min() < 1e-4:
        raise ObservationError(
            f"The errors run from {sigma.min():.2g} to {sigma.max():.2g} of the smooth curve; leave bins "
            "beyond 100 out, and give errors of at least 0.0001."
        )
    return Design(a.coordinate, low, high, sigma, quantity, order), value / curve


def _usable_order(a: Assumptions, x: np.ndarray, value: np.ndarray, notes: list[str]) -> int:
    """The order of the polynomial to divide by: the one asked for, or the highest lower one that works."""
    close = [order for order in range(a.order, -1, -1) if order + 2 <= len(value) // 2]
    for order in close:
        if divisible(value, polynomial_fit(x, order)):
            break
    else:
        raise ObservationError(
            f"“{shown(a.value)}” is not positive on average: there is no smooth curve to divide it by."
        )
    if order < a.order:
        why = "comes close to zero or below" if close[0] == a.order else "follows so few bins too closely"
        notes.append(
            f"A polynomial of order {a.order} fitted to “{shown(a.value)}” {why}; one of order {order} is "
            "divided out instead, of data and simulations alike."
        )
    return order
