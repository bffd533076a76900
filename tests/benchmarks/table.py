"""All benchmarks as one table, peers beside them: what `./run bench` prints and writes (docs/benchmarks.md).

    python -m tests.benchmarks.table
    python -m tests.benchmarks.table --only classify --output -      # one of them, printed alone

Each is run by itself, one after the other, as its own command would. Times by the clock are those of an idle
machine only where the load that is stated is small; processor time is of all threads together.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from streamdash import __version__
from streamdash.config import ENGINE_VERSION
from tests.browser.driving import ROOT

EXAMPLE = "streamdash/examples/gd1-like.csv"
PUBLISHED = "piecewise-linear route as published: 0.6 s (62 impacts) to 1.7 s (839) for each angle"
FOUR = "1e3-1e5,1e5-1e7,1e7-1e9,1e5-1e9"
SCRIPTS = {
    "first figure": ("first_figure", "--tabs", "6"),
    "first figure, classifier": ("first_figure", "--page", "classifier", "--tabs", "4"),
    "slider": ("slider_latency", "--moves", "30"),
    "50 sessions": ("load", "--sessions", "50", "--seconds", "20"),
    "film": ("film_speed",),
    "first curves": ("first_curves", "--rounds", "1"),
}
"""Scripts that print one line, by what they measure."""
COMMANDS = {
    "classify, two classes": (("classify", EXAMPLE), "8 s by the clock on two idle cores"),
    "classify, four classes": (("classify", EXAMPLE, "--mass", FOUR), "15 s by the clock on two idle cores"),
    "reproduce": (("reproduce",), "25 s of processor time"),
}
"""Commands that are timed as a whole, a new process each, and the goal."""


class Row(NamedTuple):
    """One line of the table."""

    what: str
    measured: str
    beside: str
    command: str


def measured_by_pytest() -> Iterator[Row]:
    """Rows of the benchmarks that are written for pytest-benchmark."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "benchmarks.json"
        command = ["-m", "pytest", "tests/benchmarks", "--benchmark-only", "-q", "-n0"]
        # To standard error: the table alone is printed. A goal that is missed fails there, and is a row here.
        done = subprocess.run(
            [sys.executable, *command, f"--benchmark-json={file}"], cwd=ROOT, stdout=sys.stderr
        )
        if done.returncode not in (0, 1):
            raise SystemExit(f"pytest ended with {done.returncode}: nothing was measured.")
        yield from rows_of(json.loads(file.read_text(encoding="utf-8")))


def rows_of(results: dict) -> Iterator[Row]:
    """Rows of what pytest-benchmark wrote; galpy's one impact stands beside ours."""
    found = {one["name"]: one for one in results["benchmarks"]}
    galpy = found.pop("test_one_impact_galpy", None)
    for name, one in found.items():
        what, median = name.removeprefix("test_").replace("_", " "), one["stats"]["median"]
        extra, beside = one["extra_info"], ""
        measured = f"{1e3 * median:.3g} ms (best {1e3 * one['stats']['min']:.3g})"
        if "ms_per_stream" in extra:
            measured = f"{extra['ms_per_stream']:.1f} ms a stream, worst point {extra['worst']:.1e}"
            beside = PUBLISHED
        elif name == "test_one_impact_ours" and galpy is not None:
            beside = f"galpy's streamgapdf: {1e3 * galpy['stats']['median']:.0f} ms"
        yield Row(what, measured, beside, "python -m pytest tests/benchmarks --benchmark-only")


def printed(what: str, script: str, *options: str) -> Row:
    """The line that a script of this folder prints."""
    command = ["-m", f"tests.benchmarks.{script}", *options]
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, check=False, stdout=subprocess.PIPE, encoding="utf-8"
    )
    lines = done.stdout.strip().splitlines()
    measured = lines[-1] if lines and not done.returncode else f"failed with status {done.returncode}"
    return Row(what, measured, "", " ".join(["python", *command]))


def timed(what: str, arguments: tuple[str, ...], goal: str) -> Row:
    """Seconds of a command of streamdash: by the clock, and of processors."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "streamdash.cli.main", *arguments]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True)
    elapsed, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    measured = f"{elapsed:.1f} s by the clock, {spent:.1f} s of processor time"
    if done.returncode:
        measured = f"failed with status {done.returncode}"
    return Row(what, measured, f"goal: {goal}", " ".join(["streamdash", *arguments]))


def benchmarks() -> Iterator[tuple[str, Callable[[], Iterator[Row]]]]:
    """Everything there is to run, by name."""
    yield "pytest", measured_by_pytest
    for what, (arguments, goal) in COMMANDS.items():
        yield what, lambda w=what, a=arguments, g=goal: iter((timed(w, a, g),))
    for what, (script, *options) in SCRIPTS.items():
        yield what, lambda w=what, s=script, o=options: iter((printed(w, s, *o),))


def markdown(rows: list[Row], load: float, minutes: float) -> str:
    """The table, and the machine it is of."""
    lines = [
        "# Benchmarks",
        "",
        f"Written by `./run bench` on {datetime.now(UTC):%Y-%m-%d}, in {minutes:.0f} minutes: streamdash "
        f"{__version__}, engine {ENGINE_VERSION}, Python {platform.python_version()}, "
        f"{os.cpu_count()} processors of {platform.machine()}, load {load:.1f} when it began. "
        "Times by the clock hold for an idle machine, whose load is well below its processors.",
        "",
        "| what | measured | beside it | printed by |",
        "|---|---|---|---|",
    ]
    lines += [f"| {row.what} | {row.measured} | {row.beside} | `{row.command}` |" for row in rows]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", help="only those with this word in their name")
    parser.add_argument("--output", default="docs/benchmarks.md", help="file that is written; - for none")
    arguments = parser.parse_args()
    load, start, rows = os.getloadavg()[0], time.perf_counter(), []
    for what, run in benchmarks():
        if arguments.only in what:
            print(f"==> {what}", file=sys.stderr, flush=True)
            rows += run()
    table = markdown(rows, load, (time.perf_counter() - start) / 60)
    print(table, end="")
    if arguments.output != "-":
        (ROOT / arguments.output).write_text(table, encoding="utf-8")


if __name__ == "__main__":
    main()
