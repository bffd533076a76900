"""Astronomers' formats, read through astropy: FITS, VOTable, CDS and MRT, fixed width.

A file is looked at before astropy sees it. What a header claims is compared with what the file holds, so
that no claim makes room for rows that are not there; an XML file is walked through without building
anything; what would be fetched, unpacked, unpickled or expanded is refused. The rest is bounded by the
size of the file.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.parsers import expat

import numpy as np

from streamdash.observe.limits import MAX_COLUMNS, MAX_ROWS, ObservationError, shown, too_many

REFUSED: tuple[tuple[bytes, str, str], ...] = (
    (b"PK\x03\x04", "a spreadsheet or another zip file (Excel, OpenDocument)", "save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook", "save the sheet as CSV"),
    (b"\x1f\x8b", "compressed with gzip", "unpack it first"),
    (b"BZh", "compressed with bzip2", "unpack it first"),
    (b"\xfd7zXZ", "compressed with xz", "unpack it first"),
    (b"(\xb5/\xfd", "compressed with zstandard", "unpack it first"),
    (b"\x89HDF", "an HDF5 file", "save the table as CSV, ECSV, VOTable or FITS"),
    (b"\x93NUMPY", "a NumPy array", "save the table as CSV"),
    (b"PAR1", "a Parquet file", "save the table as CSV"),
    (b"%PDF", "a PDF", "save the table as CSV"),
    (b"\x80\x04\x95", "a Python pickle, which is never opened", "save the table as CSV"),
    (b"\x80\x05\x95", "a Python pickle, which is never opened", "save the table as CSV"),
)
"""First bytes of files that are refused by name, what they are, and what to do instead."""
TAGS = frozenset(
    "VOTABLE RESOURCE DESCRIPTION DEFINITIONS INFO PARAM FIELD VALUES MIN MAX OPTION LINK GROUP FIELDref "
    "PARAMref COOSYS TIMESYS TABLE DATA TABLEDATA TR TD".split()
)
"""Elements of a VOTable that is read; others hold rows in binary or elsewhere."""
MAX_DEPTH = 30
MAX_UNIT = 40
"""Longest text of a unit."""
MAX_TEXT = 1000
"""Characters that all text cells of a row may have by the header of a VOTable."""
BYTE_BY_BYTE = "byte-by-byte description"
"""Begins the description of the columns of a CDS or MRT table."""
RULES = ({"-"}, {"="})


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of numbers out of a file that is not plain text.

    Attributes
    ----------
    names : list of str
    values : ndarray (n_rows, n_columns)
    units : list of str or None
    notes : list of str
    """

    names: list[str]
    values: np.ndarray
    units: list[str | None]
    notes: list[str]


def refuse_by_name(data: bytes) -> None:
    """Refuse what is no table that is read, and say what it is.

    Raises
    ------
    ObservationError
        For files of the kinds in `REFUSED`.
    """
    for start, kind, advice in REFUSED:
        if data.startswith(start):
            if start == b"PK\x03\x04" and b"xl/" in data:
                kind = "an Excel workbook"
            raise ObservationError(f"The file is {kind}, which is not read; {advice}.")


def read_binary(data: bytes) -> Columns | None:
    """Columns of a FITS file; None of any other."""
    return _guarded(_fits, data, "FITS") if data.startswith(b"SIMPLE  =") else None


def read_marked(data: bytes, text: str) -> Columns | None:
    """Columns of a VOTable or of a CDS or MRT table; None of other text."""
    start = text[:4000].lstrip("\ufeff \t\r\n")
    if start.startswith("<"):
        if not re.search(r"<(\w+:)?VOTABLE\b", start):
            raise ObservationError(
                "The file is XML or HTML but no VOTable; save the table as CSV or VOTable."
            )
        return _guarded(_votable, data, "VOTable")
    if BYTE_BY_BYTE in text.lower():
        return _guarded(_mrt, text, "CDS or MRT")
    return None


def fixed_width(lines: list[str]) -> list[list[str]] | None:
    """Cells of a table whose columns stand under each other, header first; None where they do not.

    Columns are parted by bars, told by a rule of dashes under the names, or by what is blank in all lines.

    Parameters
    ----------
    lines : list of str
        Names first, then rows; neither comments nor empty lines.
    """
    bars = all(line.count("|") > 1 for line in lines[:2])
    if bars:
        rows = [line for line in lines if not re.fullmatch(r"[\s|:+=-]+", line)]
        too_many(len(rows) - 1, lines[0].count("|"))
        return _guarded(lambda given: _fixed(given, format="fixed_width", delimiter="|"), rows, "fixed-width")
    marks = lines[1].split() if len(lines) > 2 else []
    if len(marks) > 1 and all(set(word) in RULES for word in marks):
        mark = lines[1].strip()[0]
        rows = [line for line in lines if not re.fullmatch(r"[\s=-]+", line) or line is lines[1]]
        too_many(len(rows) - 2, len(lines[1].split()))
        return _guarded(
            lambda given: _fixed(given, format="fixed_width_two_line", position_char=mark),
            rows,
            "fixed-width",
        )
    starts, ends = _blanks(lines)
    if len(starts) != max(len(line.split()) for line in lines) or len(starts) < 2:
        return None
    too_many(len(lines) - 1, len(starts))
    places = {"col_starts": starts, "col_ends": ends}
    return _guarded(
        lambda given: _fixed(given, format="fixed_width_no_header", **places), lines, "fixed-width"
    )


