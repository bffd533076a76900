"""Options that say what the columns of a measured profile are, shared by the commands that read one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Annotated, Literal

import typer

from streamdash.cli.common import InputError

CoordinateOption = Annotated[
    Literal["ell", "phi1", "xi"] | None, typer.Option("--coordinate", help="What positions are.")
]
PositionOption = Annotated[str | None, typer.Option("--position", help="Column with the middle of the bins.")]
UpperOption = Annotated[
    str | None, typer.Option("--upper", help="Column with their upper end; position is the lower.")
]
WidthOption = Annotated[float | None, typer.Option("--width", help="Width of the bins (deg).")]
BinOption = Annotated[
    float | None,
    typer.Option("--bin", help="Rows are stars: width of bins (deg) to count them in; 0: rows are bins."),
]
ValueOption = Annotated[str | None, typer.Option("--value", help="Column that was measured.")]
KindOption = Annotated[
    Literal["q_rho", "density", "counts", "detrended"] | None,
    typer.Option("--kind", help="What the value is."),
]
SmoothOption = Annotated[str | None, typer.Option("--smooth", help="Column with the smooth profile.")]
OrderOption = Annotated[
    int | None, typer.Option("--order", help="Polynomial divided out; 0: the mean, -1: nothing.")
]
ErrorKindOption = Annotated[
    Literal["column", "constant", "poisson"] | None,
    typer.Option("--error-kind", help="Where errors come from."),
]
ErrorOption = Annotated[str | None, typer.Option("--error", help="Column with the errors.")]
ErrorUnitOption = Annotated[
    Literal["value", "fraction", "percent"] | None,
    typer.Option("--error-unit", help="Errors in the value's unit, or relative to the value."),
]
ConstantOption = Annotated[float | None, typer.Option("--constant", help="Relative error of all bins.")]


@contextlib.contextmanager
def naming_options() -> Iterator[None]:
    """What a table leaves undecided is refused with the options that decide it."""
    from streamdash.observe.guess import ANSWERED_BY, Undecided

    try:
        yield
    except Undecided as error:
        names = dict.fromkeys(name for field in error.fields for name in ANSWERED_BY[field])
        options = [f"--{name.replace('_', '-')}" for name in names]
        raise InputError(f"{error} The options are {', '.join(options)}.") from error
