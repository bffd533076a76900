"""``streamdash infer``: how many subhalos, of which masses, hit a measured stream?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from streamdash.cli.columns import (
    BinOption,
    ConstantOption,
    CoordinateOption,
    ErrorKindOption,
    ErrorOption,
    ErrorUnitOption,
    KindOption,
    OrderOption,
    PositionOption,
    SmoothOption,
    UpperOption,
    ValueOption,
    WidthOption,
    naming_options,
)
from streamdash.cli.common import (
    ArmOption,
    CacheOption,
    InputError,
    JsonOption,
    StreamOption,
    make_cache,
    print_json,
    progress_bar,
    wrong_input,
)
from streamdash.prior import PRIORS, Prior
from streamdash.streams import STREAM_NAMES

if TYPE_CHECKING:
    from streamdash.observe.infer import Inference

PRIOR_HELP = f"One of {', '.join(PRIORS)}, or a file with a prior as JSON."


def infer_command(
    file: Annotated[
        Path, typer.Argument(metavar="PROFILE.csv", help="Table of positions, values and errors.")
    ],
    stream: StreamOption = None,
    arm: ArmOption = None,
    prior: Annotated[str, typer.Option("--prior", metavar="NAME|JSON", help=PRIOR_HELP)] = "rate",
    coordinate: CoordinateOption = None,
    position: PositionOption = None,
    upper: UpperOption = None,
    width: WidthOption = None,
    stars: BinOption = None,
    value: ValueOption = None,
    kind: KindOption = None,
    smooth: SmoothOption = None,
    order: OrderOption = None,
    error_kind: ErrorKindOption = None,
    error: ErrorOption = None,
    error_unit: ErrorUnitOption = None,
    constant: ConstantOption = None,
    streams: Annotated[
        int | None,
        typer.Option(
            "--streams", min=500, max=200_000, help="Streams to learn from; by default all shipped ones."
        ),
    ] = None,
    html: Annotated[
        Path | None, typer.Option("--report", metavar="HTML", help="Also write a report.")
    ] = None,
    as_json: JsonOption = False,
    cache: CacheOption = None,
) -> None:
    """Infer the population that hit a measured stream: abundance, half-mode mass, excess of clusters.

    An estimator is trained for the profile's own bins, errors and gaps, and kept. Streams of another prior
    than the named ones are simulated before, and kept too. What the columns are is guessed and stated.
    """
    from streamdash.observe.infer import infer

    if html is not None and not html.absolute().parent.is_dir():
        raise InputError(f"The folder of {html} does not exist; make it first.")
    changes = {
        "coordinate": coordinate,
        "position": position,
        "upper": upper,
        "width": width,
        "bin": stars,
        "value": value,
        "kind": kind,
        "smooth": smooth,
        "order": order,
        "error_kind": error_kind,
        "error": error,
        "error_unit": error_unit,
        "constant": constant,
    }
    with wrong_input(), naming_options():
        asked = read_prior(prior)
        with progress_bar() as titled:
            found = infer(
                file,
                stream or STREAM_NAMES[0],
                asked,
                arm,
                changes,
                make_cache(cache),
                streams,
                lambda what, done, total: titled(what)(done, total),
            )
    if html is not None:
        from streamdash.cli.classify import write_report
        from streamdash.plots.infer_html import infer_html

        write_report(html, infer_html(found))
    if as_json:
        print_json(found.report())
    else:
        print(text(found))


def read_prior(name: str) -> Prior:
    """A prior by its name, or from a JSON file.

    Raises
    ------
    InputError
        When it is neither.
    ConfigError
        When the file is not a prior.
    """
    if name in PRIORS:
        return PRIORS[name]
    try:
        return Prior.parse(Path(name).read_text())
    except (OSError, UnicodeDecodeError):
        known = ", ".join(PRIORS)
        raise InputError(f"--prior: {name[:60]!r} is none of {known}, nor a file that can be read.") from None


def text(found: Inference) -> str:
    """The answer as text: in words, then what was assumed."""
    lines = list(found.sentences)
    lines.append(f"Information gained: {found.posterior.information:.2f} bits.")
    lines += ["", "Assumed:", *(f"  {sentence}" for sentence in found.observation.stated)]
    return "\n".join(lines)
