"""No text can make a regular expression of the shipped code work for long: all of them grow linearly."""

from __future__ import annotations

import ast
import importlib
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import streamdash
from streamdash.observe.guess import guess
from streamdash.observe.table import MAX_COLUMNS, ObservationError, Table, read_table
from streamdash.survey.mock import EXAMPLE

TRIED = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
    phases=[Phase.explicit, Phase.generate],  # a slow text would be slow again and again while it is shrunk
)
ROOT = Path(streamdash.__file__).parents[1]
SMALL, LARGE = 1500, 12_000
"""Lengths compared. Eight times the text takes eight times as long in a linear search, 64 in a quadratic."""
MOST = 24.0
QUICK = 5e-5
"""Seconds below which the clock says nothing; a quadratic search of the larger text takes far longer."""
FUNCTIONS = ("compile", "match", "fullmatch", "search", "sub", "split", "findall", "finditer")


def patterns() -> list[tuple[str, str, str]]:
    """Where each pattern stands, what it is and how it is used, evaluated with the names of its module."""
    found = []
    for path in sorted([*ROOT.glob("streamdash/**/*.py"), *ROOT.glob("app/**/*.py")]):
        source = path.read_text(encoding="utf-8")
        if "import re\n" not in source:
            continue
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for node in ast.walk(ast.parse(source)):
            if (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and isinstance(node.func.value, ast.Name)
                and node.func.value.id == "re"
                and node.func.attr in FUNCTIONS
            ):
                # A pattern that is built from a function's own names cannot be looked at: this raises.
                module = importlib.import_module(name)
                pattern = eval(ast.unparse(node.args[0]), vars(module))
                found.append((f"{name}:{node.lineno}", pattern, node.func.attr))
    return found


def spent(work: Callable[[], object], times: int = 4) -> float:
    """Least seconds of this processor that some work takes."""
    best = float("inf")
    for _ in range(times):
        start = time.process_time()
        work()
        best = min(best, time.process_time() - start)
    return best


def growth(work: Callable[[str], object], text: Callable[[int], str]) -> float:
    """How many times longer the work takes with a text eight times as long."""
    small, large = text(SMALL), text(LARGE)
    return spent(lambda: work(large)) / max(spent(lambda: work(small)), QUICK)


def pumped(pattern: str) -> st.SearchStrategy[tuple[str, str, str]]:
    """Texts that a pattern nearly matches: a beginning, a piece to repeat, an end that breaks it."""
    match = st.from_regex(pattern)
    pieces = st.one_of(
        match.map(lambda text: text[:12]),
        match.map(lambda text: text[-6:] or "a"),
        st.sampled_from(["0", "1.", " ", "\t", "(", "[", ":", "-", "e", "a", "_", "1e1", "name:", "err"]),
    ).filter(bool)
    return st.tuples(
        match.map(lambda text: text[:20]), pieces, st.sampled_from(["", "!", "\n", "x", " -", "\x00"])
    )


@pytest.mark.parametrize(("where", "pattern", "use"), patterns(), ids=[where for where, *_ in patterns()])
def test_every_pattern_takes_time_in_proportion_to_the_text(where, pattern, use):
    compiled = re.compile(pattern)

    @TRIED
    @given(parts=pumped(pattern))
    def attack(parts):
        first, piece, last = parts

        def text(length: int) -> str:
            return first + piece * (length // len(piece)) + last

        # A pattern that is compiled may be used in any way; others are used as they are written.
        for work in {
            "compile": (compiled.search, compiled.fullmatch),
            "fullmatch": (compiled.fullmatch,),
            "match": (compiled.match,),
        }.get(use, (compiled.search,)):
            times = growth(work, text)
            assert times < MOST, f"{where}: {pattern!r} takes {times:.0f} times longer on {parts!r}"

    attack()


def test_a_quadratic_pattern_is_noticed():
    assert growth(re.compile(r"\(.*?\)").search, lambda n: "(" * n) > MOST


@pytest.mark.parametrize(
    "line",
    ["# - name:" + " " * 480 + "unit:", "# - " + "name:" * 95, "# - {" + "name: a, " * 50 + "unit: "],
    ids=["blanks", "names", "pairs"],
)
def test_comments_that_look_like_units_are_read_at_once(line):
    example = EXAMPLE.read_bytes()
    plain = spent(lambda: read_table(example))
    hostile = "\n".join([line] * 20).encode() + b"\n" + example
    assert read_table(hostile).n_rows == read_table(example).n_rows
    # Ten kilobytes of comments took minutes once; they are as much text as the table itself.
    assert spent(lambda: read_table(hostile)) < 20 * max(plain, 1e-3)


@TRIED
@given(
    piece=st.text(alphabet="#- :{}'\",;\tnameuit01.e\n\r", min_size=1, max_size=8),
    first=st.sampled_from(["", "# - ", "# - {name: ", "phi1,q\n", "1,2\n", '"']),
)
def test_reading_takes_time_in_proportion_to_the_file(piece, first):
    def read(text: str) -> None:
        try:
            read_table(text.encode())
        except ObservationError:
            pass

    assert growth(read, lambda n: first + piece * (n // len(piece))) < 2 * MOST


def test_names_of_columns_are_short_and_few_whatever_they_say():
    """What the patterns of the guess are given is cut before."""
    header = ",".join("(" * 5000 for _ in range(MAX_COLUMNS))
    table = read_table((header + "\n" + ",".join(["1"] * MAX_COLUMNS)).encode())
    assert isinstance(table, Table)
    guess(table)


def test_reading_ends_when_its_time_is_over(monkeypatch):
    monkeypatch.setattr("streamdash.observe.table.MAX_SECONDS", -1.0)
    with pytest.raises(ObservationError, match="took longer"):
        read_table(EXAMPLE.read_bytes())
