"""Estimators that are told the errors and infer the age: the shipped one, its held-out streams, its cells."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.config import ConfigError
from streamdash.inference.cells import AGE, age_edges, cell_of, grid_of
from streamdash.inference.coverage import ASKED, Row, rows
from streamdash.inference.diagnostics import LEVELS, Score, score, scores
from streamdash.inference.files import EstimatorFileError, load_estimator
from streamdash.inference.held_out import HeldOut, load_streams
from streamdash.inference.posterior import Posterior, make_grid
from streamdash.prior import Prior
from streamdash.survey.lsst import noise_factor


@pytest.fixture(scope="module")
def told():
    return load_estimator("gd1-like", told=True), load_streams("gd1-like", told=True)


@pytest.mark.parametrize("ages", [(3.0, 5.0, 9.0), (3.0, 5.0, 7.0, 9.0), (5.0, 10.0), (9.0, 3.0, 5.0)])
def test_every_age_has_an_even_cell_of_its_own(ages):
    edges = age_edges(ages)
    np.testing.assert_allclose(np.diff(edges), np.diff(edges)[0])
    assert list(cell_of(np.sort(ages), edges)) == list(range(len(ages)))


@pytest.mark.parametrize("ages", [(), (9.0,), (3.0, 9.0, 9.1, 9.2)])
def test_ages_that_have_no_even_cells_are_refused(ages):
    with pytest.raises(ConfigError, match="ages_gyr"):
        grid_of(Prior(ages_gyr=ages), with_age=True)


def test_told_estimators_are_calibrated_at_any_error_and_age(told):
    """On its shipped streams; `streamdash estimator coverage` says it of fresh ones."""
    estimator, streams = told
    found = list(rows(estimator, streams, (0.3, 1.0, 2.0)))
    assert len(found) == 3 * (1 + len(estimator.prior.ages_gyr))
    assert [row.what for row in found if row.score.n == streams.n_streams] == [
        f"errors × {factor}" for factor in ("0.3", "1", "2")
    ]
    for row in found:
        # The bounds, and three standard errors of so many streams.
        for share, level, margin in zip(row.score.coverage, LEVELS, ASKED, strict=True):
            assert abs(share - level) < margin + 3 * np.sqrt(level * (1 - level) / row.score.n), row
    for factor in ("0.3", "1", "2"):
        whole = next(row for row in found if row.what == f"errors × {factor}")
        nine = next(row for row in found if row.what == f"errors × {factor}, 9 Gyr")
        assert nine.score.information > whole.score.information, "to know the age is worth something"


def test_a_coverage_that_is_not_as_asked_is_called_so():
    def row(*coverage: float) -> Row:
        return Row("", "log10_rate", Score(1.0, 0.1, 0.5, coverage, 1000))

    assert row(0.70, 0.955).right
    assert not row(0.60, 0.95).right and not row(0.68, 0.99).right


def test_the_sharper_estimator_says_more_of_the_usual_age_and_errors(told):
    """On the same streams, which neither has learnt from."""
    sharp, streams = load_estimator("gd1-like"), load_streams("gd1-like")
    estimator = told[0]
    assert estimator.design.key == sharp.design.key
    assert estimator.prior.ages_gyr == (3.0, 5.0, 7.0, 9.0)
    q, true = streams.observed(sharp), streams.truth.log10_rate.to_numpy()
    rate = np.asarray(sharp.grid["log10_rate"])
    at_nine = [Posterior(estimator.grid, one).at(AGE, 9.0).p for one in estimator.posterior(q)]
    one, other = score(sharp.posterior(q), rate, true), score(np.array(at_nine), rate, true)
    assert one.information > 1.3 and one.information > other.information > 1.1


def test_larger_errors_say_less(told):
    estimator, streams = told
    nine = (streams.truth[AGE] == 9).to_numpy()
    told_bits = []
    for factor in (0.5, 2.0):
        p = estimator.posterior(streams.observed(estimator, factor)[nine], factor)
        told_bits.append(scores(p, estimator.grid, streams.truth[nine])["log10_rate"].information)
    assert told_bits[0] > told_bits[1]


def test_what_it_was_not_told_is_refused(told):
    estimator, streams = told
    q = streams.observed(estimator)[:1]
    with pytest.raises(ValueError, match=r"noise_factor must lie between 0\.25 and 2"):
        estimator.posterior(q, 3.0)
    with pytest.raises(ValueError, match="between 1 and 1"):
        load_estimator("gd1-like").posterior(q, 0.5)
    with pytest.raises(EstimatorFileError):
        load_streams("gd1", "population")


def test_held_out_streams_come_back_from_disk(told, tmp_path):
    _, streams = told
    streams.save(tmp_path / "streams.npz")
    again = HeldOut.load(tmp_path / "streams.npz")
    np.testing.assert_array_equal(again.clean, streams.clean)
    assert again.truth.equals(streams.truth)
    (tmp_path / "streams.npz").write_bytes((tmp_path / "streams.npz").read_bytes()[:500])
    with pytest.raises(EstimatorFileError, match="not a whole file"):
        HeldOut.load(tmp_path / "streams.npz")


def test_a_parameter_that_is_known_or_not_asked_for():
    grid = make_grid({"a": (0, 1), "b": (0, 2)}, {"a": 2, "b": 4})
    p = np.arange(8.0).reshape(2, 4) / 28
    posterior = Posterior(grid, p)
    np.testing.assert_allclose(posterior.without("a").p, p.sum(axis=0))
    np.testing.assert_allclose(posterior.at("a", 0.7).p, p[1] / p[1].sum())
    assert posterior.without("c") is posterior
    with pytest.raises(ValueError, match="not between 0 and 1"):
        posterior.at("a", 3)


def test_ten_years_of_lsst_are_better_than_one():
    for stream in ("gd1-like", "gd1", "pal5"):
        assert 0.1 < noise_factor(stream, 10) < noise_factor(stream, 1) < 1
