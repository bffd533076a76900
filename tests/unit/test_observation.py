"""Tables of measured profiles: what is read, what is refused and in which words, and what is stated."""

from __future__ import annotations

import gzip
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from streamdash.config import ConfigError
from streamdash.observe.guess import Assumptions, assume, changed, guess
from streamdash.observe.observation import interpret, read_observation
from streamdash.observe.table import MAX_BYTES, MAX_NAME, MAX_ROWS, ObservationError, read_table
from streamdash.survey.design import AS_IS, ORDER_MAX, divisible, polynomial_fit
from streamdash.survey.sky import to_theta
from tests.unit.tables import PHI1, Q, comma, csv, profile, refused, shuffled

# ------------------------------------------------------------------ reading


@pytest.mark.parametrize(
    "data",
    [
        csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error"),
        csv(PHI1, Q, 0.1 + 0 * Q, header="phi1\tq_rho\terror", separator="\t"),
        csv(PHI1, Q, 0.1 + 0 * Q, header="phi1;q_rho;error", separator=";"),
        csv(PHI1, Q, 0.1 + 0 * Q, header="  phi1   q_rho  error ", separator="   "),
        csv(PHI1, Q, 0.1 + 0 * Q, header="# a comment\n# phi1 q_rho error", separator=" "),
        csv(PHI1, Q, 0.1 + 0 * Q, header='"phi1", "q_rho", "error"').replace(b"\n", b"\r\n"),
        b"\xef\xbb\xbf" + csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error"),
        csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error").replace(b"\n", b"\r"),
        csv(PHI1[::-1], Q[::-1], 0.1 + 0 * Q, header="phi1,q_rho,error"),
        csv(PHI1 + 360, Q, 0.1 + 0 * Q, header="phi1,q_rho,error"),
        comma(csv(PHI1, Q, 0.1 + 0 * Q, header="phi1;q_rho;error", separator=";")),
        comma(csv(PHI1, Q, 0.1 + 0 * Q, header="phi1 q_rho error", separator=" ")),
        comma(csv(PHI1, Q, 0.1 + 0 * Q, header="phi1\tq_rho\terror", separator="\t")),
        "# dichte in °\n".encode("latin-1") + csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error"),
        shuffled(csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error")),
        csv(PHI1, Q, 0.1 + 0 * Q),
    ],
    ids=[
        *("csv", "tsv", "semicolons", "blanks", "commented", "dos", "bom", "mac", "falling", "turn"),
        *("comma-semicolons", "comma-blanks", "comma-tabs", "latin-1", "shuffled", "bare"),
    ],
)
def test_the_same_profile_in_any_dress(data, geometry):
    table = read_table(data)
    named = {} if table.header else {"coordinate": "phi1", "kind": "q_rho"}
    observation = interpret(table, assume(table, named), geometry)
    assert observation.assumptions.coordinate == "phi1"
    np.testing.assert_allclose(observation.q, Q / Q.mean(), rtol=2e-5)
    np.testing.assert_allclose(observation.design.sigma, 0.1 / Q.mean(), rtol=2e-5)
    np.testing.assert_allclose(observation.design.low, PHI1 - 1)


def test_an_ecsv_table_with_units(geometry):
    head = (
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: phi1, unit: deg, datatype: float64}\n"
        "# - {name: n, datatype: int64}\n# schema: astropy-2.0\nphi1 n"
    )
    table, observation = read_observation(
        csv(PHI1, np.full(len(PHI1), 90), header=head, separator=" "), geometry
    )
    assert table.units == {"phi1": "deg"}
    assert observation.assumptions.kind == "counts"
    assert observation.assumptions.error_kind == "poisson"
    np.testing.assert_allclose(observation.design.sigma, 1 / np.sqrt(90), rtol=1e-6)


def test_names_decide_what_the_columns_are():
    head = "phi1mid phi2 e_phi2 phi2width surf_bright e_surf_bright lindens e_lindens"
    table = read_table(csv(PHI1, *[Q] * 7, header=head, separator=" "))
    found = guess(table)
    assert (found.position, found.coordinate) == ("phi1mid", "phi1")
    assert (found.value, found.kind, found.error) == ("lindens", "density", "e_lindens")
    assert found.order == 3


