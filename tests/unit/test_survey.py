"""Sky coordinates, bins and shot noise, on the default stream."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from streamdash.config import StreamModel
from streamdash.streams import window_of
from streamdash.survey import sky

WINDOW = window_of(StreamModel()).theta
THETA = np.linspace(*WINDOW, 400)


def ensemble(geometry, density: np.ndarray) -> xr.Dataset:
    return xr.Dataset(
        {"density": (("stream", "theta"), density), "smooth": ("theta", geometry.smooth_density(THETA))},
        coords={"theta": THETA},
    )


@pytest.fixture(scope="module")
def edges(geometry):
    return sky.longitude_bins(geometry)


# ------------------------------------------------------------------ positions


@pytest.mark.parametrize(("theta", "ell"), [(0.0, 161.12), (0.231, 191.12), (0.577, 217.83), (0.981, 234.71)])
def test_longitudes_are_those_of_galpys_track(geometry, theta, ell):
    """The reference angles are quoted to three digits: half a unit of the last is up to 0.07°."""
    rounding = 0.0005 if theta else 0.0
    low, high = sky.theta_to_ell(geometry, [max(theta - rounding, 0.0), theta + rounding])
    assert low - 0.005 <= ell <= high + 0.005


@pytest.mark.parametrize(("theta", "phi1"), [(0.058, -28.9), (0.75, -87.3)])
def test_phi1_is_that_of_the_gd1_frame(geometry, theta, phi1):
    assert sky.from_theta(geometry, theta, "phi1") == pytest.approx(phi1, abs=0.06)


@pytest.mark.parametrize("coordinate", ["ell", "phi1"])
def test_conversions_invert_each_other(geometry, coordinate):
    there = sky.from_theta(geometry, THETA, coordinate)
    np.testing.assert_allclose(sky.to_theta(geometry, there, coordinate), THETA, atol=1e-12)
    np.testing.assert_allclose(sky.to_theta(geometry, there - 720, coordinate), THETA, atol=1e-11)


@pytest.mark.parametrize(
    ("convert", "value", "words"),
    [
        (sky.theta_to_ell, -0.01, "theta -0.01 rad is off the stream's track, 0 to"),
        (lambda *given: sky.from_theta(*given, "phi1"), 3.0, "theta 3 rad is off"),
        (sky.ell_to_theta, 160.0, "ell 160° is off the stream's track, 161.1 to"),
        (sky.ell_to_theta, [170.0, np.nan], "ell nan° is off"),
        (lambda *given: sky.to_theta(*given, "phi1"), 20.0, "phi1 20° is off"),
    ],
)
def test_positions_off_the_track_are_refused(geometry, convert, value, words):
    with pytest.raises(ValueError, match=words):
        convert(geometry, value)


def test_a_longitude_that_turns_back_is_refused(geometry):
    ell = geometry.track_ell.copy()
    ell[500:] = ell[500] - (ell[500:] - ell[500])
    with pytest.raises(ValueError, match="ell turns back along this stream; use theta"):
        sky.ell_to_theta(replace(geometry, track_ell=ell), 170.0)


def test_a_longitude_that_turns_back_beyond_the_window_serves_up_to_there(geometry):
    beyond = int(np.searchsorted(geometry.track_theta, WINDOW[1])) + 2
    ell = geometry.track_ell.copy()
    ell[beyond:] = ell[beyond] - (ell[beyond:] - ell[beyond])
    bent = replace(geometry, track_ell=ell)
    np.testing.assert_array_equal(sky.longitude_bins(bent), sky.longitude_bins(geometry))
    with pytest.raises(ValueError, match="is off the stream's track"):
        sky.theta_to_ell(bent, geometry.track_theta[beyond] + 0.1)


# ------------------------------------------------------------------ bins


def test_the_default_window_holds_347_bins(geometry, edges):
    assert edges.shape == (348,)
    np.testing.assert_allclose(np.diff(edges), 0.2, rtol=1e-3)
    assert (edges[0], edges[-1]) == pytest.approx((165.53, 234.91), abs=0.01)
    np.testing.assert_allclose(sky.ell_to_theta(geometry, edges[[0, -1]]), WINDOW)


@pytest.mark.parametrize("width", [0.0, -1.0, np.nan, np.inf])
def test_bins_need_a_positive_width(geometry, width):
    with pytest.raises(ValueError, match="width must be a positive number"):
        sky.longitude_bins(geometry, width)


def test_bin_means_are_the_exact_integrals(geometry, edges):
    values = np.random.default_rng(1).uniform(0, 2, (3, 400))
    means = sky.observe(geometry, THETA, values, edges)
    ends = sky.ell_to_theta(geometry, edges)
    for j in (0, 100, 346):
        a, b = ends[j], ends[j + 1]
        knots = THETA[(THETA > a) & (THETA < b)]
        for profile, mean in zip(values, means, strict=True):
            area, _ = integrate.quad(np.interp, a, b, args=(THETA, profile), points=[*knots], epsabs=1e-13)
            assert mean[j] == pytest.approx(area / (b - a), rel=1e-9)


@given(cuts=st.lists(st.integers(1, 398), min_size=1, max_size=30, unique=True))
def test_no_star_is_lost_or_counted_twice(geometry, cuts):
    """However the window is cut, the bins' stars add up to all stars."""
    values = np.random.default_rng(2).uniform(0, 2, 400)
    edges = np.concatenate([[THETA[0]], THETA[sorted(cuts)] - 0.0007, [THETA[-1]]])
    stars = sky.observe(geometry, THETA, values, edges, "theta") * np.diff(edges)
    assert stars.sum() == pytest.approx(integrate.trapezoid(values, THETA), rel=1e-12)


