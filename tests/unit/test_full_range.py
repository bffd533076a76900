"""The full range: what the study says follows from its numbers, and its numbers from the shipped streams."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from streamdash.paper.full_range import (
    ensembles,
    full_range_markdown,
    full_range_results,
    needed,
    sentence,
)
from streamdash.plots.full_range import draw_full_range, full_range_table
from streamdash.plots.live import use
from streamdash.plots.paper import save_full_range
from streamdash.store.cache import Cache, StoreError

REPRODUCED = Path(__file__).resolve().parents[2] / "docs" / "reproduction"


@pytest.fixture(scope="module")
def results():
    return json.loads((REPRODUCED / "full_range.json").read_text(encoding="utf-8"))


def told(*pairs):
    return [{"excess": x, "noise": 0.1, "best": {"bits": bits}} for x, bits in pairs]


def test_the_excess_needed_lies_between_those_measured():
    assert needed(told((1, 0.0), (10, 1.0)), 0.1) == pytest.approx(10**0.5)
    assert needed(told((10, 1.0), (1, 0.25), (3, 0.5)), 0.1) == pytest.approx(3)
    assert needed(told((1, 0.7), (3, 0.9)), 0.1) == 1
    assert needed(told((1, 0.1), (3, 0.4)), 0.1) is None
    assert needed(told((1, 0.9)), 0.05) is None


def test_text_and_tables_are_those_of_the_numbers(results):
    assert (REPRODUCED / "full_range.md").read_text(encoding="utf-8") == full_range_markdown(results)
    assert sentence(results) in full_range_markdown(results)
    for one in results["needed"]:
        found = needed(results["rows"], one["noise"])
        assert one["excess"] == (found if found is None else pytest.approx(found, rel=1e-4))
    table = full_range_table(results)
    assert len(table) == len(results["rows"])
    assert set(table.noise) == {0.1, 0.05, 0.02}


def test_more_clusters_and_less_noise_tell_more(results):
    table = full_range_table(results).pivot(index="noise", columns="excess", values="information_bits")
    error = full_range_table(results).information_error_bits.max()
    assert (table.diff(axis=1).iloc[:, 1:] > -3 * error).all().all()
    assert (table.sort_index(ascending=False).diff().iloc[1:] > -3 * error).all().all()
    assert table.max().max() > 0.6


@pytest.mark.parametrize("backend", ["bokeh", "matplotlib"])
def test_the_figure_is_drawn(results, backend, tmp_path):
    assert use(backend).get_plot(draw_full_range(results, backend)) is not None
    if backend == "matplotlib":
        assert all(path.stat().st_size > 1000 for path in save_full_range(results, tmp_path))


def test_streams_that_are_not_there_are_named_with_the_command(tmp_path):
    with pytest.raises(StoreError, match="streamdash simulate --preset cdm"):
        ensembles(Cache.default(tmp_path))


def test_shipped_streams_are_at_least_a_thousand_a_class(shipped_cache):
    found = ensembles(Cache((shipped_cache,)))
    assert {0.0, 1.0, 3.0, 10.0} <= set(found)
    assert all(config.n_streams >= 1000 for config in found.values())


@pytest.mark.slow
def test_numbers_are_those_of_the_shipped_streams(results, shipped_cache):
    again = full_range_results(Cache((shipped_cache,)), noises=(0.05,))
    before = {row["excess"]: row for row in results["rows"] if row["noise"] == 0.05}
    for row in again["rows"]:
        old = before[row["excess"]]["best"]
        assert row["best"]["accuracy"] == pytest.approx(old["accuracy"], abs=4 * old["accuracy_error"])
        assert row["best"]["bits"] == pytest.approx(old["bits"], abs=4 * old["bits_error"])