def test_a_gap_and_missing_values_leave_bins_out(geometry):
    keep = np.r_[0:10, 14 : len(PHI1)]
    data = csv(PHI1[keep], Q[keep], 0.1 + 0 * Q[keep], header="phi1,q_rho,error").decode().splitlines()
    data[3] = data[3].split(",")[0] + ",nan,nan"
    _, observation = read_observation("\n".join(data).encode(), geometry)
    design = observation.design
    assert design.n_bin == len(keep) - 1
    np.testing.assert_allclose(design.high - design.low, 2.0)
    assert any("1 row has no value" in words and "treated as a gap" in words for words in observation.notes)
    assert "2 gaps" in observation.stated[0]


def test_bins_given_by_their_ends(geometry):
    data = csv(PHI1 - 1, PHI1 + 1, Q, 0.1 + 0 * Q, header="phi1_low,phi1_high,q,err_q")
    _, observation = read_observation(data, geometry)
    np.testing.assert_allclose(observation.design.centers, PHI1)


def test_rows_beyond_the_stream_are_named_and_left_out(geometry):
    x = np.arange(-120.0, 20.0, 2.0)
    _, observation = read_observation(csv(x, 1 + 0 * x, 0.1 + 0 * x, header="phi1,q,err"), geometry)
    assert observation.n_outside == len(x) - observation.design.n_bin == 33
    assert any("33 of 70 rows lie outside" in words for words in observation.notes)


def test_a_density_is_divided_by_its_polynomial(geometry):
    trend = 40 + 0.5 * PHI1 + 0.004 * PHI1**2
    _, observation = read_observation(csv(PHI1, trend, 0.1 * trend, header="phi1,density,err"), geometry)
    np.testing.assert_allclose(observation.q, 1.0, atol=1e-5)
    np.testing.assert_allclose(observation.design.sigma, 0.1, rtol=1e-4)


def test_every_assumption_is_stated_and_can_be_changed(geometry):
    data = csv(PHI1, Q, 2 * Q, 0.2 + 0 * Q, header="phi1,density,smooth,err")
    table = read_table(data)
    found = guess(table)
    assert found.smooth == "smooth"
    whole = " ".join(interpret(table, found, geometry).stated)
    for words in ("“phi1” is φ1", "31 bins of 2°", "“density”", "“smooth”", "“err”", "divided by their mean"):
        assert words in whole
    plain = interpret(table, changed(found, {"constant": 0.2, "order": AS_IS}), geometry)
    assert plain.assumptions.error_kind == "constant"
    np.testing.assert_allclose(plain.q, 0.5, rtol=1e-5)
    np.testing.assert_allclose(plain.design.sigma, 0.2)
    with pytest.raises(ConfigError, match="order"):
        changed(found, {"order": ORDER_MAX + 1})


