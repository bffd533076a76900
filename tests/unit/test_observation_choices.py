"""What the columns of a table are: what is asked for where nothing decides, and what names say."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.observe.guess import Undecided, assume, changed, guess
from streamdash.observe.observation import interpret, read_observation
from streamdash.observe.table import ObservationError, read_table
from tests.unit.tables import PHI1, Q, csv, refused

ERR = 0.1 + 0 * Q
GAIA = PHI1 + 240


@pytest.mark.parametrize(
    ("data", "fields", "choices"),
    [
        (csv(GAIA, Q, ERR), {"coordinate", "kind"}, {"coordinate": "ell", "kind": "q_rho"}),
        (csv(PHI1, Q, ERR, header="angle,q,err"), {"coordinate"}, {"coordinate": "phi1"}),
        (csv(PHI1, Q, header="phi1,q"), {"error"}, {"constant": 0.1}),
        (csv(PHI1, Q, ERR, header="phi1,q,spread"), {"error"}, {"error": "spread"}),
        (csv(PHI1, Q, ERR, header="phi1,q,err_hi"), {"error"}, {"error": "err_hi"}),
        (csv(PHI1, Q, ERR, ERR, header="phi1,q,e_1,sigma_2"), {"error"}, {"error": "e_1"}),
        (csv(PHI1, Q, ERR, header="phi1,q,e_phi1"), {"error"}, {"error_kind": "constant"}),
        (csv(PHI1, Q, ERR, header="phi1,profile,err"), {"kind"}, {"kind": "q_rho"}),
        (
            csv(PHI1, Q, Q, ERR, header="phi1,y,z,err"),
            {"value", "kind"},
            {"value": "z", "kind": "q_rho", "error": "err"},
        ),
        (csv(PHI1, Q, Q, Q, ERR), {"coordinate", "value", "kind", "error"}, None),
    ],
)
def test_what_the_table_does_not_decide_is_asked_for(data, fields, choices, geometry):
    table = read_table(data)
    assert set(assume(table).undecided) == fields
    with pytest.raises(Undecided):
        interpret(table, assume(table), geometry)
    if choices is not None and "ell" not in choices.values():
        observation = interpret(table, assume(table, choices), geometry)
        assert observation.assumptions.undecided == ()


@pytest.mark.parametrize("names", ["err_lo,err_hi", "q_errplus,q_errminus", "e_q,E_q", "err-,err+"])
@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_lower_and_an_upper_error_the_mean_is_used(names, sign, geometry):
    table = read_table(csv(PHI1, Q, sign * ERR, 3 * ERR, header=f"phi1,q,{names}"))
    one = read_table(csv(PHI1, Q, 2 * ERR, header="phi1,q,err"))
    wanted = interpret(one, assume(one), geometry).design.sigma
    for chosen in ({}, {"error": names.split(",")[1]}):  # whichever of the two is named
        observation = interpret(table, assume(table, chosen), geometry)
        assert observation.design.sigma == pytest.approx(wanted)
        assert any("mean of" in words for words in observation.stated)


@pytest.mark.parametrize(
    "name", ["ra", "RAJ2000", "_RAJ2000", "ALPHA2000", "alpha_j2000", "RA_ICRS", "ra_deg", "RA (deg)", "α"]
)
def test_a_right_ascension_is_not_a_longitude(name, geometry):
    assert "right ascension" in refused(csv(GAIA, Q, ERR, header=f"{name},q,err"), geometry, coordinate="ell")


def test_another_value_has_its_own_error_or_none(geometry):
    table = read_table(
        csv(PHI1, Q, ERR, 2 * Q, 3 * ERR, 4 * Q, header="phi1,density,e_density,flux,e_flux,x")
    )
    assert assume(table).error == "e_density"
    assert assume(table, {"value": "flux", "kind": "density"}).error == "e_flux"
    with pytest.raises(Undecided, match="error of “x”") as asked:
        interpret(table, assume(table, {"value": "x", "kind": "density"}), geometry)
    assert asked.value.fields == ("error",)
    # The same for those who change what was guessed.
    assert changed(guess(table), {"value": "x"}).undecided == ("error",)
    assert changed(guess(table), {"value": "x", "error": "e_flux"}).undecided == ()


@pytest.mark.parametrize(
    ("name", "size", "unit"),
    [("error_percent", 10.0, "percent"), ("e_q_%", 10.0, "percent"), ("rel_err", 0.1, "fraction")],
)
def test_relative_errors_are_relative(name, size, unit, geometry):
    _, observation = read_observation(csv(PHI1, Q, size + 0 * Q, header=f"phi1,q,{name}"), geometry)
    assert observation.assumptions.error_unit == unit
    np.testing.assert_allclose(observation.design.sigma, 0.1 * Q / Q.mean(), rtol=2e-5)
    assert "of the value" in " ".join(observation.stated)


def test_different_units_of_value_and_error_are_asked_about(geometry):
    units = {"phi1": "deg", "q": "1/deg", "err": "1/arcmin"}
    head = "# %ECSV 1.0\n" + "\n".join(f"# - {{name: {name}, unit: {unit}}}" for name, unit in units.items())
    table = read_table(csv(PHI1, Q, ERR, header=f"{head}\nphi1 q err", separator=" "))
    assert assume(table).undecided == ("error_unit",)
    interpret(table, assume(table, {"error_unit": "value"}), geometry)
    table = read_table(csv(PHI1, Q, ERR, header="# - {name: phi1, unit: rad}\nphi1 q err", separator=" "))
    with pytest.raises(ObservationError, match="in rad; positions are given in degrees"):
        interpret(table, assume(table), geometry)


def test_a_list_of_stars_is_offered_to_be_counted(geometry):
    x = np.sort(np.random.default_rng(3).uniform(-95, -25, 900))[::-1]
    data = csv(x, 20 + 0 * x, 0 * x, header="phi1,phi2,g_mag")
    table = read_table(data)
    with pytest.raises(Undecided, match="list of 900 stars") as asked:
        interpret(table, assume(table), geometry)
    assert asked.value.fields == ("bin",)
    observation = interpret(table, assume(table, {"bin": 2.0}), geometry)
    design = observation.design
    np.testing.assert_allclose(design.high - design.low, 2.0)
    assert any("counted as stars" in words for words in observation.notes)
    whole = (x >= design.low[0]) & (x < design.high[-1])
    assert abs(1 / np.median(design.sigma) ** 2 - whole.sum() / design.n_bin) < 8  # Poisson's
    assert "no whole" not in refused(
        data, geometry, bin=0
    )  # rows are bins: something else is wrong with them
    assert "choose wider" in refused(data, geometry, bin=0.05)
    assert "choose narrower" in refused(data, geometry, bin=50.0, coordinate="phi1", position="g_mag")
