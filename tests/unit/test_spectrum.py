"""Spectra of signals whose spectra are known."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from streamdash.statistics.bispectrum import bispectrum, bispectrum_slice, rao_gabr_window
from streamdash.statistics.spectra_in_noise import check_statements, from_scale, show
from streamdash.statistics.spectrum import (
    SpectrumBand,
    band_of,
    cross_spectrum,
    noisy_spectra,
    power_spectrum,
    shot_noise_level,
    track_ratio,
)
from streamdash.survey import sky

N, STEP = 400, 0.2
X = STEP * np.arange(N)
LENGTH = N * STEP


def wave(cycles: int, amplitude: float = 1.0, phase: float = 0.0) -> np.ndarray:
    return amplitude * np.cos(2 * np.pi * cycles * X / LENGTH + phase)


def test_a_wave_has_half_its_squared_amplitude_at_its_wavenumber():
    k, power = power_spectrum(1 + wave(12, 0.3), STEP, window="boxcar")
    assert k[np.argmax(power)] == pytest.approx(12 / LENGTH)
    assert power.max() == pytest.approx(0.5 * 0.3**2 * (N - 1) * STEP)
    assert np.delete(power, np.argmax(power)).max() < 1e-12


def test_the_hann_window_keeps_a_waves_height_and_spreads_it_over_three_wavenumbers():
    k, power = power_spectrum(wave(12, 0.3), STEP)
    peak = 0.5 * 0.3**2 * (N - 1) * STEP
    np.testing.assert_allclose(power[10:13], [peak / 4, peak, peak / 4], rtol=1e-9)
    assert np.delete(power, [10, 11, 12]).max() < 1e-12 * peak


def test_parseval_the_powers_add_up_to_the_variance():
    x = np.random.default_rng(1).normal(size=(5, N)).cumsum(axis=1)
    _, power = power_spectrum(x, STEP, window="boxcar")
    np.testing.assert_allclose(power.sum(axis=1), x.var(axis=1) * (N - 1) * STEP, rtol=1e-9)


def test_white_noise_is_flat_at_the_expected_height_however_long_the_stream_is():
    sigma = 0.1
    for n in (200, 800):
        _, power = power_spectrum(np.random.default_rng(n).normal(0, sigma, (4000, n)), STEP)
        # one-sided, times the Hann window's noise bandwidth of 1.5
        expected = 2 * 1.5 * sigma**2 * STEP * (n - 1) / n
        # the two outermost wavenumbers on either side feel the mean's removal and k = 0
        np.testing.assert_allclose(power.mean(axis=0)[2:-2], expected, rtol=0.1)
        assert power.mean(axis=0)[2:-2].mean() == pytest.approx(expected, rel=0.01)


def test_shot_noise_level_is_the_median_of_an_exponential_distribution_and_scales():
    level = shot_noise_level(347, 0.2, 0.1)
    mean = 2 * 1.5 * 0.1**2 * 0.2
    assert np.median(level.median) == pytest.approx(np.sqrt(mean * np.log(2)), rel=0.02)
    np.testing.assert_allclose(shot_noise_level(347, 0.2, 0.3).median, 3 * level.median)
    assert level.scale.min() >= 1.0
    assert level.n_streams == 1000


def test_the_cross_spectrum_is_real_in_phase_imaginary_a_quarter_late_and_zero_without_relation():
    x, y = wave(9, 0.2), wave(9, 0.5)
    _, in_phase = cross_spectrum(x, y, STEP, "boxcar")
    assert in_phase[8] == pytest.approx(0.5 * 0.2 * 0.5 * (N - 1) * STEP)
    _, late = cross_spectrum(x, wave(9, 0.5, -np.pi / 2), STEP, "boxcar")
    assert abs(late[8].real) < 1e-12 and abs(late[8]) == pytest.approx(abs(in_phase[8]))
    _, other = cross_spectrum(x, wave(10, 0.5), STEP, "boxcar")
    assert np.abs(other).max() < 1e-12


def test_a_profile_with_a_hole_has_no_spectrum_and_does_not_count():
    x = np.random.default_rng(2).normal(size=(50, N))
    whole = band_of(*power_spectrum(x, STEP))
    x[7, 100] = np.nan
    holed = band_of(*power_spectrum(x, STEP))
    assert (whole.n_streams, holed.n_streams) == (50, 49)
    assert np.isfinite(holed.median).all()
    with pytest.raises(ValueError, match="without stars"):
        band_of(*power_spectrum(np.full((3, N), np.nan), STEP))


def test_profiles_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="same three or more points"):
        cross_spectrum(np.zeros(10), np.zeros(11), STEP)


def test_bands_along_theta_are_against_degrees():
    k, power = power_spectrum(np.random.default_rng(3).normal(size=(20, 300)), 0.003)
    band = band_of(k, power, np.degrees(1))
    assert band.scale[0] == pytest.approx(np.degrees(0.9))
    assert band.scale.min() >= 1.0
    np.testing.assert_allclose(band.median, np.sqrt(np.median(power[:, : len(band.scale)], axis=0)))


@pytest.fixture(scope="module")
def sample() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(4)
    q = 1 + 0.03 * rng.normal(size=(200, 347)).cumsum(axis=1)
    track = 1 + 0.5 * (q - 1) + 0.01 * rng.normal(size=q.shape)
    track[3, 5] = np.nan
    return q, rng.normal(size=q.shape), track


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.7])
def test_spectra_at_any_noise_are_those_of_the_noisy_profiles(sample, sigma):
    q, draws, track = sample
    spectra = noisy_spectra(q, draws, track, STEP)
    direct = band_of(*power_spectrum(q + sigma * draws, STEP))
    shown = spectra.band("density", sigma)
    for name in ("low", "median", "high"):
        np.testing.assert_allclose(getattr(shown, name), getattr(direct, name), rtol=1e-4)
    crossed = band_of(*cross_spectrum(q + sigma * draws, track, STEP))
    np.testing.assert_allclose(spectra.band("cross", sigma).median, crossed.median, rtol=1e-4)
    assert spectra.band("cross", sigma).n_streams == crossed.n_streams == 199
    np.testing.assert_allclose(
        spectra.band("track", sigma).median, band_of(*power_spectrum(track, STEP)).median, rtol=1e-4
    )


def test_the_track_ratio_is_one_for_the_smooth_stream_and_nowhere_without_stars(geometry):
    theta = np.linspace(0.03, 0.987, 400)
    smooth = geometry.smooth_omega(theta)
    omega = np.stack([smooth, 1.1 * smooth, np.where(theta > 0.9, np.nan, smooth)])
    ensemble = xr.Dataset(
        {"omega": (("stream", "theta"), omega), "omega_smooth": ("theta", smooth)}, {"theta": theta}
    )
    ratio = track_ratio(geometry, ensemble, sky.longitude_bins(geometry))
    np.testing.assert_allclose(ratio[0], 1.0, rtol=1e-6)
    np.testing.assert_allclose(ratio[1], 1.1, rtol=1e-6)
    assert np.isnan(ratio[2]).any()


def flat(median: list[float], half: float = 0.1) -> SpectrumBand:
    values = np.array(median)
    return SpectrumBand(np.array([60.0, 30.0, 20.5, 15.0, 7.0]), values - half, values, values + half, 10)


def test_a_statement_is_counted_from_the_largest_scale_down():
    scale = np.array([60.0, 30.0, 20.0])
    assert from_scale(scale, np.array([True, True, False])) == 30.0
    assert from_scale(scale, np.array([True, False, True])) == 60.0
    assert from_scale(scale, np.array([True, True, True])) == 20.0
    assert np.isnan(from_scale(scale, np.array([False, True, True])))


def test_the_papers_statements_are_tested_with_and_without_noise():
    noise = flat([1.0] * 5)
    clean = [flat([2.0, 2.0, 2.0, 1.2, 0.5]), flat([9.0, 5.0, 2.5, 0.9, 0.4])]
    observed = [flat([2.2, 2.2, 2.2, 1.6, 1.1]), flat([9.0, 5.0, 2.3, 1.5, 1.1])]
    found = {s.classes: s for s in check_statements(clean, observed, noise)}
    assert (found[0,].clean_from, found[0,].clean_true) == (15.0, True)
    assert (found[0,].observed_from, found[0,].observed_true) == (15.0, True)
    # the second class is not above the noise at 15 deg: not true of all scales above 8 deg
    assert (found[1,].clean_from, found[1,].clean_true) == (20.5, False)
    assert (found[0, 1].clean_from, found[0, 1].clean_true) == (15.0, True)
    # the bands touch at 20.5 deg, which is above 20
    assert (found[0, 1].observed_from, found[0, 1].observed_true) == (30.0, False)


def test_what_is_shown_follows_the_noise(sample):
    q, draws, track = sample
    spectra = [noisy_spectra(q, draws, track, STEP), noisy_spectra(1 + 5 * (q - 1), draws, track, STEP)]
    level = shot_noise_level(347, STEP)
    loud, quiet = show(spectra, level, 0.5), show(spectra, level, 0.0)
    np.testing.assert_allclose(loud.noise.median, 0.5 * level.median)
    np.testing.assert_array_equal(quiet.bands["density"][1].median, quiet.clean[1].median)
    np.testing.assert_array_equal(loud.clean[0].median, quiet.clean[0].median)
    assert (loud.bands["density"][0].median > quiet.bands["density"][0].median)[5:].all()
    detected = {s.classes: s.observed_from for s in loud.statements if s.kind == "detected"}
    assert detected[1,] < detected[0,]


# ---------------------------------------------------------------- bispectrum


def test_three_waves_that_close_a_triangle_have_a_bispectrum():
    triangle = wave(5, 0.4) + wave(8, 0.3) + wave(13, 0.2)
    (found,) = bispectrum_slice(triangle, 5, size=1)
    # each transform is half an amplitude: B(5, 8) = ½·0.4 · ½·0.3 · ½·0.2
    assert found[7] == pytest.approx(0.4 * 0.3 * 0.2 / 8)
    open_ = wave(5, 0.4) + wave(8, 0.3) + wave(14, 0.2)
    assert np.abs(bispectrum_slice(open_, 5, size=1)[0, 7]) < 1e-12


def test_phase_decides_between_skewness_and_asymmetry():
    triangle = wave(5, 0.4) + wave(8, 0.3) + wave(13, 0.2, np.pi / 2)
    (found,) = bispectrum_slice(triangle, 5, size=1)
    assert abs(found[7].real) < 1e-12
    assert abs(found[7].imag) == pytest.approx(0.4 * 0.3 * 0.2 / 8)


def test_smoothing_is_a_weighted_mean_over_both_wavenumbers():
    q = 1 + np.random.default_rng(5).normal(size=(1, 60))
    transform = np.fft.fft(q[0] - q[0].mean()) / 60
    plane = np.array(
        [[transform[a % 60] * transform[b % 60] * np.conj(transform[(a + b) % 60]) for b in range(-3, 40)]
         for a in range(1, 8)]
    )  # fmt: skip
    window = rao_gabr_window(7)
    expected = [np.sum(window * plane[:, j : j + 7]) for j in range(1, 31)]
    np.testing.assert_allclose(bispectrum_slice(q, 4, size=7)[0], expected, rtol=1e-9)


def test_the_window_is_a_symmetric_hexagon_of_weight_one():
    window = rao_gabr_window(7)
    assert window.sum() == pytest.approx(1)
    np.testing.assert_array_equal(window, window.T)
    np.testing.assert_array_equal(window, window[::-1, ::-1])
    assert window[0, 0] == 0 and window[0, 6] > 0 and window.argmax() == 24
    assert rao_gabr_window(1) == [[1.0]]
    with pytest.raises(ValueError, match="odd"):
        rao_gabr_window(4)


def test_the_mean_bispectrum_of_white_noise_is_its_third_moment():
    rng = np.random.default_rng(6)
    skewed, gaussian = rng.exponential(size=(3000, 347)), rng.normal(size=(3000, 347))
    # the third cumulant is 2, divided by n twice
    assert bispectrum_slice(skewed, 6).mean(axis=0).real.mean() == pytest.approx(2 / 347**2, rel=0.1)
    assert abs(bispectrum_slice(gaussian, 6).mean(axis=0).real.mean()) < 0.1 * 2 / 347**2
    found = bispectrum(skewed[:50], STEP)
    assert found.scale_1 == pytest.approx(69.4 / 6)
    np.testing.assert_array_less(found.real.low, found.real.high)