# ---------------------------------------------------------------- each format


def _fits(data: bytes) -> Columns:
    from astropy.io import fits

    with fits.open(io.BytesIO(data), memmap=False, disable_image_compression=True) as hdus:
        for hdu in hdus:
            if isinstance(hdu, fits.BinTableHDU | fits.TableHDU):
                break
        else:
            raise ObservationError("The FITS file holds no table; save the profile as a table extension.")
        n_rows, width = int(hdu.header["NAXIS2"]), int(hdu.header["NAXIS1"])
        n_columns = int(hdu.header["TFIELDS"])
        too_many(n_rows, n_columns)
        if n_rows * width > len(data):
            raise ObservationError(
                "The FITS file is not whole: its header tells of more rows than there are."
            )
        names, values, units, left = [], [], [], []
        for column in hdu.columns:
            code = re.fullmatch(r"1?([BIJKED])|([IFED][\d.]+)", str(column.format).strip())
            if code is None:
                left.append(column.name)
                continue
            cells = np.asarray(hdu.data.field(column.name))
            numbers = cells.astype(float)
            if cells.dtype.kind in "iu" and isinstance(column.null, int):
                numbers[cells == column.null] = np.nan
            names.append(column.name)
            values.append(numbers)
            units.append(column.unit)
        return _columns(names, values, units, left)


def _votable(data: bytes) -> Columns:
    from astropy.io import votable

    units = _walked(data)
    found = votable.parse(io.BytesIO(data), verify="ignore", invalid="mask", unit_format="cds")
    table = next(iter(found.iter_tables()), None)
    if table is None or not len(table.array):
        raise ObservationError("The VOTable holds no rows.")
    too_many(len(table.array), len(table.fields))
    names, values, of_columns, left = [], [], [], []
    for field in table.fields:
        cells = table.array[field.ID]
        name = field.name or field.ID
        if cells.dtype.kind not in "iuf" or cells.ndim != 1:
            left.append(name)
            continue
        names.append(name)
        values.append(np.ma.filled(cells.astype(float), np.nan))
        of_columns.append(units.get(name))
    return _columns(names, values, of_columns, left)


