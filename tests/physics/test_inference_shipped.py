"""The shipped estimators: calibrated, informative, quick to load, and honest about what they cannot know."""

from __future__ import annotations

import io

import numpy as np
import pytest

from streamdash import paths
from streamdash.config import ConfigError
from streamdash.inference import load_estimator
from streamdash.inference.diagnostics import joint_bits, marginals, ranks, scores
from streamdash.inference.estimator import STRANGE
from streamdash.inference.files import SHIPPED, EstimatorFileError
from streamdash.inference.held_out import load_streams
from streamdash.inference.nonsense import scrambled
from streamdash.inference.predictive import predictive_bands
from streamdash.inference.prior_ensemble import PriorEnsemble, observed
from streamdash.observe.infer import infer
from streamdash.prior import Prior
from streamdash.store.cache import Cache
from streamdash.survey.design import divided

NAMES = sorted(path.stem.rsplit("-", 1) for path in SHIPPED.glob("*.npz"))


@pytest.fixture(scope="module")
def estimator():
    return load_estimator("gd1-like")


@pytest.fixture(scope="module")
def few(estimator):
    """Streams that it has not seen: parameters and observed profiles."""
    return estimator.simulate(150, seed=71)


def test_what_is_shipped_and_what_is_not():
    assert {stream for stream, prior in NAMES if prior == "rate"} == {"gd1-like", "gd1", "pal5"}
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 8e6
    with pytest.raises(ConfigError, match="prior"):
        load_estimator("gd1-like", "none")
    with pytest.raises(ConfigError, match="stream"):
        load_estimator("milky")


def test_fresh_streams_are_answered_with_calibrated_posteriors(estimator, few):
    truth, q = few
    assert list(truth.columns) == list(estimator.grid) and q.shape == (150, estimator.design.n_bin)
    p = estimator.posterior(q)
    assert np.allclose(p.sum(axis=1), 1)
    found = scores(p, estimator.grid, truth)["log10_rate"]
    # Four standard errors of 150 streams about the bounds that 1,000 are held to (below).
    assert found.information > 1.3 - 4 * found.error
    assert abs(found.coverage[0] - 0.68) < 0.03 + 4 * np.sqrt(0.68 * 0.32 / 150)
    assert abs(found.coverage[1] - 0.95) < 0.015 + 4 * np.sqrt(0.95 * 0.05 / 150)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES, ids="-".join)
def test_coverage_and_information_on_a_thousand(name):
    stream, prior = name
    estimator = load_estimator(stream, prior)
    truth, q = estimator.simulate(1000, seed=72)
    p = estimator.posterior(q)
    for parameter, found in scores(p, estimator.grid, truth).items():
        # The bounds, and two standard errors of a thousand streams.
        assert abs(found.coverage[0] - 0.68) < 0.03 + 2 * np.sqrt(0.68 * 0.32 / 1000), parameter
        assert abs(found.coverage[1] - 0.95) < 0.015 + 2 * np.sqrt(0.95 * 0.05 / 1000), parameter
        rank = ranks(marginals(p, estimator.grid, parameter), estimator.grid[parameter], truth[parameter])
        counts = np.histogram(rank, 10, (0, 1))[0]
        assert ((counts - 100) ** 2 / 100).sum() < 40, parameter
    if name == ["gd1-like", "rate"]:
        assert found.information > 1.3 - 2 * found.error


def test_same_seed_same_streams_other_seed_others(estimator):
    truth, q = estimator.simulate(3, seed=5)
    again, same = estimator.simulate(3, seed=5)
    other, _ = estimator.simulate(3, seed=6)
    assert truth.equals(again) and np.array_equal(q, same)
    assert not np.isclose(truth, other).any()


def test_a_posterior_of_one_stream_in_words(estimator, few):
    post = estimator.posteriors(few[1][:1])[0]
    low, high = post.interval("log10_rate")
    assert low < post.median("log10_rate") < high


def test_nonsense_is_flagged_and_streams_are_not(estimator, few):
    truth, q = few
    rng = np.random.default_rng(0)
    n = estimator.design.n_bin
    assert (estimator.strangeness(q) > STRANGE).mean() <= 0.04
    phase = rng.uniform(0, 2 * np.pi, (100, 1))
    noise = 0.1 * rng.standard_normal((100, n))
    wrong = {
        "noise": 1 + 0.3 * rng.standard_normal((100, n)),
        "sine": 1 + 0.3 * np.sin(2 * np.pi * np.arange(n) / 30 + phase) + noise,
        "steps": 1 + 0.4 * np.sign(np.sin(2 * np.pi * np.arange(n) / 40 + phase)) + noise,
    }
    for what, profiles in wrong.items():
        flagged = estimator.strangeness(divided(profiles.astype(np.float32), estimator.design.fit)) > STRANGE
        assert flagged.mean() > 0.9, what
    hit = truth["log10_rate"].to_numpy() > 0
    for backwards in (q[hit][:, ::-1], scrambled(q[hit], rng)):
        assert (estimator.strangeness(backwards) > STRANGE).mean() > 0.4


