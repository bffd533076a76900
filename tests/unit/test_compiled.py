"""Compiled code is kept where that is possible, and computes the same where it is not."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

COMPILE = """
import logging, sys
logging.basicConfig(format="%(levelname)s %(message)s")
{before}
from streamdash.engine.impulse import hernquist_factor
print(round(float(hernquist_factor(0.5)), 6))
"""


def run(before: str, cache: Path, **choices) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", COMPILE.format(before=textwrap.dedent(before))],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=False,
        **choices,
    )


@pytest.fixture(scope="module")
def number(tmp_path_factory) -> str:
    """What it computes where its code is kept."""
    cache = tmp_path_factory.mktemp("kept")
    done = run("", cache)
    assert done.returncode == 0, done.stderr
    assert list(cache.rglob("*.nbc"))
    assert "WARNING" not in done.stderr
    return done.stdout


def test_a_disk_that_is_full_while_numba_compiles_is_one_line(number, tmp_path):
    # Files larger than nothing are refused by the system, as by a full disk, while Python's own are there.
    full = """
    import resource, signal
    sys.dont_write_bytecode = True
    import streamdash.compiled
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    """
    done = run(full, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == number
    said = [line for line in done.stderr.splitlines() if line]
    assert len(said) == 1
    assert said[0].startswith("WARNING Compiled code cannot be kept (File too large)")
    assert not list(tmp_path.rglob("*.nbc"))


def test_without_any_folder_for_compiled_code_it_is_compiled_each_time(number, tmp_path):
    nowhere = """
    import numba.core.caching
    for locator in numba.core.caching.FunctionCache._impl_class._locator_classes:
        locator.from_function = classmethod(lambda cls, *_: None)
    """
    done = run(nowhere, tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == number
    assert done.stderr.count("Compiled code cannot be kept") == 1
    assert len(done.stderr.splitlines()) == 1
