"""What the columns of a table probably are: a proposal, always shown and always changeable."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from streamdash.config import Config, Finite
from streamdash.observe.table import ObservationError, Table
from streamdash.survey.design import AS_IS, ORDER_MAX

Kind = Literal["q_rho", "density", "counts", "detrended"]
ErrorKind = Literal["column", "constant", "poisson"]
KINDS: dict[Kind, str] = {
    "q_rho": "Qρ: density over a smooth profile",
    "density": "linear density (stars per degree, any unit)",
    "counts": "number of stars in the bin",
    "detrended": "density already divided by its polynomial",
}
"""What a value may be, in words."""
Coordinate = Literal["ell", "phi1", "xi"]
OWN: tuple[Coordinate, ...] = ("phi1", "xi")
"""Longitudes of streams' own frames."""
NOTHING = ""
"""Stands for no column, where None would leave things as they are; for no width it is 0."""
DEFAULT_ORDER = 3
"""Order of the polynomial that a density is divided by (Bovy, Erkal & Sanders 2017, §5)."""
DEFAULT_ERROR = 0.1
"""Relative error that is assumed, and said to be, where the table has none."""

_POSITION = {
    "ell": ("l", "ell", "glon", "lgal", "gall", "galacticlongitude", "longitude", "ldeg", "elldeg"),
    "phi1": ("phi1", "φ1", "φ₁"),
    "xi": ("xi", "ξ"),
}
_VALUE = {
    "q_rho": ("qrho", "qρ", "q", "ratio", "relativedensity"),
    "detrended": ("detrended", "flattened", "normalised", "normalized"),
    "counts": ("counts", "count", "nstars", "nstar", "number", "n"),
    "density": ("density", "lindens", "lineardensity", "dens", "rho", "lambda", "value"),
}
_SMOOTH = ("smooth", "expected", "unperturbed", "trend", "rho0")
_ERROR = re.compile(r"^(e|err|error|sigma|sig|unc|uncertainty|std|d)[_ ]|err|sigma|uncert|^σ|^e$|^std$")


class Assumptions(Config):
    """What the columns of a table mean, and what is done with them. Everything can be changed."""

    coordinate: Coordinate = Field(description="what the positions are: l, φ1 or ξ, in degrees")
    position: str = Field(description="column with the middle of each bin, or its lower end")
    upper: str | None = Field(None, description="column with the upper end of each bin")
    width: Finite | None = Field(None, gt=0, le=50, description="width of bins (deg); None: their spacing")
    value: str = Field(description="column that was measured")
    kind: Kind
    smooth: str | None = Field(None, description="column with the smooth profile, in the value's unit")
    order: int = Field(
        DEFAULT_ORDER, ge=AS_IS, le=ORDER_MAX, description="polynomial divided out; 0: the mean, -1: none"
    )
    error_kind: ErrorKind = "column"
    error: str | None = Field(None, description="column with the error, in the value's unit")
    constant: Finite = Field(DEFAULT_ERROR, gt=0, le=1e30, description="the error of all bins, relative")


def guess(table: Table) -> Assumptions:
    """What a table's columns are, by their names where they have any, else by order and size.

    Raises
    ------
    ObservationError
        When there are fewer than two columns.
    """
    if len(table.names) < 2:
        raise ObservationError(
            "The table has one column; it needs at least two: a position and a value, best an error too."
        )
    plain = {name: _plain(name) for name in table.names}
    errors = [name for name in table.names if table.header and _ERROR.search(name.strip().lower())]
    free = [name for name in table.names if name not in errors]
    if len(free) < 2:
        free = list(table.names)
    position, coordinate, upper = _position(table, free, plain)
    rest = [name for name in free if name not in (position, upper)] or [table.names[-1]]
    smooth = next((name for name in rest if plain[name].startswith(_SMOOTH)), None)
    value, kind = _value(table, [name for name in rest if name != smooth] or rest, plain)
    if value == smooth:
        smooth = None
    error = _error(table, value, errors, [position, value, smooth, upper])
    error_kind: ErrorKind = "column" if error else "poisson" if kind == "counts" else "constant"
    order = 0 if kind == "q_rho" or smooth else DEFAULT_ORDER
    return Assumptions(
        coordinate=coordinate,
        position=position,
        upper=upper,
        value=value,
        kind=kind,
        smooth=smooth,
        order=order,
        error_kind=error_kind,
        error=error,
    )


