"""Classes whose abundance is free: which streams stand for them, what they teach, and what is said of it."""

from __future__ import annotations

import pytest

from app.session.catalog import read_catalog
from streamdash.classifier.abundance import free_ensembles, free_prior, learn_free
from streamdash.classifier.train import train
from streamdash.config import EnsembleConfig, Perturbers, Population
from streamdash.observe.report import abundance_words, answer, verdict_of, warnings
from streamdash.plots.report_html import result_tables
from streamdash.prior import Prior
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams
from tests.shipped import of_default_stream

LABELS = ("1e3-1e5", "1e5-1e9")


@pytest.fixture(scope="module")
def cache(shipped_cache) -> Cache:
    return Cache.default(shipped_cache)


@pytest.fixture(scope="module")
def classes(cache):
    found = {e.config.population.label: e.config for e in cache.entries() if of_default_stream(e)}
    return [found[label] for label in LABELS]


def of(**values) -> EnsembleConfig:
    return EnsembleConfig(population=Population(components=(Perturbers(mass_range="1e5-1e9", **values),)))


def test_a_range_stands_for_itself_at_any_rate_and_nothing_else_does():
    prior = free_prior(of())
    assert prior is not None and prior.names == ("log10_rate",) and prior.mass_range == (1e5, 1e9)
    assert free_prior(of(rate_factor=10.0)) == prior
    assert free_prior(of(X=3.0)).X == 3.0
    for other in ({"slope": -1.9}, {"half_mode_mass": 1e8}, {"profile": "plummer"}, {"rs_factor": 2.0}):
        assert free_prior(of(**other)) is None, other
    both = Population(components=(Perturbers(mass_range="1e3-1e5"), Perturbers(mass_range="1e5-1e9")))
    assert free_prior(EnsembleConfig(population=both)) is None
    assert free_prior(EnsembleConfig(prior=Prior())) is None


def test_streams_of_free_abundance_are_shipped_and_are_no_class_to_choose(cache, classes):
    found = free_ensembles(cache, classes)
    assert [c.prior.mass_range for c in found] == [(1e3, 1e5), (1e5, 1e9)]
    assert all(c.stream == classes[0].stream and c.n_streams == 1000 for c in found)
    assert free_ensembles(cache, [classes[0], of(X=3.0)]) == ()
    assert free_ensembles(cache, [of(), of(rate_factor=2.0)]) == ()  # where the rate is free they are one
    offered = [choice for stream in read_catalog(cache.entries()).streams for choice in stream.ensembles]
    assert len(offered) > 2 and all(choice.config.prior is None for choice in offered)


@pytest.mark.slow
def test_who_learnt_one_abundance_is_sure_and_wrong_at_others(cache, classes):
    fixed = train(ObservedStreams.read(cache, classes), 0.1)
    free = learn_free(cache, classes, fixed, noise=0.1)
    assert free is not None
    n = len(free.judged.y)
    error = (free.accuracy[0] * (1 - free.accuracy[0]) / n) ** 0.5
    assert fixed.scores.values["overall_accuracy"] > 0.98
    assert free.fixed_accuracy + 4 * error < free.accuracy[0]
    assert free.fixed_confidence - free.fixed_accuracy > 0.05
    said = free.judged.probability.max(axis=1).mean()
    assert abs(said - free.accuracy[0]) < 4 * error
    assert f"{free.fixed_accuracy:.0%}" in free.sentence
    assert learn_free(cache, [classes[0], of(X=3.0)], fixed) is None


def result_of(fixed: float, free: float | None) -> dict:
    """What a report is written from: a profile that the two ways call of the second class."""
    classes = [
        {"mass_range": "1e3-1e5", "probability": 1 - fixed, "low": 0.01, "high": 0.1, "ln_bayes": -4.0},
        {"mass_range": "1e5-1e9", "probability": fixed, "low": 0.9, "high": 0.99, "ln_bayes": 0.0},
    ]
    for c in classes:
        c["ln_bayes_error"] = 0.5
    abundance = {"words": "unknown", "probability": [0, 0], "accuracy": 0.97, "fixed_accuracy": 0.81}
    if free is not None:
        abundance["probability"] = [1 - free, free]
    alike = {"verdict": "alike", "p": 0.4, "p_distance": 0.3, "p_pattern": 0.4, "p_structure": 0.5}
    quality = {
        "accuracy": 0.98,
        "accuracy_error": 0.01,
        "accuracy_low": 0.97,
        "accuracy_high": 0.99,
        "confusion": [[90, 10], [5, 95]],
        "calibration_error": 0.01,
        "pdf_accuracy": 0.8,
        "n_held_out": 200,
        "n_streams": [1000, 1000],
    }
    return {
        "classes": classes,
        "abundance": None if free is None else abundance,
        "resemblance": {**alike, "n_held_out": 200},
        "quality": quality,
        "detected": True,
        "resembles": True,
        "hangs_on": {"kind": "", "p": 1.0},
    }


@pytest.mark.parametrize(
    ("free", "verdict", "words"),
    [
        (0.88, "decided", "probability 88 % with an abundance unknown, 95 % (68 % interval 90 to 99 %)"),
        (0.6, "undecided", "only if the abundance is the simulated one: probability 95 % then, and 60 %"),
        (0.1, "undecided", "and 10 % with an abundance unknown"),
        (None, "decided", "probability 95 % (68 % interval"),
    ],
)
def test_what_may_be_quoted_holds_for_any_abundance(free, verdict, words):
    result = result_of(0.95, free)
    result["verdict"] = verdict_of(result)
    assert result["verdict"] == verdict
    assert words in answer(result)
    # Undecided is an answer; that another class would be decided for is a warning.
    assert any("abundance decides" in w for w in warnings(result)) == (free == 0.1)
    said = abundance_words(result)
    assert ("other abundances" in said) == (free is None)
    assert said in result_tables(result).replace("&#39;", "'")
