"""PDF(Qρ): against numpy's own histogram and quantiles, and at its edges."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.statistics.pdf import (
    Pdfs,
    bin_edges,
    common_range,
    measure_pdfs,
    pdf_of_profiles,
    quantiles_of_sorted,
    y_distribution,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture
def profiles(rng) -> list[np.ndarray]:
    """Three models of unequal size and growing scatter."""
    return [
        (1 + scatter * rng.standard_normal((n, 347))).astype(np.float32)
        for n, scatter in ((120, 0.1), (80, 0.3), (55, 0.6))
    ]


def test_range_is_the_widest_where_every_model_has_samples(profiles):
    low, high = common_range(profiles)
    assert low == max(q.min() for q in profiles)
    assert high == min(q.max() for q in profiles)


@pytest.mark.parametrize("n_bin", [2, 10, 100, 500])
def test_density_is_numpys_histogram_normalised(profiles, n_bin):
    pdfs = measure_pdfs(profiles, n_bin)
    for q, y in zip(profiles, pdfs.y, strict=True):
        for stream in (0, len(q) - 1):
            expected = np.histogram(q[stream].astype(float), pdfs.edges, density=True)[0]
            np.testing.assert_allclose(y[stream], expected, rtol=1e-12)


@pytest.mark.parametrize("n_bin", [2, 7, 500])
def test_every_pdf_integrates_to_one(profiles, n_bin):
    pdfs = measure_pdfs(profiles, n_bin)
    for y in pdfs.y:
        np.testing.assert_allclose(y.sum(axis=1) * np.diff(pdfs.edges)[0], 1, rtol=1e-12)


def test_both_ends_of_the_range_are_counted():
    q = np.array([[0.0, 0.5, 1.0, 2.0, -1.0]])
    np.testing.assert_allclose(pdf_of_profiles(q, np.array([0.0, 0.5, 1.0])), [[2 / 3, 4 / 3]])


def test_values_that_are_not_finite_are_not_counted():
    q = np.array([[0.1, np.nan, 0.9, np.inf, -np.inf]])
    np.testing.assert_allclose(pdf_of_profiles(q, bin_edges((0, 1), 2)), [[1, 1]])
    assert common_range([q]) == (0.1, 0.9)


def test_a_stream_outside_the_range_has_no_density():
    y = pdf_of_profiles(np.array([[5.0, 6.0], [0.2, 0.4]]), bin_edges((0, 1), 4))
    assert not y[0].any()
    assert y[1].sum() == pytest.approx(4)


def test_a_constant_profile_fills_one_bin():
    q = np.ones((3, 50))
    pdfs = measure_pdfs([q, q], 10)
    assert pdfs.edges[0] < 1 < pdfs.edges[-1]
    assert np.count_nonzero(pdfs.y[0], axis=1).tolist() == [1, 1, 1]
    assert pdfs.y[0].sum() * np.diff(pdfs.edges)[0] == pytest.approx(3)


def test_an_empty_bin_is_zero_in_every_quantile():
    q = np.repeat([[0.0, 0.05, 0.95, 1.0]], 6, axis=0)
    band = measure_pdfs([q], 10).band(0)
    assert band.low[5] == band.median[5] == band.high[5] == 0
    assert band.median[0] > 0


def test_bands_are_numpys_quantiles(profiles):
    pdfs = measure_pdfs(profiles, 30)
    for model, y in enumerate(pdfs.y):
        band = pdfs.band(model, (0.16, 0.5, 0.84))
        expected = np.quantile(y, (0.16, 0.5, 0.84), axis=0)
        np.testing.assert_allclose([band.low, band.median, band.high], expected, rtol=1e-12)


def test_quantiles_of_one_sample_are_that_sample():
    np.testing.assert_array_equal(quantiles_of_sorted(np.array([[3.0]]), (0, 0.5, 1)), [[3], [3], [3]])


def test_order_of_streams_and_of_longitudes_does_not_matter(profiles, rng):
    first = measure_pdfs(profiles, 40)
    shuffled = measure_pdfs([rng.permutation(rng.permutation(q, axis=1)) for q in profiles], 40)
    for model in range(3):
        np.testing.assert_allclose(first.sorted_y[model], shuffled.sorted_y[model], rtol=1e-12)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_no_noise_and_huge_noise(profiles, rng, noise):
    noisy = [q + np.float32(noise) * rng.standard_normal(q.shape).astype(np.float32) for q in profiles]
    pdfs = measure_pdfs(noisy, 50)
    assert all(np.isfinite(y).all() for y in pdfs.y)
    widths = [np.sqrt(np.average((pdfs.centers - 1) ** 2, weights=y.mean(axis=0))) for y in pdfs.y]
    assert widths == sorted(widths)
    assert widths[0] == pytest.approx(np.hypot(0.1, noise), rel=0.1)


def test_distribution_of_one_bin_is_on_common_bins_and_integrates_to_one(profiles):
    pdfs = measure_pdfs(profiles, 20)
    samples = [y[:, 10] for y in pdfs.y]
    edges, heights = y_distribution(samples, 50)
    assert heights.shape == (3, 50)
    np.testing.assert_allclose(heights.sum(axis=1) * np.diff(edges)[0], 1)
    assert edges[0] == min(s.min() for s in samples)
    assert edges[-1] == max(s.max() for s in samples)


def test_distribution_of_a_bin_that_no_stream_reaches():
    edges, heights = y_distribution([np.zeros(5), np.zeros(3)], 10)
    np.testing.assert_array_equal(heights[0], heights[1])
    assert edges[0] < 0 < edges[-1]


def test_occupied_counts_streams():
    pdfs = Pdfs(np.array([0.0, 1.0, 2.0]), (np.array([[1.0, 0.0], [0.5, 0.5], [0.0, 0.0]]),))
    np.testing.assert_array_equal(pdfs.occupied(0), [2, 1])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: common_range([]), "at least one model"),
        (lambda: common_range([np.ones((2, 3)), np.full((2, 3), np.nan)]), "M1 has no finite"),
        (lambda: common_range([np.ones((2, 3)), np.full((2, 3), 2.0)]), "share no value"),
        (lambda: bin_edges((0, 1), 1), "between 2 and 500"),
        (lambda: bin_edges((0, 1), 501), "between 2 and 500"),
        (lambda: bin_edges((1, 1), 10), "lower end first"),
        (lambda: pdf_of_profiles(np.ones(4), np.array([0.0, 1.0])), "n_streams, n_longitudes"),
    ],
)
def test_what_cannot_be_measured_says_why(call, words):
    with pytest.raises(ValueError, match=words):
        call()