def _plain(name: str) -> str:
    """Letters and digits of a name, in lower case."""
    return "".join(c for c in name.lower() if c.isalnum())


def _position(table: Table, free: list[str], plain: dict[str, str]) -> tuple[str, Coordinate, str | None]:
    if table.header:
        for name in free:
            for own in OWN:
                if plain[name].startswith(_POSITION[own]):
                    return name, own, _upper(name, free, plain, own)
            if plain[name] in _POSITION["ell"] or plain[name].startswith(("ell", "glon")):
                return name, "ell", _upper(name, free, plain, "ell")
    x = table.column(free[0])
    finite = x[np.isfinite(x)]
    negative = finite.size > 0 and bool(finite.min() < 0)
    return free[0], "phi1" if negative else "ell", None


def _upper(name: str, free: list[str], plain: dict[str, str], coordinate: str) -> str | None:
    """The column of upper ends, where this one is of lower ends."""
    if not re.search(r"low|lo$|min|left|start", plain[name]):
        return None
    starts = _POSITION[coordinate]
    others = (n for n in free if n != name and plain[n].startswith(starts))
    return next((n for n in others if re.search(r"upp|up$|high|hi$|max|right|end", plain[n])), None)


def _value(table: Table, rest: list[str], plain: dict[str, str]) -> tuple[str, Kind]:
    kinds: tuple[Kind, ...] = ("q_rho", "detrended", "counts", "density")
    if table.header:
        for kind in kinds:
            for name in rest:
                if plain[name] in _VALUE[kind]:
                    return name, kind
        for kind in kinds:
            for name in rest:
                if plain[name].startswith(tuple(word for word in _VALUE[kind] if len(word) > 3)):
                    return name, kind
        for name in rest:
            if "dens" in plain[name]:
                return name, "density"
    values = table.column(rest[0])
    finite = values[np.isfinite(values)]
    if finite.size and np.all(finite >= 0) and np.all(finite == np.round(finite)) and finite.max() > 1:
        return rest[0], "counts"
    return rest[0], "q_rho" if finite.size and 0.7 < np.median(finite) < 1.4 else "density"


def _error(table: Table, value: str, errors: list[str], taken: list[str | None]) -> str | None:
    """The column with the error of the value: its namesake, else the only one, else the third column."""
    if not table.header:
        others = [name for name in table.names if name not in taken]
        return others[0] if others else None
    namesakes = [name for name in errors if value.lower() in name.lower()]
    if namesakes:
        return namesakes[0]
    return errors[0] if len(errors) == 1 else next((n for n in errors if n not in taken), None)


def changed(assumptions: Assumptions, changes: Mapping[str, Any]) -> Assumptions:
    """Assumptions with some of them replaced; what is None stays, `NOTHING` takes a column away.

    A value of another kind brings the division that is usual for it, a named error column brings its
    use, a constant error likewise, unless they are given themselves.

    Raises
    ------
    ConfigError
        When a value is not allowed; the sentence names the field.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    empty = {"upper": NOTHING, "smooth": NOTHING, "error": NOTHING, "width": 0}
    taken = {name for name, value in empty.items() if name in given and given[name] == value}
    if "order" not in given and ("kind" in given or "smooth" in given):
        smooth = None if "smooth" in taken else given.get("smooth", assumptions.smooth)
        ratio = given.get("kind", assumptions.kind) == "q_rho" or smooth is not None
        given["order"] = 0 if ratio else DEFAULT_ORDER
    if "error_kind" not in given and ("error" in given or "constant" in given):
        given["error_kind"] = "column" if "error" in given and "error" not in taken else "constant"
    return Assumptions.parse(assumptions.model_dump() | given | dict.fromkeys(taken))
