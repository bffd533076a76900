"""Running the command line in this process."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from streamdash.cli.main import app


def run(*arguments: str | Path, exit_code: int = 0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == exit_code, (result.output, result.exception)
    return result


def refused(*arguments: str | Path) -> str:
    """The one sentence with which a command refuses."""
    result = run(*arguments, exit_code=2)
    assert result.stdout == ""
    sentence = result.stderr.strip()
    assert sentence.startswith("Error: ")
    assert "\n" not in sentence
    return sentence
