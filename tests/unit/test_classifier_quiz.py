"""Guess the mass: who is asked about, and whether the explanation finds what is there."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.classifier.quiz import (
    ROUNDS,
    WIDTHS,
    draw_rounds,
    find_clue,
    learn,
    measure,
    measures,
    points,
    quiz_split,
    spread,
)
from streamdash.survey.observed import ObservedStreams
from tests.unit import made_up

N_BINS = 120


def waves(*amplitudes: float, n_streams: int = 80) -> ObservedStreams:
    """Classes that differ in the size of slow ups and downs only."""
    rng = np.random.default_rng(0)
    phase = 2 * np.pi * np.arange(N_BINS) / 60
    q = tuple(
        (1 + a * np.sin(phase + rng.uniform(0, 6.28, (n_streams, 1)))).astype(np.float32) for a in amplitudes
    )
    draws = tuple(rng.standard_normal(x.shape).astype(np.float32) for x in q)
    return made_up.observed(q, draws, tuple(f"1e{i}-1e{i + 1}" for i in range(len(q))))


def test_a_game_asks_about_held_out_streams_once_each_and_is_the_same_for_all():
    streams = waves(0.1, 0.3)
    sets = quiz_split(streams)
    rows = draw_rounds(streams, sets, seed=3)
    assert len(set(rows)) == ROUNDS
    assert set(rows) <= set(sets.test)
    assert not set(rows) & {*sets.train, *sets.validation}
    np.testing.assert_array_equal(rows, draw_rounds(streams, sets, seed=3))
    assert (rows != draw_rounds(streams, sets, seed=4)).any()
    both = streams.y[np.concatenate([draw_rounds(streams, sets, seed) for seed in range(30)])]
    assert 0.4 < both.mean() < 0.6


def test_the_measures_are_what_they_say():
    q = np.ones((1, N_BINS), np.float32)
    q[0, 60] = -9
    values = dict(zip(measures(), measure(q)[0], strict=True))
    assert values["deepest", (1,)] == -9
    assert values["deepest", (7,)] == pytest.approx(1 - 10 / 7, abs=1e-5)
    assert values["scatter", (1,)] == pytest.approx(q.std(), rel=1e-5)
    assert values["highest", (WIDTHS[-1],)] == 1
    assert len(values) == measure(q).shape[1]


def test_the_clue_is_the_scatter_where_only_the_scatter_differs():
    streams = waves(0.05, 0.4)
    sets = quiz_split(streams)
    known = learn(streams, sets, noise=0.1)
    assert len(known.y) == len(streams.y) - len(sets.test)
    observed = streams.observed(0.1)
    for row in sets.test[::10]:
        clue = find_clue(known, observed[row], int(streams.y[row]))
        assert clue.probability[streams.y[row]] > 0.95
        assert clue.probability.sum() == pytest.approx(1)
        low, high = clue.usual[streams.y[row]]
        assert low < high
        assert clue.usual[0][1] < clue.usual[1][0] or clue.usual[1][1] < clue.usual[0][0]


def test_no_clue_is_convincing_where_noise_drowns_everything():
    streams = waves(0.01, 0.02)
    sets = quiz_split(streams)
    known = learn(streams, sets, noise=1.0)
    observed = streams.observed(1.0)
    rows = sets.test[::4]
    sure = [find_clue(known, observed[row], int(streams.y[row])).probability.max() for row in rows]
    assert np.median(sure) < 0.9


@pytest.mark.parametrize("n_classes", [2, 3, 4])
def test_nobody_gains_by_stating_what_they_do_not_believe(n_classes):
    rng = np.random.default_rng(n_classes)
    for _ in range(20):
        believed = rng.dirichlet(np.ones(n_classes))
        other = rng.dirichlet(np.ones(n_classes))
        expected = [sum(p * points(q, c) for c, p in enumerate(believed)) for q in (believed, other)]
        assert expected[0] > expected[1]
    assert spread(n_classes, 1, 0.9).sum() == pytest.approx(1)
    assert spread(n_classes, 1, 1 / n_classes) == pytest.approx(1 / n_classes)
