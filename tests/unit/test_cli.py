"""The command line: what it answers, refuses and leaves behind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from streamdash.cli.stream import COLUMNS
from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.engine.density import perturbed_stream
from streamdash.engine.impacts import Impacts, expected_impacts, sample_impacts
from streamdash.simulation.geometry import load_geometry
from streamdash.survey import sky
from tests.unit.commands import refused, run

SIMULATE = ["simulate", "--mass", "1e5-1e7", "--streams", "60", "--n-theta", "30", "--executor", "inline"]


def contents(folder: Path) -> dict[str, int]:
    return {str(f.relative_to(folder)): f.stat().st_mtime_ns for f in folder.rglob("*")}


@pytest.fixture
def geometry(geometry_cache):
    return load_geometry(StreamModel(), geometry_cache)


# ------------------------------------------------------------------ wrong input


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--mass 1e3-1e5"),
        (["--mass", "1e5-1e3"], "perturbers.mass_range: the lower mass must come first"),
        (["--mass", "0-1e5"], "perturbers.mass_range: masses must lie between 1 and 1e+12"),
        (["--mass", "-1e3-1e5"], "mass range '-1e3-1e5' is not of the form 1e3-1e5"),
        (["--mass", "1-1e12"], "span at most 8 decades"),
        (["--mass", "heavy"], "mass range 'heavy' is not of the form"),
        (["--mass", "1e3-1e5", "--streams", "0"], "n_streams: input should be greater than or equal to 1"),
        (["--mass", "1e3-1e5", "--streams", "-5"], "n_streams"),
        (["--mass", "1e3-1e5", "--streams", "many"], "--streams"),
        (["--mass", "1e3-1e5", "--seed", "-1"], "seed"),
        (["--mass", "1e3-1e5", "--workers", "0"], "--workers"),
        (["--mass", "1e3-1e5", "--X", "0"], "perturbers.X"),
        (["--mass", "1e3-1e5", "--X", "nan"], "perturbers.X"),
        (["--mass", "1e3-1e5", "--profile", "nfw"], "--profile"),
        (["--mass", "1e3-1e5", "--age", "99"], "stream.age_gyr"),
        (["--mass", "1e3-1e5", "--q", "9"], "stream.potential.q"),
        (["--mass", "1e3-1e5", "--times", "3,2"], "times_gyr must increase"),
        (["--mass", "1e3-1e5", "--times", "3;2"], "--times: '3;2' is not a list of numbers"),
        (["--mass", "1e3-1e5", "--progenitor", "1,2"], "stream.progenitor"),
        (["--mass", "1e3-1e5", "--stream", "gd2"], "stream: 'gd2' is none of gd1-like, gd1, pal5"),
        (
            ["--mass", "1e3-1e5", "--stream", "gd1-like", "--arm", "trailing"],
            "arm: gd1-like has a leading arm",
        ),
        (["--mass", "1e3-1e5", "--stream", "pal5", "--age", "99"], "age_gyr"),
        (["--mass", "1e3-1e5", "--theta-min", "0.99"], "theta_min must be smaller than theta_max"),
        (["--mass", "1e3-1e5", "--config", "nowhere.json"], "nowhere.json cannot be read"),
        (["--mass", "1e3-1e5", "--strems", "3"], "--strems"),
    ],
)
@pytest.mark.parametrize("dry_run", [[], ["--dry-run"]])
def test_wrong_simulations_are_refused(tmp_path, arguments, words, dry_run):
    assert words in refused("simulate", *arguments, *dry_run, "--cache", tmp_path / "cache")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not JSON"),
        ("[1]", "configuration"),
        ('{"streams": 5}', "streams"),
        ('{"perturbers": {"X": "wide"}}', "perturbers.X"),
    ],
)
def test_wrong_configuration_files_are_refused(tmp_path, text, words):
    (tmp_path / "config.json").write_text(text)
    arguments = ["simulate", "--config", tmp_path / "config.json", "--cache", tmp_path / "cache"]
    assert words in refused(*arguments, "--seed", "1")
    assert not (tmp_path / "cache").exists()


def test_a_mistyped_command_is_refused():
    assert "simulate" in refused("simulat")
    assert "No such command" in refused("cache", "empty")


# ------------------------------------------------------------------ simulate


def test_simulate_list_verify_and_remove(geometry_cache):
    root = geometry_cache.roots[0]
    answer = json.loads(run(*SIMULATE, "--cache", root, "--json").stdout)
    assert (answer["label"], answer["state"], answer["n_streams"]) == ("1e5-1e7", "complete", 60)
    assert answer["cost_s"] > 0
    dataset = geometry_cache.open_ensemble(answer["key"])
    assert dataset.density.shape == (60, 30)

    listed = json.loads(run("cache", "list", "--cache", root, "--json").stdout)
    assert [(e["kind"], e["state"]) for e in listed] == [("ensemble", "complete"), ("geometry", "complete")]
    assert EnsembleConfig.parse(listed[0]["config"]).key == answer["key"] == listed[0]["key"]
    text = run("cache", "list", "--cache", root).stdout
    assert answer["key"] in text
    assert "60/60" in text

    assert "intact" in run("cache", "verify", "--cache", root).stdout
    assert "--yes" in refused("cache", "remove", answer["key"], "--cache", root)
    run("cache", "remove", answer["key"], "--yes", "--cache", root)
    assert [e.kind for e in geometry_cache.entries()] == ["geometry"]


def test_the_same_simulation_again_is_only_opened(geometry_cache):
    root = geometry_cache.roots[0]
    run(*SIMULATE, "--cache", root)
    before = contents(root)
    assert "60 streams of 1e5-1e7" in run(*SIMULATE, "--cache", root).stdout
    assert contents(root) == before


def test_every_option_reaches_the_configuration(tmp_path, geometry_cache):
    """With a dry run for the wrong cache, the key tells what was asked for."""
    root = geometry_cache.roots[0]
    options = {
        "--X": 3, "--rate-factor": 0.5, "--slope": -1.9, "--cutoff-mass": 1e6, "--profile": "plummer",
        "--rs-factor": 2, "--sigma-h": 150, "--length-factor": 1.2, "--theta-min": 0.1,
        "--theta-max": 0.9, "--n-theta": 31, "--seed": 7, "--streams": 12,
    }  # fmt: skip
    expected = EnsembleConfig(
        perturbers=Perturbers(
            mass_range="1e6-1e8", X=3, rate_factor=0.5, slope=-1.9, cutoff_mass=1e6, profile="plummer",
            rs_factor=2, sigma_h=150, length_factor=1.2,
        ),
        theta_min=0.1, theta_max=0.9, n_theta=31, seed=7, n_streams=12,
    )  # fmt: skip
    arguments = [str(word) for pair in options.items() for word in pair]
    simulate = ["simulate", "--mass", "1e6-1e8", "--dry-run", "--json", "--cache", root]
    assert json.loads(run(*simulate, *arguments).stdout)["key"] == expected.key
    (tmp_path / "config.json").write_text(expected.model_dump_json())
    again = run("simulate", "--config", tmp_path / "config.json", "--dry-run", "--json", "--cache", root)
    assert json.loads(again.stdout)["key"] == expected.key


@pytest.mark.parametrize("mass", ["1e3-1e5", "1e5-1e9"])
def test_a_dry_run_says_impacts_and_cost_and_writes_nothing(geometry_cache, geometry, mass):
    root = geometry_cache.roots[0]
    before = contents(root)
    arguments = ["simulate", "--mass", mass, "--streams", "1000", "--dry-run", "--cache", root]
    answer = json.loads(run(*arguments, "--workers", "2", "--json").stdout)
    assert answer["impacts_per_stream"] == expected_impacts(geometry, Perturbers(mass_range=mass))
    assert answer["seconds"] == pytest.approx(1000 * answer["seconds_per_stream"] / 2)
    assert f"{answer['impacts_per_stream']:.2f}" in run(*arguments).stdout
    assert contents(root) == before


def test_the_environment_names_the_cache(geometry_cache, monkeypatch):
    monkeypatch.setenv("STREAMDASH_CACHE", str(geometry_cache.roots[0]))
    run(*SIMULATE)
    assert [e.kind for e in geometry_cache.entries()] == ["ensemble", "geometry"]


def test_a_cache_that_cannot_be_written_is_refused_before_any_work(geometry_cache, tmp_path):
    (tmp_path / "file").write_text("")
    assert "is a file" in refused(*SIMULATE, "--cache", tmp_path / "file")
    assert "Cannot write to the cache" in refused(*SIMULATE, "--cache", tmp_path / "file" / "below")


# ------------------------------------------------------------------ stream


@pytest.fixture
def impacts(geometry, tmp_path) -> Path:
    path = tmp_path / "impacts.csv"
    drawn = sample_impacts(geometry, Perturbers(mass_range="1e6-1e8"), np.random.default_rng(0))
    drawn.to_frame().drop(columns="profile").to_csv(path, index=False)
    return path


@pytest.mark.parametrize("profile", ["hernquist", "plummer"])
def test_stream_computes_the_profile_of_a_table(geometry_cache, geometry, impacts, tmp_path, profile):
    output = tmp_path / "profile.csv"
    run(
        "stream",
        impacts,
        "-o",
        output,
        "--profile",
        profile,
        "--n-theta",
        "50",
        "--cache",
        geometry_cache.roots[0],
    )
    table = pd.read_csv(output)
    assert tuple(table.columns) == COLUMNS
    theta = np.linspace(0.03, 0.987, 50)
    expected = perturbed_stream(geometry, Impacts.read_csv(impacts, geometry, profile), theta)
    for name in ("theta", "density", "smooth", "q_rho", "omega"):
        np.testing.assert_allclose(table[name], expected[name], rtol=1e-8)
    np.testing.assert_allclose(table.ell, sky.theta_to_ell(geometry, theta), rtol=1e-8)


def test_without_impacts_q_is_one(geometry_cache, impacts, tmp_path):
    impacts.write_text(impacts.read_text().splitlines()[0] + "\n")
    run("stream", impacts, "-o", tmp_path / "profile.csv", "--cache", geometry_cache.roots[0])
    np.testing.assert_allclose(pd.read_csv(tmp_path / "profile.csv").q_rho, 1, atol=1e-12)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("mass_msun", "-5", "mass_msun"),
        ("mass_msun", "nan", "mass_msun"),
        ("b_kpc", "near", "b_kpc"),
        ("time_gyr", "12", "time_gyr"),
        ("theta", "9", "theta"),
        ("r_s_kpc", "0", "r_s_kpc"),
        ("vx_kms", "", "vx_kms"),
    ],
)
def test_wrong_tables_are_refused_by_row_and_column(geometry_cache, impacts, tmp_path, column, value, words):
    table = pd.read_csv(impacts, dtype=str)
    table.loc[2, column] = value
    table.to_csv(impacts, index=False)
    output = tmp_path / "profile.csv"
    output.write_text("kept")
    sentence = refused("stream", impacts, "-o", output, "--cache", geometry_cache.roots[0])
    assert words in sentence
    assert "row 3" in sentence
    assert output.read_text() == "kept"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("b_kpc", "b"), "column 'b_kpc' is missing"),
        (lambda text: "", "not a table"),
        (lambda text: "\x00\x01\x02" * 100, ""),
    ],
)
def test_files_that_are_not_tables_of_impacts_are_refused(geometry_cache, impacts, tmp_path, change, words):
    impacts.write_text(change(impacts.read_text()))
    assert words in refused("stream", impacts, "-o", tmp_path / "p.csv", "--cache", geometry_cache.roots[0])
    assert not (tmp_path / "p.csv").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.csv", "-o", "{tmp}/p.csv"], "nowhere.csv is not a file"),
        (["{impacts}"], "--output"),
        (["{impacts}", "-o", "{tmp}/no/folder/p.csv"], "does not exist"),
        (["{impacts}", "-o", "{tmp}"], "cannot be written"),
        (["{impacts}", "-o", "{tmp}/p.csv", "--n-theta", "1"], "n_theta"),
        (["{impacts}", "-o", "{tmp}/p.csv", "--theta-max", "2.5"], "is off the stream's track"),
        (["{impacts}", "-o", "{tmp}/p.csv", "--theta-min", "0.99"], "theta_min must be smaller"),
        (["{impacts}", "-o", "{tmp}/p.csv", "--profile", "nfw"], "--profile"),
    ],
)
def test_wrong_requests_for_a_stream_are_refused(geometry_cache, impacts, tmp_path, arguments, words):
    filled = [text.format(tmp=tmp_path, impacts=impacts) for text in arguments]
    before = contents(tmp_path)
    assert words in refused("stream", *filled, "--cache", geometry_cache.roots[0])
    assert contents(tmp_path) == before


# ------------------------------------------------------------------ cache


def test_verify_names_every_problem_and_fails(cache, toy):
    path = toy.fill(cache)
    toy.damage(path / "data.zarr/omega/c/1/0", "bit-flipped")
    result = run("cache", "verify", "--cache", cache.roots[0], exit_code=1)
    assert result.stdout.strip() == f"{path.name}: data.zarr/omega/c/1/0 does not match its checksum"
    result = run("cache", "verify", toy.CONFIG.key, "--cache", cache.roots[0], "--json", exit_code=1)
    (found,) = json.loads(result.stdout)
    assert found["state"] == "damaged"
    assert found["problems"] == ["data.zarr/omega/c/1/0 does not match its checksum"]
    listed = run("cache", "list", "--cache", cache.roots[0]).stdout
    assert f"{path.name} is damaged: data.zarr/omega/c/1/0" in listed


def test_verify_does_not_mind_what_is_unfinished(cache, toy):
    toy.fill(cache, [1])
    assert "intact, partial" in run("cache", "verify", "--cache", cache.roots[0]).stdout


def test_an_empty_cache_is_listed(tmp_path):
    assert run("cache", "list", "--cache", tmp_path / "none").stdout == "The cache is empty.\n"
    assert json.loads(run("cache", "list", "--cache", tmp_path / "none", "--json").stdout) == []


def test_shipped_entries_are_not_removed(shipped_cache, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    name = next((shipped_cache / "geometries").iterdir()).name
    assert f"{name} is part of a cache that is only read" in refused("cache", "remove", name, "--yes")
    assert (shipped_cache / "geometries" / name / "manifest.json").exists()


@pytest.mark.parametrize("command", [["cache", "remove", "abc", "--yes"], ["cache", "verify", "abc"]])
def test_an_unknown_entry_is_refused(tmp_path, command):
    assert "'abc'" in refused(*command, "--cache", tmp_path)


def test_removing_may_be_declined(cache, toy):
    """Asked on a terminal; without one, --yes is needed."""
    import pty

    path = toy.fill(cache)
    arguments = [
        sys.executable,
        "-m",
        "streamdash.cli.main",
        "cache",
        "remove",
        path.name,
        "--cache",
        str(cache.roots[0]),
    ]
    for answer, gone in ((b"n\n", False), (b"y\n", True)):
        terminal, end = pty.openpty()
        process = subprocess.Popen(arguments, stdin=end, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        os.write(terminal, answer)
        process.communicate(timeout=300)
        os.close(terminal)
        os.close(end)
        assert process.returncode == (0 if gone else 2)
        assert path.exists() is not gone


@pytest.mark.parametrize("port", ["0", "70000", "http"])
def test_impossible_ports_are_refused(port):
    assert "--port" in refused("serve", "--port", port)


def test_help_names_every_command():
    text = run("--help").stdout
    assert all(name in text for name in ("serve", "simulate", "stream", "cache"))


# ------------------------------------------------------------------ quick to answer

HEAVY = ["numpy", "scipy", "pandas", "numba", "galpy", "xarray", "zarr", "sklearn", "xgboost", "matplotlib"]
HEAVY += ["holoviews", "panel", "joblib", "loky", "astropy"]


@pytest.mark.parametrize("command", ["", "serve", "simulate", "reproduce", "classify", "cache"])
def test_help_loads_no_numerical_library(command):
    """Seconds would pass before the first word."""
    script = (
        "import sys\n"
        "from streamdash.cli.main import app\n"
        "try:\n"
        "    app([*sys.argv[2:], '--help'], prog_name='streamdash')\n"
        "finally:\n"
        "    print('LOADED', sorted(sys.modules.keys() & set(sys.argv[1].split(','))))\n"
    )
    options = [",".join(HEAVY), *filter(None, [command])]
    done = subprocess.run([sys.executable, "-c", script, *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Usage: streamdash" in done.stdout
    assert done.stdout.splitlines()[-1] == "LOADED []"
