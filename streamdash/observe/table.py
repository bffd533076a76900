"""Reading a table of numbers that somebody else wrote: text in, columns of numbers out.

Whatever the bytes are, the answer is a `Table` or an `ObservationError` with one sentence. Sizes are
checked before anything is parsed, every step is linear in the size, and nothing in the text is
evaluated, opened or followed: a cell is a number or it is not.
"""

from __future__ import annotations

import csv
import io
import re
import time
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from streamdash.settings import Settings

MAX_BYTES = 1_000_000
MAX_ROWS = 5000
MAX_COLUMNS = 64
MAX_LINES = 4 * MAX_ROWS
"""Ends of lines, comments and empty lines included; files for Windows have two a line."""
MAX_SECONDS = 20.0
"""Longest time that is spent on one file; the largest ones take a second or two on an idle machine."""
MAX_NAME = 40
"""Characters of a column's name that are kept."""
MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "--", "...", "masked"})
"""What stands for no value, in any case of letters."""
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d{1,4})?")
_LONGEST_NUMBER = 60
_LONGEST_COMMENT = 500
"""Characters of a comment in which units are looked for."""


class UploadLimit(Settings):
    """How large a table the operator of a server lets people upload."""

    max_upload_mb: float = Field(
        MAX_BYTES / 1e6,
        gt=0,
        le=MAX_BYTES / 1e6,
        description="largest table that people may upload, MB; more than 1 is never read",
    )


class ObservationError(ValueError):
    """A table that cannot be used; one sentence that says where and what to do."""