# ------------------------------------------------------------------ refusing


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "The file is empty"),
        (b" \n\n", "The file is empty"),
        (b"# only\n# comments", "holds no rows"),
        (b"phi1,q\n", "a header but no rows"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "not text"),
        (b"phi1,q\n-30,\xff\xfe\n", "Line 2, column “q”: “ÿþ” is not a number"),
        (b"PK\x03\x04 [Content_Types].xml xl/workbook.xml", "is an Excel workbook, which is not read; save"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "is an Excel workbook"),
        (gzip.compress(b"phi1,q", mtime=0), "compressed with gzip"),
        (pickle.dumps({"phi1": [1.0]}), "a Python pickle, which is never opened"),
        (b"phi1;q\n-30;1,234\n-28;2,500", "“1,234” may have a decimal comma or one that parts thousands"),
        ("phi1,q\n-30,1".encode("utf-16"), "UTF-16"),
        (b"x" * (MAX_BYTES + 1), "larger than 1 MB"),
        (b"1 2\n" * (MAX_ROWS + 2), "at most 5000 are read"),
        (b"\n" * 900_000 + b"1", "lines"),
        (b",".join([b"1"] * 1000), "1000 columns; at most 64"),
        (profile(line4="-86,abc,0.1"), "Line 4, column “q_rho”: “abc” is not a number"),
        (profile(line4="-86,1.0"), "Line 4 has 2 values"),
        (profile(line4="-88,1.0,0.1"), "Line 4, column “phi1”: -88 is there twice"),
        (profile(line4="nan,1.0,0.1"), "Line 4, column “phi1”: an empty cell is not a position"),
        (profile(line4="-86,inf,0.1"), "Line 4, column “q_rho”: inf is not a finite number"),
        (profile(line4="-86,-3,0.1"), "Line 4, column “q_rho”: -3 is negative by more than 3 errors"),
        (profile(line4="-86,1,0"), "Line 4, column “error”: the error 0 is not a positive number"),
        (profile(line4="-86,1,-0.1"), "Line 4, column “error”: the error -0.1"),
        (profile(line4="-86,1,nan"), "Line 4, column “error”: the error an empty cell"),
        (profile(line4="=cmd|' /C calc'!A0,1,0.1"), "is not a number"),
        (profile(line1="phi1,1.5,error"), "Line 1 mixes names and numbers"),
        (csv(PHI1, Q, 0 * Q, header="phi1,q,err"), "All errors in column “err” are zero"),
        (csv(PHI1, 0 * Q, 0.1 + 0 * Q, header="phi1,q,err"), "no stream in it"),
        (csv(np.radians(PHI1), Q, header="phi1,q"), "looks like radians"),
        (csv(np.radians(PHI1) % (2 * np.pi), Q, header="l,q"), "looks like radians"),
        (csv(PHI1 + 240, Q, header="ra,q"), "right ascension"),
        (csv(PHI1 + 120, Q, header="phi1,q"), "does not overlap the simulated stretch"),
        (csv(PHI1[:5], Q[:5], header="phi1,q"), "Only 5 bins"),
        (csv(PHI1, header="phi1"), "one column"),
        (csv(PHI1, Q, 9 + 0 * Q, header="phi1,q,err"), "errors are larger than the values"),
        (csv(PHI1, np.round(50 * Q) - 45, header="phi1,counts"), "counts cannot be"),
        (csv(PHI1, 50 * Q, header="phi1,counts"), "not a whole number"),
        (csv(PHI1, 1e7 * Q, Q, header="phi1,q,err"), "holds values that no Qρ"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_line_and_column(data, words, geometry):
    assert words in refused(data, geometry)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"position": "nowhere"}, "There is no column “nowhere”"),
        ({"width": 9.0}, "overlaps the one before it"),
        ({"coordinate": "ell"}, "does not overlap"),
        ({"error_kind": "poisson"}, "Poisson errors need counts"),
        ({"order": 6, "width": 0.5, "error_kind": "column", "error": "phi1"}, "not a positive number"),
        ({"smooth": "phi1"}, "the smooth profile must be a positive number"),
    ],
)
def test_wrong_assumptions_are_refused(changes, words, geometry):
    assert words in refused(profile(), geometry, **changes)


def test_what_strangers_write_is_cut_and_made_printable(geometry):
    evil = "<script>alert(1)</script>\x1b[31m" + "x" * 500
    sentence = refused(profile(line4=f"-86,{evil},0.1"), geometry)
    assert "\x1b" not in sentence
    table = read_table(profile(line1=f"phi1,q,{evil}"))
    assert max(map(len, table.names)) <= MAX_NAME
    assert table.names[2].isprintable()


# ------------------------------------------------------------------ anything at all


def survives(data: bytes, geometry, **changes) -> None:
    """Reading ends in an observation of finite numbers or in one sentence."""
    try:
        table = read_table(data)
        observation = interpret(table, assume(table, changes), geometry)
    except ValueError as error:
        assert isinstance(error, ObservationError | ConfigError)
        assert len(str(error)) < 600
        assert "\n" not in str(error)
        return
    design = observation.design
    assert np.isfinite(observation.q).all()
    assert (design.sigma > 0).all() and np.isfinite(design.sigma).all()
    assert (design.high > design.low).all()
    assert all(isinstance(words, str) for words in observation.stated)


ANY = settings(
    max_examples=500,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    database=None,
)
CELLS = st.one_of(
    st.floats(-400, 400).map(lambda x: f"{x:.4g}"),
    st.sampled_from(
        ["", "nan", "inf", "-inf", "1e999", "0", "-0", "1e-400", "1_0", "٣", "=1+1", '"', "'", "#", "\x0c"]
    ),
    st.text(max_size=8),
)


@ANY
@given(data=st.binary(max_size=600))
def test_any_bytes(data, geometry):
    survives(data, geometry)


@ANY
@given(data=st.text(max_size=400))
def test_any_text(data, geometry):
    survives(data.encode("utf-8", "surrogatepass"), geometry)


