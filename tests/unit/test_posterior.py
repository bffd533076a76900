"""Posteriors on a grid: summaries against numbers that are known, and what they refuse."""

import numpy as np
import pytest
from scipy import stats

from streamdash.inference.posterior import Posterior, make_grid
from streamdash.inference.words import sentences, sentences_on
from streamdash.prior import POPULATION, RATE

RANGES = {"log10_rate": (-1.0, 1.0), "log10_half_mode_mass": (5.0, 9.0), "log10_excess": (-2.0, 1.0)}


def gaussian(mean: float, sd: float, name: str = "log10_rate", n: int = 80) -> Posterior:
    grid = make_grid({name: RANGES[name]}, {name: n})
    p = np.diff(stats.norm(mean, sd).cdf(grid[name]))
    return Posterior(grid, p / p.sum())


def product(*one: Posterior) -> Posterior:
    p = np.ones(())
    for posterior in one:
        p = np.multiply.outer(p, posterior.p)
    return Posterior({name: edges for posterior in one for name, edges in posterior.grid.items()}, p)


def test_a_gaussian_gives_its_own_quantiles():
    post = gaussian(0.1, 0.15)
    assert post.median("log10_rate") == pytest.approx(0.1, abs=0.005)
    assert post.interval("log10_rate", 0.68) == pytest.approx((0.1 - 0.149, 0.1 + 0.149), abs=0.006)
    assert post.upper_limit("log10_rate") == pytest.approx(0.1 + 1.645 * 0.15, abs=0.01)
    assert post.lower_limit("log10_rate") == pytest.approx(0.1 - 1.645 * 0.15, abs=0.01)
    # Of a Gaussian against a uniform prior: log2(range / (sd sqrt(2 pi e))).
    assert post.information == pytest.approx(np.log2(2 / (0.15 * np.sqrt(2 * np.pi * np.e))), abs=0.02)


def test_the_prior_has_no_information_and_is_said_to_be_unconstrained():
    grid = make_grid({"log10_rate": (-1, 1)}, {"log10_rate": 40})
    flat = Posterior(grid, np.full(40, 1 / 40))
    assert flat.information == pytest.approx(0, abs=1e-12)
    assert sentences(flat, RATE) == ["The data do not constrain the abundance of 10⁶–10⁹ M☉."]


def test_marginals_of_a_product_are_its_factors():
    one, two = gaussian(0.3, 0.2, n=20), gaussian(7, 0.5, "log10_half_mode_mass", 16)
    both = product(one, two)
    assert both.p.sum() == pytest.approx(1)
    assert np.allclose(both.marginal("log10_rate"), one.p)
    assert np.allclose(both.marginal("log10_half_mode_mass", "log10_rate"), np.multiply.outer(two.p, one.p))
    assert both.information == pytest.approx(one.information + two.information)
    assert both.information_on("log10_rate") == pytest.approx(one.information)
    with pytest.raises(ValueError, match="none of the parameters"):
        both.marginal("rate")


def test_given_cuts_and_joined_multiplies():
    post = product(gaussian(0.0, 0.5, n=20), gaussian(7, 1.0, "log10_half_mode_mass", 16))
    cut = post.given("log10_half_mode_mass", 8, 9)
    assert cut.p.sum() == pytest.approx(1) and cut.marginal("log10_half_mode_mass")[:12].sum() == 0
    with pytest.raises(ValueError, match="no cell"):
        post.given("log10_rate", 3, 4)
    twice = gaussian(0.0, 0.3).joined(gaussian(0.2, 0.3))
    low, high = twice.interval("log10_rate")
    assert (low + high) / 2 == pytest.approx(0.1, abs=0.01)
    assert (high - low) / 2 == pytest.approx(0.3 / np.sqrt(2), rel=0.03)
    with pytest.raises(ValueError, match="same grid"):
        gaussian(0, 1).joined(gaussian(0, 1, n=40))


def test_region_holds_its_level_in_the_fewest_cells():
    post = product(gaussian(0.0, 0.3, n=20), gaussian(7, 0.7, "log10_half_mode_mass", 16))
    names = ("log10_rate", "log10_half_mode_mass")
    inside = post.cells_within(names, 0.68)
    assert 0.68 <= post.p[inside].sum() < 0.72
    assert post.p[inside].min() >= post.p[~inside].max()


def test_draws_follow_the_posterior():
    draws = gaussian(0.1, 0.15).sample(20_000, np.random.default_rng(0))["log10_rate"]
    assert draws.mean() == pytest.approx(0.1, abs=0.01) and draws.std() == pytest.approx(0.15, abs=0.01)


@pytest.mark.parametrize(("mean", "end", "word"), [(1.4, "upper", "above"), (-1.4, "lower", "below")])
def test_beyond_the_prior_is_said_to_be_at_its_edge(mean, end, word):
    post = gaussian(mean, 0.2)
    assert post.edges_reached("log10_rate") == (end,)
    first, second = sentences_on(post, "log10_rate", RATE)
    assert word in first and "95 %" in first and "edge of the prior" in second


def test_inside_the_prior_is_an_interval_in_people_s_units():
    post = gaussian(np.log10(2), 0.1)
    assert post.edges_reached("log10_rate") == ()
    assert sentences_on(post, "log10_rate", RATE) == [
        "The abundance of 10⁶–10⁹ M☉ is 2 (1.6 to 2.5 × CDM at 68 %).".replace("is 2 (", "is 2 × CDM (")
    ]


def test_half_mode_mass_is_a_limit_with_the_particle_s_mass():
    (words,) = sentences_on(gaussian(5, 0.5, "log10_half_mode_mass"), "log10_half_mode_mass", POPULATION)
    assert "below" in words and "keV" in words


def test_shapes_that_do_not_fit_are_refused():
    grid = make_grid({"log10_rate": (-1, 1)}, {"log10_rate": 40})
    with pytest.raises(ValueError, match="shape"):
        Posterior(grid, np.ones(41) / 41)
