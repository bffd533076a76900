"""Bayes factors: against integrals known in closed form, and their symmetries and limits."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.statistics.evidence import (
    PAPER_RULES,
    Evidence,
    Rules,
    far_from_peak,
    jeffreys,
    measure_evidence,
    measured_width,
)
from streamdash.statistics.evidence_growth import bootstrap, growth
from streamdash.statistics.joint import decorrelate, joint_evidence
from streamdash.statistics.overlap import overlap_integrals
from streamdash.statistics.pdf import Pdfs, measure_pdfs


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def rows(*samples: np.ndarray) -> list[np.ndarray]:
    """One bin α per model, sorted, as `overlap_integrals` wants them."""
    return [np.sort(s)[None, :] for s in samples]


def toy_profiles(rng, scatters=(0.05, 0.3, 0.8), n_streams=(300, 260, 220), noise=0.1):
    """Correlated log-normal profiles of growing scatter, as perturbed streams are."""
    result = []
    for scatter, n in zip(scatters, n_streams, strict=True):
        walk = np.cumsum(rng.standard_normal((n, 347)), axis=1) / np.sqrt(347)
        q = np.exp(scatter * (walk - walk.mean(axis=1, keepdims=True)))
        result.append((q + noise * rng.standard_normal(q.shape)).astype(np.float32))
    return result


def normal_overlap(mean_i, sigma_i, mean_j, sigma_j):
    """∫ N(y; mean_i, sigma_i) N(y; mean_j, sigma_j) dy."""
    variance = sigma_i**2 + sigma_j**2
    return np.exp(-0.5 * (mean_i - mean_j) ** 2 / variance) / np.sqrt(2 * np.pi * variance)


def test_overlap_of_gaussians_and_their_bayes_factor(rng):
    means, sigmas = (2.0, 2.7), (0.4, 0.9)
    samples = [m + s * rng.standard_normal(400_000) for m, s in zip(means, sigmas, strict=True)]
    integrals = overlap_integrals(rows(*samples), (60, 120, 240))
    for i in range(2):
        for j in range(2):
            expected = normal_overlap(means[i], sigmas[i], means[j], sigmas[j])
            np.testing.assert_allclose(integrals[:, i, j, 0], expected, rtol=0.01)
    evidence = Evidence(integrals, np.zeros(1, bool), np.zeros((2, 1), bool))
    known = np.log(
        normal_overlap(means[0], sigmas[0], means[0], sigmas[0])
        / normal_overlap(means[0], sigmas[0], means[1], sigmas[1])
    )
    assert evidence.ln_bayes(0, 0, 1)[0][0] == pytest.approx(known, abs=0.02)


def test_integral_of_uniform_distributions_by_hand():
    """Heights 1 and 1 on [0, 1] in ten bins: the trapezoid reaches from centre to centre, 0.9."""
    even = np.linspace(0, 1, 1000)
    trapezoid = overlap_integrals(rows(even, even), (10,))[0, 0, 1, 0]
    whole = overlap_integrals(rows(even, even), (10,), trapezoid=False)[0, 0, 1, 0]
    assert trapezoid == pytest.approx(0.9, rel=1e-3)
    assert whole == pytest.approx(1.0, rel=1e-3)


def test_integrals_match_numpy_histograms(rng):
    samples = [rng.gamma(2, 1, 500), rng.gamma(3, 1, 400)]
    edges = np.linspace(min(s.min() for s in samples), max(s.max() for s in samples), 38)
    heights = [np.histogram(s, edges, density=True)[0] for s in samples]
    centers = 0.5 * (edges[1:] + edges[:-1])
    for i in range(2):
        for j in range(2):
            assert overlap_integrals(rows(*samples), (37,))[0, i, j, 0] == pytest.approx(
                np.trapezoid(heights[i] * heights[j], centers), rel=1e-12
            )


def test_bins_of_y_may_start_at_zero(rng):
    sample = rng.uniform(4, 5, 2000)
    heights = np.histogram(sample, np.linspace(0, sample.max(), 11), density=True)[0]
    found = overlap_integrals(rows(sample, sample), (10,), trapezoid=False, from_zero=True)[0, 0, 1, 0]
    assert found == pytest.approx((heights**2).sum() * sample.max() / 10)


def test_without_self_pairs_the_square_is_unbiased(rng):
    """E_ii of few streams in many bins: self-pairs add exactly (bins per y) / (number of streams)."""
    few = np.sort(rng.standard_normal((3000, 60)), axis=1)
    biased, unbiased = (
        overlap_integrals([few], (40,), self_pairs=pairs, trapezoid=False)[0, 0, 0] for pairs in (True, False)
    )
    bins_per_y = 40 / (few[:, -1] - few[:, 0])
    np.testing.assert_allclose(biased, unbiased * 59 / 60 + bins_per_y / 60)
    known = 1 / (2 * np.sqrt(np.pi))
    assert unbiased.mean() == pytest.approx(known, rel=0.03)
    assert biased.mean() > 1.3 * known


def test_identical_models_cannot_be_told_apart(rng):
    q = toy_profiles(rng)[1]
    evidence = measure_evidence(measure_pdfs([q, q], 20), noise=0.1)
    assert evidence.cumulative(0, 0, 1).value == 0
    assert evidence.cumulative(0, 0, 1).word == "inconclusive"


def test_two_ensembles_of_one_model_give_almost_no_evidence(rng):
    q = toy_profiles(rng, (0.3, 0.3), (1500, 1500))
    pdfs = measure_pdfs(q, 20)
    rules = Rules(y_bins=(10, 20, 30, 40, 50), self_pairs=False)
    evidence = measure_evidence(pdfs, 0.1, rules)
    kept = evidence.kept(0, 0, 1)
    assert kept.sum() >= 5
    assert np.abs(evidence.ln_bayes(0, 0, 1)[0][kept]).max() < 0.1
    assert abs(evidence.cumulative(0, 0, 1).value) < 0.3
    assert all(abs(joint.value) < 0.5 for joint in joint_evidence(*pdfs.y, kept))


def test_disjoint_distributions_are_excluded_not_infinite(rng):
    y = np.stack([rng.uniform(1, 2, 100), rng.uniform(1, 2, 100)], axis=1)
    apart = y + [0.0, 5.0]  # the second bin never overlaps
    evidence = measure_evidence(Pdfs(np.array([0.9, 1.0, 1.1]), (y, apart)), noise=1.0)
    np.testing.assert_array_equal(evidence.kept(0, 0, 1), [True, False])
    total = evidence.cumulative(0, 0, 1)
    assert np.isfinite([total.value, total.low, total.high]).all()
    assert total.n_kept == 1
    assert np.isnan(evidence.ln_bayes(0, 0, 1)[0][1])
    _, _, high = evidence.ln_bayes(0, 0, 1)
    assert not np.isinf(high).any()


def test_nothing_to_compare_is_said_not_counted(rng):
    y = rng.uniform(1, 2, (100, 2))
    evidence = measure_evidence(Pdfs(np.array([0.9, 1.0, 1.1]), (y, y + 9)), noise=1.0)
    total = evidence.cumulative(0, 0, 1)
    assert (total.value, total.n_kept, total.word) == (0.0, 0, "no bins")
    assert np.isnan(bootstrap(Pdfs(np.array([0.9, 1.0, 1.1]), (y, y + 9)), evidence, 5)[0, 1])


def test_order_of_streams_does_not_matter(rng):
    q = toy_profiles(rng)
    first = measure_evidence(measure_pdfs(q, 30), 0.1)
    second = measure_evidence(measure_pdfs([rng.permutation(part) for part in q], 30), 0.1)
    np.testing.assert_allclose(first.integrals, second.integrals, rtol=1e-10)


def test_order_of_classes_only_renames_them(rng):
    q = toy_profiles(rng)
    order = [2, 0, 1]  # new place k holds old model order[k]
    first = measure_evidence(measure_pdfs(q, 30), 0.1, PAPER_RULES)
    second = measure_evidence(measure_pdfs([q[k] for k in order], 30), 0.1, PAPER_RULES, low_mass=1)
    np.testing.assert_array_equal(first.far, second.far)
    for new_i, i in enumerate(order):
        for new_j, j in enumerate(order):
            assert second.cumulative(new_i, new_i, new_j).value == pytest.approx(
                first.cumulative(i, i, j).value, abs=1e-9
            )


def test_swapping_the_pair_on_one_fiducial_changes_the_sign(rng):
    evidence = measure_evidence(measure_pdfs(toy_profiles(rng), 30), 0.1)
    for f in range(3):
        np.testing.assert_allclose(evidence.ln_bayes(f, 0, 2)[0], -evidence.ln_bayes(f, 2, 0)[0])
        np.testing.assert_array_equal(evidence.kept(f, 0, 2), evidence.kept(f, 2, 0))
        assert evidence.cumulative(f, 1, 1).value == 0


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_no_noise_and_huge_noise(rng, noise):
    q = toy_profiles(rng, noise=noise)
    evidence = measure_evidence(measure_pdfs(q, 20), noise, PAPER_RULES)
    values = [evidence.cumulative(i, i, j).value for i in range(3) for j in range(3)]
    assert np.isfinite(values).all()
    if noise == 0.0:  # 3 σ_ε is no distance: only the peak is left
        assert np.count_nonzero(~evidence.far) == 1


def test_more_noise_hides_the_difference(rng):
    walk = [q - 1 for q in toy_profiles(rng, noise=0.0)]
    draws = [rng.standard_normal(q.shape).astype(np.float32) for q in walk]

    def total(noise):
        q = [1 + w + np.float32(noise) * d for w, d in zip(walk, draws, strict=True)]
        return measure_evidence(measure_pdfs(q, 20), noise).cumulative(0, 0, 2).value

    assert total(0.1) > total(0.3) > total(1.0)


@pytest.mark.parametrize("n_bin", [2, 500])
def test_fewest_and_most_bins(rng, n_bin):
    pdfs = measure_pdfs(toy_profiles(rng), n_bin)
    evidence = measure_evidence(pdfs, 0.1)
    total = evidence.cumulative(0, 0, 2)
    assert np.isfinite(total.value)
    assert 0 < total.n_kept <= n_bin
    assert all(
        np.isfinite(joint.value) for joint in joint_evidence(pdfs.y[0], pdfs.y[2], evidence.kept(0, 0, 2))
    )


def test_unequal_class_sizes_are_normalised(rng):
    q = toy_profiles(rng, (0.3, 0.3), (3000, 300), noise=0.1)
    y_bins = Rules(y_bins=(10, 20), self_pairs=False)
    evidence = measure_evidence(measure_pdfs(q, 10), 0.1, y_bins)
    kept = evidence.kept(0, 0, 1)
    assert np.abs(evidence.ln_bayes(0, 0, 1)[0][kept]).max() < 0.25


def test_an_empty_bin_is_excluded_as_too_few_samples(rng):
    q = toy_profiles(rng, (0.05, 0.3), (200, 200))
    q = [np.where(np.abs(part - 1.1) < 0.03, 1.2, part) for part in q]
    pdfs = measure_pdfs(q, 100)
    empty = np.flatnonzero((pdfs.edges[:-1] > 1.07) & (pdfs.edges[1:] < 1.13))
    assert len(empty)
    evidence = measure_evidence(pdfs, 0.1)
    assert evidence.sparse[:, empty].all()
    assert not evidence.kept(0, 0, 1)[empty].any()


def test_a_bin_reached_by_too_few_streams_of_one_model_is_left_out(rng):
    y = rng.uniform(1, 2, (50, 3))
    rare = y.copy()
    rare[9:, 1] = 0.0  # nine streams only
    rare[10:, 2] = 0.0  # ten streams
    evidence = measure_evidence(Pdfs(np.array([0.8, 0.9, 1.0, 1.1]), (y, rare)), 1.0, Rules(y_bins=(10,)))
    np.testing.assert_array_equal(evidence.sparse, [[False, False, False], [False, True, False]])


def test_constant_profiles(rng):
    flat = np.ones((40, 347))
    evidence = measure_evidence(measure_pdfs([flat, flat], 10), 0.1)
    assert evidence.cumulative(0, 0, 1).value == 0


def test_distance_from_the_peak_counts_bin_centres():
    edges = np.linspace(0.5, 1.5, 11)
    y = np.tile(np.exp(-0.5 * ((0.5 * (edges[1:] + edges[:-1]) - 0.95) / 0.1) ** 2), (4, 1))
    for reach, first, last in (("centre", 1, 7), ("whole", 2, 6), ("part", 1, 7)):
        far = far_from_peak(Pdfs(edges, (y, y)), 0.3, reach=reach)
        np.testing.assert_array_equal(np.flatnonzero(~far), range(first, last + 1))
    assert np.flatnonzero(~far_from_peak(Pdfs(edges, (y, y)), 0.01, reach="whole")).tolist() == [4]


def test_measured_width_is_the_standard_deviation_of_a_gaussian(rng):
    assert measured_width(1 + 0.13 * rng.standard_normal((400, 347))) == pytest.approx(0.13, rel=0.01)


@pytest.mark.parametrize(
    ("value", "word"),
    [
        (0.0, "inconclusive"),
        (-0.99, "inconclusive"),
        (1.0, "weak"),
        (2.49, "weak"),
        (-2.5, "moderate"),
        (4.99, "moderate"),
        (5.0, "strong"),
        (53.5, "strong"),
        (np.inf, "strong"),
        (np.nan, "no bins"),
    ],
)
def test_jeffreys_words(value, word):
    assert jeffreys(value) == word


# --- all bins together -----------------------------------------------------------------------


def correlated_gaussians(rng, n_bin, n_streams, correlation):
    """Two multivariate Gaussians whose bins are correlated, and the known ln B of all bins."""
    k = np.arange(n_bin)
    shape = correlation ** np.abs(k[:, None] - k[None, :])
    tilt = np.diag(np.linspace(0.8, 1.5, n_bin))
    c_i, c_j = shape, tilt @ shape @ tilt
    delta = 0.5 * np.sin(1 + k)
    known = 0.5 * (np.linalg.slogdet(c_i + c_j)[1] - np.linalg.slogdet(2 * c_i)[1])
    known += 0.5 * delta @ np.linalg.solve(c_i + c_j, delta)
    y_i = rng.multivariate_normal(np.zeros(n_bin), c_i, n_streams)
    y_j = rng.multivariate_normal(delta, c_j, n_streams)
    return y_i, y_j, known


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.95])
def test_joint_evidence_of_gaussians_is_the_known_one(rng, correlation):
    y_i, y_j, known = correlated_gaussians(rng, 8, 20_000, correlation)
    joint, _ = joint_evidence(y_i, y_j, np.ones(8, bool))
    assert joint.n_components == 8
    assert joint.n_unresolved == 0
    assert joint.gaussian == pytest.approx(known, rel=0.05)
    assert joint.value == pytest.approx(known, rel=0.05, abs=0.1)


def test_the_sum_over_bins_is_wrong_where_bins_are_correlated(rng):
    """Twelve copies of one bin, each with a little noise: the sum counts the same thing twelve times."""
    base_i, base_j = rng.standard_normal(4000), 1.5 + rng.standard_normal(4000)
    y_i = base_i[:, None] + 0.05 * rng.standard_normal((4000, 12))
    y_j = base_j[:, None] + 0.05 * rng.standard_normal((4000, 12))
    once = 0.25 * 1.5**2  # ln B of one pair of unit Gaussians
    integrals = overlap_integrals([np.sort(y.T, axis=1) for y in (y_i, y_j)], (20, 40, 60))
    summed = Evidence(integrals, np.zeros(12, bool), np.zeros((2, 12), bool)).cumulative(0, 0, 1).value
    joint, _ = joint_evidence(y_i, y_j, np.ones(12, bool))
    assert summed == pytest.approx(12 * once, rel=0.1)
    assert joint.value == pytest.approx(once, abs=0.25)


def test_joint_evidence_does_not_feel_a_linear_change_of_variables(rng):
    y_i, y_j, _ = correlated_gaussians(rng, 5, 3000, 0.5)
    mix = rng.standard_normal((5, 5))
    every = np.ones(5, bool)
    plain, mixed = joint_evidence(y_i, y_j, every)[0], joint_evidence(y_i @ mix, y_j @ mix, every)[0]
    assert mixed.gaussian == pytest.approx(plain.gaussian, abs=1e-6)
    assert mixed.value == pytest.approx(plain.value, abs=1e-6)


def test_components_are_uncorrelated_in_both_models(rng):
    y_i, y_j, _ = correlated_gaussians(rng, 6, 1000, 0.8)
    transform = decorrelate(y_i, y_j)
    for z in (transform(y_i), transform(y_j)):
        c = np.cov(z, rowvar=False)
        np.testing.assert_allclose(c, np.diag(np.diag(c)), atol=1e-8)


def test_bins_that_depend_on_each_other_lose_a_component(rng):
    q = toy_profiles(rng, (0.2, 0.4), (500, 500))
    pdfs = measure_pdfs(q, 10, (-5.0, 8.0))  # every value is inside: the bins sum to a constant
    occupied = (pdfs.y[0].std(axis=0) + pdfs.y[1].std(axis=0)) > 0
    joint, _ = joint_evidence(*pdfs.y, np.ones(10, bool))
    assert joint.n_components + joint.n_unresolved == occupied.sum() - 1


def test_models_apart_in_some_component_are_counted_as_unresolved(rng):
    y_i, y_j = rng.standard_normal((2, 2000, 3)) * [[[1.0, 1.0, 1.0]], [[1.0, 2.0, 4.0]]]
    joint, _ = joint_evidence(y_i, y_j + [0.0, 60.0, 0.0], np.ones(3, bool), (10, 20))
    assert (joint.n_components, joint.n_unresolved) == (2, 1)
    assert np.isfinite(joint.value)


def test_no_bin_is_no_joint_evidence(rng):
    y = rng.standard_normal((20, 3))
    joint, _ = joint_evidence(y, y, np.zeros(3, bool))
    assert (joint.value, joint.n_components, joint.word) == (0.0, 0, "no bins")


def test_more_bins_than_streams_has_no_gaussian_fit(rng):
    joint, _ = joint_evidence(*rng.standard_normal((2, 5, 9)), np.ones(9, bool))
    assert np.isnan(joint.gaussian)


# --- errors and convergence ------------------------------------------------------------------


def test_bootstrap_error_is_the_scatter_of_independent_ensembles(rng):
    """The standard error found from one ensemble is the scatter that repeating it would show."""
    rules = Rules(y_bins=(10, 15, 20))
    totals, errors = [], []
    for _ in range(24):
        pdfs = measure_pdfs(toy_profiles(rng, (0.05, 0.3), (200, 200)), 10, (0.4, 1.6))
        evidence = measure_evidence(pdfs, 0.1, rules)
        totals.append(evidence.cumulative(0, 0, 1).value)
        errors.append(bootstrap(pdfs, evidence, 60, y_bins=rules.y_bins)[0, 1])
    assert 0.6 < np.mean(errors) / np.std(totals, ddof=1) < 1.6


def test_bootstrap_repeats_itself(rng):
    pdfs = measure_pdfs(toy_profiles(rng), 10)
    evidence = measure_evidence(pdfs, 0.1)
    first, second = (bootstrap(pdfs, evidence, 10, seed=4) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert (np.diag(first) == 0).all()
    assert (first[~np.eye(3, dtype=bool)] > 0).all()


def test_growth_ends_at_the_full_ensembles(rng):
    pdfs = measure_pdfs(toy_profiles(rng), 20)
    rules = Rules(y_bins=(20, 50, 100))
    evidence = measure_evidence(pdfs, 0.1, rules)
    curve = growth(pdfs, evidence, 0, 2, y_bins=rules.y_bins)
    assert curve.n_streams.tolist() == [50, 100, 200, 220]
    whole = [y[:220] for y in pdfs.y]
    expected = measure_evidence(Pdfs(pdfs.edges, (whole[0], whole[2])), 0.1, rules)
    kept = evidence.kept(0, 0, 2)
    assert curve.mean[-1] == pytest.approx(expected.ln_bayes(0, 0, 1)[0][kept].sum())
    assert np.isnan(curve.scatter[-1])
    assert curve.scatter[0] > 0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda p: measure_evidence(Pdfs(p.edges, p.y[:1]), 0.1), "at least two"),
        (lambda p: measure_evidence(p, 0.1, Rules(y_bins=(1,))), "at least 2"),
        (lambda p: measure_evidence(p, 0.1, Rules(y_bins=())), "at least 2"),
        (lambda p: overlap_integrals([np.ones((2, 0)), np.ones((2, 3))]), "at least one stream"),
        (lambda p: bootstrap(p, measure_evidence(p, 0.1), 1), "at least 2"),
    ],
)
def test_what_cannot_be_compared_says_why(rng, call, words):
    pdfs = measure_pdfs(toy_profiles(rng), 10)
    with pytest.raises(ValueError, match=words):
        call(pdfs)
