"""Many simulated streams: one chunk function, run inline, in worker processes or on a cluster.

Stream *i* has a random generator of its own, seeded by the ensemble's seed, the stream model, the
population and *i*: its impacts depend neither on the chunk it is computed in, nor on who computes
it, nor on how many streams are asked for. The chunks that exist in the cache are the progress; what
is missing is computed, a part of a chunk at a time and in any order, and written by this process alone.
"""

from __future__ import annotations

import contextlib
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd
import xarray as xr
from loky import cpu_count

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.engine.density import stream_profile
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import expected_impacts, sample_impacts
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.workers import WorkerError, results
from streamdash.store.cache import BusyError, Cache, StoreError, Writer
from streamdash.store.codec import CHUNK, chunk_streams

__all__ = ["CHUNK", "Estimate", "Stopped", "WorkerError", "estimate", "simulate", "stream_rng", "theta_grid"]

Progress = Callable[[int, int], None]
"""Called with how many are done, and how many there are."""

BUSY_POLL_S = 0.5
PART = 5
"""Streams that a worker computes at a time: all workers share the first chunk, which somebody awaits."""
TIMING_S = 2.0
"""An estimate of the cost times streams for about this long."""


class Stopped(Exception):
    """The simulation was asked to stop; every finished chunk is kept.

    Attributes
    ----------
    done, total : int
        Streams finished, and asked for.
    """

    def __init__(self, done: int, total: int) -> None:
        super().__init__(f"Stopped with {done} of {total} streams finished; the same call resumes.")
        self.done, self.total = done, total


@dataclass(frozen=True)
class Part:
    """Consecutive streams of chunk `index`, from number `start`: ``density`` and ``omega``
    (n, n_theta), ``n_impacts`` (n,), core seconds."""

    index: int
    start: int
    density: np.ndarray
    omega: np.ndarray
    n_impacts: np.ndarray
    cost_s: float


@dataclass(frozen=True)
class Estimate:
    """What an ensemble will cost: expected impacts of a stream, and its seconds on one core."""

    impacts_per_stream: float
    seconds_per_stream: float


def simulate(
    config: EnsembleConfig,
    executor: str = "processes",
    workers: int | None = None,
    cache: Cache | None = None,
    progress: Progress | None = None,
    should_stop: Callable[[], bool] | None = None,
    geometry_progress: Progress | None = None,
    nice: int = 0,
    title: str = "",
) -> xr.Dataset:
    """The ensemble of `config`: from the cache, or computed (what is missing of it) and kept there.

    Parameters
    ----------
    config : EnsembleConfig
    executor : {"inline", "processes", "dask"}
        This process, worker processes of this machine, or the Dask cluster of the active
        ``distributed.Client``, whose workers must see the same cache folder.
    workers : int, optional
        How many worker processes; one per core by default.
    cache : Cache, optional
        The default cache when not given.
    progress : callable, optional
        Called with streams finished and asked for, once at first and after every chunk.
    should_stop : callable, optional
        Asked after every few streams; True ends the simulation with `Stopped`.
    geometry_progress : callable, optional
        Called with impact times finished and all, when the stream's geometry must be computed.
    nice : int
        How much worker processes of this machine stand back for others, 0 to 19.
    title : str
        Name for people, kept with an entry that has none.

    Returns
    -------
    xarray.Dataset
        As `streamdash.store.cache.Cache.open_ensemble` describes it. On one machine the same
        bytes for any executor, number of workers and interruptions; elsewhere the same to the engine's
        accuracy.

    Raises
    ------
    Stopped
        When `should_stop` said so.
    StoreError
        When the cache cannot be written to, for example on a full disk.
    WorkerError
        When a worker process was killed, for example for want of memory.
    ValueError
        When `executor` or `workers` cannot be used.
    """
    cache = cache if cache is not None else Cache.default()
    with contextlib.suppress(StoreError):  # not there, not finished or damaged
        return cache.open_ensemble(config)
    complete(config, cache, executor, workers, progress, should_stop, geometry_progress, nice, title)
    return cache.open_ensemble(config)


def complete(
    config: EnsembleConfig,
    cache: Cache,
    executor: str = "processes",
    workers: int | None = None,
    progress: Progress | None = None,
    should_stop: Callable[[], bool] | None = None,
    geometry_progress: Progress | None = None,
    nice: int = 0,
    title: str = "",
) -> None:
    """Compute what is missing of an ensemble, in the cache only; arguments and errors as `simulate`."""
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be 1 or more (got {workers})")
    cache.check_writable()
    stop = should_stop or (lambda: False)
    geometry_report = _stopping(geometry_progress, stop, config.n_streams)
    geometry = load_geometry(config.stream, cache, workers, geometry_report, executor, nice)
    with _begin(cache, config, background(geometry, config), progress, stop, title) as writer:
        _report(writer, progress, stop)
        pieces = [(config, i, part, cache) for i in writer.missing() for part in _parts(config, i)]
        gathered: dict[int, list[Part]] = defaultdict(list)
        with contextlib.closing(results(compute_part, pieces, executor, workers, nice)) as parts:
            for part in parts:
                gathered[part.index].append(part)
                if len(gathered[part.index]) == len(_parts(config, part.index)):
                    _write(writer, gathered.pop(part.index))
                    _report(writer, progress, stop)
                elif stop():
                    raise Stopped(writer.n_done, config.n_streams)


