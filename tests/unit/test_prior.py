"""Priors: what they refuse, what they draw, and ensembles whose streams have parameters of their own."""

import numpy as np
import pytest

from streamdash.config import ConfigError, EnsembleConfig
from streamdash.naming import class_labels, differences
from streamdash.prior import PARAMETERS, POPULATION, PRIORS, RATE, Prior
from streamdash.simulation.ensemble import simulate, stream_parameters
from streamdash.store.cache import Cache


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({"log10_rate": (1, -1)}, "log10_rate"),
        ({"log10_rate": (-9, 1)}, "log10_rate"),
        ({"log10_rate": None}, "open"),
        ({"log10_half_mode_mass": (5, float("nan"))}, "log10_half_mode_mass"),
        ({"noise_factor": (2, 1)}, "noise_factor"),
        ({"ages_gyr": (5, 5)}, "ages_gyr"),
        ({"mass_range": "1e9-1e6"}, "mass"),
        ({"unknown": 1}, "unknown"),
    ],
)
def test_refused_in_one_sentence(fields, word):
    with pytest.raises(ConfigError, match=word) as caught:
        Prior(**fields)
    assert "\n" not in str(caught.value)


def test_json_there_and_back():
    for prior in PRIORS.values():
        assert Prior.parse(prior.to_json()) == prior
        config = EnsembleConfig(prior=prior, n_streams=7)
        back = EnsembleConfig.parse(config.model_dump_json())
        assert back == config and back.key == config.key
        assert back.model_copy(update={"n_streams": 9}) == EnsembleConfig(prior=prior, n_streams=9)


def test_keys_of_ensembles_without_a_prior_are_as_before():
    assert "prior" not in EnsembleConfig().model_dump(mode="json")
    assert EnsembleConfig(prior=RATE).key != EnsembleConfig().key


def test_prior_and_population_exclude_each_other():
    with pytest.raises(ConfigError, match="prior: leave population and perturbers out"):
        EnsembleConfig(prior=RATE, perturbers={"mass_range": "1e6-1e9"})
    with pytest.raises(ConfigError, match="prior.log10_rate"):
        EnsembleConfig(prior={"log10_rate": [2, 1]})


def test_what_is_observed_only_does_not_change_what_is_simulated():
    nuisances = Prior(background=0.2, background_deg=30, noise_factor=(0.8, 1.2), ages_gyr=(3, 5))
    assert nuisances.key != RATE.key
    assert EnsembleConfig(prior=nuisances).key == EnsembleConfig(prior=RATE).key


def test_draws_fill_their_ranges_evenly():
    rng = np.random.default_rng(0)
    draws = [POPULATION.draw(rng) for _ in range(4000)]
    for name, (low, high) in POPULATION.ranges.items():
        values = np.array([draw[name] for draw in draws])
        assert low <= values.min() and values.max() <= high
        shares = np.histogram(values, 10, (low, high))[0] / len(values)
        assert abs(shares - 0.1).max() < 0.025


def test_population_has_the_parameters():
    values = {"log10_rate": 0.5, "log10_half_mode_mass": 7.0, "log10_excess": -1.0, "slope": -1.8}
    clusters, halos = Prior().population({**values, "log10_rs_factor": 0.3}).components
    assert halos.rate_factor == pytest.approx(10**0.5) and halos.half_mode_mass == pytest.approx(1e7)
    assert halos.slope == -1.8 and halos.rs_factor == clusters.rs_factor == pytest.approx(10**0.3)
    assert clusters.mass_range == (1e3, 1e5) and clusters.rate_factor == pytest.approx(0.1)
    cold = Prior().population({})
    assert cold.components[0].rate_factor == 1 and cold.components[0].half_mode_mass is None
    assert set(POPULATION.names) <= set(PARAMETERS)


def test_parameters_depend_on_seed_and_number_alone():
    few, many = (stream_parameters(EnsembleConfig(prior=POPULATION, n_streams=n, seed=3)) for n in (4, 9))
    assert few.equals(many.head(4))
    other = stream_parameters(EnsembleConfig(prior=POPULATION, n_streams=4, seed=4))
    assert not np.isclose(other, few).any()


def test_named_for_people():
    names = class_labels([EnsembleConfig(perturbers={"mass_range": "1e6-1e9"}), EnsembleConfig(prior=RATE)])
    assert len(set(names)) == 2
    assert any("population of its own" in words for words in differences(EnsembleConfig(prior=RATE)))


def test_ensemble_is_kept_and_resumed_like_any(tmp_path):
    shipped = Cache.default().roots[0]
    cache = Cache((shipped, tmp_path), tmp_path)
    config = EnsembleConfig(prior=Prior(log10_rate=(-2, 1)), n_streams=12, seed=5)
    streams = simulate(config, "inline", cache=cache)
    more = simulate(config.model_copy(update={"n_streams": 14}), "inline", cache=cache)
    assert np.array_equal(more.density[:12], streams.density)
    rate = stream_parameters(config).log10_rate
    # More subhalos where the rate is higher: their ranks agree, whatever the counts are.
    assert np.corrcoef(rate.rank(), streams.n_impacts.to_series().rank())[0, 1] > 0.7
    entry = cache.find(config.key)
    assert entry.state == "complete" and entry.label == "prior-1e6-1e9"