@pytest.mark.parametrize("stream", ["gd1-like", "gd1", "pal5"])
def test_nonsense_never_gets_a_narrow_answer(stream):
    """Flagged, or a wide answer; of a smooth stream an upper limit or little more than the prior."""
    one = load_estimator(stream)
    design, rng = one.design, np.random.default_rng(3)
    n, sigma = design.n_bin, design.noise
    phase = rng.uniform(0, 2 * np.pi, (200, 1))
    noise = sigma * rng.standard_normal((200, n))
    x = np.arange(n)
    wrong = {
        "noise": 1 + 5 * sigma * rng.standard_normal((200, n)),
        "short waves": 1 + 0.3 * np.sin(2 * np.pi * x / min(30, n) + phase) + noise,
        "long waves": 1 + 0.3 * np.sin(2 * np.pi * x / min(150, n) + phase) + noise,
    }
    wrong = {what: divided(profiles.astype(np.float32), design.fit) for what, profiles in wrong.items()}
    streams = load_streams(stream)
    hit = streams.truth["log10_rate"].to_numpy() > 0
    wrong["back to front"] = streams.observed(one)[hit][:, ::-1]
    low, high = one.prior.ranges["log10_rate"]
    for what, profiles in wrong.items():
        posts = one.posteriors(profiles)
        limits = [post.interval("log10_rate") for post in posts]
        upper = np.array(["lower" in post.edges_reached("log10_rate") for post in posts])
        narrow = np.array([b - a < 0.2 * (high - low) for a, b in limits]) & ~upper
        assert narrow.mean() <= 0.05, what
    smooth = divided((1 + noise).astype(np.float32), design.fit)
    medians = [post.median("log10_rate") for post in one.posteriors(smooth)]
    assert np.median(medians) < 0.5 * (low + high)
    assert not (one.strangeness(np.ones((1, n), np.float32)) > STRANGE).any()


def test_beyond_the_prior_is_at_its_edge(estimator):
    more = PriorEnsemble.fresh(Prior(log10_rate=(1.5, 1.6)), estimator.stream, 12, seed=1)
    q = observed(more.clean(estimator.design), estimator.design, estimator.prior, np.random.default_rng(0))
    posts, strange = estimator.posteriors(q), estimator.strangeness(q) > STRANGE
    reached = [
        bool(s) or "upper" in post.edges_reached("log10_rate") for post, s in zip(posts, strange, strict=True)
    ]
    assert np.mean(reached) > 0.8
    none = np.ones((20, estimator.design.n_bin), np.float32)
    q = observed(none, estimator.design, estimator.prior, np.random.default_rng(1))
    assert np.mean(["lower" in post.edges_reached("log10_rate") for post in estimator.posteriors(q)]) > 0.8


def test_posterior_predictive_bands_hold_the_stream(estimator, tmp_path):
    fresh = PriorEnsemble.fresh(estimator.prior, estimator.stream, 60, seed=2)
    clean = fresh.clean(estimator.design)
    q = observed(clean, estimator.design, estimator.prior, np.random.default_rng(0))
    bands = predictive_bands(estimator.posteriors(q[:1])[0], fresh, estimator.design, clean)
    assert bands.shape == (5, estimator.design.n_bin) and (np.diff(bands, axis=0) >= 0).all()


def test_joint_information_of_one_parameter_is_its_own(estimator, few):
    p = estimator.posterior(few[1])
    assert joint_bits(p, estimator.grid, few[0]).mean() == pytest.approx(
        scores(p, estimator.grid, few[0])["log10_rate"].information
    )


def profile_of(estimator, q: np.ndarray):
    import pandas as pd

    design = estimator.design
    return pd.DataFrame({"ell": design.centers, "q_rho": q, "error": design.sigma})


@pytest.mark.slow
def test_an_upload_is_answered_whatever_the_order_of_its_rows(estimator, few, tmp_path):
    """An estimator is trained for its own bins, kept, and used again for the same bins."""
    table = profile_of(estimator, few[1][0]).iloc[50:300]
    own = Cache((paths.CACHE, tmp_path / "cache"), tmp_path / "cache")
    options = {"n_streams": 600, "kept_in": tmp_path, "changes": {"order": 3}, "cache": own}
    steps: list[str] = []
    first = infer(table, progress=lambda what, *_: steps.append(what), **options)
    assert len(set(steps)) == 1, "its streams are shipped: nothing is simulated"
    assert len(list(tmp_path.glob("*.npz"))) == 1
    backwards = infer(table.iloc[::-1], **options)
    assert np.allclose(first.posterior.p, backwards.posterior.p, atol=1e-6)
    assert len(list(tmp_path.glob("*.npz"))) == 1
    report = first.report()
    assert sum(report["parameters"]["log10_rate"]["probability"]) == pytest.approx(1, abs=1e-3)
    assert report["answer"] and report["bins"] == 250
    shuffled = infer(table.sample(frac=1, random_state=1), **options)
    assert np.allclose(first.posterior.p, shuffled.posterior.p, atol=1e-6)
    assert len(list(tmp_path.glob("*.npz"))) == 1


def test_wrong_uploads_get_a_sentence(tmp_path):
    with pytest.raises(ValueError, match="cannot be read"):
        infer(tmp_path / "none.csv")
    with pytest.raises(ValueError):
        infer(io.BytesIO(b"").getvalue())
    with pytest.raises(ConfigError, match="prior"):
        infer(b"ell,q_rho\n", prior="none")


def test_damaged_shipped_file_is_named(tmp_path, monkeypatch):
    from streamdash.inference import files

    monkeypatch.setattr(files, "SHIPPED", tmp_path)
    (tmp_path / "gd1-like-rate.npz").write_bytes(b"PK")
    with pytest.raises(EstimatorFileError, match="gd1-like-rate"):
        load_estimator("gd1-like")
