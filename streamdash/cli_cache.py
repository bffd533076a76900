"""``streamdash cache``: what is in the cache, whether it is intact, and removing from it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from streamdash.cli_common import (
    CacheOption,
    InputError,
    JsonOption,
    OneSentence,
    duration,
    make_cache,
    print_json,
)
from streamdash.store import Entry

cache_app = typer.Typer(cls=OneSentence, no_args_is_help=True, help="What is in the cache.")
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Key or directory name of an entry.")]


@cache_app.command("list")
def list_command(cache: CacheOption = None, as_json: JsonOption = False) -> None:
    """List ensembles, geometries and spectra, the incomplete and damaged ones too."""
    entries = make_cache(cache).entries()
    if as_json:
        print_json([_as_dict(entry) for entry in entries])
        return
    if not entries:
        print("The cache is empty.")
        return
    table = Table(box=None, pad_edge=False)
    for name in ("what", "label", "key", "state", "streams", "MB", "core time", "date", "version", "where"):
        table.add_column(name, justify="right" if name in ("streams", "MB", "core time") else "left")
    for entry in entries:
        streams = "" if entry.kind != "ensemble" or not entry.n_total else f"{entry.n_done}/{entry.n_total}"
        table.add_row(
            entry.kind,
            entry.label,
            entry.key,
            entry.state,
            streams,
            f"{entry.size_bytes / 1e6:.2f}",
            duration(entry.cost_s) if entry.cost_s else "",
            entry.date[:10],
            entry.code_version,
            "shipped" if entry.shipped else "own",
        )
    Console(width=None if sys.stdout.isatty() else 200).print(table)
    for entry in entries:
        if entry.reason:
            print(f"{entry.path.name} is {entry.state}: {entry.reason}.")


@cache_app.command("verify")
def verify_command(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One entry; all by default.")] = None,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Read every file and compare checksums; exit code 1 when something is wrong."""
    where = make_cache(cache)
    found = [(entry, where.verify(entry)) for entry in ([where.find(name)] if name else where.entries())]
    if as_json:
        print_json([{**_as_dict(entry), "problems": problems} for entry, problems in found])
    else:
        for entry, problems in found:
            for problem in problems or ["intact" if entry.state == "complete" else f"intact, {entry.state}"]:
                print(f"{entry.path.name}: {problem}")
    if any(problems for _, problems in found):
        raise typer.Exit(1)


@cache_app.command("remove")
def remove_command(
    name: NameArgument,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")] = False,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Delete an entry of your own; shipped ones stay."""
    where = make_cache(cache)
    entry = where.find(name)
    if entry.shipped or entry.state == "foreign":
        where.remove(entry.path.name)  # says why not
    if not yes:
        if as_json or not sys.stdin.isatty():
            raise InputError(f"Say --yes to delete {entry.path.name} without being asked.")
        typer.confirm(f"Delete {entry.path} ({entry.size_bytes / 1e6:.1f} MB)?", abort=True)
    where.remove(entry.path.name)
    if as_json:
        print_json({"removed": _as_dict(entry)})
    else:
        print(f"Removed {entry.path}.")


def _as_dict(entry: Entry) -> dict[str, Any]:
    plain = {name: getattr(entry, name) for name in entry.__dataclass_fields__}
    config = entry.config.model_dump(mode="json") if entry.config else None
    return {**plain, "name": Path(entry.path).name, "config": config}
