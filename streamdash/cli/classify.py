"""``streamdash classify``: which perturbers made the gaps of a measured profile?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from streamdash.config import EnsembleConfig, StreamModel
from streamdash.streams import STREAM_NAMES, named_stream, stream_of, stream_text

if TYPE_CHECKING:
    from streamdash.store.cache import Cache


def classify_command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Table of positions, values and errors.")],
    mass: Annotated[
        str, typer.Option("--mass", help="Mass ranges to compare, 2 to 4, such as 1e3-1e5,1e5-1e9.")
    ] = "1e3-1e5,1e5-1e9",
    stream: StreamOption = None,
    arm: ArmOption = None,
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
    html: Annotated[
        Path | None, typer.Option("--report", metavar="HTML", help="Also write a report.")
    ] = None,
    hold: Annotated[
        bool,
        typer.Option("--robustness", help="Also try other polynomials, errors, halves and mass ranges."),
    ] = False,
    as_json: JsonOption = False,
    cache: CacheOption = None,
) -> None:
    """Classify a measured density profile by the mass range of the perturbers.

    Simulated streams are put through the profile's own bins, errors and gaps, and a classifier is
    trained on them. What the columns are is guessed and stated; the options change it.
    """
    from streamdash.observe.report import text

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
        model = named_stream(stream or STREAM_NAMES[0]).arm(arm)
        result, page = classify(
            _read(file), make_cache(cache), mass.split(","), changes, model, file.name, hold
        )
        if html is not None:
            write_report(html, page())
    if as_json:
        print_json(result)
    else:
        print(text(result))


def classify(
    data: bytes,
    cache: Cache,
    labels: list[str],
    changes: dict[str, Any],
    stream: StreamModel | None = None,
    name: str = "",
    hold: bool = False,
) -> tuple[dict[str, Any], Any]:
    """Report on a table of an arm of a stream, the default one if not given, and what makes its HTML.

    ``name`` is what the file is called; ``hold`` adds the table of robustness.

    Raises
    ------
    ValueError
        In one sentence, when the table or a choice cannot be used.
    """
    from streamdash.observe.guess import assume
    from streamdash.observe.observation import interpret
    from streamdash.observe.table import read_table
    from streamdash.simulation.geometry import load_geometry

    if not 2 <= len(labels) <= 4:
        raise InputError(f"--mass: give 2 to 4 classes, separated by commas, not {len(labels)}.")
    configs = [_find(cache, label.strip(), stream or StreamModel()) for label in labels]
    table = read_table(data)
    assumptions, geometry = assume(table, changes), load_geometry(configs[0].stream, cache)
    observation = interpret(table, assumptions, geometry)
    found = []
    with progress_bar() as titled:
        learning = titled("Learning from streams so observed")
        learning(0, 100)
        # The trees' libraries take a second to load: by now it is known that there is something to learn.
        from streamdash.observe.provenance import Source, signed
        from streamdash.observe.report import report
        from streamdash.observe.robustness import other_sets, robustness, variants
        from streamdash.observe.verdict import judge, prepare
        from streamdash.observe.wording import tried

        prepared = prepare(cache, configs, observation.design, learning)
        if hold:
            rows = variants(table, assumptions, geometry, configs, other_sets(cache, configs))
            found = robustness(cache, rows, titled("Trying what would change the answer"))
    result = signed(report(judge(prepared, observation), observation, prepared), Source.of(data, name))
    result = tried(result, found)

    def page() -> str:
        from streamdash.plots.report_html import report_html  # with holoviews, for the report alone

        return report_html(result, observation, prepared.bands())

    return result, page


def _find(cache: Cache, label: str, stream: StreamModel) -> Any:
    """The complete ensemble of a stream and mass range, or of a cache key; of several, that of most streams.

    Models of the stream that differ in age or another number are of that stream as well.
    """
    from streamdash.config import mass_label, parse_mass_range

    try:
        wanted = mass_label(parse_mass_range(label))
    except ValueError:
        wanted = label
    name, arm = stream_of(stream).name, stream.arm

    def there(config: EnsembleConfig) -> bool:
        return config.prior is None and (stream_of(config.stream).name, config.stream.arm) == (name, arm)

    found = cache.complete_ensembles(lambda c: there(c) and c.label == wanted)
    found = found or cache.complete_ensembles(lambda c: c.prior is None and c.key == label)
    if not found:
        known = ", ".join(sorted({e.config.label for e in cache.complete_ensembles(there)})) or "none at all"
        raise InputError(
            f"--mass: no complete ensemble of {label[:40]!r} for {stream_text(stream)} is in the cache; "
            f"there are {known}."
        )
    return max(found, key=lambda e: e.config.n_streams).config


def _read(path: Path) -> bytes:
    from streamdash.observe.table import MAX_BYTES

    try:
        with path.open("rb") as stream:
            return stream.read(MAX_BYTES + 1)
    except OSError as failure:
        raise InputError(f"{path} cannot be read ({failure.strerror}).") from None


def write_report(path: Path, page: str) -> None:
    """Write an HTML report, whole or not at all.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    from streamdash.store.entry import write_file

    try:
        write_file(path, page.encode())
    except OSError as failure:
        raise InputError(f"{path} cannot be written ({failure.strerror}).") from None
