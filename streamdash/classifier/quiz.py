"""Guess the mass: ten streams nobody was trained on, and the single number that gives each away.

The rounds are drawn from the test streams of `streamdash.classifier.data.split`, so neither a
classifier nor the numbers compared with (measured on the other streams) have seen them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import gaussian_kde

from streamdash.classifier.data import Split, check_classes, split
from streamdash.survey.observed import ObservedStreams

ROUNDS = 10
WIDTHS = (1, 7, 15, 31, 63)
"""Smoothing widths in bins at which streams are measured."""
BAND = (0.16, 0.84)
"""Quantiles between which a class usually lies."""
SURPRISE = 0.01
"""Share of values taken to be anywhere in the range of all classes: no density is exactly zero."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """A few telling numbers of the streams that are not judged, as observed.

    Attributes
    ----------
    values : ndarray (n_rows, n_measures)
    y : ndarray (n_rows,)
        Their classes.
    """

    values: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Clue:
    """The single number by which a stream of known class differs most from the other classes.

    Attributes
    ----------
    kind : {"scatter", "ripple", "deepest", "highest"}
    widths : tuple of int
        Smoothing width in bins; two for a ripple, between which it is measured.
    value : float
        Of this stream.
    usual : tuple of (low, high)
        What 68 % of each class have.
    probability : ndarray (n_classes,)
        Of each class, by this number alone.
    samples : tuple of ndarray
        The number of each class's streams.
    """

    kind: str
    widths: tuple[int, ...]
    value: float
    usual: tuple[tuple[float, float], ...]
    probability: np.ndarray
    samples: tuple[np.ndarray, ...]


def draw_rounds(streams: ObservedStreams, sets: Split, seed: int, rounds: int = ROUNDS) -> np.ndarray:
    """Row numbers of the streams of a game (rounds,): every class equally likely, no stream twice."""
    rng = np.random.default_rng(seed)
    test = rng.permutation(sets.test)
    left = [list(test[streams.y[test] == c]) for c in range(len(streams.q))]
    return np.array([left[c].pop() for c in rng.integers(len(left), size=rounds)])


def spread(n_classes: int, choice: int, sure: float) -> np.ndarray:
    """Probability of each class for somebody who is so sure of one and has no opinion on the others.

    Parameters
    ----------
    n_classes, choice : int
    sure : float
        Probability of the choice; no less than blind guessing's, ``1 / n_classes``.
    """
    probability = np.full(n_classes, (1 - sure) / (n_classes - 1))
    probability[choice] = sure
    return probability


def points(probability: np.ndarray, truth: int) -> float:
    """Quadratic (Brier) score of stated probabilities: 100 if certain and right, 0 for blind guessing.

    It is proper: whoever states what they believe has the highest expected score.

    Examples
    --------
    >>> points(np.array([1.0, 0.0, 0.0]), 0), points(np.full(3, 1 / 3), 0)
    (100.0, 0.0)
    >>> points(np.array([1.0, 0.0, 0.0]), 1)
    -200.0
    """
    n = len(probability)
    missed = float(np.sum((probability - np.eye(n)[truth]) ** 2))
    return round(100 * (1 - missed * n / (n - 1)), 9)


def quiz_split(streams: ObservedStreams, seed: int = 0) -> Split:
    """Who is asked about (test) and who was learnt from (the rest), for a classifier of that seed."""
    return split(check_classes(streams).y, seed)


def measures() -> list[tuple[str, tuple[int, ...]]]:
    """Kind and smoothing widths of each number that is measured."""
    single = [(kind, (width,)) for kind in ("scatter", "deepest", "highest") for width in WIDTHS]
    return single + [("ripple", pair) for pair in zip(WIDTHS[:-1], WIDTHS[1:], strict=True)]


def measure(q: np.ndarray) -> np.ndarray:
    """Telling numbers of observed profiles (n_streams, n_bins): an (n_streams, n_measures) array."""
    smooth = {w: uniform_filter1d(q, w, axis=1, mode="nearest") if w > 1 else q for w in WIDTHS}
    compute = {
        "scatter": lambda widths: smooth[widths[0]].std(axis=1),
        "deepest": lambda widths: smooth[widths[0]].min(axis=1),
        "highest": lambda widths: smooth[widths[0]].max(axis=1),
        "ripple": lambda widths: (smooth[widths[0]] - smooth[widths[1]]).std(axis=1),
    }
    return np.stack([compute[kind](widths) for kind, widths in measures()], axis=1)


def learn(streams: ObservedStreams, sets: Split, noise: float) -> Measurements:
    """Measure the streams that are not asked about, at the given noise."""
    rows = np.concatenate([sets.train, sets.validation])
    return Measurements(measure(streams.observed(noise)[rows]), streams.y[rows])


def find_clue(known: Measurements, observed: np.ndarray, truth: int) -> Clue:
    """What gives a stream away, once its class is known.

    Of all numbers the one is chosen that alone makes the true class most probable; densities of
    each class are estimated by Gaussian kernels.

    Parameters
    ----------
    known : Measurements
    observed : ndarray (n_bins,)
        Qρ as observed.
    truth : int
    """
    values = measure(observed[None, :].astype(known.values.dtype))[0]
    classes = range(int(known.y.max()) + 1)
    best: tuple[float, int, np.ndarray] | None = None
    for i, value in enumerate(values):
        probability = _probability([known.values[known.y == c, i] for c in classes], value)
        if best is None or probability[truth] > best[0]:
            best = probability[truth], i, probability
    assert best is not None
    _, i, probability = best
    kind, widths = measures()[i]
    samples = tuple(known.values[known.y == c, i] for c in classes)
    usual = tuple((float(low), float(high)) for low, high in (np.quantile(x, BAND) for x in samples))
    return Clue(kind, widths, float(values[i]), usual, probability, samples)


def _probability(samples: list[np.ndarray], value: float) -> np.ndarray:
    spread = max(x.max() for x in samples) - min(x.min() for x in samples)
    density = np.array([float(gaussian_kde(x)(value)[0]) for x in samples])
    density = (1 - SURPRISE) * density + SURPRISE / spread
    return density / density.sum()
