"""The ``streamdash`` command. One module a command; this one puts them together."""

from __future__ import annotations

from typing import Annotated

import typer

from streamdash import __version__
from streamdash.cli.cache import cache_app
from streamdash.cli.classify import classify_command
from streamdash.cli.common import OneSentence
from streamdash.cli.convergence import convergence_command
from streamdash.cli.estimator import estimator_app
from streamdash.cli.geometry import geometry_command
from streamdash.cli.infer import infer_command
from streamdash.cli.mock import mock_command
from streamdash.cli.reproduce import reproduce_command
from streamdash.cli.serve import serve_command
from streamdash.cli.simulate import simulate_command
from streamdash.cli.stream import stream_command

app = typer.Typer(cls=OneSentence, no_args_is_help=True, pretty_exceptions_enable=False)
app.command("serve")(serve_command)
app.command("simulate")(simulate_command)
app.command("reproduce")(reproduce_command)
app.command("convergence")(convergence_command)
app.command("stream")(stream_command)
app.command("geometry")(geometry_command)
app.command("classify")(classify_command)
app.command("infer")(infer_command)
app.command("mock")(mock_command)
app.add_typer(cache_app, name="cache")
app.add_typer(estimator_app, name="estimator")


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"streamdash {__version__}")
        raise typer.Exit


@app.callback()
def main(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Stellar streams perturbed by dark-matter subhalos: simulate, look, classify."""


if __name__ == "__main__":
    app(prog_name="streamdash")
