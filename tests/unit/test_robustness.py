"""The table of robustness: what it tries, and that it finds what would change an answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from streamdash.classifier.data import Cancelled
from streamdash.observe.guess import assume
from streamdash.observe.robustness import Variant, other_sets, robustness, robustness_words, variants
from streamdash.observe.table import read_table
from streamdash.observe.wording import would_change
from streamdash.store.cache import Cache
from streamdash.survey.mock import EXAMPLE
from tests.shipped import of_default_stream


@pytest.fixture(scope="module")
def cache(small_cache) -> Cache:
    return Cache.default(small_cache)


@pytest.fixture(scope="module")
def configs(cache):
    known = {e.config.label: e.config for e in cache.entries() if of_default_stream(e)}
    return [known["1e3-1e5"], known["1e5-1e9"]]


@pytest.fixture(scope="module")
def rows(configs, cache, geometry) -> list[Variant]:
    table = read_table(EXAMPLE.read_bytes())
    return variants(table, assume(table), geometry, configs, other_sets(cache, configs))


def test_every_choice_that_might_decide_is_tried(rows, geometry):
    asked = rows[0].observation
    named = [row for row in rows if row.group == "order"]
    assert [row.name[-1] for row in named] == ["0", "1", "2", "4", "5"]
    for row in named:
        assert row.problem or row.observation.design.order == int(row.name[-1])
    assert sum(not row.problem for row in named) >= 3
    for row, factor in zip([row for row in rows if row.group == "errors"], (0.5, 2.0), strict=True):
        np.testing.assert_allclose(row.observation.design.sigma, factor * asked.design.sigma)
        np.testing.assert_array_equal(row.observation.q, asked.q)
    lower, upper = [row.observation.design for row in rows if row.group == "half"]
    assert lower.n_bin + upper.n_bin == asked.design.n_bin
    assert lower.high.max() <= upper.low.min() + 1e-6
    # A half is divided by the polynomial that fits that half, not by the whole profile's.
    half = next(row.observation for row in rows if row.group == "half")
    assert abs(half.q.mean() - 1) < 0.05
    assert all("classes" in row.name for row in rows if row.group == "classes")


def test_sets_of_classes_share_no_mass(cache, configs):
    sets = other_sets(cache, configs)
    for group in sets:
        ranges = [config.population.mass_range for config in group]
        assert len(ranges) >= 2 and ranges != [c.population.mass_range for c in configs]
        assert all(a[1] <= b[0] for a, b in zip(ranges, ranges[1:], strict=False))


def test_what_cannot_be_read_so_is_a_row_that_says_why(configs, geometry):
    table = read_table(EXAMPLE.read_bytes())
    few = replace(table, values=table.values[:12], lines=table.lines[:12])
    made = variants(few, assume(few), geometry, configs)
    problems = [row.problem for row in made if row.observation is None]
    assert any("too closely" in words for words in problems)
    assert any("at least 8 are needed" in words for words in problems)
    assert all(row.problem == "" for row in made if row.observation is not None)


def test_each_row_answers_and_those_that_differ_are_named(cache, rows):
    steps = []
    chosen = [rows[0], *(row for row in rows if row.group in ("errors", "half"))]
    found = robustness(cache, chosen, lambda done, total: steps.append((done, total)))
    assert steps == [(i + 1, len(chosen)) for i in range(len(chosen))]
    for entry in found:
        np.testing.assert_allclose(sum(c["probability"] for c in entry["classes"]), 1, rtol=1e-5)
        assert entry["best"] == max(entry["classes"], key=lambda c: c["probability"])["mass_range"]
    assert found[0]["agrees"]
    assert found[1]["accuracy"] > found[2]["accuracy"]  # smaller errors tell more
    other = {**found[1], "best": "1e3-1e5", "masses": [1e3, 1e5], "agrees": False, "name": "turned"}
    sentence = robustness_words([*found, other])
    assert "would change the answer" in sentence and "turned (10³–10⁵ M☉" in sentence
    assert "With errors half as large" in would_change({"resembles": True, "robustness": found})
    assert "was not tried" in would_change({"resembles": True, "robustness": []})


def test_it_ends_when_it_is_told_to(cache, rows):
    with pytest.raises(Cancelled):
        robustness(cache, rows, should_stop=lambda: True)


def test_halves_of_a_profile_on_another_turn(configs, geometry):
    table = read_table(EXAMPLE.read_bytes())
    turned = replace(table, values=table.values + np.array([360.0, 0, 0]))
    pairs = zip(
        variants(table, assume(table), geometry, configs),
        variants(turned, assume(turned), geometry, configs),
        strict=True,
    )
    for a, b in pairs:
        assert (a.name, a.problem) == (b.name, b.problem)
        if not a.problem:
            np.testing.assert_allclose(a.observation.design.low, b.observation.design.low)
