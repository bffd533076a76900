"""Streams to learn from and to judge by, and how they are divided.

A stream is in exactly one of the three sets of a `Split`. Copies of it with fresh noise
are made after the split and from training streams only, so nothing of a stream that is
judged was ever trained on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamdash._moved import renamed
from streamdash.survey.design import measured
from streamdash.survey.observed import ObservedStreams

__getattr__ = renamed(__name__)
TEST_SHARE = 0.25
"""Share of all streams kept for testing (paper §2.5)."""
VALIDATION_SHARE = 0.25
"""Share of the remaining streams kept for validation (paper §2.5)."""
MIN_STREAMS = 20
"""Streams per class below which a split into three sets means nothing."""


class ClassifierError(ValueError):
    """Data or settings that no classifier can be trained on or used with; one sentence."""


class Cancelled(Exception):
    """The work was stopped because ``should_stop()`` said so."""


@dataclass(frozen=True, eq=False)
class Split:
    """Row numbers of the pooled streams in each set."""

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray


def check_classes(streams: ObservedStreams) -> ObservedStreams:
    """The same streams, once it is known that they make classes which can be learnt.

    Raises
    ------
    ClassifierError
        When there are not 2 to 4 classes, or one has too few streams or values that are no numbers.
    """
    if not 2 <= len(streams.q) <= 4:
        raise ClassifierError(f"A classifier takes 2 to 4 classes, not {len(streams.q)}.")
    for label, q in zip(streams.labels, streams.q, strict=True):
        if len(q) < MIN_STREAMS:
            raise ClassifierError(
                f"{label} has {len(q)} streams; simulate at least {MIN_STREAMS} to train a classifier."
            )
        if not np.all(np.isfinite(q)):
            raise ClassifierError(f"{label} has Qρ values that are not finite; simulate it again.")
    return streams


def split(y: np.ndarray, seed: int) -> Split:
    """Divide streams as the paper does: 25 % test, the rest 75:25 training and validation.

    Parameters
    ----------
    y : ndarray (n_streams,) of int
        Class of each stream; every set gets the same shares of classes.
    seed : int
        Decides who goes where; nothing else does.
    """
    from sklearn.model_selection import train_test_split  # a second of imports, in every worker process

    rows = np.arange(len(y))
    rest, test = train_test_split(rows, test_size=TEST_SHARE, stratify=y, random_state=seed)
    train, validation = train_test_split(
        rest, test_size=VALIDATION_SHARE, stratify=y[rest], random_state=seed
    )
    return Split(np.sort(train), np.sort(validation), np.sort(test))


def augmented(
    sample: ObservedStreams, rows: np.ndarray, noise: float | np.ndarray, copies: int, seeds: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Some streams as observed, ``copies`` times, each time with fresh noise.

    The first copy has the stream's own fixed draw, the others fresh draws from ``seeds``.

    Returns
    -------
    q : ndarray (copies * n_rows, n_bins), float32
    y : ndarray (copies * n_rows,)
    """
    parts = [sample.observed(noise)[rows]]
    rng = np.random.default_rng(list(seeds))
    for _ in range(copies - 1):
        fresh = rng.standard_normal((len(rows), sample.n_bins), dtype=np.float32)
        parts.append(measured(sample.clean[rows], fresh, noise, sample.design.fit))
    return np.concatenate(parts), np.tile(sample.y[rows], copies)
