"""What the columns of a table probably are: a proposal, always shown and always changeable.

Where nothing in the table decides, the field is named in `Assumptions.undecided`, and
`streamdash.observe.observation.interpret` refuses until it is chosen.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from streamdash.config import Config, Finite
from streamdash.observe.names import (
    error_stem,
    error_unit_of,
    is_beside,
    is_error,
    one_sided,
    other_side,
    plain_name,
)
from streamdash.observe.table import ObservationError, Table, shown
from streamdash.survey.design import AS_IS, ORDER_MAX

Kind = Literal["q_rho", "density", "counts", "detrended"]
ErrorKind = Literal["column", "constant", "poisson"]
ErrorUnit = Literal["value", "fraction", "percent"]
KINDS: dict[Kind, str] = {
    "q_rho": "Qρ: density over a smooth profile",
    "density": "linear density (stars per degree, any unit)",
    "counts": "number of stars in the bin",
    "detrended": "density already divided by its polynomial",
}
"""What a value may be, in words."""
ERROR_UNITS: dict[ErrorUnit, str] = {
    "value": "in the value's unit",
    "fraction": "fractions of the value",
    "percent": "percent of the value",
}
"""What an error column may be given in, in words."""
Coordinate = Literal["ell", "phi1", "xi"]
OWN: tuple[Coordinate, ...] = ("phi1", "xi")
"""Longitudes of streams' own frames."""
NOTHING = ""
"""Stands for no column, where None would leave things as they are; for no width it is 0."""
DEFAULT_ORDER = 3
"""Order of the polynomial that a density is divided by (Bovy, Erkal & Sanders 2017, §5)."""
DEFAULT_ERROR = 0.1
"""Relative error that is proposed where the table has none."""
ANSWERED_BY: dict[str, tuple[str, ...]] = {
    "bin": ("bin",),
    "coordinate": ("coordinate",),
    "value": ("value",),
    "kind": ("kind",),
    "error": ("error", "constant", "error_kind"),
    "error_unit": ("error_unit",),
}
"""Fields that may be undecided, and the choices of which one decides each."""
MIN_STARS = 50
"""Rows that a list of stars has at least."""
EVEN = 0.4
"""Share of steps within a fifth of the usual one, below which rows are stars rather than bins."""

_POSITION = {
    "ell": ("l", "ell", "glon", "lgal", "gall", "galacticlongitude", "ldeg", "elldeg"),
    "phi1": ("phi1", "φ1", "φ₁"),
    "xi": ("xi", "ξ"),
}
_VALUE = {
    "q_rho": ("qrho", "qρ", "q", "ratio", "relativedensity"),
    "detrended": ("detrended", "flattened", "normalised", "normalized"),
    "counts": ("counts", "count", "nstars", "nstar", "number", "n"),
    "density": ("density", "lindens", "lineardensity", "dens", "rho", "lambda"),
}
_SMOOTH = ("smooth", "expected", "unperturbed", "trend", "rho0")


class Assumptions(Config):
    """What the columns of a table mean, and what is done with them. Everything can be changed."""

    coordinate: Coordinate = Field(description="what the positions are: l, φ1 or ξ, in degrees")
    position: str = Field(description="column with the middle of each bin, or its lower end")
    upper: str | None = Field(None, description="column with the upper end of each bin")
    width: Finite | None = Field(None, gt=0, le=50, description="width of bins (deg); None: their spacing")
    bin: Finite | None = Field(
        None,
        gt=0,
        le=50,
        description="rows are stars, counted in bins of this width (deg); None: rows are bins",
    )
    value: str = Field(description="column that was measured")
    kind: Kind
    smooth: str | None = Field(None, description="column with the smooth profile, in the value's unit")
    order: int = Field(
        DEFAULT_ORDER, ge=AS_IS, le=ORDER_MAX, description="polynomial divided out; 0: the mean, -1: none"
    )
    error_kind: ErrorKind = "column"
    error: str | None = Field(None, description="column with the error")
    error_unit: ErrorUnit = Field("value", description="whether errors are relative to the value")
    constant: Finite = Field(DEFAULT_ERROR, gt=0, le=1e30, description="the error of all bins, relative")
    undecided: tuple[str, ...] = Field((), description="fields that nothing in the table decides")


class Undecided(ObservationError):
    """What nothing in a table decides; it must be chosen before there is an answer.

    Attributes
    ----------
    fields : tuple of str
        Of `Assumptions`; what decides each is in `ANSWERED_BY`.
    """

    def __init__(self, fields: tuple[str, ...], sentence: str) -> None:
        super().__init__(sentence)
        self.fields = fields


def assume(table: Table, changes: Mapping[str, Any] | None = None) -> Assumptions:
    """What a table's columns are, where some of it is known: the rest is guessed to fit.

    Raises
    ------
    ObservationError
        When there are fewer than two columns.
    ConfigError
        When a value is not allowed; the sentence names the field.
    """
    changes = changes or {}
    return changed(guess(table, changes), changes)


