"""Streams drawn from a prior: simulated like any ensemble, observed with what is not known about them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.engine.geometry import Geometry
from streamdash.prior import Prior
from streamdash.simulation.ensemble import (
    background,
    compute_part,
    compute_stream,
    simulate,
    stream_parameters,
)
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.workers import results
from streamdash.store.cache import Cache
from streamdash.streams import named_stream, stream_of
from streamdash.survey.design import AS_IS, Design, measured, observe_as, published_design, smooth_as

TRAINING_SEED = 1
"""Seed of the ensembles that estimators learn from."""
FRESH_SEEDS = 2**32
"""Seeds from here on are for streams that no estimator has seen."""
INLINE = 20
"""So few fresh streams are computed by this process."""
PART = 25

Progress = Callable[[int, int], None]


class Member(NamedTuple):
    """The streams of one age: configuration, geometry, and the open ensemble."""

    config: EnsembleConfig
    geometry: Geometry
    streams: xr.Dataset


@dataclass(frozen=True, eq=False)
class PriorEnsemble:
    """Streams with parameters of their own, one member for each age that the prior allows.

    Attributes
    ----------
    prior : Prior
    members : tuple of Member
    """

    prior: Prior
    members: tuple[Member, ...]

    @classmethod
    def load(
        cls,
        prior: Prior,
        stream: StreamModel,
        n_streams: int,
        cache: Cache | None = None,
        seed: int = TRAINING_SEED,
        workers: int | None = None,
        executor: str = "processes",
        progress: Progress | None = None,
        nice: int = 0,
    ) -> PriorEnsemble:
        """From the cache, or simulated and kept there as `streamdash.simulate` does.

        Parameters
        ----------
        n_streams : streams in all; every age has the same share.
        progress : called with streams finished and asked for.
        """
        cache = cache if cache is not None else Cache.default()
        members: list[Member] = []
        for config in configs(prior, stream, n_streams, seed):
            before = sum(member.config.n_streams for member in members)

            def report(done: int, _total: int, before: int = before) -> None:
                if progress is not None:
                    progress(before + done, n_streams)

            geometry = load_geometry(config.stream, cache, workers, executor=executor, nice=nice)
            streams = simulate(config, executor, workers, cache, report, nice=nice)
            members.append(Member(config, geometry, streams))
        return cls(prior, tuple(members))

    @classmethod
    def fresh(
        cls, prior: Prior, stream: StreamModel, n_streams: int, seed: int, cache: Cache | None = None
    ) -> PriorEnsemble:
        """Streams that no ensemble of the cache holds, computed now and not kept."""
        cache = cache if cache is not None else Cache.default()
        members: list[Member] = []
        for config in configs(prior, stream, n_streams, FRESH_SEEDS + seed):
            geometry = load_geometry(config.stream, cache)
            members.append(Member(config, geometry, _computed(config, geometry, cache)))
        return cls(prior, tuple(members))

    @property
    def n_streams(self) -> int:
        """Streams of all ages."""
        return sum(member.config.n_streams for member in self.members)

    @property
    def stream(self) -> StreamModel:
        """The stream, at the first age."""
        return self.members[0].config.stream

    @property
    def age_gyr(self) -> np.ndarray:
        """Age of every stream (n_streams,)."""
        return np.concatenate([np.full(m.config.n_streams, m.config.stream.age_gyr) for m in self.members])

    def parameters(self) -> pd.DataFrame:
        """True parameters, a row for every stream and a column for each open parameter."""
        return pd.concat([stream_parameters(m.config) for m in self.members], ignore_index=True)

    def truth(self, with_age: bool = False) -> pd.DataFrame:
        """The same; with a column for the age before them, where it is inferred too."""
        found = self.parameters()
        if with_age:
            found.insert(0, "age_gyr", self.age_gyr)
        return found

    def clean(self, design: Design) -> np.ndarray:
        """Every stream in the design's bins (n_streams, n_bin): no noise, nothing divided out."""
        return np.concatenate([clean_streams(m.geometry, m.streams, design) for m in self.members])


def clean_streams(geometry: Geometry, streams: xr.Dataset, design: Design) -> np.ndarray:
    """Streams of an ensemble in a design's bins (n_streams, n_bin): no noise, nothing divided out.

    A density is in units of the smooth stream's mean: its own unit means nothing.
    """
    q = observe_as(geometry, streams, design)
    if design.quantity == "density":
        q = q / np.float32(smooth_as(geometry, streams, design).mean())
    return q.astype(np.float32, copy=False)