@ANY
@given(
    rows=st.lists(st.lists(CELLS, min_size=1, max_size=5), min_size=1, max_size=30),
    separator=st.sampled_from([",", "\t", ";", " "]),
)
def test_any_table(rows, separator, geometry):
    survives("\n".join(separator.join(row) for row in rows).encode("utf-8", "surrogatepass"), geometry)


@ANY
@given(data=st.data())
def test_a_good_table_with_a_wound_and_any_assumption(data, geometry):
    text = bytearray(csv(PHI1, 60 * Q, 5 + 0 * Q, 55 + 0 * Q, header="phi1,density,err,smooth"))
    for _ in range(data.draw(st.integers(0, 3))):
        place = data.draw(st.integers(0, len(text) - 1))
        text[place : place + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    end = data.draw(st.integers(len(text) // 2, len(text)))
    name = st.sampled_from(["phi1", "density", "err", "smooth", "none such"])
    changes = {
        "coordinate": data.draw(st.sampled_from(["phi1", "ell", None])),
        "position": data.draw(st.one_of(st.none(), name)),
        "upper": data.draw(st.one_of(st.none(), st.none(), name)),
        "width": data.draw(st.one_of(st.none(), st.floats(0.01, 50))),
        "value": data.draw(st.one_of(st.none(), name)),
        "kind": data.draw(st.sampled_from(["q_rho", "density", "counts", "detrended", None])),
        "smooth": data.draw(st.one_of(st.none(), name)),
        "order": data.draw(st.one_of(st.none(), st.integers(AS_IS, ORDER_MAX))),
        "error_kind": data.draw(st.sampled_from(["column", "constant", "poisson", None])),
        "error": data.draw(st.one_of(st.none(), name)),
        "constant": data.draw(st.one_of(st.none(), st.floats(1e-3, 1e3))),
    }
    survives(bytes(text[:end]), geometry, **changes)


@pytest.mark.parametrize(
    "data",
    [
        b"," * (MAX_BYTES - 1),
        b'"' * (MAX_BYTES - 1),
        b"#" * (MAX_BYTES - 1),
        b"1" * (MAX_BYTES - 1),
        b"# - {name: " + b"a" * (MAX_BYTES - 100) + b", unit: ",
        b"\n".join([b" ".join([b"1"] * 90)] * 5000),
        b"\r".join([b"x"] * 19_000),
    ],
    ids=["commas", "quotes", "comment", "digits", "unit", "wide", "returns"],
)
def test_the_largest_files_are_answered(data, geometry):
    survives(data, geometry)


def test_assumptions_are_checked_whoever_makes_them():
    with pytest.raises(ConfigError, match="width"):
        Assumptions(coordinate="ell", position="a", value="b", kind="q_rho", width=-1.0)


def test_a_polynomial_near_zero_gives_way_to_one_of_lower_order_that_is_named(geometry):
    """A density that falls to nothing over half of the stream: a cubic passes below zero, the mean cannot."""
    density = np.where(np.arange(len(PHI1)) < 0.4 * len(PHI1), 100.0, 2.0)
    data = csv(PHI1, density, np.full(len(PHI1), 5.0), header="phi1,density,error")
    _, observation = read_observation(data, geometry)
    order = observation.design.order
    assert order < 3 and observation.used.order == order
    fit = polynomial_fit(observation.design.centers, 3)
    assert (fit @ density).min() < 0.1 * density.mean()
    (note,) = [words for words in observation.notes if "order 3" in words]
    assert f"one of order {order} is divided out" in note
    assert not divisible(density, fit)
    assert divisible(density, polynomial_fit(observation.design.centers, order))


def test_a_profile_that_is_negative_on_average_is_refused(geometry):
    density = np.where(np.arange(len(PHI1)) == 3, 1.0, -1.0)
    with pytest.raises(ObservationError, match="not positive on average"):
        read_observation(csv(PHI1, density, np.full(len(PHI1), 5.0), header="phi1,density,error"), geometry)


def test_bins_nearest_the_progenitor_are_counted(geometry):
    data = csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error")
    _, observation = read_observation(data, geometry)
    ends = np.stack([observation.design.low, observation.design.high])
    assert observation.n_near == np.count_nonzero(to_theta(geometry, ends, "phi1").min(axis=0) < 0.15)