def guess(table: Table, known: Mapping[str, Any] | None = None) -> Assumptions:
    """What a table's columns are, by their names where they have any, else by order and size.

    Parameters
    ----------
    table : Table
    known : mapping, optional
        Columns that are known: ``position``, ``value`` and ``smooth`` are taken into account.

    Raises
    ------
    ObservationError
        When there are fewer than two columns.
    """
    if len(table.names) < 2:
        raise ObservationError(
            "The table has one column; it needs at least two: a position and a value, best an error too."
        )
    known = {name: column for name, column in (known or {}).items() if column in table.names}
    plain = {name: plain_name(name) for name in table.names}
    errors = [name for name in table.names if table.header and is_error(name)]
    free = [name for name in table.names if name not in errors]
    if len(free) < 2:
        free = list(table.names)
    undecided = []
    position, coordinate, upper, sure = _position(table, free, plain, known.get("position"))
    if not sure:
        undecided.append("coordinate")
    rest = [name for name in free if name not in (position, upper)] or [table.names[-1]]
    smooth = next((name for name in rest if plain[name].startswith(_SMOOTH)), None)
    candidates = [name for name in rest if name != smooth] or rest
    first, kind, sure = _value(table, candidates, plain)
    value = known.get("value", first)
    if value != first:
        value, kind, sure = _value(table, [value], plain)
    if value == smooth:
        smooth = None
    if not sure:
        rivals = [name for name in candidates if not is_beside(name)]
        # Without names the order of three columns says what they are; that of more does not.
        if "value" not in known and len(rivals) > (1 if table.header else 2):
            undecided.append("value")
        undecided.append("kind")
    others = [name for name in table.names if name not in (position, upper, value, smooth)]
    error, sure = _error(table, value, errors, others, plain, value == first)
    error_kind: ErrorKind = "column" if error else "poisson" if kind == "counts" else "constant"
    if not sure and (kind != "counts" or errors or any(not is_beside(n) for n in others)):
        undecided.append("error")
    unit, sure = _error_unit(table, error, value)
    if not sure:
        undecided.append("error_unit")
    if upper is None and _is_star_list(table, position, candidates, plain):
        undecided = [name for name in undecided if name == "coordinate"] + ["bin"]
    return Assumptions(
        coordinate=coordinate,
        position=position,
        upper=upper,
        value=value,
        kind=kind,
        smooth=smooth,
        order=0 if kind == "q_rho" or smooth else DEFAULT_ORDER,
        error_kind=error_kind,
        error=error,
        error_unit=unit,
        undecided=tuple(undecided),
    )


