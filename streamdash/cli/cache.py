"""``streamdash cache``: what is in the cache, whether it is intact; removing and carrying entries."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from streamdash.cli.common import (
    CacheOption,
    InputError,
    JsonOption,
    OneSentence,
    duration,
    make_cache,
    print_json,
    progress_bar,
    wrong_input,
)

if TYPE_CHECKING:
    import xarray as xr

    from streamdash.config import Config
    from streamdash.store.cache import Cache, Entry

cache_app = typer.Typer(cls=OneSentence, no_args_is_help=True, help="What is in the cache.")
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Key or directory name of an entry.")]


WorkersOption = Annotated[int | None, typer.Option("--workers", "-w", min=1, help="Worker processes.")]
REPAIRED = "what was damaged is computed again"
SET_APART = "it cannot be read and is set aside; `streamdash cache prune` removes it"


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
    repair: Annotated[
        bool,
        typer.Option("--repair", help="Compute what is damaged again, and set aside what is beyond that."),
    ] = False,
    workers: WorkersOption = None,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Read every file and compare checksums; exit code 1 when something is, or stays, wrong."""
    where = make_cache(cache)
    found = [(entry, where.verify(entry)) for entry in ([where.find(name)] if name else where.entries())]
    done = {e.path: _repair(where, e, workers) for e, problems in found if problems and repair}
    if as_json:
        print_json(
            [
                {**_as_dict(entry), "problems": problems, "repair": done.get(entry.path, "")}
                for entry, problems in found
            ]
        )
    else:
        for entry, problems in found:
            for problem in problems or ["intact" if entry.state == "complete" else f"intact, {entry.state}"]:
                print(f"{entry.path.name}: {problem}")
            if entry.path in done:
                print(f"{entry.path.name}: {done[entry.path]}")
    if any(problems and done.get(entry.path) not in (REPAIRED, SET_APART) for entry, problems in found):
        raise typer.Exit(1)


def _repair(cache: Cache, entry: Entry, workers: int | None) -> str:
    """Mend a damaged entry as far as that can be done; says what was done."""
    from streamdash.simulation.ensemble import background, complete
    from streamdash.simulation.geometry import load_geometry
    from streamdash.store.entry import SET_ASIDE, explained, set_aside

    if SET_ASIDE in entry.path.name:
        return "it was set aside before; `streamdash cache prune` removes it"
    if entry.state == "foreign":
        return "it was not made by streamdash; delete it by hand"
    if entry.shipped:
        return "it is part of a cache that is only read; simulate the same and yours is used instead"
    if entry.config is None or entry.kind == "spectra":  # `streamdash convergence` makes these anew
        with cache.writing(entry.key or entry.path.name), explained(entry.path):
            set_aside(entry.path)
        return SET_APART
    with progress_bar() as titled, wrong_input():
        times = titled("Geometry of the stream")
        if entry.kind == "geometry":
            load_geometry(entry.config, cache, workers, times)
        elif entry.n_done < entry.n_total:  # it was not finished before either: what is sound stays
            geometry = load_geometry(entry.config.stream, cache, workers, times)
            cache.begin(entry.config, background(geometry, entry.config)).close()
        else:
            report = titled(f"Streams {entry.label}")
            complete(entry.config, cache, workers=workers, progress=report, geometry_progress=times)
    return REPAIRED


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


@cache_app.command("prune")
def prune_command(
    unfinished: Annotated[bool, typer.Option("--unfinished", help="Partial ensembles as well.")] = False,
    max_mb: Annotated[
        float | None,
        typer.Option("--max-mb", min=0, help="Keep so much; the least recently used goes first."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Remove what was set aside and what killed runs left behind; shipped entries and those in use stay."""
    from streamdash.store.keeping import prune

    limit = None if max_mb is None else int(max_mb * 1e6)
    gone = prune(make_cache(cache), unfinished, limit, dry_run)
    if as_json:
        print_json([{"path": path, "size_bytes": size} for path, size in gone])
        return
    for path, size in gone:
        print(f"{'Would remove' if dry_run else 'Removed'} {path} ({size / 1e6:.2f} MB).")
    if not gone:
        print("There is nothing to remove.")


@cache_app.command("export")
def export_command(
    name: NameArgument,
    target: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Name of the file; NAME.zip by default.")
    ] = None,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write an entry as one file, for another machine's `import`."""
    from streamdash.store.bundle import export_entry

    where = make_cache(cache)
    target = target or Path(f"{where.find(name).path.name}.zip")
    entry = export_entry(where, name, target)
    if as_json:
        print_json({"file": target, "size_bytes": target.stat().st_size, "entry": _as_dict(entry)})
    else:
        print(f"Wrote {entry.path.name} to {target} ({target.stat().st_size / 1e6:.2f} MB).")


@cache_app.command("import")
def import_command(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="A file that `export` wrote.")],
    max_mb: Annotated[float, typer.Option("--max-mb", min=0, help="Largest file accepted.")] = 1000,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Take an exported entry into the cache, after checking all of it; a geometry against its model."""
    from streamdash.config import StreamModel
    from streamdash.simulation.geometry import check_geometry
    from streamdash.store.bundle import import_entry

    def compare(config: Config, dataset: xr.Dataset) -> None:
        if isinstance(config, StreamModel):
            check_geometry(config, dataset)

    entry = import_entry(make_cache(cache), source, int(max_mb * 1e6), compare)
    if as_json:
        print_json(_as_dict(entry))
    else:
        print(f"{entry.path.name} is in the cache now ({entry.state}).")


def _as_dict(entry: Entry) -> dict[str, Any]:
    plain = {name: getattr(entry, name) for name in entry.__dataclass_fields__}
    config = entry.config.model_dump(mode="json") if entry.config else None
    return {**plain, "name": Path(entry.path).name, "config": config}