def configs(prior: Prior, stream: StreamModel, n_streams: int, seed: int) -> list[EnsembleConfig]:
    """What is simulated: an ensemble for each age, which share the streams as evenly as can be."""
    models = [stream]
    if prior.ages_gyr:
        models = [_at_age(stream, age) for age in prior.ages_gyr]
    shares = [len(part) for part in np.array_split(np.arange(n_streams), len(models))]
    return [
        EnsembleConfig(stream=model, prior=prior, n_streams=share, seed=seed)
        for model, share in zip(models, shares, strict=True)
        if share
    ]


def observed(
    q: np.ndarray,
    design: Design,
    prior: Prior,
    rng: np.random.Generator,
    factors: np.ndarray | float | None = None,
) -> np.ndarray:
    """Clean streams as they would be observed: the prior's nuisances and the design's noise, then divided.

    Parameters
    ----------
    q : ndarray (n_streams, n_bin)
        As `PriorEnsemble.clean` gives them.
    rng : draws wave, size of the errors, and noise of every stream.
    factors : ndarray (n_streams,) or float, optional
        Errors relative to the design's, where they are known and not drawn from the prior.
    """
    if prior.background:
        q = (q * _waves(len(q), design, prior, rng)).astype(np.float32)
    draws = rng.standard_normal(q.shape, dtype=np.float32)
    low, high = prior.noise_factor
    if factors is not None:
        draws *= np.broadcast_to(np.asarray(factors, np.float32), len(q))[:, None]
    elif high > low:
        factors = np.exp(rng.uniform(np.log(low), np.log(high), (len(q), 1)))
        draws *= factors.astype(np.float32)
    elif low != 1.0:
        draws *= np.float32(low)
    return measured(q, draws, design.sigma, design.fit)


def noise_factors(n: int, prior: Prior, rng: np.random.Generator) -> np.ndarray:
    """Errors of `n` streams relative to the design's, drawn from the prior (uniform in the logarithm)."""
    low, high = np.log(prior.noise_factor)
    return np.exp(rng.uniform(low, high, n))


def _waves(n: int, design: Design, prior: Prior, rng: np.random.Generator) -> np.ndarray:
    """1 + a Gaussian process over the bins with the prior's amplitude and scale, kept above 0."""
    x = design.centers / prior.background_deg
    covariance = np.exp(-0.5 * np.subtract.outer(x, x) ** 2)
    values, vectors = np.linalg.eigh(covariance)
    kept = values > 1e-6 * values[-1]
    root = vectors[:, kept] * np.sqrt(values[kept])
    waves = rng.standard_normal((n, int(kept.sum()))) @ root.T
    return np.maximum(1 + prior.background * waves, 0.05)


def _at_age(stream: StreamModel, age: float) -> StreamModel:
    """A model at another age, with the velocity dispersion that makes it as long."""
    if age == stream.age_gyr:
        return stream
    known = stream_of(stream)
    aged = known.at_age(age)
    return aged.arm(stream.arm).model_copy(
        update={"n_times": stream.n_times} if stream.times_gyr is None else {}
    )


def _computed(config: EnsembleConfig, geometry: Geometry, cache: Cache) -> xr.Dataset:
    numbers = range(config.n_streams)
    if config.n_streams <= INLINE:
        density = np.array([compute_stream(geometry, config, i)[0] for i in numbers])
    else:
        pieces = [(config, i, numbers[i : i + PART], cache) for i in range(0, config.n_streams, PART)]
        with contextlib.closing(results(compute_part, pieces)) as found:
            parts = sorted(found, key=lambda part: part.start)
        density = np.concatenate([part.density for part in parts])
    return background(geometry, config).assign(density=(("stream", "theta"), density.astype(np.float32)))


def model_of(stream: str | StreamModel, arm: str | None = None) -> StreamModel:
    """A stream's model by its name; a model as it is."""
    return stream if isinstance(stream, StreamModel) else named_stream(stream).arm(arm)


def default_design(geometry: Geometry) -> Design:
    """How a stream is observed unless asked otherwise: its published bins, divided by a cubic at least.

    Nobody knows the smooth density of a measured stream, so some polynomial is always divided out.
    """
    design = published_design(geometry)
    return design if design.order != AS_IS else replace(design, order=3)
