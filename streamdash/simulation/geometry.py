"""The geometry of a stream: from the cache, or computed with galpy in worker processes and kept there."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from streamdash.config import StreamModel
from streamdash.engine.galpy_streams import Nodes, StreamError, time_unit_gyr, timed_part
from streamdash.engine.geometry import Geometry, unbuildable
from streamdash.simulation.workers import WorkerError, kill_workers, results
from streamdash.store.cache import BusyError, Cache, StoreError
from streamdash.store.parts import GeometryWriter

BUSY_POLL_S = 0.5
CHECKED_TIMES = 2
"""Impact times of a geometry from elsewhere that are computed anew."""
CHECK_TOLERANCE = 1e-3
"""Largest difference from them, relative to the largest number of its kind; processors differ by 10⁻⁶."""
CHECK_S = 600.0
"""Longest that this may take."""


def load_geometry(
    stream: StreamModel,
    cache: Cache | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: str = "processes",
    nice: int = 0,
) -> Geometry:
    """The geometry of `stream`: from the cache, or computed and then cached.

    One process computes a geometry, others wait and report its progress. Finished impact times are
    kept, so that whoever comes after an interruption goes on from there.

    Parameters
    ----------
    stream : StreamModel
    cache : Cache, optional
        Where to look and to keep; the default cache when not given.
    workers : int, optional
        Processes when it must be computed; all cores when not given.
    progress : callable, optional
        Called with (times done, times in all); what it raises ends the computation.
    executor, nice
        As for `streamdash.simulation.workers.results`.

    Raises
    ------
    StoreError
        When the cache cannot be written to.
    WorkerError, ValueError
        As `compute_geometry`.
    """
    cache = cache if cache is not None else Cache.default()
    dataset = cache.open_geometry(stream)
    n = len(stream.impact_times_gyr)
    while dataset is None:
        try:
            writer = cache.begin_geometry(stream, timeout=BUSY_POLL_S)
        except BusyError:
            if progress is not None:
                progress(cache.times_done(stream), n)
            continue
        with writer:
            dataset = cache.open_geometry(stream)  # whoever was waited for may have stored it
            if dataset is None:
                dataset = _compute_kept(stream, writer, workers, progress, executor, nice)
    return Geometry.from_dataset(dataset, stream)


def _compute_kept(
    stream: StreamModel,
    writer: GeometryWriter,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
    executor: str,
    nice: int,
) -> xr.Dataset:
    """Compute the impact times that are not there yet, each kept at once, and store the geometry."""
    cost_s = 0.0

    def keep(k: int, nodes: Nodes, seconds: float) -> None:
        nonlocal cost_s
        cost_s += seconds
        writer.write(k, {**nodes._asdict(), "seconds": np.array(seconds)})

    kept = {}
    for k, arrays in writer.parts().items():
        cost_s += float(arrays.pop("seconds"))
        kept[k] = Nodes(**arrays)
    geometry = compute_geometry(stream, workers, progress, executor, nice, kept, keep)
    dataset = geometry.to_dataset()
    writer.finish(dataset, cost_s)
    return dataset


def compute_geometry(
    stream: StreamModel,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: str = "processes",
    nice: int = 0,
    kept: Mapping[int, Nodes] | None = None,
    keep: Callable[[int, Nodes, float], None] | None = None,
    coarse: bool = False,
) -> Geometry:
    """Build the geometry of `stream` with galpy, impact times in parallel.

    Parameters
    ----------
    kept : nodes of impact times that are known already, by their number.
    keep : called with number, nodes and core seconds of every impact time that is finished.
    coarse : to a permille only, in a quarter of the time; for previews, never for the cache.

    Raises
    ------
    ValueError
        When galpy cannot build a stream from this model (for example an unbound
        progenitor), naming the model's fields to change.
    WorkerError
        When a worker was killed.
    """
    n = len(stream.impact_times_gyr)
    nodes = dict(kept or {})
    if progress is not None:
        progress(len(nodes), n)
    smooth: dict[str, Any] = {}
    # The smooth stream takes as long as a time or two: it is built by a worker as well.
    pieces: list[tuple] = [(stream, None, coarse), *((stream, k, coarse) for k in range(n) if k not in nodes)]
    try:
        with contextlib.closing(results(timed_part, pieces, executor, workers, nice)) as found:
            for k, new, seconds in found:
                if k is None:
                    smooth = new
                else:
                    nodes[k] = new
                    if keep is not None:
                        keep(k, new, seconds)
                if progress is not None:
                    progress(len(nodes), n)
    except StreamError:
        raise
    except (ValueError, IndexError, FloatingPointError, np.linalg.LinAlgError) as error:
        raise unbuildable(error) from error
    except RuntimeError as error:
        if isinstance(error, StoreError | WorkerError):
            raise
        raise unbuildable(error) from error
    width = max(len(item.theta) for item in nodes.values())
    theta, xv, jac = (
        np.stack([_pad(getattr(nodes[k], name), width) for k in range(n)]) for name in Nodes._fields
    )
    return Geometry(
        stream=stream,
        times=np.array(stream.impact_times_gyr) / time_unit_gyr(),
        node_theta=theta,
        node_xv=xv,
        node_jac=jac,
        **smooth,
    )


def _pad(values: np.ndarray, length: int) -> np.ndarray:
    padding = [(0, length - len(values))] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, padding, constant_values=np.nan)


def check_geometry(stream: StreamModel, dataset: xr.Dataset) -> None:
    """Compare a geometry from elsewhere with what galpy says of its model today.

    The smooth stream and `CHECKED_TIMES` impact times, drawn at random, are computed anew.

    Raises
    ------
    ValueError
        When they differ by more than `CHECK_TOLERANCE` of their size, or a number is missing; in one
        sentence. Also when galpy cannot build the stream, or needs more than `CHECK_S`.
    """
    geometry = Geometry.from_dataset(dataset, stream)
    times = np.array(stream.impact_times_gyr) / time_unit_gyr()
    _check_alike("times", geometry.times, times)
    drawn = np.random.default_rng().permutation(len(times))[:CHECKED_TIMES]
    pieces: list[tuple] = [(stream, None), *((stream, int(k)) for k in drawn)]
    patience = threading.Timer(CHECK_S, kill_workers)
    patience.start()
    try:
        for k, fresh, _ in results(timed_part, pieces):
            if k is None:
                for name, value in fresh.items():
                    _check_alike(name, getattr(geometry, name), value)
                continue
            for field in Nodes._fields:
                theirs, ours = getattr(geometry, f"node_{field}")[k], getattr(fresh, field)
                _check_alike(f"node_{field}", theirs[: len(ours)], ours)
    except WorkerError as error:
        raise ValueError(
            f"its geometry could not be compared with its model within {CHECK_S:.0f} s"
        ) from error
    except (IndexError, FloatingPointError, np.linalg.LinAlgError, RuntimeError) as error:
        raise unbuildable(error) from error
    finally:
        patience.cancel()


def _check_alike(name: str, theirs: Any, ours: Any) -> None:
    theirs, ours = np.asarray(theirs, float), np.asarray(ours, float)
    if theirs.shape != ours.shape or not np.allclose(
        theirs, ours, rtol=0, atol=CHECK_TOLERANCE * float(np.abs(ours).max(initial=0.0)), equal_nan=True
    ):
        raise ValueError(f"{name} of its geometry is not that of its model, computed anew")
