"""How an estimator is trained, and on which streams."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Literal, NamedTuple, ParamSpec, TypeVar

import numpy as np
from pydantic import Field
from threadpoolctl import threadpool_limits

from streamdash.config import Config
from streamdash.statistics.features import FeatureSet
from streamdash.validation import Finite

P = ParamSpec("P")
T = TypeVar("T")
COPIES = 8
"""Draws of the noise of every training stream."""

PENALTY_STREAMS = 32_000
"""A penalty is a prior of the weights: of twice as many streams the mean loss feels half of it."""


class Training(Config):
    """How an estimator is trained."""

    members: int = Field(5, ge=1, le=20, description="networks whose mean is taken")
    max_epochs: int = Field(40, ge=1, le=1000, description="passes over the training streams")
    alpha: Finite = Field(
        0.4, ge=0, description="penalty on large weights, for as many training streams as PENALTY_STREAMS"
    )
    blur: Finite = Field(
        0.025, ge=0, le=0.2, description="parameters are learnt with this error, as a share of their range"
    )
    copies: int = Field(COPIES, ge=1, le=50, description="draws of the noise of every training stream")
    seed: int = Field(0, ge=0, description="of split, noise and networks")
    features: FeatureSet = FeatureSet()
    told: tuple[Literal["noise", "age"], ...] = Field(
        (),
        description="nuisances that can be fixed when it is asked: it is told the size of the errors, "
        "and infers the age with the rest",
    )

    def penalty(self, n_streams: int) -> float:
        """`alpha` for networks that learn from so many streams."""
        return self.alpha * PENALTY_STREAMS / n_streams


class Split(NamedTuple):
    """Numbers of the streams for training, validation and test."""

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray


def split_streams(n: int, seed: int = 0) -> Split:
    """Share out streams: 80 % for training, 10 % for validation, 10 % for test; none is in two."""
    order = np.random.default_rng([seed, n]).permutation(n)
    first, second = int(0.8 * n), int(0.9 * n)
    return Split(np.sort(order[:first]), np.sort(order[first:second]), np.sort(order[second:]))


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Run a function with one thread for its matrices: they are small, and more wait for each other."""

    @functools.wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        with threadpool_limits(1):
            return function(*args, **kwargs)

    return alone
