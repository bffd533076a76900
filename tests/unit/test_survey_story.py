"""Numbers of the story: the stream on the sky, pieces of streams, stars behind a noise."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.survey.story import PIECES, deviations, odds, pieces, stars_per_bin, track


def test_the_track_runs_from_the_progenitor_to_where_the_density_has_fallen(geometry):
    shown = track(geometry)
    assert shown.theta[0] == pytest.approx(0, abs=2e-3)
    assert shown.density[-1] == pytest.approx(0.2, abs=0.01)
    assert (shown.ell[0], shown.ell[-1]) == (pytest.approx(161.12, abs=0.3), pytest.approx(234.9, abs=0.3))
    straight = np.hypot(np.ptp(shown.ell) * np.cos(np.deg2rad(35)), np.ptp(shown.b))
    assert shown.sky_length == pytest.approx(straight, rel=0.1)


def test_pieces_of_white_noise_average_out_and_of_a_slow_wave_do_not():
    rng = np.random.default_rng(0)
    white = 1 + 0.3 * rng.standard_normal((200, 512))
    wave = 1 + 0.3 * np.sqrt(2) * np.sin(2 * np.pi * np.arange(512) / 512)
    of_white, of_wave = deviations(white), deviations(np.tile(wave, (3, 1)))
    np.testing.assert_allclose(of_white[1], 0.3 / np.sqrt(PIECES), rtol=0.1)
    assert of_wave[1][:6] == pytest.approx(0.3, rel=0.02)
    assert (of_white[0] < of_white[2]).all()
    shown = pieces([of_white, of_wave], 0.5, 0.2)
    np.testing.assert_allclose(shown.noise, 0.5 / np.sqrt(PIECES))
    assert shown.visible_from(0) == np.inf
    assert shown.visible_from(1) == pytest.approx(0.2 * 4)  # 0.5/√4 < 0.3 < 0.5/√2


def test_a_short_stream_is_cut_into_two_pieces_at_least():
    few = deviations(1 + 0.3 * np.random.default_rng(0).standard_normal((50, 30)))
    assert few.shape == (3, 4)  # of 1, 2, 4 and 8 bins
    assert np.isfinite(few).all()
    np.testing.assert_allclose(pieces([few], 0.1, 2.0).width, [2, 4, 8, 16])


def test_the_stars_behind_a_noise():
    assert stars_per_bin(0.1) == pytest.approx(100)
    assert stars_per_bin(0) == np.inf


def test_the_odds_of_two_gaussians_are_their_ratio():
    rng = np.random.default_rng(0)
    shown = odds(rng.normal(0, 1, 4000), rng.normal(2, 1, 4000))
    for value in (0.0, 0.5, 1.0, 1.5, 2.0):
        assert np.log(shown.at(value)) == pytest.approx(2 - 2 * value, abs=0.35)  # ln N(0, 1) - ln N(2, 1)
    assert shown.right == pytest.approx((0.841, 0.841), abs=0.02)  # Φ(1)
    assert 0 < shown.at(-9) < np.inf
