"""Streams to learn from and to judge by, and how they are divided.

A stream is in exactly one of the three sets of a `Split`. Copies of it with fresh noise
are made after the split and from training streams only, so nothing of a stream that is
judged was ever trained on.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from sklearn.model_selection import train_test_split

from streamdash.config import EnsembleConfig
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey import sky
from streamdash.survey.bands import noise_draws
from streamdash.survey.design import measured

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
class LabelledStreams:
    """Simulated streams of 2 to 4 classes as arrays.

    Attributes
    ----------
    q : tuple of ndarray (n_streams, n_bins)
        Noise-free Qρ of each class, lowest mass first.
    draws : tuple of ndarray (n_streams, n_bins)
        The fixed standard-normal draw per stream and bin that is its noise at σ_ε = 1.
    labels : tuple of str
        Mass range of each class, for example ``1e3-1e5``.
    keys : tuple of str
        What each class's streams are: the key of the ensemble's configuration.
    ell : ndarray (n_bins,), optional
        Centre of each bin in degrees (or in any other coordinate along the stream).
    n_impacts : tuple of ndarray (n_streams,), optional
        Subhalos that hit each stream; nothing is learnt from them, they explain mistakes.
    fit : ndarray (n_bins, n_bins), optional
        Where profiles are divided by a polynomial fitted to them, noise included: the matrix that
        fits it (`streamdash.survey.design.Design.fit`). `q` is then not divided yet.

    Raises
    ------
    ClassifierError
        When the arrays do not fit together.
    """

    q: tuple[np.ndarray, ...]
    draws: tuple[np.ndarray, ...]
    labels: tuple[str, ...]
    keys: tuple[str, ...] = ()
    ell: np.ndarray = field(default_factory=lambda: np.zeros(0))
    n_impacts: tuple[np.ndarray, ...] = ()
    fit: np.ndarray | None = None

    def __post_init__(self) -> None:
        if not self.keys:
            object.__setattr__(self, "keys", tuple("" for _ in self.labels))
        if not len(self.ell):
            object.__setattr__(self, "ell", np.arange(self.q[0].shape[-1], dtype=float))
        self._check()

    def _check(self) -> None:
        if not 2 <= len(self.labels) <= 4:
            raise ClassifierError(f"A classifier takes 2 to 4 mass ranges, not {len(self.labels)}.")
        if len(set(self.labels)) < len(self.labels):
            raise ClassifierError("The mass ranges must differ from each other.")
        if not len(self.q) == len(self.draws) == len(self.labels) == len(self.keys):
            raise ClassifierError("Each mass range needs its streams, its noise draws and its key.")
        for label, q, draws in zip(self.labels, self.q, self.draws, strict=True):
            if q.ndim != 2 or q.shape != draws.shape or q.shape[1] != len(self.ell):
                raise ClassifierError(
                    f"{label}: streams and draws must both have shape (streams, {len(self.ell)} bins), "
                    f"but have {q.shape} and {draws.shape}."
                )
            if len(q) < MIN_STREAMS:
                raise ClassifierError(
                    f"{label} has {len(q)} streams; simulate at least {MIN_STREAMS} to train a classifier."
                )
            if not np.all(np.isfinite(q)):
                raise ClassifierError(f"{label} has Qρ values that are not finite; simulate it again.")

    @property
    def n_bins(self) -> int:
        """Number of bins along the stream."""
        return len(self.ell)

    @cached_property
    def y(self) -> np.ndarray:
        """Class of every stream (n_total,), classes one after the other."""
        return np.repeat(np.arange(len(self.q)), [len(q) for q in self.q])

    @cached_property
    def clean(self) -> np.ndarray:
        """Noise-free Qρ of every stream (n_total, n_bins)."""
        return np.concatenate(self.q).astype(np.float32, copy=False)

    def observed(self, noise: float | np.ndarray) -> np.ndarray:
        """Every stream with its own fixed noise (n_total, n_bins), float32."""
        return measured(self.clean, np.concatenate(self.draws), noise, self.fit)

    @cached_property
    def digest(self) -> str:
        """Hash of everything in the sample: data, draws, labels, keys and bins."""
        sha = hashlib.sha256(repr((self.labels, self.keys, [q.shape for q in self.q])).encode())
        for array in (*self.q, *self.draws, self.ell, *([] if self.fit is None else [self.fit])):
            sha.update(np.ascontiguousarray(array).tobytes())
        return sha.hexdigest()

    def locate(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Class and index within its ensemble of pooled row numbers."""
        first = np.concatenate([[0], np.cumsum([len(q) for q in self.q])])
        owner = np.searchsorted(first, rows, side="right") - 1
        return owner, np.asarray(rows) - first[owner]


@dataclass(frozen=True, eq=False)
class Split:
    """Row numbers of the pooled streams in each set."""

    train: np.ndarray
    validation: np.ndarray
    test: np.ndarray


def read_streams(cache: Cache, ensembles: Sequence[str | EnsembleConfig]) -> LabelledStreams:
    """Streams of 2 to 4 ensembles in 0.2° bins of longitude, each with its own noise draws.

    Parameters
    ----------
    cache : Cache
    ensembles : sequence of str or EnsembleConfig
        Keys or configurations of complete ensembles of one stream model, lowest masses first.

    Raises
    ------
    StoreError
        When an ensemble is missing or damaged.
    ClassifierError
        When they do not make classes of one problem.
    """
    configs = [e if isinstance(e, EnsembleConfig) else cache.find(e).config for e in ensembles]
    if len({config.stream.key for config in configs}) > 1:
        raise ClassifierError("All mass ranges must be simulated for the same stream.")
    geometry = load_geometry(configs[0].stream, cache)
    edges = sky.longitude_bins(geometry)
    datasets = [cache.open_ensemble(config) for config in configs]
    q = tuple(sky.q_rho(geometry, dataset, edges) for dataset in datasets)
    return LabelledStreams(
        q,
        tuple(noise_draws(config, x.shape) for config, x in zip(configs, q, strict=True)),
        tuple(config.perturbers.label for config in configs),
        tuple(config.key for config in configs),
        0.5 * (edges[:-1] + edges[1:]),
        tuple(dataset["n_impacts"].to_numpy() for dataset in datasets),
    )


def split(y: np.ndarray, seed: int) -> Split:
    """Divide streams as the paper does: 25 % test, the rest 75:25 training and validation.

    Parameters
    ----------
    y : ndarray (n_streams,) of int
        Class of each stream; every set gets the same shares of classes.
    seed : int
        Decides who goes where; nothing else does.
    """
    rows = np.arange(len(y))
    rest, test = train_test_split(rows, test_size=TEST_SHARE, stratify=y, random_state=seed)
    train, validation = train_test_split(
        rest, test_size=VALIDATION_SHARE, stratify=y[rest], random_state=seed
    )
    return Split(np.sort(train), np.sort(validation), np.sort(test))


def augmented(
    sample: LabelledStreams, rows: np.ndarray, noise: float | np.ndarray, copies: int, seeds: Sequence[int]
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
        parts.append(measured(sample.clean[rows], fresh, noise, sample.fit))
    return np.concatenate(parts), np.tile(sample.y[rows], copies)
