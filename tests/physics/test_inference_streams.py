"""Streams that are shipped for estimators of anybody's bins: they are the engine's, whole, and enough."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.inference.files import EstimatorFileError
from streamdash.inference.held_out import load_streams
from streamdash.inference.prior_ensemble import TRAINING_SEED, configs
from streamdash.inference.shipped_streams import (
    FOLDER,
    SOFT,
    STEP,
    are_shipped,
    load_shipped,
    path_of,
    save_streams,
)
from streamdash.observe.infer import learnt
from streamdash.prior import PRIORS, Prior
from streamdash.simulation.ensemble import compute_stream
from streamdash.store.cache import Cache
from streamdash.streams import named_stream

SETS = [("gd1-like", "rate"), ("gd1", "rate"), ("pal5", "rate"), ("gd1-like", "population")]


@pytest.mark.parametrize("stream, prior", SETS)
def test_shipped_streams_are_those_that_the_engine_computes(stream, prior):
    ensemble = load_shipped(PRIORS[prior], named_stream(stream).arm())
    ((config, geometry, streams),) = ensemble.members
    assert ensemble.n_streams == streams.sizes["stream"] >= 5000
    density, smooth = streams.density.values, streams.smooth.values
    assert density.shape == (ensemble.n_streams, config.n_theta) and (density >= 0).all()
    for i in (0, ensemble.n_streams - 1):
        fresh = compute_stream(geometry, config, i)[0]
        off = (density[i] - fresh) / smooth
        # Rounding, and the engine's own accuracy, which differs between processors.
        assert np.sqrt(np.mean(off**2)) < 5e-3


def test_every_file_is_found_and_other_priors_have_none():
    asked = {path_of(configs(PRIORS[p], named_stream(s).arm(), 1, TRAINING_SEED)[0]) for s, p in SETS}
    assert asked == set(FOLDER.glob("*"))
    model = named_stream("gd1-like").arm()
    assert are_shipped(PRIORS["rate"], model)
    for other in (Prior(log10_rate=(-1, 0.5)), Prior(ages_gyr=(5.0, 9.0))):
        assert not are_shipped(other, model) and load_shipped(other, model) is None
    assert load_shipped(PRIORS["rate"], model, 10**6) is None, "more than there are"


@pytest.mark.parametrize("stream, prior", SETS)
def test_no_mock_is_a_stream_that_estimators_for_other_bins_learn_from(stream, prior):
    learnt_from = load_shipped(PRIORS[prior], named_stream(stream).arm()).parameters()
    mocks = load_streams(stream, prior).truth
    assert not np.isin(mocks.log10_rate.round(9), learnt_from.log10_rate.round(9)).any()


def test_streams_come_back_as_they_were_written(tmp_path):
    ((config, _, streams),) = load_shipped(PRIORS["rate"], named_stream("gd1").arm(), 30).members
    rng = np.random.default_rng(0)
    density = streams.density * np.exp(rng.normal(0, 3, streams.density.shape))  # up to far from smooth
    density[:5] = 0
    path = save_streams(config, streams.assign(density=density), tmp_path)
    again = load_shipped(PRIORS["rate"], config.stream, folder=tmp_path).members[0].streams.density
    allowed = 0.51 * STEP * np.hypot(density, SOFT * streams.smooth)
    assert (np.abs(again - density) <= allowed).all() and (again[:5] == 0).all()
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(EstimatorFileError, match="not a whole file of streams"):
        load_shipped(PRIORS["rate"], config.stream, folder=tmp_path)
    np.savez(path, differences=np.zeros((3, 7), np.int16))
    with pytest.raises(EstimatorFileError, match="angles"):
        load_shipped(PRIORS["rate"], config.stream, folder=tmp_path)


def test_an_estimator_for_other_bins_needs_no_simulation(tmp_path):
    """Nothing is written to the cache, and a stretch that some streams are empty in is learnt from too."""
    from streamdash.inference import load_estimator

    design = load_estimator("gd1-like").design.part(slice(0, 40))
    own = Cache((Cache.default().roots[0],), None)  # that can only be read
    steps: set[str] = set()
    estimator, streams = learnt(
        PRIORS["rate"],
        named_stream("gd1-like").arm(),
        design,
        own,
        600,
        progress=lambda what, *_: steps.add(what),
        kept_in=tmp_path,
    )
    assert steps == {"Learning from streams so observed"}
    p = estimator.posterior(streams.observed(estimator))
    assert p.shape == (60, 40) and np.isfinite(p).all()
