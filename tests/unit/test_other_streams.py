"""Streams that were made otherwise: what the shipped study says follows from its numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from streamdash.classifier.other_streams import (
    GROUPS,
    SETTINGS,
    USUAL,
    caveat,
    group_sentence,
    is_usual,
    moved,
    other_streams_markdown,
    shipped_results,
)
from streamdash.plots.live import use
from streamdash.plots.other_streams import draw_other_streams, other_streams_table

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "reproduction" / "other_streams.md"


@pytest.fixture(scope="module")
def results():
    found = shipped_results()
    assert found is not None
    return found


def test_every_setting_differs_from_the_usual_streams_in_one_thing():
    assert {setting.group for setting in SETTINGS} == {USUAL, *GROUPS}
    configs = [setting.config("1e5-1e9") for setting in SETTINGS]
    assert len({config.key for config in configs}) == len(SETTINGS)
    assert [is_usual(config) for config in configs] == [True] + [False] * (len(SETTINGS) - 1)
    plummer = next(s for s in SETTINGS if s.label == "Plummer spheres").config("1e3-1e5").population
    assert plummer.components[0].X == pytest.approx(5 * 1.05 / 1.62, abs=1e-3)  # as far away in kpc


def test_the_document_is_that_of_the_numbers(results):
    assert DOCUMENT.read_text(encoding="utf-8") == other_streams_markdown(results)


def test_a_change_counts_beyond_its_scatter(results):
    rows = {(row["label"], len(row["classes"])): row for row in results["rows"]}
    assert moved(results, rows[SETTINGS[0].label, 2]) == (False, False)
    assert moved(results, rows["0.1 × the rate", 2]) == (True, True)
    assert moved(results, rows["X = 10", 2]) == (False, False)
    assert "does not change beyond its scatter" in group_sentence(results, "X")
    assert "accuracy changes" in group_sentence(results, "age")


def test_a_verdict_cites_rate_and_age_of_its_own_classes(results):
    words = caveat(results, ["1e3-1e5", "1e5-1e9"])
    assert "0.1 × the rate" in words and "5 Gyr" in words and "X =" not in words
    assert caveat(results, ["1e3-1e5", "1e6-1e9"]) == "" and caveat(None, ["1e3-1e5", "1e5-1e9"]) == ""


@pytest.mark.parametrize("backend", ["bokeh", "matplotlib"])
def test_the_figure_has_the_usual_streams_first(results, backend):
    table = other_streams_table(results, ("rate", "age"))
    assert list(table.group[:2]) == [USUAL, USUAL] and set(table.group) == {USUAL, "rate", "age"}
    assert use(backend).get_plot(draw_other_streams(results, ("rate", "age"), backend)) is not None
