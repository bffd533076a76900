"""Before an ensemble is computed: a few of its streams, and what all of it will take."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from streamdash import paths
from streamdash.config import EnsembleConfig, StreamModel
from streamdash.engine.geometry import Geometry, smooth_geometry
from streamdash.engine.impacts import expected_impacts
from streamdash.simulation.ensemble import background, compute_stream
from streamdash.simulation.geometry import compute_geometry
from streamdash.store.cache import Cache, StoreError

PREVIEW_S = 1.0
"""After this long no further stream of a preview is begun."""
IMPACTS_MAX = 20_000
"""Most impacts expected per stream of which a preview is made: a stream takes about a second then."""


COARSE_TIMES = 8
"""Impact times of a coarse preview."""


@dataclass(frozen=True)
class Preview:
    """The first streams of an ensemble.

    Attributes
    ----------
    impacts_per_stream : expected number.
    seconds_per_stream : of one core, measured; NaN when no stream was computed.
    streams : Dataset as of `streamdash.store.cache.Cache.open_ensemble`; None without a geometry or with
        too many impacts.
    """

    impacts_per_stream: float
    seconds_per_stream: float
    streams: xr.Dataset | None


def coarse_config(config: EnsembleConfig) -> EnsembleConfig:
    """The same ensemble with `COARSE_TIMES` impact times, or as many as it has where those are fewer."""
    few = min(COARSE_TIMES, len(config.stream.impact_times_gyr))
    stream = StreamModel.parse(config.stream.model_dump() | {"n_times": few, "times_gyr": None})
    return config.model_copy(update={"stream": stream})


def coarse_preview(
    config: EnsembleConfig,
    n_streams: int,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    nice: int = 0,
) -> Preview:
    """A few streams of a model whose geometry is not there, from a coarse one: seconds instead of minutes.

    Impacts happen at `COARSE_TIMES` times only, and frequencies and tracks are off by up to a permille. The
    streams are not those that the ensemble will hold, but alike. Nothing is kept.

    Parameters
    ----------
    progress : called with impact times done and all; what it raises ends the computation.

    Raises
    ------
    ValueError
        When galpy cannot build a stream from this model.
    WorkerError
        When a worker was killed.
    """
    coarse = coarse_config(config)
    # Worker processes build the geometry; this one only waits for them, and compiles what streams need.
    compiling = threading.Thread(target=_compile, daemon=True)
    compiling.start()
    geometry = compute_geometry(coarse.stream, workers, progress, nice=nice, coarse=True)
    compiling.join()
    return preview(coarse, geometry, n_streams)


def _compile() -> None:
    """Compile the engine, which a machine does once and keeps, with a stream of the shipped geometry."""
    config = EnsembleConfig()
    with contextlib.suppress(StoreError):
        dataset = Cache((paths.CACHE,)).open_geometry(config.stream)
        if dataset is not None:
            compute_stream(Geometry.from_dataset(dataset, config.stream), config, 0)


def coarse_text(config: EnsembleConfig) -> str:
    """What is said of every coarse preview."""
    few, all_of_them = (len(one.stream.impact_times_gyr) for one in (coarse_config(config), config))
    return (
        f"Coarse preview: impacts at {few} instead of {all_of_them} times, frequencies and tracks to a "
        "permille; streams alike, but not those that the simulation will hold."
    )


def preview(config: EnsembleConfig, geometry: Geometry, n_streams: int) -> Preview:
    """The first streams of an ensemble, at most `n_streams` and for about `PREVIEW_S`.

    They are the very streams that the ensemble will begin with.
    """
    impacts = expected_impacts(geometry, config.population)
    if impacts > IMPACTS_MAX:
        return Preview(impacts, float("nan"), None)
    compute_stream(geometry, config, 0)  # compiles what is not compiled yet
    start = time.perf_counter()
    streams: list[tuple[np.ndarray, np.ndarray, int]] = []
    while len(streams) < min(n_streams, config.n_streams) and time.perf_counter() - start < PREVIEW_S:
        streams.append(compute_stream(geometry, config, len(streams)))
    seconds = (time.perf_counter() - start) / len(streams)
    density, omega, n_impacts = (np.array(part) for part in zip(*streams, strict=True))
    dataset = background(geometry, config).assign(
        density=(("stream", "theta"), density),
        omega=(("stream", "theta"), omega),
        n_impacts=("stream", n_impacts),
        stream=np.arange(len(streams)),
    )
    return Preview(impacts, seconds, dataset)


def expectation(config: EnsembleConfig) -> float:
    """Expected impacts per stream where the geometry is not there yet; builds the smooth stream (seconds).

    Raises
    ------
    ValueError
        When galpy cannot build a stream from this model.
    """
    return expected_impacts(smooth_geometry(config.stream), config.population)
