"""What all tests share: the shipped cache, the default stream's geometry, a cache of one's own."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import hypothesis
import pytest

ROOT = Path(__file__).resolve().parents[1]


def _digest(texts: Iterable[bytes]) -> str:
    return hashlib.sha256(b"".join(texts)).hexdigest()[:16]


SOURCES = {path: path.read_bytes() for path in sorted((ROOT / "streamdash").rglob("*.py"))}
COMPILED = [text for path, text in SOURCES.items() if path.parent.name == "engine" or b"from numba" in text]
"""Of what is compiled, and of the constants in it."""


# Run from a script's background, Ctrl-C is ignored and all that tests start would inherit it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# A machine that is busy with something else is not a failure.
hypothesis.settings.register_profile("suite", deadline=None)
hypothesis.settings.load_profile("suite")
# Before anything imports numba; worker processes and servers started by tests inherit it. numba's disk
# cache does not notice a change in a function that another module inlines, so compiled code is kept apart
# for each state of what is compiled; edits elsewhere compile nothing anew.
os.environ.setdefault("NUMBA_CACHE_DIR", str(ROOT / ".pytest_cache" / "numba" / _digest(COMPILED)))
# A developer's own cache must not decide what a test sees, nor models of other sources.
os.environ.pop("STREAMDASH_CACHE", None)
os.environ["STREAMDASH_MODELS"] = str(ROOT / ".pytest_cache" / "models" / _digest(SOURCES.values()))


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--slow``: also the tests that are marked slow, as continuous integration does."""
    parser.addoption("--slow", action="store_true", help="run the tests marked slow as well")


WARM = """
from streamdash.config import EnsembleConfig
from streamdash.simulation.ensemble import compute_part
from streamdash.store.cache import Cache
compute_part(EnsembleConfig(n_streams=2), 0, range(2), Cache.default("cache"))
"""
"""What has the engine compiled."""


def pytest_sessionstart(session: pytest.Session) -> None:
    """Have the engine compiled once, before several workers and what they start do so side by side."""
    several = getattr(session.config.option, "numprocesses", None)
    if several and not hasattr(session.config, "workerinput"):
        subprocess.run([sys.executable, "-c", WARM], cwd=ROOT, check=True)


BROWSER_FILES = ("test_accessibility", "test_pdf_evidence", "test_observe", "test_profiles", "test_guard")
"""Those that take longest, in the order in which they are begun."""


def _turn(item: pytest.Item) -> int:
    """Place of a test's file: the browser's last, and of them the longest first, so that no core idles."""
    if item.path.parent.name != "browser":
        return 0
    name = item.path.stem
    return 1 + (BROWSER_FILES.index(name) if name in BROWSER_FILES else len(BROWSER_FILES))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked slow, unless it is asked for: by ``--slow``, ``-m`` or its own name."""
    items.sort(key=_turn)
    named = any("::" in argument for argument in config.args)
    if config.getoption("--slow") or config.option.markexpr or named:
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


@pytest.fixture(scope="session")
def root() -> Path:
    """Top folder of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shipped_cache() -> Path:
    """The ``cache/`` folder that comes with the checkout; tests only read it."""
    return ROOT / "cache"


@pytest.fixture(scope="session")
def small_cache(shipped_cache, tmp_path_factory) -> Path:
    """Folder of a cache with the first streams of the shipped ensembles of the paper's two classes."""
    return _first_streams(shipped_cache, tmp_path_factory.mktemp("small") / "cache", "1e3-1e5", "1e5-1e9")


@pytest.fixture(scope="session")
def small_cache_of_four(shipped_cache, tmp_path_factory) -> Path:
    """The same of the paper's two classes and of the two that the heavier of them is divided into."""
    labels = ("1e3-1e5", "1e5-1e9", "1e5-1e7", "1e7-1e9")
    return _first_streams(shipped_cache, tmp_path_factory.mktemp("four") / "cache", *labels)


def _first_streams(shipped_cache: Path, root: Path, *labels: str) -> Path:
    """Fill a cache with the first streams of shipped ensembles of the default stream."""
    from streamdash.store.cache import CHUNK, Cache
    from tests.shipped import of_default_stream

    shutil.copytree(shipped_cache / "geometries", root / "geometries")
    shipped, cache = Cache.default(shipped_cache), Cache.default(root)
    for entry in shipped.entries():
        if of_default_stream(entry) and entry.config.population.label in labels:
            data = shipped.open_ensemble(entry.config)
            config = entry.config.model_copy(update={"n_streams": 2 * CHUNK})
            with cache.begin(config, data[["smooth", "omega_smooth"]]) as writer:
                for index in writer.missing():
                    part = data.isel(stream=slice(index * CHUNK, (index + 1) * CHUNK))
                    writer.write(index, *(part[name].values for name in ("density", "omega", "n_impacts")))
    return root


@pytest.fixture
def cache_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache folder that ``STREAMDASH_CACHE`` points to during the test."""
    directory = tmp_path / "cache"
    directory.mkdir()
    monkeypatch.setenv("STREAMDASH_CACHE", str(directory))
    return directory


@pytest.fixture(scope="session")
def geometry():
    """Geometry of the default stream, from the shipped cache."""
    from streamdash.config import StreamModel
    from streamdash.simulation.geometry import load_geometry

    return load_geometry(StreamModel())
