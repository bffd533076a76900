"""Streams of a prior that an estimator has not learnt from: mocks, predictive bands, and its diagnostics."""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from streamdash.inference.cells import AGE
from streamdash.inference.estimator import Estimator
from streamdash.inference.files import (
    DEFAULT_PRIOR,
    HELD_OUT,
    EstimatorFileError,
    arrays_of,
    kept_folder,
    shipped_path,
)
from streamdash.inference.prior_ensemble import PriorEnsemble, observed
from streamdash.inference.training import split_streams
from streamdash.store.cache import Cache
from streamdash.store.entry import write_file

NOISE_SEED = 20_181_112
"""Seed of the noise that held-out streams are shown with; a stream's draws only scale with its errors."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Streams in the bins of an estimator's design, and what hit them.

    Attributes
    ----------
    truth : DataFrame
        Parameters, a column for each of the estimator's, a row for every stream.
    clean : ndarray (n_streams, n_bin)
        No noise, nothing divided out.
    """

    truth: pd.DataFrame
    clean: np.ndarray

    @classmethod
    def fresh(cls, estimator: Estimator, n: int, seed: int, cache: Cache | None = None) -> HeldOut:
        """Simulated now; none is one that an estimator learns from."""
        streams = PriorEnsemble.fresh(estimator.prior, estimator.stream, n, seed, cache)
        order = np.random.default_rng(seed).permutation(n)  # ages come in blocks
        truth = streams.truth(AGE in estimator.grid).iloc[order].reset_index(drop=True)
        return cls(truth, streams.clean(estimator.design)[order])

    @classmethod
    def of_test(cls, ensemble: PriorEnsemble, estimator: Estimator, seed: int = 0) -> HeldOut:
        """The test streams of the ensemble that an estimator was trained on with that seed."""
        part = split_streams(ensemble.n_streams, seed).test
        part = np.random.default_rng(seed).permutation(part)
        truth = ensemble.truth(AGE in estimator.grid).iloc[part].reset_index(drop=True)
        return cls(truth, ensemble.clean(estimator.design)[part])

    @property
    def n_streams(self) -> int:
        """How many there are."""
        return len(self.clean)

    def observed(self, estimator: Estimator, noise_factor: float = 1.0) -> np.ndarray:
        """All of them as measured with the estimator's design (n_streams, n_bin).

        Parameters
        ----------
        noise_factor : errors relative to the design's, where the estimator is told.
        """
        return seen(self.clean, estimator, noise_factor, np.random.default_rng(NOISE_SEED))

    def save(self, path: Path) -> None:
        """Write them, in half precision: a thousandth of the density is far below any error."""
        file = io.BytesIO()
        np.savez_compressed(
            file,
            names=np.frombuffer(json.dumps(list(self.truth)).encode(), np.uint8),
            truth=self.truth.to_numpy(np.float64),
            clean=self.clean.astype(np.float16),
        )
        write_file(path, file.getvalue())

    @classmethod
    def load(cls, path: Path) -> HeldOut:
        """Read what `save` wrote.

        Raises
        ------
        EstimatorFileError
            When the file is missing, damaged, or something else.
        """
        with arrays_of(path, "file of held-out streams") as arrays:
            names, truth, clean = (arrays[name] for name in ("names", "truth", "clean"))
            found = cls(pd.DataFrame(truth, columns=json.loads(names.tobytes())), clean.astype(np.float32))
            if len(found.truth) != len(found.clean):
                raise EstimatorFileError(f"{path} does not hold as many parameters as streams.")
        return found


def seen(
    clean: np.ndarray, estimator: Estimator, noise_factor: float, rng: np.random.Generator
) -> np.ndarray:
    """Clean streams (n, n_bin) as the estimator's design measures them, with errors of that size."""
    factors = noise_factor if estimator.noise_told else None
    return observed(clean, estimator.design, estimator.prior, rng, factors)


def load_streams(stream: str, prior: str = DEFAULT_PRIOR, told: bool = False) -> HeldOut:
    """The held-out streams that are shipped with an estimator; see `load_estimator`."""
    path = shipped_path(stream, prior, told)
    return HeldOut.load(path.parent / HELD_OUT / path.name)


def keep_streams(key: str, streams: HeldOut, folder: Path | None = None) -> None:
    """Keep the held-out streams of an estimator for somebody's own design beside it."""
    place = (folder or kept_folder()) / HELD_OUT
    place.mkdir(parents=True, exist_ok=True)
    streams.save(place / f"{key}.npz")


def kept_streams(key: str, folder: Path | None = None) -> HeldOut | None:
    """What `keep_streams` kept, or None."""
    try:
        return HeldOut.load((folder or kept_folder()) / HELD_OUT / f"{key}.npz")
    except EstimatorFileError:
        return None