def test_bins_are_the_same_in_every_coordinate(geometry, edges):
    values = np.random.default_rng(3).uniform(0, 2, (5, 400))
    theta_edges = sky.ell_to_theta(geometry, edges)
    phi1_edges = sky.from_theta(geometry, theta_edges, "phi1")
    in_ell = sky.observe(geometry, THETA, values, edges, "ell")
    np.testing.assert_allclose(sky.observe(geometry, THETA, values, theta_edges, "theta"), in_ell, rtol=1e-9)
    np.testing.assert_allclose(sky.observe(geometry, THETA, values, phi1_edges, "phi1"), in_ell, rtol=1e-9)
    backwards = sky.observe(geometry, THETA, values, edges[::-1], "ell")
    np.testing.assert_allclose(backwards, in_ell[:, ::-1], rtol=1e-12)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ([165.3, 165.6, 165.8], r"bin 0 \(165.3 to 165.6°\) is not within the profiles, ell 165.53"),
        ([170, 171, 240], r"bin 1 \(171 to 240°\) is not within"),
        ([170, 170, 171], "must increase"),
        ([170, 172, 171], "must increase"),
        ([170], "at least two"),
        ([170, np.nan], "finite"),
    ],
)
def test_bins_that_cannot_be_filled_are_named(geometry, bad, words):
    with pytest.raises(ValueError, match=words):
        sky.observe(geometry, THETA, np.ones(400), np.array(bad, dtype=float))


def test_an_unknown_coordinate_is_refused(geometry):
    with pytest.raises(ValueError, match="one of ell, phi1, theta"):
        sky.observe(geometry, THETA, np.ones(400), np.array([0.1, 0.2]), "ra")


# ------------------------------------------------------------------ Qρ


def test_an_unperturbed_stream_has_q_of_one(geometry, edges):
    smooth = np.tile(geometry.smooth_density(THETA), (2, 1)).astype("float32")
    np.testing.assert_allclose(sky.q_rho(geometry, ensemble(geometry, smooth), edges), 1, atol=1e-6)


def test_q_is_observed_over_expected_stars(geometry, edges):
    density = np.random.default_rng(4).uniform(0, 2, (3, 400)).astype("float32")
    data = ensemble(geometry, density)
    expected = sky.observe(geometry, THETA, density.astype(float), edges) / sky.observe(
        geometry, THETA, data.smooth.values, edges
    )
    q = sky.q_rho(geometry, data, edges)
    assert q.dtype == np.float32
    np.testing.assert_allclose(q, expected, rtol=2e-6)


# ------------------------------------------------------------------ noise


def test_noise_is_standard_normal_and_the_same_for_the_first_streams():
    draws = sky.shot_noise((2000, 347), seed=5)
    assert draws.dtype == np.float32
    assert abs(draws.mean()) < 5 / np.sqrt(draws.size)
    assert draws.std() == pytest.approx(1, abs=5 / np.sqrt(2 * draws.size))
    np.testing.assert_array_equal(sky.shot_noise((70, 347), seed=5), draws[:70])
    assert not np.array_equal(sky.shot_noise((70, 347), seed=6), draws[:70])


def test_noise_scales_with_its_level():
    q, draws = np.ones((10, 7), dtype="float32"), sky.shot_noise((20, 7))
    noisy = sky.add_noise(q, draws, 0.1)
    assert noisy.dtype == np.float32
    np.testing.assert_allclose(noisy, 1 + 0.1 * draws[:10], rtol=1e-6)
    np.testing.assert_array_equal(sky.add_noise(q, draws, 0), q)
    assert (sky.add_noise(0 * q, draws, 0.1) < 0).any()


@pytest.mark.parametrize("sigma", [-0.1, np.nan, np.inf])
def test_a_noise_level_must_be_a_number_of_zero_or_more(sigma):
    with pytest.raises(ValueError, match="noise must be a number of 0 or more"):
        sky.add_noise(np.ones((2, 3)), np.ones((2, 3)), sigma)


@pytest.mark.parametrize("shape", [(21, 7), (10, 8)])
def test_noise_for_other_streams_or_bins_is_refused(shape):
    with pytest.raises(ValueError, match="noise was drawn for"):
        sky.add_noise(np.ones(shape), sky.shot_noise((20, 7)), 0.1)