def _walked(data: bytes) -> dict[str, str]:
    """Look at every element of a VOTable before astropy does, without building any; units by column."""
    depth = rows = fields = tables = text = 0
    claimed = 0
    units: dict[str, str] = {}

    def refuse(words: str) -> None:
        raise ObservationError(f"The VOTable {words}.")

    def started(tag: str, given: dict[str, str]) -> None:
        nonlocal depth, rows, fields, tables, text, claimed
        tag = tag.rpartition(":")[2]
        depth += 1
        if depth > MAX_DEPTH:
            refuse("is nested too deep to be one")
        if tag in ("BINARY", "BINARY2", "FITS", "PARQUET", "STREAM"):
            refuse(f"holds its rows as {tag}; save it as TABLEDATA")
        if tag not in TAGS:
            refuse(f"holds “{shown(tag)}”, which is not read; save it without")
        tables += tag == "TABLE"
        if tables > 1:
            refuse("holds several tables; save the one with the profile")
        rows += tag == "TR"
        too_many(rows)
        if tag == "TABLE" and "nrows" in given:
            claimed = _whole(given["nrows"])
        if tag in ("FIELD", "PARAM"):
            fields += tag == "FIELD"
            too_many(0, fields)
            size = given.get("arraysize", "1").strip()
            text_cell = given.get("datatype", "") in ("char", "unicodeChar")
            if size != "1" and not (text_cell and re.fullmatch(r"\d{0,4}\*?", size)):
                refuse(f"has arrays in its cells (“{shown(given.get('name', ''))}”); save it without")
            text += _whole(size.strip("*")) if text_cell else 0
            if text > MAX_TEXT:
                refuse("has longer texts in its rows than are read; save it without")
            unit = given.get("unit", "")
            if len(unit) > MAX_UNIT:
                refuse(f"has a unit longer than {MAX_UNIT} characters")
            if tag == "FIELD" and unit:
                units[given.get("name") or given.get("ID", "")] = unit

    def ended(_tag: str) -> None:
        nonlocal depth
        depth -= 1

    def declared(*_given: Any) -> Any:
        refuse(
            "has a document type or entities of its own, which are not read; save it without (no <!DOCTYPE)"
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = started, ended
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = declared
    parser.ExternalEntityRefHandler = parser.UnparsedEntityDeclHandler = declared
    parser.Parse(data, True)
    if claimed > rows:
        refuse("is not whole: its header tells of more rows than there are")
    return units


def _mrt(text: str) -> Columns:
    lines = re.split("\r\n|\r|\n", text)
    first = next((i for i, line in enumerate(lines) if line.lower().startswith(BYTE_BY_BYTE)), len(lines))
    rules = [i for i in range(first, len(lines)) if len(lines[i]) > 9 and set(lines[i].strip()) in RULES]
    if len(rules) < 3:
        raise ObservationError(
            "The CDS or MRT table has no end of its byte-by-byte description (a line of dashes)."
        )
    described = lines[first : rules[2]]
    if len(described) > 10 * MAX_COLUMNS or max(map(len, described)) > 2000:
        raise ObservationError("The byte-by-byte description is longer than any that is read.")
    defined = [line for line in described if re.match(r" *(\d+ *- *)?\d+ +[AIFEDaifed]\d+", line)]
    body = [line for line in lines[rules[-1] + 1 :] if line.strip()]
    too_many(len(body), len(defined))
    if any(len(word) > MAX_UNIT for line in defined for word in line.split()[:4]):
        raise ObservationError("The byte-by-byte description has a longer unit or format than is read.")
    from astropy.io import ascii as text_tables

    table = text_tables.read([*lines[first : rules[-1] + 1], *body], format="cds", guess=False)
    too_many(len(table), len(table.colnames))
    names, values, units, left = [], [], [], []
    for name in table.colnames:
        column = table[name]
        if column.dtype.kind not in "iuf":
            left.append(name)
            continue
        names.append(name)
        values.append(np.ma.filled(np.ma.asarray(column).astype(float), np.nan))
        units.append(None if column.unit is None else str(column.unit))
    return _columns(names, values, units, left)


def _fixed(lines: list[str], **form: Any) -> list[list[str]]:
    from astropy.io import ascii as text_tables

    as_text = {"*": [text_tables.convert_numpy(str)]}
    table = text_tables.read(lines, guess=False, converters=as_text, fill_values=[], **form)
    too_many(len(table), len(table.colnames))
    rows = [[str(cell) for cell in row] for row in table]
    return rows if "col_starts" in form else [list(table.colnames), *rows]


# ---------------------------------------------------------------- common


def _columns(names: list[str], values: list[np.ndarray], units: list[str | None], left: list[str]) -> Columns:
    if not names:
        raise ObservationError("The table has no columns of single numbers.")
    notes = []
    if left:
        some = ", ".join(f"“{shown(name)}”" for name in left[:4]) + (", …" if len(left) > 4 else "")
        notes.append(f"Columns that are not single numbers were left out: {some}.")
    return Columns(names, np.stack(values, axis=1), units, notes)


def _guarded(reader: Callable[[Any], Any], given: Any, kind: str) -> Any:
    """Whatever goes wrong in somebody else's reader is one sentence."""
    from astropy import log

    log.setLevel("ERROR")  # astropy's warnings about a stranger's file are for nobody
    try:
        return reader(given)
    except ObservationError:
        raise
    except Exception as error:
        words = shown(" ".join(str(error).split())[:200]) or type(error).__name__
        raise ObservationError(
            f"The file looks like a {kind} table but cannot be read as one ({words}); save it as CSV."
        ) from None


def _blanks(lines: list[str]) -> tuple[list[int], list[int]]:
    """First and last place of each column: what is parted by places that are blank in all lines."""
    width = min(max(map(len, lines)), 20 * MAX_COLUMNS)
    used = np.zeros(width, dtype=bool)
    for line in lines:
        marks = np.frombuffer(line[:width].encode("utf-32-le"), np.uint32)
        used[: len(marks)] |= marks > ord(" ")
    steps = np.diff(np.concatenate([[0], used.astype(int), [0]]))
    return np.flatnonzero(steps == 1).tolist(), (np.flatnonzero(steps == -1) - 1).tolist()


def _whole(text: str) -> int:
    """A number out of an attribute; what is none counts as more than is read."""
    return int(text) if re.fullmatch(r"\d{1,9}", text.strip()) else (0 if not text.strip() else 10 * MAX_ROWS)
