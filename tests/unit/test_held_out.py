"""Held-out likelihood ratios, and the rules of the evidence: what must hold whatever the noise draw."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from streamdash.paper.evidence import find_entries
from streamdash.plots.pdf import collect
from streamdash.statistics.cumulative import cumulative_tables
from streamdash.statistics.evidence import PAPER_RULES, RULES, Rules, measured_evidence
from streamdash.statistics.evidence_growth import growth
from streamdash.statistics.held_out import held_out
from streamdash.statistics.pdf import central_range
from streamdash.store.cache import Cache


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(8)


@pytest.fixture(scope="module")
def shipped(shipped_cache):
    """The four shipped ensembles, by mass range."""
    cache = Cache.default(shipped_cache)
    labels = ("1e3-1e5", "1e5-1e7", "1e5-1e9", "1e7-1e9")
    return {label: collect(cache, find_entries(cache, [label])[0].key) for label in labels}


def gaussians(rng, n_streams, spread, n_longitudes=300):
    """Streams of independent Gaussian values of one width each."""
    return 1 + spread * rng.standard_normal((n_streams, n_longitudes))


def test_ratio_of_one_model_with_itself_is_even(rng):
    for judged in held_out(gaussians(rng, 1000, 0.1), gaussians(rng, 1000, 0.1), 10):
        low, high = judged.right_interval
        assert low < judged.right < high
        assert abs(judged.right - 0.5) < 4 * (high - low) / 2
        assert abs(judged.quantiles[1]) < 0.5


def test_ratio_agrees_with_the_known_likelihood(rng):
    """Two kinds of stream that differ in the share of one value alone: the ratio is binomial."""
    n, length, shares = 2000, 40, (0.3, 0.5)
    q = [np.where(rng.random((n, length)) < share, 0.0, 1.0) for share in shares]
    counts = (q[0] == 0).sum(axis=1)
    known = counts * np.log(shares[0] / shares[1]) + (length - counts) * np.log(0.7 / 0.5)
    judged, _ = held_out(*q, 2)
    common = (counts >= 12) & (counts <= 18)  # elsewhere one of the two has few streams to learn from
    slope, offset = np.polyfit(known[common], judged.ln_ratio[common], 1)
    assert 0.85 < slope < 1.1
    assert abs(offset) < 0.2
    assert judged.right == pytest.approx((known > 0).mean(), abs=0.03)


def test_streams_are_judged_by_others(rng):
    """Densities of a stream's own half would put streams of pure noise right."""
    found = held_out(gaussians(rng, 60, 0.1, 40), gaussians(rng, 60, 0.1, 40), 20)
    assert sum(judged.n_right for judged in found) == pytest.approx(60, abs=25)


@pytest.mark.parametrize(
    "pair",
    [("1e3-1e5", "1e5-1e9"), ("1e3-1e5", "1e5-1e7"), ("1e5-1e7", "1e7-1e9"), ("1e5-1e7", "1e5-1e9")],
    ids=" and ".join,
)
def test_less_noise_tells_more_whatever_the_classes(shipped, pair):
    levels = (0.5, 0.3, 0.2, 0.1, 0.05, 0.0)
    found = [held_out(*(shipped[label].noisy(noise) for label in pair), 20) for noise in levels]
    for truth in (0, 1):
        ratios = [judged[truth].quantiles[1] for judged in found]
        errors = [0.03 * ratio + 0.3 for ratio in ratios]
        assert all(b > a - e for (a, b), e in zip(pairwise(ratios), errors[1:], strict=True)), ratios
        assert ratios[-1] > 1.5 * ratios[0]
        assert found[-1][truth].right > found[0][truth].right - 0.02


def test_streams_that_are_told_apart_are_so_where_the_figure_of_merit_says_less(shipped):
    """∫ Π_i Π_j dy falls for a broad truth; the share of streams put right does not."""
    q = [shipped[label].noisy(0.1) for label in ("1e3-1e5", "1e5-1e9")]
    evidence = measured_evidence(q, 0.1, 20)[1]
    narrow, broad = held_out(*q, 20)
    assert evidence.cumulative(1, 1, 0).value < 0.5 * evidence.cumulative(0, 0, 1).value
    assert min(narrow.right, broad.right) > 0.99


def test_the_default_range_hardly_hangs_on_the_draw_of_the_noise(shipped):
    observed = [shipped[label] for label in ("1e3-1e5", "1e5-1e9")]

    def redraw(number):
        return [one.noisy(0.1, number) for one in observed]

    scatter = {}
    for name, rules in (("paper", PAPER_RULES), ("central", Rules())):
        tables = cumulative_tables(redraw(0), 0.1, 4, (10, 20, 50), rules, redraw)
        scatter[name] = [table["pairs"][0]["draw_error"] for table in tables]
        for row in (row for table in tables for row in table["pairs"]):
            assert row["error"] >= max(row["sampling_error"], row["draw_error"])
    assert all(c < p / 2 for c, p in zip(scatter["central"], scatter["paper"], strict=True)), scatter
    assert max(scatter["central"]) < 2


def test_growth_ends_at_the_sum_of_the_table(shipped):
    q = [shipped[label].noisy(0.1) for label in ("1e3-1e5", "1e5-1e9")]
    for rules in RULES.values():
        pdfs, evidence = measured_evidence(q, 0.1, 20, rules)
        curve = growth(pdfs, evidence, 0, 1, sizes=[len(q[0])])
        assert curve.mean[-1] == pytest.approx(evidence.cumulative(0, 0, 1).value)


def test_all_bins_count_by_default(shipped):
    q = [shipped[label].noisy(0.3) for label in ("1e5-1e9", "1e7-1e9")]
    for n_bin in (10, 20, 50):
        assert measured_evidence(q, 0.3, n_bin)[1].cumulative(0, 0, 1).n_kept == n_bin


def test_models_without_a_common_central_range(rng):
    apart = [gaussians(rng, 30, 0.01), 3 + gaussians(rng, 30, 0.01)]
    low, high = central_range(apart)
    assert low > high
    assert [judged.right for judged in held_out(*apart, 20)] == [1.0, 1.0]
    with pytest.raises(ValueError, match="share no value"):
        measured_evidence(apart, 0.01, 20)


def test_constant_streams_are_no_evidence():
    flat = np.ones((20, 50))
    for judged in held_out(flat, flat, 10):
        np.testing.assert_array_equal(judged.ln_ratio, 0)


def test_too_few_streams_are_said(rng):
    with pytest.raises(ValueError, match="at least 4 streams"):
        held_out(gaussians(rng, 3, 0.1), gaussians(rng, 30, 0.1), 10)
