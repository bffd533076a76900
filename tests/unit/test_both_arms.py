"""Both arms of a stream together: one population, each arm its own impacts, bins side by side."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from app.session.catalog import SHOWN, read_catalog
from streamdash.classifier.model import BEST
from streamdash.classifier.train import train
from streamdash.config import EnsembleConfig, Perturbers
from streamdash.paper.statistics import POWER, information, statistics_evidence
from streamdash.plots.profiles import names, profiles_figure
from streamdash.simulation.geometry import compute_geometry
from streamdash.simulation.preview import COARSE_TIMES, coarse_config, coarse_preview, coarse_text
from streamdash.statistics.features import FeatureMap, FeatureSet, summarise
from streamdash.store.cache import Cache
from streamdash.streams import named_stream
from streamdash.survey.bands import compute, read_profiles
from streamdash.survey.design import divided
from streamdash.survey.observed import ObservedStreams, arm_keys
from tests.unit.commands import refused, run

MASSES = ("1e3-1e5", "1e5-1e9")
GD1 = named_stream("gd1")
QUICK = BEST.model_copy(
    update={
        "copies": 1,
        "boosting": BEST.boosting.model_copy(update={"n_estimators": 30, "early_stopping_rounds": None}),
    }
)


def ensemble(arm: str, mass: str) -> EnsembleConfig:
    return EnsembleConfig(stream=GD1.arms[arm], perturbers=Perturbers(mass_range=mass), n_streams=1000)


@pytest.fixture(scope="module")
def cache(shipped_cache):
    return Cache.default(shipped_cache)


@pytest.fixture(scope="module")
def pairs():
    return ["+".join(ensemble(arm, mass).key for arm in GD1.arms) for mass in MASSES]


@pytest.fixture(scope="module")
def arms(cache):
    return [ObservedStreams.read(cache, [ensemble(arm, mass) for mass in MASSES]) for arm in GD1.arms]


@pytest.fixture(scope="module")
def both(cache, pairs):
    return ObservedStreams.read(cache, pairs)


def test_a_stream_of_both_arms_is_one_of_each_side_by_side(both, arms):
    assert both.design.arms == tuple(arm.design.n_bin for arm in arms)
    for c in range(len(MASSES)):
        for stretch, arm in zip(both.design.stretches, arms, strict=True):
            np.testing.assert_array_equal(both.q[c][:, stretch], arm.q[c])
            np.testing.assert_array_equal(both.noisy(0.1)[c][:, stretch], arm.noisy(0.1)[c])
        np.testing.assert_array_equal(both.n_impacts[c], sum(arm.n_impacts[c] for arm in arms))
    assert not np.array_equal(*(arm.n_impacts[0] for arm in arms))  # each has impacts of its own


def test_arms_of_different_populations_are_no_stream(cache, arms):
    other = ObservedStreams.read(cache, [ensemble("trailing", mass) for mass in MASSES[:1]])
    with pytest.raises(ValueError, match="one population"):
        ObservedStreams.beside([arms[0], other])
    assert ObservedStreams.beside(arms[:1]) is arms[0]
    assert arm_keys("a+b") == ["a", "b"] and arm_keys("a") == ["a"]


def test_each_arm_is_divided_by_a_polynomial_of_its_own(both):
    design = replace(both.design, order=3)
    q = both.noisy(0.1)[1][:20]
    whole = divided(q, design.fit)
    for stretch in design.stretches:
        one = replace(
            design, low=design.low[stretch], high=design.high[stretch], sigma=design.sigma[stretch], arms=()
        )
        np.testing.assert_allclose(whole[:, stretch], divided(q[:, stretch], one.fit), rtol=1e-4)
    assert design.key != replace(design, arms=()).key
    assert both.design.key == both.design.with_noise(both.design.sigma).key


def test_features_do_not_reach_across_the_progenitor(both):
    sizes = both.design.arms
    q = both.noisy(0.1)[1][:30]
    features = FeatureSet(n_pca=2, arms=sizes)
    apart = np.concatenate([summarise(q[:, s], FeatureSet()) for s in both.design.stretches], axis=1)
    np.testing.assert_array_equal(summarise(q, features), apart)
    fitted = FeatureMap.fit(q, features)
    assert len(fitted.names) == fitted(q).shape[1] == len(set(fitted.names))
    assert FeatureSet(n_pca=2).key == FeatureSet.parse(FeatureSet(n_pca=2).model_dump()).key
    assert "arms" not in FeatureSet().model_dump()
    with pytest.raises(ValueError, match="bins of all arms"):
        summarise(q[:, :-1], features)


def test_classifier_and_evidence_use_both_arms(both, arms):
    """Two arms are twice the data: they tell more than either, by far more than the errors."""
    bits = {}
    for name, streams in (("both", both), ("leading", arms[0]), ("trailing", arms[1])):
        judged = train(streams, 0.1, QUICK)
        bits[name], error = information(judged)
        assert error < 0.1
    assert judged.classifier.card.settings.features.arms == ()
    assert bits["both"] > max(bits["leading"], bits["trailing"])
    evidence = statistics_evidence(both, 0.1)[POWER]
    assert all(np.isfinite(found.value) for found in evidence.values())


def test_profiles_of_both_arms_are_panels_side_by_side(cache, pairs):
    profiles = read_profiles(cache, pairs, "q_rho")
    assert [binned.config.stream.arm for binned in profiles] == [*GD1.arms] * 2
    panels = [compute(binned, i // 2, "phi1", 0.1, 0, 0) for i, binned in enumerate(profiles)]
    assert names(panels)[1].endswith("trailing arm") and names(panels)[1].startswith("M0")
    assert len(profiles_figure(cache, pairs, coordinate="phi1")) == 4


def test_the_catalog_offers_each_arm_and_both(cache):
    catalog = read_catalog(cache.entries(SHOWN))
    labels = [stream.label for stream in catalog.streams]
    for title in ("GD-1", "Palomar 5"):
        assert {f"{title}, leading arm", f"{title}, trailing arm", f"{title}, both arms"} <= set(labels)
    for stream in catalog.streams:
        for choice in stream.ensembles:
            assert choice.key == "+".join(arm.key for arm in choice.arms) if stream.arms else not choice.arms
            assert len({arm.config.population for arm in choice.arms}) <= 1
    assert labels[0] == "GD-1-like"
    pal5 = next(stream for stream in catalog.streams if stream.label == "Palomar 5, both arms")
    assert [arm.model.arm for arm in pal5.arms] == ["trailing", "leading"]


# --- coarse previews --------------------------------------------------------------------------


@pytest.mark.slow
def test_a_coarse_preview_is_near_the_true_stream_and_says_what_it_is(cache):
    """Frequencies and track to a permille; the number of impacts as exact, as it hangs on them."""
    config = EnsembleConfig(perturbers=Perturbers(mass_range="1e7-1e9"))
    coarse = coarse_config(config)
    assert len(coarse.stream.impact_times_gyr) == COARSE_TIMES == 8
    geometry = compute_geometry(coarse.stream, executor="inline", coarse=True)
    exact = compute_geometry(coarse.stream, executor="inline")
    assert geometry.mean_omega == pytest.approx(exact.mean_omega, rel=2e-3)
    assert geometry.length == pytest.approx(exact.length, rel=2e-3)
    assert np.interp(0.5, geometry.track_theta, geometry.track_ell) == pytest.approx(
        np.interp(0.5, exact.track_theta, exact.track_ell), abs=0.2
    )
    scale = np.nanmax(np.abs(exact.node_jac))
    np.testing.assert_allclose(geometry.node_jac, exact.node_jac, rtol=0, atol=0.01 * scale)
    seen: list[int] = []
    found = coarse_preview(config, 3, workers=1, progress=lambda done, total: seen.append(done))
    assert found.streams is not None and found.streams.sizes["stream"] >= 1
    assert seen[-1] == COARSE_TIMES
    assert "8 instead of 64 times" in coarse_text(config)
    assert "1 instead of 1" in coarse_text(
        EnsembleConfig(stream=coarse.stream.model_copy(update={"n_times": 1}))
    )


# --- the command line -------------------------------------------------------------------------


def test_commands_compute_both_arms(shipped_cache, tmp_path):
    few = ["--stream", "gd1", "--arm", "both", "--mass", "1e8-1e9", "--streams", "2", "--json"]
    cache = tmp_path / "cache"
    cache.mkdir()
    for arm in GD1.arms.values():
        entry = next(e for e in Cache.default(shipped_cache).entries() if e.key == arm.key)
        (cache / "geometries").mkdir(exist_ok=True)
        (cache / "geometries" / entry.path.name).symlink_to(entry.path)
    found = json.loads(run("simulate", *few, "--executor", "inline", "--cache", cache).stdout)
    assert [one["state"] for one in found] == ["complete"] * 2
    configs = [Cache.default(cache).find(one["key"]).config for one in found]
    assert [config.stream for config in configs] == list(GD1.arms.values())
    assert configs[0].population == configs[1].population


@pytest.mark.parametrize("command", ["simulate", "geometry"])
def test_an_arm_that_is_not_there_is_refused(command):
    mass = ["--mass", "1e3-1e5"] if command == "simulate" else []
    sentence = refused(command, *mass, "--stream", "gd1-like", "--arm", "both")
    assert "gd1-like has a leading arm only" in sentence
    assert "gd1-like has a leading arm" in refused(
        command, *mass, "--stream", "gd1-like", "--arm", "trailing"
    )


def test_forty_components_and_none_are_refused_in_one_sentence():
    many = [word for _ in range(40) for word in ("--component", "1e3-1e5")]
    assert refused("simulate", *many).endswith("a population has at most 8 components, this one 40.")
    assert "mass range '' is not of the form" in refused("simulate", "--component", "")


def test_components_that_overlap_are_allowed_and_said(tmp_path):
    both = ["--component", "1e7-1e9", "--component", "1e8-1e9"]
    result = run("simulate", *both, "--streams", "1", "--dry-run", "--json")
    assert "1e7-1e9 and 1e8-1e9 overlap in mass" in result.stderr
    assert len(json.loads(result.stdout)["components"]) == 2


@pytest.mark.parametrize(
    ("progenitor", "words"),
    [
        (["1.5,10,1,0.1,0.1,0"], "progenitor: it is not bound"),
        (["1,0.1,0.02,0.1,0,0"], "progenitor: it plunges"),
        (
            ["12,0.1,1,0.1,0.1,0", "--age", "0.5"],
            "age_gyr: in 0.5 Gyr the progenitor does not even oscillate once",
        ),
    ],
)
@pytest.mark.parametrize("how", ["--dry-run", "--preview"])
def test_a_progenitor_that_leaves_no_stream_is_refused_in_one_sentence(progenitor, words, how):
    """Whatever else the command has said of its progress, this is the last line."""
    result = run("simulate", "--mass", "1e7-1e9", "--progenitor", *progenitor, how, exit_code=2)
    assert result.stdout == ""
    assert result.stderr.strip().splitlines()[-1].startswith(f"Error: {words}")
