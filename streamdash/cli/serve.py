"""``streamdash serve``: the web app, in Panel's own server."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import chain
from typing import Annotated, Any

import typer

from streamdash import paths
from streamdash.cli.common import CacheOption, InputError, make_cache


def serve_command(
    port: Annotated[
        int | None, typer.Option("--port", "-p", min=1, max=65535, help="Port to listen on (5006).")
    ] = None,
    address: Annotated[
        str | None,
        typer.Option("--address", help="Address to listen on (localhost); 0.0.0.0 is all of this machine's."),
    ] = None,
    show: Annotated[bool, typer.Option("--show/--no-show", help="Open a browser.")] = False,
    allow_origin: Annotated[
        list[str] | None,
        typer.Option(
            "--allow-origin",
            metavar="HOST[:PORT]",
            help="Where browsers reach the server, when that is not the address above; may be repeated.",
        ),
    ] = None,
    cache: CacheOption = None,
    settings: Annotated[
        bool, typer.Option("--settings", help="Print the settings, check them, and do not start.")
    ] = False,
) -> None:
    """Start the dashboard; --settings lists the environment variables that set it up."""
    from streamdash.cli.deploy import (
        Deployment,
        check,
        server_arguments,
        server_environment,
        settings_table,
        warnings_of,
    )
    from streamdash.observe.table import UploadLimit
    from streamdash.simulation.limits import Limits, open_scheduler

    make_cache(cache)
    if not (paths.APP / "main.py").is_file():
        raise InputError(f"The dashboard is not where it should be ({paths.APP}); install streamdash anew.")
    given: dict[str, Any] = {"address": address, "port": port, "origins": allow_origin or None}
    chosen = Deployment(**{name: value for name, value in given.items() if value is not None})
    limits = Limits()
    allowed = [limits, UploadLimit()]
    if settings:
        for name, value, meaning in chain.from_iterable(map(settings_table, [chosen, *allowed])):
            print(f"{name:<32} {value:<20} {meaning}")
    check(chosen, os.environ)
    for sentence in filter(None, [*warnings_of(chosen, os.environ), open_scheduler(limits.scheduler)]):
        print(sentence, file=sys.stderr)
    if settings:
        return
    environment = server_environment(chosen, os.environ)
    if cache is not None:
        environment["STREAMDASH_CACHE"] = str(cache.expanduser().absolute())
    command = [sys.executable, str(paths.APP / "launch.py"), *server_arguments(chosen, show, os.environ)]
    if os.name == "posix":  # become the server, so that signals reach it and nothing is orphaned
        sys.stdout.flush()
        os.execve(sys.executable, command, environment)  # noqa: S606 (a shell would only be in the way)
    raise typer.Exit(subprocess.call(command, env=environment))
