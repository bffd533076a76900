"""The wheel, built and installed for real in an environment of its own, away from the checkout."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import sysconfig
import tarfile
import time
import tomllib
import urllib.request
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from streamdash import Cache, __version__
from tests.unit.sources import imported, shipped

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "streamdash" / "examples" / "gd1-like.csv"


def normal(name: str) -> str:
    """A distribution's name as packaging normalises it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def test_all_imports_are_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    everything = [*project["dependencies"], *project["optional-dependencies"]["dask"]]
    declared = {normal(re.match(r"[\w.-]+", line)[0]) for line in everything}
    distributions = packages_distributions()
    used = {top for path in shipped() for top in imported(path) if top not in sys.stdlib_module_names}
    undeclared = {
        top: distributions.get(top)
        for top in used - {"streamdash", "app"}
        if not declared & {normal(name) for name in distributions.get(top, [])}
    }
    assert undeclared == {}


class Installed:
    """An environment with the wheel in it; the libraries it needs are those of the running Python."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.home = folder / "home"
        self.home.mkdir()
        venv = folder / "venv"
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
        self.python = venv / "bin" / "python"
        pip = [sys.executable, "-m", "pip", "--python", self.python, "--disable-pip-version-check"]
        subprocess.run([*pip, "install", "--quiet", "--no-deps", "--no-index", wheel], check=True)
        (self.packages,) = venv.glob("lib/python*/site-packages")
        # A folder named in a .pth file is searched after site-packages, and its own .pth files, which
        # would bring the checkout in, are not read.
        (self.packages / "libraries.pth").write_text(f"{sysconfig.get_paths()['purelib']}\n")
        self.environment = {
            key: value
            for key, value in os.environ.items()
            if not key.startswith(("PYTHON", "STREAMDASH")) and key != "VIRTUAL_ENV"
        } | {"HOME": str(self.home), "XDG_DATA_HOME": "", "XDG_CACHE_HOME": ""}

    def run(self, *arguments: object, exit_code: int = 0) -> str:
        """What a command of the environment prints, started in an empty folder."""
        program = self.python.parent / str(arguments[0])
        done = subprocess.run(
            [program, *map(str, arguments[1:])],
            cwd=self.home,
            env=self.environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == exit_code, done.stdout + done.stderr
        return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel"]
    subprocess.run([*pip, "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT], check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Installed:
    return Installed(tmp_path_factory.mktemp("elsewhere"), wheel)


@pytest.mark.slow
def test_the_wheel_holds_one_package_and_the_shipped_simulations(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"streamdash"}
    files = [path.relative_to(ROOT).as_posix() for path in (ROOT / "cache").rglob("*") if path.is_file()]
    shipped_files = {f"streamdash/shipped/{file}" for file in files if "/." not in file}
    assert len(shipped_files) > 100 and shipped_files <= set(names)
    assert {"streamdash/py.typed", "streamdash/shipped/app/main.py"} <= set(names)
    templates = [path.relative_to(ROOT).as_posix() for path in ROOT.glob("[as]*/**/*.html")]
    inside = {f"streamdash/shipped/{t}" if t.startswith("app/") else t for t in templates}
    assert len(inside) > 10 and inside <= set(names)
    read = {name for path in shipped() for name in re.findall(r'DOCS / "([^"]+)"', path.read_text("utf-8"))}
    assert read and {f"streamdash/shipped/docs/{name}" for name in read} <= set(names)
    assert [name for name in names if "/." in name or "__pycache__" in name] == []
    assert [name for name in names if name.endswith("licenses/LICENSE")] != []
    assert wheel.stat().st_size < 80e6


@pytest.mark.slow
def test_the_library_is_the_wheels_and_nothing_else_is_installed(installed):
    where = installed.run("python", "-c", "import streamdash; print(streamdash.__file__)")
    assert Path(where.strip()).is_relative_to(installed.packages)
    installed.run("python", "-c", "import app", exit_code=1)
    assert installed.run("streamdash", "--version").split() == ["streamdash", __version__]
    assert "classify" in installed.run("streamdash", "--help")


@pytest.mark.slow
def test_shipped_simulations_are_listed_and_intact(installed):
    entries = json.loads(installed.run("streamdash", "cache", "list", "--json"))
    assert {entry["state"] for entry in entries} == {"complete"}
    assert all(Path(entry["path"]).is_relative_to(installed.packages) for entry in entries)
    checkout = {entry.path.name for entry in Cache((ROOT / "cache",)).entries()}
    assert {Path(entry["path"]).name for entry in entries} == checkout
    installed.run("streamdash", "cache", "verify")


@pytest.mark.slow
def test_the_example_is_classified(installed):
    report = json.loads(installed.run("streamdash", "classify", EXAMPLE, "--json"))
    probability = {one["mass_range"]: one["probability"] for one in report["classes"]}
    assert sum(probability.values()) == pytest.approx(1)
    truth = json.loads(EXAMPLE.with_suffix(".truth.json").read_text(encoding="utf-8"))
    assert max(probability, key=probability.__getitem__) == truth["mass_range"]


@pytest.mark.slow
def test_table_1_is_reproduced_and_no_file_left_behind(installed):
    printed = installed.run("streamdash", "reproduce", "--no-classifier")
    table = (ROOT / "docs" / "reproduction" / "table1.md").read_text(encoding="utf-8")
    assert printed.splitlines()[0] == table.splitlines()[0]
    assert sorted(path.name for path in installed.home.iterdir() if not path.name.startswith(".")) == []


@pytest.mark.slow
def test_the_dashboard_is_served(installed, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = tmp_path / "log"
    with log.open("wb") as stream:
        server = subprocess.Popen(
            [installed.python.parent / "streamdash", "serve", "--port", str(port)],
            cwd=installed.home,
            env=installed.environment,
            stdout=stream,
            stderr=subprocess.STDOUT,
        )
    try:
        page = fetch(f"http://localhost:{port}/main?page=evidence", server)
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait(300)
    said = log.read_text(encoding="utf-8")
    assert "Traceback" not in said and "Error" not in said, said
    assert "<title>streamdash</title>" in page
    assert re.search(r'"roots":\s*\{\s*"', page), "the page has nothing on it"


def fetch(url: str, server: subprocess.Popen, seconds: float = 300) -> str:
    """A page as soon as the server gives it."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        assert server.poll() is None, "the server ended"
        with contextlib.suppress(OSError):
            return urllib.request.urlopen(url, timeout=seconds).read().decode()
        time.sleep(0.2)
    raise AssertionError(f"no answer within {seconds:g} s")


@pytest.mark.slow
def test_the_source_distribution_makes_the_same_wheel(wheel, tmp_path):
    script = "import sys; from hatchling.build import build_sdist; print(build_sdist(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", script, tmp_path], cwd=ROOT, check=True, capture_output=True)
    (sdist,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "unpacked", filter="data")
    (source,) = (tmp_path / "unpacked").iterdir()
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel"]
    subprocess.run([*pip, "-q", "--no-deps", "--no-build-isolation", "-w", tmp_path, source], check=True)
    (again,) = tmp_path.glob("*.whl")
    assert sorted(zipfile.ZipFile(again).namelist()) == sorted(zipfile.ZipFile(wheel).namelist())