def changed(assumptions: Assumptions, changes: Mapping[str, Any]) -> Assumptions:
    """Assumptions with some of them replaced; what is None stays, `NOTHING` takes a column away.

    A value of another kind brings the division that is usual for it, a named error column brings its
    use, a constant error likewise, unless they are given themselves. Another value column leaves the
    error of the one before: which is its error is then undecided, unless that is given too.

    Raises
    ------
    ConfigError
        When a value is not allowed; the sentence names the field.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    empty = {"upper": NOTHING, "smooth": NOTHING, "error": NOTHING, "width": 0, "bin": 0}
    taken = {name for name, value in empty.items() if name in given and given[name] == value}
    if "order" not in given and ("kind" in given or "smooth" in given):
        smooth = None if "smooth" in taken else given.get("smooth", assumptions.smooth)
        ratio = given.get("kind", assumptions.kind) == "q_rho" or smooth is not None
        given["order"] = 0 if ratio else DEFAULT_ORDER
    if "error_kind" not in given and ("error" in given or "constant" in given):
        given["error_kind"] = "column" if "error" in given and "error" not in taken else "constant"
    undecided = list(assumptions.undecided)
    if given.get("value", assumptions.value) != assumptions.value and assumptions.error_kind == "column":
        undecided.append("error")
        given.setdefault("error", None)
    decided = {
        field
        for field, answers in ANSWERED_BY.items()
        if any(name in given for name in answers if given.get(name))
    }
    if "bin" in given:
        decided.add("bin")
    if given.get("error_kind") == "column" and not given.get("error", assumptions.error):
        decided.discard("error")
    if given.get("bin"):  # nothing but positions is looked at
        decided |= {"value", "kind", "error", "error_unit"}
    left = tuple(dict.fromkeys(name for name in undecided if name not in decided))
    return Assumptions.parse(assumptions.model_dump() | given | dict.fromkeys(taken) | {"undecided": left})


def open_questions(table: Table, a: Assumptions, fields: tuple[str, ...]) -> Undecided | None:
    """What is undecided among these fields, in one sentence for each; None where all is decided."""
    asked = tuple(field for field in fields if field in a.undecided)
    if not asked:
        return None
    value, position = shown(a.value), shown(a.position)
    names = [n for n in table.names if n not in (a.position, a.upper)]
    columns = ", ".join(f"“{shown(n)}”" for n in names[:4]) + (", …" if len(names) > 4 else "")
    words = {
        "bin": f"The table looks like a list of {table.n_rows} stars: give the width of the bins (deg) in "
        "which they are counted, or 0 if every row is a bin.",
        "coordinate": f"“{position}” may be Galactic longitude, a longitude of the stream's own frame or a "
        "right ascension: say which it is.",
        "value": f"What was measured may be any of {columns}: name the column.",
        "kind": f"“{value}” may be Qρ, a density or counts: say which it is.",
        "error": f"No column is clearly the error of “{value}”: name it, or give a relative error for all "
        "bins or, for counts, Poisson's.",
        "error_unit": f"“{shown(a.error or '')}” and “{value}” have different units: say whether the error "
        "is relative.",
    }
    return Undecided(asked, " ".join(words[field] for field in asked))


# ---------------------------------------------------------------- single columns


def _position(
    table: Table, free: list[str], plain: dict[str, str], known: str | None
) -> tuple[str, Coordinate, str | None, bool]:
    if table.header:
        for name in [known] if known else free:
            for own in OWN:
                if plain[name].startswith(_POSITION[own]):
                    return name, own, _upper(name, free, plain, own), True
            if plain[name] in _POSITION["ell"] or plain[name].startswith(("ell", "glon")):
                return name, "ell", _upper(name, free, plain, "ell"), True
    position = known or free[0]
    x = table.column(position)
    finite = x[np.isfinite(x)]
    negative = finite.size > 0 and bool(finite.min() < 0)
    return position, "phi1" if negative else "ell", None, False


def _upper(name: str, free: list[str], plain: dict[str, str], coordinate: str) -> str | None:
    """The column of upper ends, where this one is of lower ends."""
    if not re.search(r"low|lo$|min|left|start", plain[name]):
        return None
    starts = _POSITION[coordinate]
    others = (n for n in free if n != name and plain[n].startswith(starts))
    return next((n for n in others if re.search(r"upp|up$|high|hi$|max|right|end", plain[n])), None)


def _value(table: Table, rest: list[str], plain: dict[str, str]) -> tuple[str, Kind, bool]:
    kinds: tuple[Kind, ...] = ("q_rho", "detrended", "counts", "density")
    if table.header:
        for kind in kinds:
            for name in rest:
                if plain[name] in _VALUE[kind]:
                    return name, kind, True
        for kind in kinds:
            for name in rest:
                if plain[name].startswith(tuple(word for word in _VALUE[kind] if len(word) > 3)):
                    return name, kind, True
        for name in rest:
            if "dens" in plain[name]:
                return name, "density", True
    first = next((name for name in rest if not is_beside(name)), rest[0])
    values = table.column(first)
    finite = values[np.isfinite(values)]
    if finite.size and np.all(finite >= 0) and np.all(finite == np.round(finite)) and finite.max() > 1:
        return first, "counts", False
    return first, "q_rho" if finite.size and 0.7 < np.median(finite) < 1.4 else "density", False


def _error(
    table: Table, value: str, errors: list[str], others: list[str], plain: dict[str, str], expected: bool
) -> tuple[str | None, bool]:
    """The column with the error of the value, and whether that is clear.

    Clear is a namesake, or the only error column that is no other column's, or a lower and an upper error
    that belong together (the first of them is named, both are used); without a header, the only column
    that is left.
    """
    if not table.header:
        return (others[0] if others else None), len(others) == 1
    stems = {name: error_stem(name) for name in errors if name != value}
    theirs = {plain[name] for name in table.names if name not in errors and name != value}
    own = [n for n, stem in stems.items() if stem == plain[value]]
    near = [
        n
        for n, stem in stems.items()
        if stem and stem not in theirs and (plain[value].startswith(stem) or stem.startswith(plain[value]))
    ]
    unnamed = [n for n, stem in stems.items() if not stem or stem not in theirs]
    for group, clear in ((own, True), (near, True), (unnamed, expected)):
        if len(group) == 1 and not one_sided(group[0]):
            return group[0], clear
        if len(group) == 2 and other_side(group[0], group) == group[1]:
            return group[0], clear
        if group:
            return None, False
    return None, False


def _error_unit(table: Table, error: str | None, value: str) -> tuple[ErrorUnit, bool]:
    """What the error is given in, by its name and by the units that a file states."""
    if error is None:
        return "value", True
    units = table.units.get(error), table.units.get(value)
    named = error_unit_of(error, units[0])
    if named is not None:
        return named, True
    return "value", None in units or units[0] == units[1]


def _is_star_list(table: Table, position: str, rest: list[str], plain: dict[str, str]) -> bool:
    """Whether rows are stars: many, at uneven places, and nothing called a density or a number."""
    x = np.sort(table.column(position))
    if len(x) < MIN_STARS or not np.isfinite(x).all():
        return False
    steps = np.diff(x)
    usual = np.median(steps)
    even = np.mean(np.abs(steps - usual) <= 0.2 * usual) if usual > 0 else 0.0
    return even < EVEN and not (table.header and _value(table, rest, plain)[2])
