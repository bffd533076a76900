"""What each statistic keeps, on streams of which it is known what tells them apart."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from streamdash.classifier.model import BEST, Boosting
from streamdash.paper.statistics import (
    PDF,
    POWER,
    PROFILE,
    STATISTICS,
    Kept,
    compare_statistics,
    information,
    statistics_evidence,
    statistics_markdown,
    statistics_numbers,
)
from streamdash.plots.statistics import draw_statistics, statistics_sentence, statistics_table
from streamdash.survey.observed import ObservedStreams
from tests.unit import made_up

QUICK = BEST.model_copy(update={"boosting": Boosting(n_estimators=30, max_depth=2), "copies": 1})
N, BINS = 160, 120


def labelled(one: np.ndarray, other: np.ndarray) -> ObservedStreams:
    draws = np.random.default_rng(9).standard_normal((2, *one.shape), dtype=np.float32)
    q = tuple(x.astype(np.float32) for x in (one, other))
    return made_up.observed(q, draws, ("1e3-1e5", "1e5-1e9"))


def skewed(rng: np.random.Generator) -> np.ndarray:
    return 0.1 * (rng.exponential(size=(N, BINS)) - 1)


@pytest.fixture(scope="module")
def mirrored() -> list[Kept]:
    """Gaps in one class, clumps in the other: the same power, another PDF."""
    rng = np.random.default_rng(1)
    return compare_statistics(labelled(1 + skewed(rng), 1 - skewed(rng)), 0.01, QUICK)


def by_name(rows: list[Kept]) -> dict[str, Kept]:
    return {row.name: row for row in rows}


def test_a_mirrored_profile_has_the_same_power_and_another_pdf(mirrored):
    found = by_name(mirrored)
    assert found[PDF].bits > 0.8
    assert abs(found[POWER].bits) < 0.15
    assert found[PDF].evidence[0, 1].value > 5 > abs(found[POWER].evidence[0, 1].value)


def test_correlated_profiles_have_another_power_and_the_same_pdf():
    rng = np.random.default_rng(2)
    white = rng.normal(size=(N, BINS))
    smooth = gaussian_filter1d(rng.normal(size=(N, BINS)), 1.5, mode="wrap")
    # one set of values in both, in the order of either: exactly the same PDF
    smooth = np.take_along_axis(np.sort(rng.normal(size=(N, BINS))), smooth.argsort(1).argsort(1), axis=1)
    streams = labelled(1 + 0.1 * white, 1 + 0.1 * smooth)
    found = by_name(compare_statistics(streams, 0.0, QUICK))
    assert found[POWER].bits > 0.6
    assert abs(found[PDF].bits) < 0.15
    assert found[POWER].evidence[0, 1].value > 2 > found[PDF].evidence[0, 1].value


def test_all_statistics_are_judged_on_the_same_unseen_streams(mirrored):
    assert [row.name for row in mirrored] == list(STATISTICS)
    for row in mirrored:
        np.testing.assert_array_equal(row.judged.rows, mirrored[0].judged.rows)
    assert len(mirrored[0].judged.y) == N // 2
    assert set(by_name(mirrored)[PROFILE].evidence) == {(0, 1), (1, 0)}


def test_information_is_zero_for_a_guess_and_whole_for_certainty(mirrored):
    judged = mirrored[0].judged

    class Sure:
        y = judged.y
        probability = np.eye(2)[judged.y]

    class Guess:
        y = judged.y
        probability = np.full((len(judged.y), 2), 0.5)

    assert information(Sure) == (pytest.approx(1.0), 0.0)
    assert information(Guess) == (pytest.approx(0.0), 0.0)


def test_evidence_of_three_classes_is_of_every_ordered_pair():
    rng = np.random.default_rng(3)
    q = [1 + scale * skewed(rng).astype(np.float32) for scale in (0.5, 1.0, 2.0)]
    draws = tuple(rng.standard_normal((3, N, BINS), dtype=np.float32))
    streams = made_up.observed(q, draws, ("1e3-1e5", "1e5-1e7", "1e7-1e9"))
    for found in statistics_evidence(streams, 0.05).values():
        assert set(found) == {(i, j) for i in range(3) for j in range(3) if i != j}


def test_figure_table_and_words_have_the_numbers(mirrored):
    labels = ("1e3-1e5", "1e5-1e9")
    table = statistics_table(mirrored, labels)
    assert table.information_bits.tolist() == [row.bits for row in mirrored]
    assert f"the {PDF} {by_name(mirrored)[PDF].bits:.3f}" in statistics_sentence(mirrored)
    draw_statistics(mirrored, "bokeh")
    numbers = statistics_numbers(mirrored, labels, 0.01)
    assert numbers["possible_bits"] == math.log2(2)
    text = statistics_markdown(numbers)
    assert text.count("\n| ") == 1 + len(STATISTICS)
    assert f"{mirrored[0].bits:.3f} ± " in text
