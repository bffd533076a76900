"""Reading a table of numbers that somebody else wrote: text in, columns of numbers out.

Whatever the bytes are, the answer is a `Table` or an `ObservationError` with one sentence. Sizes are
checked before anything is parsed, every step is linear in the size, and nothing in the text is
evaluated, opened or followed: a cell is a number or it is not.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

import numpy as np

from streamdash.observe.formats import Columns, fixed_width, read_binary, read_marked, refuse_by_name
from streamdash.observe.limits import (
    MAX_BYTES,
    MAX_COLUMNS,
    MAX_LINES,
    MAX_NAME,
    MAX_ROWS,
    MAX_SECONDS,
    Deadline,
    ObservationError,
    UploadLimit,
    shown,
    too_large,
    too_many,
)

__all__ = [
    "MAX_BYTES",
    "MAX_COLUMNS",
    "MAX_NAME",
    "MAX_ROWS",
    "ObservationError",
    "Table",
    "UploadLimit",
    "read_table",
    "shown",
    "too_large",
]

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "--", "...", "masked"})
"""What stands for no value, in any case of letters."""
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d{1,4})?")
_COMMA = re.compile(r"[+-]?\d*,\d+([eEdD][+-]?\d{1,4})?")
"""A number with a decimal comma."""
_LONGEST_NUMBER = 60
_LONGEST_COMMENT = 500
"""Characters of a comment in which units are looked for."""


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


def read_table(data: bytes) -> Table:
    """Read a table of numbers from the bytes of a file.

    CSV, TSV, semicolons or white space; UTF-8 with or without a byte-order mark, or Latin-1; decimal
    points, or commas where these part no columns. Lines that begin with ``#`` are comments, and the last of
    them before the numbers may name the columns, as may the first other line. ECSV is CSV or white space
    under such comments. VOTable, FITS tables, CDS, MRT and fixed width: `streamdash.observe.formats`.

    Raises
    ------
    ObservationError
        When it is too large, not a table, or not of numbers: the sentence names line and column.
    """
    deadline = Deadline(MAX_SECONDS)
    if len(data) > MAX_BYTES:
        raise ObservationError(too_large(MAX_BYTES))
    refuse_by_name(data)
    found = read_binary(data)
    if found is not None:
        return _of_columns(found)
    text, notes = _text(data)
    found = read_marked(data, text)
    if found is not None:
        return _of_columns(found)
    lines = _lines(text)
    comments = [text for _, text in lines if text.lstrip().startswith("#")]
    rows = [(number, text) for number, text in lines if text.strip() and not text.lstrip().startswith("#")]
    if not rows:
        raise ObservationError("The file holds no rows: only comments or empty lines.")
    too_many(len(rows) - 1)
    numbers = np.array([number for number, _ in rows])
    cells, numbers = _split([text for _, text in rows], numbers, deadline)
    too_many(0, len(cells[0]))
    cells = _points(cells, notes, deadline)
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
    return Table(names, values, body_lines, given is not None, _units(comments, names), tuple(notes))


def _of_columns(found: Columns) -> Table:
    """The table of a file that is not plain text; its rows are numbered from 1."""
    too_many(*found.values.shape)
    if not len(found.values):
        raise ObservationError("The table has a header but no rows of numbers.")
    names = _names(found.names, len(found.names))
    units = {name: shown(unit) for name, unit in zip(names, found.units, strict=True) if unit}
    return Table(names, found.values, np.arange(1, len(found.values) + 1), True, units, tuple(found.notes))


def _text(data: bytes) -> tuple[str, list[str]]:
    """The text of a file, and what is to be said of how it was read."""
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
        return data.decode("utf-8-sig"), []
    except UnicodeDecodeError:
        return data.decode("latin-1"), ["The file is not UTF-8 text and was read as Latin-1."]


def _lines(text: str) -> list[tuple[int, str]]:
    # Only these end a line: str.splitlines would also split at form feeds and Unicode separators.
    return list(enumerate(re.split("\r\n|\r|\n", text), start=1))


def _split(rows: list[str], numbers: np.ndarray, deadline: Deadline) -> tuple[list[list[str]], np.ndarray]:
    """Cells of every row, with the separator that the first rows have, and the rows' lines.

    Where rows of white space have different numbers of cells, their places may tell the columns.
    """
    head = rows[:2]
    separator = next((s for s in ("\t", ";", ",") if all(s in row for row in head)), None)
    words = head[-1].split()
    if separator == "," and len(words) > 1 and all(_COMMA.fullmatch(word) or _number(word) for word in words):
        separator = None  # decimal commas between blanks
    if separator is None:
        cells = [_words(row) for row in rows]
        marked = all(row.count("|") > 1 for row in head) or re.fullmatch(
            r"[\s=-]+", rows[min(1, len(rows) - 1)]
        )
        if marked or len({len(row) for row in cells}) > 1:
            found = fixed_width([row.expandtabs() for row in rows])
            if found is not None:
                rules = [bool(re.fullmatch(r"[\s|:+=-]+", row)) for row in rows]
                kept = numbers[~np.array(rules)]
                return found, kept if len(kept) == len(found) else np.arange(1, len(found) + 1)
        return cells, numbers
    cells = []
    for row in rows:
        deadline.check()
        try:
            read = next(csv.reader(io.StringIO(row), delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 131,072 characters
            read = [row]
        cells.append(read)
    return cells, numbers


def _words(row: str) -> list[str]:
    """Cells between blanks; quotation marks around one are taken off."""
    return [w[1:-1] if len(w) > 1 and w[0] == w[-1] == '"' else w for w in row.split()]


def _points(cells: list[list[str]], notes: list[str], deadline: Deadline) -> list[list[str]]:
    """Cells with decimal points, where the file has commas in their place."""
    found = [cell.strip() for row in cells for cell in row if "," in cell and _COMMA.fullmatch(cell.strip())]
    if not found:
        return cells
    deadline.check()
    if all(re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in found):
        raise ObservationError(
            f"“{shown(found[0])}” may have a decimal comma or one that parts thousands; write decimal points "
            "and no commas."
        )
    notes.append("Decimal commas were read as points.")
    return [
        [cell.replace(",", ".") if _COMMA.fullmatch(cell.strip()) else cell for cell in row] for row in cells
    ]


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
    cells: list[list[str]], lines: np.ndarray, names: tuple[str, ...], deadline: Deadline
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
