"""Astronomers' formats through astropy: the same profile out of each, and hostile files of each."""

from __future__ import annotations

import io
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from astropy.io import ascii as text_tables
from astropy.io import fits
from astropy.table import MaskedColumn
from astropy.table import Table as AstropyTable
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from streamdash.observe.guess import assume
from streamdash.observe.limits import MAX_BYTES
from streamdash.observe.observation import interpret
from streamdash.observe.table import ObservationError, Table, read_table

PHI1 = np.arange(-90.0, -28.0, 2.0)
Q = np.round(1 + 0.3 * np.sin(PHI1 / 7), 5)
N = len(PHI1)


def made() -> AstropyTable:
    """φ1, Qρ and its error, a name for every bin, and one value that is not there."""
    table = AstropyTable({"name": [f"bin {i}" for i in range(N)], "phi1": PHI1})
    table["q_rho"] = MaskedColumn(Q, mask=np.arange(N) == 4)
    table["e_q_rho"] = np.full(N, 0.1)
    table["phi1"].unit = "deg"
    return table


def written(form: str, table: AstropyTable | None = None, **options) -> bytes:
    """A table as astropy writes it."""
    table = made() if table is None else table
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if form in ("fits", "votable"):
            out = io.BytesIO()
            table.write(out, format=form, **options)
            return out.getvalue()
        text = io.StringIO()
        text_tables.write(table, text, format=form, **options)
        return text.getvalue().encode()


def plain() -> AstropyTable:
    """Without names of bins, which text tables of numbers do not hold."""
    table = made()
    table.remove_column("name")
    return table


FILES = {
    "fits": written("fits"),
    "votable": written("votable"),
    "mrt": written("mrt"),
    "bars": written("fixed_width", plain(), bookend=True, fill_values=[(text_tables.masked, "")]),
    "rule": written("fixed_width_two_line", plain(), fill_values=[(text_tables.masked, "")]),
    "markdown": written(
        "fixed_width", plain(), bookend=True, fill_values=[(text_tables.masked, "nan")]
    ).replace(b"\n", b"\n|---|---|---|\n", 1),
    "places": written("fixed_width", plain(), delimiter=None, fill_values=[(text_tables.masked, "")]),
    "ecsv": written("ecsv", plain()),
}


@pytest.mark.parametrize("form", FILES)
def test_the_same_profile_out_of_every_format(form, geometry):
    table = read_table(FILES[form])
    assert table.names == ("phi1", "q_rho", "e_q_rho")
    np.testing.assert_allclose(table.column("phi1"), PHI1)
    np.testing.assert_allclose(table.column("q_rho"), np.where(np.arange(N) == 4, np.nan, Q), rtol=1e-5)
    if form in ("fits", "votable", "mrt"):
        assert table.units == {"phi1": "deg"}
        assert "“name”" in " ".join(table.notes)
    observation = interpret(table, assume(table), geometry)
    assert observation.design.n_bin == N - 1
    assert observation.assumptions.error == "e_q_rho"


def test_a_cds_table_with_its_readme_before_it():
    text = FILES["mrt"].decode()
    body = text[text.index("Byte-by-byte") :]
    head = "J/MNRAS/494/5315  The track of GD-1\n" + "=" * 80 + "\n"
    assert read_table((head + body).encode()).n_rows == N


def test_a_binary_votable_is_told_how_to_be_saved():
    with pytest.raises(ObservationError, match="BINARY.*; save it as TABLEDATA"):
        read_table(written("votable", tabledata_format="binary"))


def test_whole_numbers_that_stand_for_nothing_are_gaps():
    column = fits.Column("n", "J", null=-99, array=np.array([5, -99, 7], np.int32))
    place = fits.Column("phi1", "E", array=np.arange(3, dtype=np.float32))
    wide = fits.Column("cube", "3E", array=np.zeros((3, 3), np.float32))
    out = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns([place, column, wide])]).writeto(out)
    table = read_table(out.getvalue())
    np.testing.assert_array_equal(table.column("n"), [5, np.nan, 7])
    assert "“cube”" in table.notes[0]


# ------------------------------------------------------------------ hostile files

VOTABLE = FILES["votable"].decode()
ENTITIES = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
BOMB = f'<?xml version="1.0"?><!DOCTYPE VOTABLE [<!ENTITY a0 "haha">{ENTITIES}]><VOTABLE>&a9;</VOTABLE>'
FOREIGN = (
    '<?xml version="1.0"?><!DOCTYPE VOTABLE [<!ENTITY e SYSTEM "file:///etc/passwd">]><VOTABLE>&e;</VOTABLE>'
)
CELL = '<FIELD ID="a" name="a" datatype="double"/>'


def of_table(inside: str, more: str = "") -> bytes:
    """A VOTable with something of its own in it."""
    start = f'<?xml version="1.0"?><VOTABLE version="1.4"><RESOURCE><TABLE{more}>'
    return f"{start}{inside}</TABLE></RESOURCE></VOTABLE>".encode()


def big_fits(**cards: int) -> bytes:
    """A FITS table whose header claims what is not there."""
    data = FILES["fits"].decode("latin-1")
    for name, value in cards.items():
        at = data.index(f"{name:8}=", 2880)
        data = f"{data[:at]}{name:8}={value:>21}{data[at + 30 :]}"
    return data.encode("latin-1")


