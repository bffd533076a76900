"""What the commands share: options, one-sentence errors, progress bars.

Nothing here, nor at the top of a command's module, imports the numerical libraries: they take seconds,
and `streamdash --help` needs none of them.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from typer.core import TyperGroup

from streamdash.config import ConfigError, EnsembleConfig
from streamdash.streams import STREAM_NAMES, named_stream

if TYPE_CHECKING:
    from streamdash.store.cache import Cache

UsageError: type[Exception] = typer.BadParameter.__bases__[0]

CacheOption = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        envvar="STREAMDASH_CACHE",
        metavar="DIR",
        show_default="the shipped cache and your own",
        help="The only cache folder, read and written.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", metavar="JSON", help="Start from a config.json, or from a part of one."),
]
StreamOption = Annotated[
    str | None,
    typer.Option(
        "--stream", metavar="NAME", show_default=STREAM_NAMES[0], help=f"One of {', '.join(STREAM_NAMES)}."
    ),
]
ArmOption = Annotated[
    Literal["leading", "trailing"] | None,
    typer.Option("--arm", show_default="the stream's first", help="Arm of the stream."),
]

BothArmsOption = Annotated[
    Literal["leading", "trailing", "both"] | None,
    typer.Option("--arm", show_default="the stream's first", help="Arm of the stream, or both."),
]

messages = Console(stderr=True, highlight=False, soft_wrap=True)
"""People read this; what a command answers goes to standard output."""


class InputError(Exception):
    """Wrong input, said in one sentence."""


class OneSentence(TyperGroup):
    """Commands whose errors are one sentence on standard error and exit code 2."""

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")  # M☉ where a terminal knows ASCII only
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
        try:
            code = super().main(args, prog_name, complete_var, False, windows_expand_args, **extra)
        except UsageError as error:
            if not str(error):  # no command was named: its message is the help
                error.show()  # type: ignore[attr-defined]
                sys.exit(2)
            fail(error.format_message())  # type: ignore[attr-defined]
        except (ConfigError, InputError) as error:
            fail(str(error))
        except typer.Abort:
            fail("Nothing was done.")
        except RuntimeError as error:
            from streamdash.store.entry import StoreError

            if not isinstance(error, StoreError):
                raise
            fail(str(error))
        sys.exit(code if isinstance(code, int) else 0)


def fail(sentence: str) -> NoReturn:
    """Print one sentence on standard error and leave with exit code 2."""
    messages.print(f"Error: {sentence}", markup=False)
    sys.exit(2)


@contextlib.contextmanager
def wrong_input() -> Iterator[None]:
    """A ValueError inside is what a person asked for, not a fault of the program."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from error


def print_json(value: Any) -> None:
    """Print `value` as JSON on standard output."""
    print(json.dumps(value, indent=1, default=str))


def read_config(
    path: Path | None, changes: dict[str, Any], stream: str | None = None, arm: str | None = None
) -> EnsembleConfig:
    """Configuration from a file and options; options that are None change nothing.

    Parameters
    ----------
    path : JSON of an EnsembleConfig, or of a part of it.
    changes : values by dotted name, such as ``{"perturbers.X": 5}``.
    stream, arm : a named stream, in place of the file's, and one of its arms; the arm alone is that of
        whatever stream there is. A named stream's dispersion follows its age unless both are changed.

    Raises
    ------
    InputError, ConfigError
        In one sentence.
    """
    data: Any = {}
    if path is not None:
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(f"{path} cannot be read ({error.strerror}).") from None
        except ValueError as error:
            raise InputError(f"{path} is not JSON ({error}).") from None
        EnsembleConfig.parse(data)
    if stream is not None:
        named, age = named_stream(stream), changes.get("stream.age_gyr")
        data["stream"] = (named if age is None else named.at_age(age)).arm(arm).model_dump()
    elif arm is not None:
        changes = {**changes, "stream.arm": arm}
    for name, value in changes.items():
        *parents, last = name.split(".")
        if value is None:
            continue
        place = data
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return EnsembleConfig.parse(data)


def arms_of(stream: str | None, arm: str | None, config: Path | None = None) -> list[str | None]:
    """The arms that ``--stream``, or else ``--config``, and ``--arm`` name; ``both`` are two.

    Raises
    ------
    InputError, ConfigError
        When the stream has not both, or is none.
    """
    if arm != "both":
        return [arm]
    if stream is None and config is not None:
        return ["leading", "trailing"]
    named = named_stream(stream or STREAM_NAMES[0])
    if len(named.arms) < 2:
        raise InputError(
            f"--arm: {named.name} has a {named.default_arm} arm only; leave --arm out, or choose a --stream "
            "with both."
        )
    return list(named.arms)


@contextlib.contextmanager
def progress_bar() -> Iterator[Callable[[str], Callable[[int, int], None]]]:
    """A bar with the time that remains; what is yielded makes a ``(done, total)`` callback by title."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=messages) as bar:
        tasks: dict[str, Any] = {}

        def titled(title: str) -> Callable[[int, int], None]:
            def report(done: int, total: int) -> None:
                if title not in tasks:  # what was there before says nothing about the speed
                    tasks[title] = bar.add_task(title, total=total, completed=done)
                bar.update(tasks[title], completed=done, total=total)

            return report

        yield titled


def make_cache(directory: Path | None) -> Cache:
    """The cache that ``--cache``, the environment or the defaults name."""
    from streamdash.store.cache import Cache

    return Cache.default(directory)


def duration(seconds: float) -> str:
    """A time for people: ``0.8 s``, ``45 s``, ``12 min``, ``3.5 h``.

    Examples
    --------
    >>> duration(45), duration(12 * 60)
    ('45 s', '12 min')
    """
    if seconds < 10:
        return f"{seconds:.2g} s"
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
