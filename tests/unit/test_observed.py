"""Designs, and ensembles seen through them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.store.cache import Cache, StoreError
from streamdash.streams import window_of
from streamdash.survey import design, sky
from streamdash.survey.design import AS_IS, Design, default_design, observe_as, smooth_as
from streamdash.survey.observed import ObservedStreams, noise_draws

THETA = np.linspace(*window_of(StreamModel()).theta, 400)
LOW, HIGH = (EnsembleConfig(perturbers=Perturbers(mass_range=m)) for m in ("1e3-1e5", "1e5-1e9"))


@pytest.fixture(scope="module")
def ensemble(geometry) -> xr.Dataset:
    """Streams of any density, and the smooth stream."""
    smooth = geometry.smooth_density(THETA)
    bumps = np.random.default_rng(0).uniform(0, 2, (5, len(THETA)))
    return xr.Dataset(
        {
            "density": (("stream", "theta"), (smooth * bumps).astype("float32")),
            "smooth": ("theta", smooth),
            "n_impacts": ("stream", np.arange(5)),
        },
        coords={"theta": THETA},
    )


@pytest.fixture(scope="module")
def shipped(small_cache) -> Cache:
    return Cache.default(small_cache)


@pytest.fixture(scope="module")
def two(shipped) -> ObservedStreams:
    return ObservedStreams.read(shipped, in_order(shipped))


def in_order(cache: Cache) -> list[EnsembleConfig]:
    found = [entry.config for entry in cache.entries() if entry.kind == "ensemble"]
    return sorted(found, key=lambda config: config.population.mass_range)


# ------------------------------------------------------------------ designs


def test_many_streams_are_put_into_bins_a_part_at_a_time(geometry, ensemble, monkeypatch):
    at_once = observe_as(geometry, ensemble, default_design(geometry))
    monkeypatch.setattr(design, "AT_ONCE", 2)
    np.testing.assert_allclose(observe_as(geometry, ensemble, default_design(geometry)), at_once, rtol=1e-5)


def test_the_default_design_measures_q_rho_in_the_papers_bins(geometry, ensemble):
    design = default_design(geometry)
    edges = sky.longitude_bins(geometry)
    np.testing.assert_array_equal(design.edges, edges)
    assert (design.noise, design.step) == (sky.NOISE, abs(edges[1] - edges[0]))
    np.testing.assert_array_equal(
        observe_as(geometry, ensemble, design), sky.q_rho(geometry, ensemble, edges)
    )
    np.testing.assert_allclose(smooth_as(geometry, ensemble, design), 1, rtol=1e-12)


@given(cuts=st.sets(st.integers(0, 692), min_size=4, max_size=40), gaps=st.data())
def test_a_gap_takes_its_bins_away_and_nothing_else(geometry, ensemble, cuts, gaps):
    edges = 166.0 + 0.1 * np.array(sorted(cuts)) * 0.98
    whole = Design.adjoining("ell", edges)
    kept = np.array(gaps.draw(st.lists(st.booleans(), min_size=len(cuts) - 1, max_size=len(cuts) - 1)))
    kept[[0, -1]] = True
    part = Design("ell", whole.low[kept], whole.high[kept], whole.sigma[kept])
    np.testing.assert_allclose(
        observe_as(geometry, ensemble, part), observe_as(geometry, ensemble, whole)[:, kept], rtol=2e-5
    )


@pytest.mark.parametrize("quantity", ["q_rho", "density"])
@pytest.mark.parametrize("gap", [False, True])
def test_bins_that_run_the_other_way_are_the_same_bins(geometry, ensemble, quantity, gap):
    edges = np.linspace(170, 230, 31)
    low, high, sigma = edges[:-1], edges[1:], np.linspace(0.1, 0.2, 30)
    if gap:
        low, high, sigma = (np.delete(array, [7, 8]) for array in (low, high, sigma))
    rising = Design("ell", low, high, sigma, quantity)
    falling = Design("ell", high[::-1], low[::-1], sigma[::-1], quantity)
    assert rising.gapless is falling.gapless is not gap
    np.testing.assert_allclose(
        observe_as(geometry, ensemble, falling),
        observe_as(geometry, ensemble, rising)[:, ::-1],
        rtol=2e-5,
    )


def test_the_noise_slider_changes_the_errors_and_nothing_else(geometry):
    design = default_design(geometry, 0.1)
    louder = design.with_noise(0.3)
    np.testing.assert_array_equal(louder.sigma, np.full(design.n_bin, 0.3))
    assert louder.bins_key == design.bins_key and louder.key != design.key
    assert louder.with_noise(0.1).key == design.key
    each = design.with_noise(np.linspace(0, 1, design.n_bin))
    assert each.noise == pytest.approx(0.5) and each.sigma[-1] == 1


@pytest.mark.parametrize("noise", [-0.1, np.nan, np.inf, [0.1, 0.1], np.full(30, -1.0)])
def test_errors_that_are_none_are_refused(noise):
    design = Design.adjoining("ell", np.linspace(170, 230, 31))
    with pytest.raises(ValueError, match=r"0 or more|one for each"):
        design.with_noise(noise)


def test_bins_with_gaps_have_no_common_edges():
    design = Design("ell", np.array([1.0, 3.0]), np.array([2.0, 4.0]), np.ones(2))
    with pytest.raises(ValueError, match="use low and high"):
        _ = design.edges


# ------------------------------------------------------------------ observed streams


def test_streams_are_the_ensembles_in_order_with_draws_of_their_own(two, shipped):
    configs = in_order(shipped)
    assert two.labels == ("1e3-1e5", "1e5-1e9")
    assert two.keys == tuple(config.key for config in configs)
    for config, q, draws, hits in zip(configs, two.q, two.draws, two.n_impacts, strict=True):
        assert q.shape == draws.shape == (config.n_streams, two.n_bins) and len(hits) == config.n_streams
        np.testing.assert_array_equal(draws, sky.shot_noise(q.shape, int(config.key, 16)))
    assert abs(np.corrcoef(two.draws[0].ravel(), two.draws[1].ravel())[0, 1]) < 0.02


def test_keys_and_configurations_name_the_same_streams(two, shipped):
    again = ObservedStreams.read(shipped, [config.key for config in in_order(shipped)], two.design)
    assert again.digest == two.digest


def test_noise_is_that_of_the_design_unless_another_is_asked_for(two):
    for noise in (0.0, 0.1, 0.25):
        by_class, pooled = two.noisy(noise), two.observed(noise)
        np.testing.assert_array_equal(np.concatenate(by_class), pooled)
        np.testing.assert_array_equal(np.concatenate(two.with_noise(noise).noisy()), pooled)
        off = (pooled - two.clean) / max(noise, 1e-9)
        assert off.std() == pytest.approx(float(noise > 0), abs=0.01)
    np.testing.assert_array_equal(two.observed(), two.observed(sky.NOISE))


def test_other_draws_of_the_noise_have_numbers(two):
    own, first, second = (two.noisy(0.1, number)[0] - two.q[0] for number in (0, 1, 2))
    np.testing.assert_array_equal(own, two.noisy(0.1)[0] - two.q[0])
    for one, other in ((own, first), (own, second), (first, second)):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.02


def test_a_polynomial_is_divided_out_noise_included(two, shipped):
    design = Design("ell", np.arange(170.0, 230, 2), np.arange(172.0, 232, 2), np.full(30, 0.1), "q_rho", 0)
    streams = ObservedStreams.read(shipped, in_order(shipped), design)
    np.testing.assert_allclose(streams.observed().mean(axis=1), 1, rtol=1e-5)
    assert np.ptp(streams.clean.mean(axis=1)) > 0.01  # not divided before the noise is there


def test_a_density_is_in_units_of_the_smooth_streams_mean(shipped):
    design = Design("phi1", np.arange(-80.0, -30, 5), np.arange(-75.0, -25, 5), np.full(10, 0.1), "density")
    streams = ObservedStreams.read(shipped, in_order(shipped)[:1], design)
    assert streams.smooth.mean() == pytest.approx(1)
    np.testing.assert_allclose(np.median(streams.q[0], axis=0), streams.smooth, rtol=0.1)


def test_rows_are_located_in_their_ensembles(two):
    rows = np.array([0, len(two.q[0]) - 1, len(two.q[0]), len(two.y) - 1])
    owner, index = two.locate(rows)
    np.testing.assert_array_equal(owner, two.y[rows])
    for row, c, i in zip(rows, owner, index, strict=True):
        np.testing.assert_array_equal(two.clean[row], two.q[c][i])


def test_parts_joined_are_the_whole(two):
    joined = ObservedStreams.join([two.only([0]), two.only([1])])
    assert joined.digest == two.digest
    assert two.only([1]).labels == two.labels[1:]
    assert joined.q[1] is two.q[1]


def test_what_cannot_be_compared_is_refused(two, shipped):
    with pytest.raises(ValueError, match="given twice"):
        ObservedStreams.join([two, two])
    with pytest.raises(ValueError, match="same bins"):
        ObservedStreams.join([two.only([0]), two.only([1]).with_noise(0.5)])
    with pytest.raises(ValueError, match="same stream"):
        ObservedStreams.read(shipped, [LOW, HIGH.model_copy(update={"stream": StreamModel(arm="trailing")})])
    with pytest.raises(ValueError, match="not within the profiles"):
        ObservedStreams.read(shipped, in_order(shipped), Design.adjoining("ell", [100.0, 110.0, 120.0]))
    with pytest.raises(StoreError):
        ObservedStreams.read(shipped, ["0" * 16])


def test_arrays_that_do_not_fit_are_named(two):
    design = Design.adjoining("theta", np.arange(5.0))
    q = np.ones((3, 4), dtype="float32")
    with pytest.raises(ValueError, match="configuration, its streams and its noise"):
        ObservedStreams((LOW, HIGH), design, (q,), (q,))
    with pytest.raises(ValueError, match=r"1e5-1e9: streams and draws .* \(streams, 4 bins\)"):
        ObservedStreams((LOW, HIGH), design, (q, q[:, :2]), (q, q))


def test_classes_of_the_same_masses_are_two_classes():
    design = Design.adjoining("theta", np.arange(5.0))
    warm = HIGH.model_copy(update={"perturbers": Perturbers(mass_range="1e5-1e9", cutoff_mass=1e7)})
    q = np.ones((3, 4), dtype="float32")
    streams = ObservedStreams((HIGH, warm), design, (q, q), (q, q))
    assert streams.labels == ("1e5-1e9", "1e5-1e9, cutoff 1e7 Msun")
    assert not np.array_equal(noise_draws(HIGH, (2, 3)), noise_draws(warm, (2, 3)))


def test_a_digest_changes_with_whatever_the_streams_are(two):
    design = two.design
    moved = Design("ell", design.low + 1e-9, design.high + 1e-9, design.sigma)
    divided = Design("ell", design.low, design.high, design.sigma, "q_rho", 2)
    others = [two.only([0]), two.only([1, 0])]
    others += [ObservedStreams(two.configs, d, two.q, two.draws) for d in (moved, divided)]
    others.append(ObservedStreams(two.configs, design, two.q, two.draws[::-1]))
    assert len({two.digest, *(other.digest for other in others)}) == 1 + len(others)
    assert two.with_noise(0.7).digest == two.digest
    assert divided.order != AS_IS
