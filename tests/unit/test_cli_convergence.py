"""``streamdash convergence`` and the appendix figures, on the shipped spectra."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamdash.cli.main import app
from streamdash.convergence.knobs import KNOBS, knob
from streamdash.convergence.text import convergence_markdown, cost, measure
from streamdash.convergence.verdicts import AGREES
from streamdash.store.cache import Cache

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "convergence.md"


def run(*arguments: str | Path, exit_code: int = 0):
    result = CliRunner().invoke(app, ["convergence", *(str(argument) for argument in arguments)])
    assert result.exit_code == exit_code, (result.output, result.exception)
    return result


@pytest.fixture(scope="module")
def numbers(shipped_cache) -> dict:
    return json.loads(run("--cache", shipped_cache, "--json").stdout)


def test_every_test_has_a_verdict_and_all_have_a_cost(numbers):
    assert [one["key"] for one in numbers["knobs"]] == list(KNOBS)
    for one in numbers["knobs"]:
        assert one["verdict"] in ("agrees", "within the scatter of streams", "differs")
        assert all(0 < shift["error"] < 0.5 for shift in one["shifts"])
    assert numbers["cost"]["n_ensembles"] == 33
    assert numbers["cost"]["n_streams"] == 32 * 1000 + 2000
    assert numbers["cost"]["streams_core_s"] > 60 and numbers["cost"]["geometries_core_s"] > 60


def test_the_engines_own_settings_and_the_number_of_streams_have_converged(numbers):
    """Not what the physics does, but what our numbers must do to be trusted."""
    for one in numbers["knobs"]:
        if one["key"] in ("frequencies", "kicks", "streams"):
            claimed = [shift for shift in one["shifts"] if shift["setting"] >= knob(one["key"]).claim]
            assert max(abs(shift["largest"]) for shift in claimed) < AGREES, one["key"]


def test_one_test_is_said_in_a_line(shipped_cache):
    lines = run("times", "--cache", shipped_cache).stdout.splitlines()
    assert lines[0].startswith("Number of impact times: ")
    assert "Of what the paper calls converged, as observed (σ_ε = 0.1), 16 times against 64 times" in lines[0]
    assert lines[-1].startswith("7 ensembles, 8000 streams: ")


def test_what_is_not_there_is_refused_in_a_sentence(shipped_cache):
    for arguments, words in (
        (["nonsense"], "there are phase, times"),
        (["x", "--seed", "7"], "--compute simulates them"),
    ):
        result = run(*arguments, "--cache", shipped_cache, exit_code=2)
        assert result.stdout == ""
        assert words in result.stderr and result.stderr.count("\n") == 1


def test_the_document_is_what_the_command_writes(shipped_cache):
    cache = Cache.default(shipped_cache)
    found, lacking = measure(cache)
    assert lacking == []
    assert DOCUMENT.read_text(encoding="utf-8") == convergence_markdown(found, cost(cache, found))