HOSTILE = {
    "bomb": (BOMB.encode(), "document type or entities"),
    "foreign": (FOREIGN.encode(), "document type or entities"),
    "deep": (b"<VOTABLE>" + b"<RESOURCE>" * 90_000, "nested too deep"),
    "href": (
        of_table(f'{CELL}<DATA><BINARY><STREAM href="file:///etc/passwd"/></BINARY></DATA>'),
        "BINARY; save it as TABLEDATA",
    ),
    "fetched": (of_table(f'{CELL}<DATA><FITS><STREAM href="http://localhost/"/></FITS></DATA>'), "as FITS"),
    "unknown": (of_table("<SCRIPT/>"), "“SCRIPT”"),
    "claimed": (
        of_table(f"{CELL}<DATA><TABLEDATA><TR><TD>1</TD></TR></TABLEDATA></DATA>", ' nrows="900000000"'),
        "more rows than there are",
    ),
    "texts": (
        of_table('<FIELD ID="a" name="a" datatype="char" arraysize="9999"/><DATA><TABLEDATA/></DATA>'),
        "longer texts",
    ),
    "arrays": (
        of_table('<FIELD ID="a" name="a" datatype="double" arraysize="1000x1000"/><DATA><TABLEDATA/></DATA>'),
        "arrays in its cells",
    ),
    "rows": (
        of_table(f"{CELL}<DATA><TABLEDATA>{'<TR><TD>1</TD></TR>' * 5001}</TABLEDATA></DATA>"),
        "5001 rows; at most 5000",
    ),
    "fields": (of_table(CELL * 65), "65 columns; at most 64"),
    "html": (b"<!doctype html><html></html>", "XML or HTML but no VOTable"),
    "fits rows": (big_fits(NAXIS2=4000), "more rows than there are"),
    "fits many": (big_fits(NAXIS2=2_000_000_000), "2000000000 rows; at most 5000"),
    "fits wide": (big_fits(NAXIS1=2_000_000_000), "more rows than there are"),
    "fits fields": (big_fits(TFIELDS=999), "999 columns; at most 64"),
    "fits cut": (FILES["fits"][:2880], "holds no table"),
    "mrt": (
        b"Byte-by-byte Description of file: x\n" + b"-" * 80 + b"\n" + b"1-2 F5.2 --- a x\n" * 3,
        "end of its byte-by-byte description",
    ),
    "mrt units": (
        FILES["mrt"].replace(b"deg   ", b"(" * 90 + b"deg "),
        "longer unit or format",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_before_they_cost_anything(name):
    data, words = HOSTILE[name]
    read_table(FILES["votable"])  # what is imported is not counted
    read_table(FILES["fits"])
    tracemalloc.start()
    began = time.process_time()
    with pytest.raises(ObservationError, match=words):
        read_table(data)
    spent, peak = time.process_time() - began, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6
    assert spent < 20


def nothing_is_fetched(monkeypatch) -> None:
    """Whatever would open an address or a file by name fails loudly."""

    def refuse(*_given, **_named):
        raise AssertionError("a file asked for something to be opened")

    monkeypatch.setattr("urllib.request.urlopen", refuse)
    monkeypatch.setattr("pickle.loads", refuse)
    monkeypatch.setattr("pickle.load", refuse)


ANY = settings(
    max_examples=250,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    database=None,
)
WOUNDS = st.lists(
    st.tuples(
        st.floats(0, 1),
        st.integers(0, 40),
        st.one_of(
            st.binary(max_size=30),
            st.sampled_from(
                [
                    b'nrows="99999999"',
                    b'arraysize="*"',
                    b"<STREAM/>",
                    b"-1",
                    b"1E99",
                    b"P(9)",
                    b"10+999999999",
                    b"A1",
                ]
            ),
        ),
    ),
    min_size=1,
    max_size=4,
)


@pytest.mark.parametrize("form", FILES)
def test_a_wounded_file_is_read_or_refused_in_one_sentence(form, geometry, monkeypatch):
    nothing_is_fetched(monkeypatch)

    @ANY
    @given(wounds=WOUNDS, end=st.floats(0.2, 1.0))
    def inner(wounds, end):
        data = bytearray(FILES[form])
        for place, length, put in wounds:
            at = int(place * len(data))
            data[at : at + length] = put
        try:
            table = read_table(bytes(data[: int(end * len(data)) + 1]))
            interpret(table, assume(table), geometry)
        except ValueError as error:
            assert "\n" not in str(error) and len(str(error)) < 600
        else:
            assert isinstance(table, Table) and table.values.dtype == float

    inner()


@pytest.mark.parametrize(
    "data",
    [
        of_table(f"{CELL * 60}<DATA><TABLEDATA>{'<TR>' + '<TD>1</TD>' * 60 + '</TR>'}" * 1),
        of_table(CELL + "<DATA><TABLEDATA>" + "<TR><TD>1</TD></TR>" * 4900 + "</TABLEDATA></DATA>"),
        FILES["fits"][:5760] + b"CONTINUE  '" + b"x" * 60 + b"'" * 9 + b"CONTINUE" * 100_000,
        FILES["mrt"] + b"\n".join([FILES["mrt"].splitlines()[-1]] * 4900),
        FILES["mrt"].splitlines()[0] + b"\n" + b"Byte-by-byte Description of file: x\n" * 9000,
        b"| " * 400_000 + b"\n" + b"| " * 90_000,
        b"- - " * 200_000 + b"\n" + b"--- " * 30,
        b"a b c\n" + b"1     2\n" * 4999,
        b"a" + b" " * 900_000 + b"b\n1 2\n3",
        b"SIMPLE  =                    T" + b" " * 900_000,
        b"<VOTABLE " + b"a" * 900_000,
        b"<VOTABLE>" + b"<!-- -->" * 100_000,
    ],
)
def test_the_largest_files_take_bounded_time(data, geometry):
    data = data[:MAX_BYTES]
    began = time.process_time()
    try:
        table = read_table(data)
        interpret(table, assume(table), geometry)
    except ValueError as error:
        assert len(str(error)) < 600
    assert time.process_time() - began < 20