def too_large(limit: int) -> str:
    """What is said of a file of more than `limit` bytes."""
    return f"The file is larger than {limit / 1e6:g} MB; a profile has a few dozen rows."


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of numbers.

    Attributes
    ----------
    names : tuple of str
        One a column, all different: those of the header, or ``column 1``, ``column 2``, …
    values : ndarray (n_rows, n_columns)
        NaN where there is no value.
    lines : ndarray (n_rows,) of int
        Line of the file that each row stands in, from 1.
    header : bool
        Whether the names come from the file.
    units : dict of str to str
        Units by column, where the file states them.
    notes : tuple of str
        What was made of the file that its author may not expect, one sentence each.
    """

    names: tuple[str, ...]
    values: np.ndarray
    lines: np.ndarray
    header: bool
    units: dict[str, str]
    notes: tuple[str, ...] = ()

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return len(self.values)

    def column(self, name: str) -> np.ndarray:
        """Values of a column (n_rows,).

        Raises
        ------
        ObservationError
            When there is no such column.
        """
        if name not in self.names:
            raise ObservationError(
                f"There is no column “{shown(name)}”; the table has {', '.join(map(shown, self.names[:12]))}."
            )
        return self.values[:, self.names.index(name)]


class _Deadline:
    """Ends reading that takes too long: whatever a file is made of, others wait for the same processor."""

    def __init__(self, seconds: float) -> None:
        self.end = time.monotonic() + seconds

    def check(self) -> None:
        """Raise `ObservationError` when the time is over."""
        if time.monotonic() > self.end:
            raise ObservationError(
                f"Reading the file took longer than {MAX_SECONDS:g} s; give fewer rows and columns: a "
                "profile has a few dozen rows."
            )


def read_table(data: bytes) -> Table:
    """Read a table of numbers from the bytes of a text file.

    CSV, TSV, semicolons or white space; UTF-8 with or without a byte-order mark; lines that begin
    with ``#`` are comments, and the last of them before the numbers may name the columns, as may the
    first other line. ECSV is CSV or white space under such comments.

    Raises
    ------
    ObservationError
        When it is too large, not text, or not a table of numbers: the sentence names line and column.
    """
    deadline = _Deadline(MAX_SECONDS)
    lines = _lines(_text(data))
    comments = [text for _, text in lines if text.lstrip().startswith("#")]
    rows = [(number, text) for number, text in lines if text.strip() and not text.lstrip().startswith("#")]
    if not rows:
        raise ObservationError("The file holds no rows: only comments or empty lines.")
    if len(rows) > MAX_ROWS + 1:
        raise ObservationError(f"The table has {len(rows)} rows; at most {MAX_ROWS} are read: average some.")
    cells = _split([text for _, text in rows], deadline)
    numbers = np.array([number for number, _ in rows])
    if len(cells[0]) > MAX_COLUMNS:
        raise ObservationError(f"The table has {len(cells[0])} columns; at most {MAX_COLUMNS} are read.")
    header = _is_header(cells[0], int(numbers[0]))
    given = cells[0] if header else _names_in_comment(comments, len(cells[0]))
    body, body_lines = (cells[1:], numbers[1:]) if header else (cells, numbers)
    if not body:
        raise ObservationError("The table has a header but no rows of numbers.")
    width = len(body[0])
    if given is not None and len(given) != width:
        raise ObservationError(
            f"The header names {len(given)} columns, but line {body_lines[0]} has {width} values: make them "
            "agree."
        )
    names = _names(given, width)
    values = _values(body, body_lines, names, deadline)
    return Table(names, values, body_lines, given is not None, _units(comments, names))


def shown(text: str) -> str:
    """Text of a stranger for a sentence: printable, on one line and short."""
    clean = "".join(c if c.isprintable() else "�" for c in text.strip())
    return clean if len(clean) <= MAX_NAME else clean[: MAX_NAME - 1] + "…"


def _text(data: bytes) -> str:
    if len(data) > MAX_BYTES:
        raise ObservationError(too_large(MAX_BYTES))
    if not data.strip():
        raise ObservationError("The file is empty.")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise ObservationError("The file is UTF-16 text; save it as UTF-8.")
    if b"\x00" in data:
        raise ObservationError("The file is not text (it holds zero bytes); save the table as CSV.")
    if data.count(b"\n") + data.count(b"\r") > MAX_LINES:
        raise ObservationError(
            f"The file has more than {MAX_LINES:,} lines; at most {MAX_ROWS} rows are read."
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise ObservationError(
            f"The file is not UTF-8 text (line {line}); save the table as CSV in UTF-8."
        ) from None


def _lines(text: str) -> list[tuple[int, str]]:
    # Only these end a line: str.splitlines would also split at form feeds and Unicode separators.
    return list(enumerate(re.split("\r\n|\r|\n", text), start=1))


def _split(rows: list[str], deadline: _Deadline) -> list[list[str]]:
    """Cells of every row, with the separator that the first rows have."""
    head = rows[:2]
    separator = next((s for s in ("\t", ";", ",") if all(s in row for row in head)), None)
    if separator is None:
        return [row.split() for row in rows]
    cells = []
    for row in rows:
        deadline.check()
        try:
            found = next(csv.reader(io.StringIO(row), delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 131,072 characters
            found = [row]
        cells.append(found)
    return cells


def _number(cell: str) -> float | None:
    """The value of a cell: NaN where it stands for none, None where it is not a number."""
    text = cell.strip()
    if text.lower() in MISSING:
        return np.nan
    if text.lower().lstrip("+-") in ("inf", "infinity"):
        return np.inf
    if len(text) > _LONGEST_NUMBER or not text.isascii() or _NUMBER.fullmatch(text) is None:
        return None
    return float(text.replace("d", "e").replace("D", "e"))


def _is_header(cells: list[str], line: int) -> bool:
    """Whether the first line names columns rather than giving values; a mixture is refused."""
    strange = [cell for cell in cells if _number(cell) is None]
    if strange and any(np.isfinite(_number(cell) or 0.0) and cell not in strange for cell in cells):
        raise ObservationError(
            f"Line {line} mixes names and numbers (“{shown(strange[0])}” is not a number): a header has "
            "names only, a row numbers only."
        )
    return bool(strange)


def _values(
    cells: list[list[str]], lines: np.ndarray, names: tuple[str, ...], deadline: _Deadline
) -> np.ndarray:
    values = np.empty((len(cells), len(names)))
    for i, (row, line) in enumerate(zip(cells, lines, strict=True)):
        deadline.check()
        if len(row) != len(names):
            raise ObservationError(
                f"Line {line} has {len(row)} values where the lines before have {len(names)}; each row needs "
                "one value per column (nan where there is none)."
            )
        for j, cell in enumerate(row):
            value = _number(cell)
            if value is None:
                raise ObservationError(
                    f"Line {line}, column “{names[j]}”: “{shown(cell)}” is not a number."
                    + (" Decimals need a point." if re.fullmatch(r"[+-]?\d+,\d+", cell.strip()) else "")
                )
            values[i, j] = value
    return values


def _names_in_comment(comments: list[str], width: int) -> list[str] | None:
    """Names in the last comment, where it has as many words as there are columns and none is a number."""
    if not comments:
        return None
    words = re.split(r"[,;\t\s]+", comments[-1].strip().lstrip("#").strip())
    if len(words) != width or any(_number(word) is not None for word in words):
        return None
    return words


def _names(given: list[str] | None, width: int) -> tuple[str, ...]:
    names: list[str] = []
    for j in range(width):
        plain = shown(given[j]) if given is not None else ""
        name = plain or f"column {j + 1}"
        names.append(name if name not in names else shown(f"column {j + 1} {name}"))
    return tuple(names)


def _units(comments: list[str], names: tuple[str, ...]) -> dict[str, str]:
    """Units in the lines ``# - {name: phi1, unit: deg, …}`` of an ECSV header."""
    units = {}
    for comment in comments[: 4 * MAX_COLUMNS]:
        entry = comment[:_LONGEST_COMMENT].lstrip("# \t")
        if not entry.startswith("-"):
            continue
        pairs = (field.partition(":") for field in entry[1:].strip(" \t{}").split(","))
        words = {key.strip(): value.strip(" \t'\"{}") for key, _, value in pairs}
        if words.get("unit") and shown(words.get("name", "")) in names:
            units[shown(words["name"])] = shown(words["unit"])
    return units
