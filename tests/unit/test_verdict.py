"""The verdict on measured profiles: streams of known truth, saved as tables, and profiles of nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from streamdash.classifier.data import Cancelled, ClassifierError, split
from streamdash.config import Perturbers, StreamModel
from streamdash.observe.guess import changed, guess
from streamdash.observe.observation import Observation, interpret, read_observation
from streamdash.observe.provenance import Source, signed
from streamdash.observe.report import answer, report, text
from streamdash.observe.resemblance import UNLIKE, Cloud, learn_likeness
from streamdash.observe.table import read_table
from streamdash.observe.verdict import _band, judge, learn, prepare
from streamdash.plots.report_html import report_html
from streamdash.store.cache import Cache
from streamdash.survey.design import (
    AS_IS,
    Design,
    divided,
    divisible,
    measured,
    observe_as,
    polynomial_fit,
)
from streamdash.survey.mock import mock_bins, mock_observation
from streamdash.survey.observed import ObservedStreams
from streamdash.survey.sky import observe, q_rho, to_theta
from tests.shipped import of_default_stream

LABELS = ("1e3-1e5", "1e5-1e9")
N_KNOWN = 800
"""Streams per class that the tests learn from; the others are the unseen truth."""
ORDER = 3
IMAGE = "<img/src=x>"


@pytest.fixture(scope="module")
def cache(shipped_cache) -> Cache:
    return Cache.default(shipped_cache)


@pytest.fixture(scope="module")
def configs(cache):
    found = {e.config.population.label: e.config for e in cache.entries() if of_default_stream(e)}
    return [found[label] for label in LABELS]


@pytest.fixture(scope="module")
def bins():
    """2° bins of φ1 with a gap of two bins, and an error for each."""
    low = np.delete(np.arange(-98.0, -28.0, 2.0), (11, 12))
    return low, low + 2.0, np.round(0.05 + 0.02 * np.cos(low / 5), 4)


def as_file(bins, values: np.ndarray, name: str) -> bytes:
    low, high, sigma = bins
    rows = zip(0.5 * (low + high), values, sigma, strict=True)
    return (f"phi1,{name},error\n" + "".join(f"{x:g},{v:.7g},{s:g}\n" for x, v, s in rows)).encode()


@pytest.fixture(scope="module")
def world(cache, configs, geometry, bins):
    """What is learnt from some streams observed in `bins`, divided by a cubic; and the unseen ones."""
    _, example = read_observation(as_file(bins, np.ones(len(bins[0])), "detrended"), geometry)
    assert (example.design.order, example.design.quantity) == (ORDER, "density")
    streams = ObservedStreams.read(cache, configs, example.design)
    known = replace(
        streams, q=tuple(q[:N_KNOWN] for q in streams.q), draws=tuple(d[:N_KNOWN] for d in streams.draws)
    )
    unseen = tuple(q[N_KNOWN:] for q in streams.q)
    return learn(known), unseen


def upload(world, bins, geometry, truth: int, number: int) -> Observation:
    """An unseen stream of a class: observed with noise, divided, written to a table and read again."""
    prepared, unseen = world
    rng = np.random.default_rng([truth, number])
    clean = unseen[truth][number][None]
    draws = rng.standard_normal(clean.shape, dtype=np.float32)
    values = measured(clean, draws, prepared.design.sigma, prepared.design.fit)[0]
    return read_observation(as_file(bins, values, "detrended"), geometry)[1]


# ------------------------------------------------------------------ observing alike


def test_streams_are_observed_in_the_profiles_own_bins(cache, configs, geometry, bins):
    low, high, sigma = bins
    dataset = cache.open_ensemble(configs[1]).isel(stream=slice(3))
    seen = observe_as(geometry, dataset, Design("phi1", low, high, sigma, "q_rho", AS_IS))
    for b in (0, 10, 11, len(low) - 1):
        np.testing.assert_allclose(
            seen[:, b], q_rho(geometry, dataset, [low[b], high[b]], "phi1")[:, 0], rtol=1e-5
        )


def test_a_density_counts_the_stars_between_the_ends(cache, configs, geometry, bins):
    low, high, sigma = bins
    dataset = cache.open_ensemble(configs[1]).isel(stream=slice(3))
    seen = observe_as(geometry, dataset, Design("phi1", low, high, sigma, "density", ORDER))
    theta = dataset.theta.values
    for b in (0, 20):
        ends = np.sort(to_theta(geometry, [low[b], high[b]], "phi1"))
        mean = observe(geometry, theta, dataset.density.values, ends, "theta")[:, 0]
        np.testing.assert_allclose(seen[:, b], mean * np.diff(ends) / 2.0, rtol=1e-4)


def test_the_polynomial_is_numpys():
    x = np.linspace(-90, -30, 20)
    y = np.random.default_rng(0).normal(1, 0.1, 20)
    np.testing.assert_allclose(polynomial_fit(x, 3) @ y, np.polyval(np.polyfit(x, y, 3), x), rtol=1e-8)
    np.testing.assert_allclose(divided(y, polynomial_fit(x, 0)), y / y.mean())


def test_noise_has_the_stated_size_after_the_division():
    rng = np.random.default_rng(1)
    sigma = np.linspace(0.02, 0.1, 30)
    fit = polynomial_fit(np.arange(30.0), 1)
    profile = np.repeat(np.linspace(30, 90, 30)[None], 4000, axis=0)
    noisy = measured(profile, rng.standard_normal(profile.shape), sigma, fit)
    # The fitted line takes two degrees of freedom, at the ends most.
    np.testing.assert_allclose(noisy.std(axis=0)[5:-5], sigma[5:-5], rtol=0.12)


# ------------------------------------------------------------------ the proof


@pytest.mark.slow
def test_the_right_class_wins_as_often_as_the_held_out_matrix_says(world, bins, geometry):
    prepared, _ = world
    each = 60
    verdicts = [judge(prepared, upload(world, bins, geometry, c, n)) for c in (0, 1) for n in range(each)]
    truth = np.repeat([0, 1], each)
    right = np.array([v.best for v in verdicts]) == truth
    claimed = np.array([v.probability.max() for v in verdicts])
    promised, n_held = verdicts[0].accuracy[0], len(prepared.judged.y)

    def error(share: float, n: int) -> float:
        return float(np.sqrt(max(share * (1 - share), 0.25 / n) / n))

    print(f"right {right.mean():.3f}, held-out {promised:.3f}, claimed {claimed.mean():.3f}")
    assert abs(right.mean() - promised) < 3.5 * np.hypot(error(promised, len(truth)), error(promised, n_held))
    # Among answers given with probability p, a fraction p is right: for the sure and for the unsure.
    for group in (claimed >= 0.95, claimed < 0.95):
        n = max(int(group.sum()), 1)
        expected = claimed[group].mean() if group.any() else 1.0
        print(f"claimed {expected:.3f}, right {right[group].mean() if group.any() else 1:.3f} of {n}")
        assert not group.any() or abs(right[group].mean() - expected) < 3.5 * error(expected, n) + 0.02
    strange = np.mean([v.resemblance.unlike for v in verdicts])
    print(f"unlike any class: {strange:.3f}")
    assert strange <= UNLIKE + 3.5 * error(UNLIKE, len(truth))
    inside = [v.low[v.best] <= v.probability[v.best] <= v.high[v.best] for v in verdicts]
    assert all(inside)


def test_profiles_of_nothing_are_unlike_any_class(cache, configs, geometry, bins):
    low, high, sigma = bins[0], bins[1], 0.6 * bins[2]  # the paper's noise, averaged over 2°
    design = Design("phi1", low, high, sigma, "q_rho", 0)
    streams = ObservedStreams.read(cache, configs, design)
    unseen = streams.q[1][-40:]
    known = replace(streams, q=tuple(q[:-40] for q in streams.q), draws=tuple(d[:-40] for d in streams.draws))
    sets = split(known.y, 0)
    learnt = np.concatenate([sets.train, sets.validation])
    cloud = Cloud.of(known.observed(sigma)[learnt], known.y[learnt], sigma)
    likeness = learn_likeness(known, sigma, known.smooth, learnt, sets.test, cloud)
    rng = np.random.default_rng(0)
    flat = np.ones(unseen.shape, np.float32)
    phase = rng.uniform(0, 2 * np.pi, (len(flat), 1))
    profiles = {
        "smooth": flat,
        "noise": flat + 0.3 * rng.standard_normal(flat.shape),
        "sine": flat + 0.3 * np.sin(2 * np.pi * design.centers / 10 + phase),
        "reversed": unseen[:, ::-1],
    }
    for name, clean in profiles.items():
        draws = rng.standard_normal(clean.shape)
        p = np.array([r.p for r in likeness(measured(clean, draws, sigma, design.fit).astype(np.float32))])
        print(f"{name}: median p {np.median(p):.4f}, share flagged {np.mean(p < UNLIKE):.2f}")
        assert np.mean(p < UNLIKE) >= 0.8, name
    noiseless = likeness(divided(flat[:1], design.fit))[0]
    assert noiseless.unlike
    true = np.array(
        [r.p for r in likeness(measured(unseen, rng.standard_normal(unseen.shape), sigma, design.fit))]
    )
    assert np.mean(true < UNLIKE) <= 0.1
    assert 0.2 < np.median(true)


def test_what_is_unlike_comes_first_and_probabilities_step_back(world, bins, geometry):
    prepared, _ = world
    strange = 1 + 0.4 * np.where(np.arange(len(bins[0])) % 2, 1, -1)
    _, observation = read_observation(as_file(bins, strange, "detrended"), geometry)
    result = report(judge(prepared, observation), observation, prepared)
    assert result["resemblance"]["verdict"] == "unlike"
    assert result["answer"].startswith("Unlike anything simulated. This profile resembles none of")
    assert (result["verdict"], result["resembles"]) == ("unlike anything simulated", False)
    assert "do not use the probabilities" in result["warnings"][0]
    assert "should not be used" in result["answer"]
    assert not any(f"{100 * c['probability']:.0f} %" in result["answer"] for c in result["classes"])
    page = report_html(result, observation, prepared.bands())
    assert page.index("resembles none") < page.index("<table")
    assert 'class="aside"' in page


# ------------------------------------------------------------------ the answer


def test_the_report_has_one_story_in_every_form(world, bins, geometry):
    prepared, _ = world
    observation = upload(world, bins, geometry, 1, 7)
    verdict = judge(prepared, observation)
    result = report(verdict, observation, prepared)
    assert result["answer"] == answer(result)
    assert result["answer"] in text(result)
    assert result["agreement"] in text(result)
    np.testing.assert_allclose(sum(c["probability"] for c in result["classes"]), 1, rtol=1e-5)
    for c in result["classes"]:
        assert c["low"] <= c["probability"] <= c["high"]
    test = split(prepared.streams.y, 0).test  # without those that would be refused when measured
    scored = divisible(np.concatenate(prepared.streams.densities())[test], prepared.design.fit).sum()
    assert np.sum(result["quality"]["confusion"]) == result["quality"]["n_held_out"] == scored < 400
    assert any("molecular" in words for words in result["caveats"])
    page = report_html(result, observation, prepared.bands())
    assert "<script" not in page
    assert "<svg" in page


def test_names_of_strangers_stay_text_in_the_report(world, bins, geometry):
    prepared, _ = world
    low, high, sigma = bins
    rows = zip(0.5 * (low + high), np.ones(len(low)), sigma, strict=True)
    data = (f"phi1,{IMAGE},error\n" + "".join(f"{x:g},{v:g},{s:g}\n" for x, v, s in rows)).encode()
    table = read_table(data)
    observation = interpret(table, changed(guess(table), {"kind": "detrended"}), geometry)
    result = signed(
        report(judge(prepared, observation), observation, prepared), Source.of(data, f"{IMAGE}.csv")
    )
    for entry in (*result["classes"], *result["provenance"]["classes"]):
        entry.update(dict.fromkeys(("label", "title", "name"), IMAGE))
    result["warnings"] = [*result["warnings"], IMAGE]
    page = report_html(result, observation, prepared.bands())
    assert "<img" not in page
    assert page.count("&lt;img/src=x&gt;") > 5


def test_the_same_question_has_the_same_answer(world, bins, geometry):
    prepared, _ = world
    observation = upload(world, bins, geometry, 0, 3)
    one, two = judge(prepared, observation), judge(prepared, observation)
    np.testing.assert_array_equal(one.low, two.low)
    assert one.resemblance == two.resemblance


def test_another_design_is_refused(world, bins, geometry):
    low, high, sigma = bins
    other = read_observation(as_file((low, high, 2 * sigma), np.ones(len(low)), "detrended"), geometry)[1]
    with pytest.raises(ClassifierError, match="other bins or errors"):
        judge(world[0], other)


def test_learning_stops_when_asked(cache, configs, geometry, world):
    seen = []

    def stop() -> bool:
        return len(seen) > 3

    with pytest.raises(Cancelled):
        prepare(cache, configs, world[0].design, lambda done, total: seen.append((done, total)), stop)
    assert all(0 <= done <= total for done, total in seen)


def test_classes_of_different_streams_are_refused(cache, configs, world):
    strange = configs[1].model_copy(update={"stream": StreamModel(age_gyr=5.0)})
    with pytest.raises(ValueError, match="same stream"):
        prepare(cache, [configs[0], strange], world[0].design)


# ------------------------------------------------------------------ parts


@pytest.fixture(scope="module", params=[2, 3], ids=["two classes", "three classes"])
def survey(request, cache, geometry):
    """Models for 36 bins of 2° with errors of 12 %, divided by a cubic, and streams they never saw."""
    labels = {2: LABELS, 3: ("1e3-1e5", "1e5-1e7", "1e7-1e9")}[request.param]
    found = {e.config.population.label: e.config for e in cache.entries() if of_default_stream(e)}
    low, high = mock_bins(geometry, "phi1", 2.0)
    design = Design("phi1", low, high, np.full(len(low), 0.12), "density", ORDER)
    streams = ObservedStreams.read(cache, [found[label] for label in labels], design)
    n_known = 1400
    known = replace(
        streams, q=tuple(q[:n_known] for q in streams.q), draws=tuple(d[:n_known] for d in streams.draws)
    )
    return learn(known), [q[n_known:] for q in streams.q]


@pytest.mark.slow
def test_streams_observed_again_are_answered_within_the_interval_as_often_as_it_says(survey):
    """68 % of the answers to the same streams, truly observed again: nothing that is learnt is asked."""
    prepared, unseen = survey
    rng = np.random.default_rng(11)

    def observed_again() -> np.ndarray:
        clean = np.concatenate(unseen)
        draws = rng.standard_normal(clean.shape, dtype=np.float32)
        q = measured(clean, draws, prepared.design.sigma, prepared.design.fit)
        return prepared.answers(q).mean(axis=0)

    first, again = observed_again(), np.stack([observed_again() for _ in range(4)])
    inside = []
    for answer_, others in zip(first, again.swapaxes(0, 1), strict=True):
        low, high = _band(prepared.replicas(answer_), answer_)
        assert (low <= answer_).all() and (answer_ <= high).all()
        best = answer_.argmax()
        inside.append((others[:, best] >= low[best]) & (others[:, best] <= high[best]))
    share = float(np.mean(inside))
    print(f"{len(unseen)} classes: {100 * share:.1f} % of the answers to streams observed again are inside")
    assert 0.60 <= share <= 0.76


def test_mock_streams_are_their_own(geometry):
    low, high = mock_bins(geometry, "phi1", 2.0, gaps=(-60.5,))
    assert not np.any((low < -60.5) & (high > -60.5))
    perturbers = Perturbers(mass_range="1e7-1e9")
    one, two = (mock_observation(geometry, perturbers, n, low, high) for n in (1, 2))
    again = mock_observation(geometry, perturbers, 1, low, high)
    assert one.text() == again.text() != two.text()
    _, observation = read_observation(one.text().encode(), geometry)
    assert observation.assumptions.kind == "density"
    assert observation.design.n_bin == len(low)


def test_streams_with_a_polynomial_are_other_streams(world):
    streams = world[0].streams
    bare = replace(streams, design=replace(streams.design, order=AS_IS))
    assert bare.digest != streams.digest
