"""``streamdash serve``: the web app, in Panel's own server."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

from streamdash.cli_common import CacheOption, InputError, make_cache

APP = Path(__file__).resolve().parent.parent / "app" / "main.py"


def serve_command(
    port: Annotated[int, typer.Option("--port", "-p", min=1, max=65535, help="Port to listen on.")] = 5006,
    address: Annotated[
        str, typer.Option("--address", help="Address to listen on; 0.0.0.0 is all of this machine's.")
    ] = "localhost",
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
) -> None:
    """Start the dashboard."""
    make_cache(cache)
    if not APP.is_file():
        raise InputError(f"The app is not beside the library ({APP}); serve it from a checkout.")
    environment = dict(os.environ)
    if cache is not None:
        environment["STREAMDASH_CACHE"] = str(cache.expanduser().absolute())
    command = [sys.executable, "-m", "panel", "serve", str(APP)]
    command += serve_arguments(port, address, show, allow_origin or [])
    if os.name == "posix":  # become the server, so that signals reach it and nothing is orphaned
        sys.stdout.flush()
        os.execve(sys.executable, command, environment)
    raise typer.Exit(subprocess.call(command, env=environment))


def serve_arguments(port: int, address: str, show: bool, allow_origin: list[str]) -> list[str]:
    """Options of ``panel serve``.

    Browsers are let in from localhost and the bound address, unless `allow_origin` or the
    environment variable ``BOKEH_ALLOW_WS_ORIGIN`` says otherwise. Health checks belong on
    ``/liveness``: a look at ``/`` would build a session.
    """
    arguments = ["--port", str(port), "--address", address, "--liveness"]
    origins = list(allow_origin)
    if not origins and not os.environ.get("BOKEH_ALLOW_WS_ORIGIN"):
        hosts = {"localhost": None, "127.0.0.1": None} | (
            {} if address in ("", "0.0.0.0", "::") else {address: None}
        )
        origins = [f"{host}:{port}" for host in hosts]
    for origin in origins:
        arguments += ["--allow-websocket-origin", origin]
    return [*arguments, "--show"] if show else arguments