def estimate(config: EnsembleConfig, geometry: Geometry) -> Estimate:
    """Expected impacts and measured cost of the streams of `config`, from its first few streams."""
    compute_stream(geometry, config, 0)  # compiles what is not compiled yet
    start = time.perf_counter()
    count = 0
    while count < 20 and (elapsed := time.perf_counter() - start) < TIMING_S:
        count += 1
        compute_stream(geometry, config, count)
    elapsed = time.perf_counter() - start
    return Estimate(expected_impacts(geometry, config.population), elapsed / count)


def prepare_workers(cache: Cache, workers: int | None = None, nice: int = 0) -> None:
    """Have worker processes of this machine start, import and load what the default stream needs."""
    with contextlib.suppress(WorkerError, StoreError):
        for _ in results(_prepare, [(cache,)] * (workers or cpu_count()), "processes", workers, nice):
            pass


def _prepare(cache: Cache) -> None:
    config = EnsembleConfig()
    if cache.open_geometry(config.stream) is not None:
        compute_stream(_geometry(config.stream, cache), config, 0)


def theta_grid(config: EnsembleConfig) -> np.ndarray:
    """Parallel angles (n_theta,) of an ensemble, rad."""
    return np.linspace(config.theta_min, config.theta_max, config.n_theta)


def background(geometry: Geometry, config: EnsembleConfig) -> xr.Dataset:
    """The smooth stream on the ensemble's angles: ``smooth`` and ``omega_smooth`` over ``theta``."""
    theta = theta_grid(config)
    return xr.Dataset(
        {
            "smooth": ("theta", geometry.smooth_density(theta)),
            "omega_smooth": ("theta", geometry.smooth_omega(theta)),
        },
        coords={"theta": theta},
    )


def stream_rng(config: EnsembleConfig, i: int) -> np.random.Generator:
    """Random generator of stream `i`, the same whatever `n_streams`, angles and accuracy are."""
    drawn = config.population if config.prior is None else config.prior
    keys = config.stream.key + drawn.key
    words = [int(keys[j : j + 8], 16) for j in range(0, len(keys), 8)]
    return np.random.default_rng(np.random.SeedSequence([config.seed, *words], spawn_key=(i,)))


def stream_parameters(config: EnsembleConfig) -> pd.DataFrame:
    """Parameters of every stream of an ensemble with a prior, a column for each that is open.

    They are drawn again, from the generators that the streams themselves were drawn with.
    """
    assert config.prior is not None
    rows = [config.prior.draw(stream_rng(config, i)) for i in range(config.n_streams)]
    return pd.DataFrame(rows, columns=list(config.prior.names))


def compute_stream(geometry: Geometry, config: EnsembleConfig, i: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Density, mean frequency (n_theta,) and number of impacts of stream `i`."""
    rng = stream_rng(config, i)
    population = config.population
    if config.prior is not None:
        population = config.prior.population(config.prior.draw(rng))
    impacts = sample_impacts(geometry, population, rng)
    density, omega = stream_profile(geometry, impacts, theta_grid(config), config.accuracy)
    return density, omega, len(impacts)


def compute_part(config: EnsembleConfig, index: int, numbers: range, cache: Cache) -> Part:
    """Compute some streams of chunk `index`; what a worker process runs."""
    geometry = _geometry(config.stream, cache)
    start = time.thread_time()  # not the clock's: workers may have to share cores
    streams = [compute_stream(geometry, config, i) for i in numbers]
    density, omega, n_impacts = (np.array(column) for column in zip(*streams, strict=True))
    return Part(index, numbers.start, density, omega, n_impacts, time.thread_time() - start)


def _parts(config: EnsembleConfig, index: int) -> list[range]:
    streams = chunk_streams(config, index)
    return [streams[i : i + PART] for i in range(0, len(streams), PART)]


def _write(writer: Writer, parts: list[Part]) -> None:
    """Put a whole chunk into the cache."""
    parts = sorted(parts, key=lambda part: part.start)
    density, omega, n_impacts = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("density", "omega", "n_impacts")
    )
    writer.write(parts[0].index, density, omega, n_impacts, sum(part.cost_s for part in parts))


@lru_cache(maxsize=2)
def _geometry(stream: StreamModel, cache: Cache) -> Geometry:
    dataset = cache.open_geometry(stream)
    if dataset is None:  # computing it here would be done by every worker, at minutes each
        raise WorkerError(
            f"A worker does not find the stream's geometry in {cache.roots[-1]}; "
            "all workers must see the same cache folder."
        )
    return Geometry.from_dataset(dataset, stream)


def _begin(
    cache: Cache,
    config: EnsembleConfig,
    smooth: xr.Dataset,
    progress: Progress | None,
    stop: Callable[[], bool],
    title: str,
) -> Writer:
    """The writer, once no other process writes; meanwhile that process's progress is reported."""
    while True:
        try:
            return cache.begin(config, smooth, BUSY_POLL_S, title)
        except BusyError:
            done = cache.streams_done(config)
            if progress is not None:
                progress(done, config.n_streams)
            if stop():
                raise Stopped(done, config.n_streams) from None


def _report(writer: Writer, progress: Progress | None, stop: Callable[[], bool]) -> None:
    done, total = writer.n_done, writer.config.n_streams
    if progress is not None:
        progress(done, total)
    if done < total and stop():
        raise Stopped(done, total)


def _stopping(progress: Progress | None, stop: Callable[[], bool], n_streams: int) -> Progress:
    """Progress of the geometry that can be stopped as well."""

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total)
        if stop():
            raise Stopped(0, n_streams)

    return report
