"""Results that are computed once and read often: in the server's process and in each of its workers.

`Results.shared` is the place for every result that depends only on (ensembles, noise, bins, …):
PDFs, evidence, trained models. It computes each key once however many ask at the same moment, keeps
what was used last, and forgets the rest. No Panel: worker processes import this.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
import sys
import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from cachetools import LRUCache

from app.session.catalog import Choice
from streamdash.config import StreamModel
from streamdash.engine.geometry import Geometry
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

T = TypeVar("T")
logger = logging.getLogger(__name__)

MEMORY_BYTES = 512 * 2**20
"""Memory that shared results may keep, in bytes."""
WORKER_BYTES = 256 * 2**20
"""The same in each worker process."""


class Unavailable(Exception):
    """Something cannot be shown; the message is one sentence for the person looking."""


class Results:
    """Geometries, ensembles and shared results of one cache.

    Handed to a worker process, this arrives there as the worker's own `Results` of the same cache: what
    a computation needs is read where it is needed, and kept there.

    Parameters
    ----------
    cache
        The cache that is read.
    memory
        Bytes that shared results may keep.
    """

    def __init__(self, cache: Cache, memory: int = MEMORY_BYTES) -> None:
        self.cache = cache
        self._results: LRUCache = LRUCache(memory, getsizeof=_size)
        self._running: dict[Hashable, tuple[Future, int]] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return of_this_process, (self.cache,)

    def known(self, key: Hashable) -> Any:
        """The result of a key if it is kept, else None."""
        with self._lock:
            return self._results.get(key)

    def keep(self, key: Hashable, result: Any) -> None:
        """Keep a result that was computed elsewhere."""
        with self._lock:
            try:
                self._results[key] = result
            except ValueError:  # larger than all the memory allowed
                logger.warning("result %r is too large to be kept", key)

    def shared(self, key: Hashable, compute: Callable[[], T]) -> T:
        """Result of ``compute()``, computed once for all sessions.

        Parameters
        ----------
        key
            Everything the result depends on, hashable, starting with a name of its kind:
            ``("evidence", ensemble_keys, noise, n_bin)``. Floats must be rounded already.
        compute
            Called without arguments if the result is not there. It may call `shared` with other
            keys. Its result is shared between sessions and threads: never change it in place.

        Returns
        -------
        result
            Also when it is too large to be kept.

        Raises
        ------
        Exception
            Whatever ``compute`` raised, for every caller that waited; nothing is kept, so that the
            next call tries again.
        """
        me = threading.get_ident()
        with self._lock:
            if key in self._results:
                return self._results[key]
            future, owner = self._running.get(key, (None, me))
            if future is None:
                future = Future()
                self._running[key] = (future, me)
                mine = True
            else:
                mine = False
        if not mine:
            if owner == me:
                raise RuntimeError(f"computing {key!r} asks for itself")
            return future.result()
        try:
            result = compute()
        except BaseException as error:
            with self._lock:
                del self._running[key]
            future.set_exception(error)
            raise
        self.keep(key, result)
        with self._lock:
            del self._running[key]
        future.set_result(result)
        return result

    def geometry(self, stream: StreamModel) -> Geometry:
        """Geometry of a stream, from the cache only: computing it takes minutes.

        Raises
        ------
        Unavailable
            When the cache does not have it or it is damaged.
        """

        def compute() -> Geometry:
            dataset = self.cache.open_geometry(stream)
            if dataset is None:
                raise Unavailable(
                    "The geometry of this stream is not in the cache; run `streamdash simulate` for it once."
                )
            return Geometry.from_dataset(dataset, stream)

        return self.shared(("geometry", stream.key), compute)

    def ensemble(self, key: str) -> xr.Dataset:
        """A complete ensemble, in memory: ``density`` and ``omega`` (stream, theta)."""
        return self.shared(("ensemble", key), lambda: self.cache.open_ensemble(key).load())

    def observed(self, choices: Sequence[Choice]) -> ObservedStreams:
        """Ensembles of one stream as they are observed by default, in the bins of its description.

        Each ensemble is opened and binned once, whatever others it is compared with.

        Raises
        ------
        Unavailable
            When a stream cannot be shown in such bins, or its geometry is not there.
        """
        keys = tuple(choice.key for choice in choices)
        if len(choices) > 1:
            return self.shared(
                ("observed", *keys), lambda: ObservedStreams.join([self.observed([c]) for c in choices])
            )
        (choice,) = choices
        if choice.arms:
            return self.shared(
                ("observed", *keys),
                lambda: ObservedStreams.beside([self.observed([arm]) for arm in choice.arms]),
            )

        def compute() -> ObservedStreams:
            geometry = self.geometry(choice.config.stream)
            try:
                return ObservedStreams.of(geometry, self.ensemble(choice.key), choice.config)
            except ValueError as error:
                raise Unavailable(f"{choice.label} cannot be shown in bins of longitude: {error}.") from None

        return self.shared(("observed", *keys), compute)


@functools.lru_cache(maxsize=2)
def of_this_process(cache: Cache) -> Results:
    """The one `Results` of a cache in a worker process."""
    return Results(cache, WORKER_BYTES)


def _size(value: Any) -> int:
    """Bytes of arrays in a result, however nested; 1 kB for anything else."""
    if isinstance(value, np.ndarray):
        return value.nbytes + 128
    if isinstance(value, xr.Dataset | xr.DataArray):
        return value.nbytes + 1024
    if isinstance(value, bytes | str):
        return sys.getsizeof(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return 256 + sum(_size(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, Mapping):
        return 256 + sum(_size(item) for item in value.values())
    if isinstance(value, tuple | list):
        return 256 + sum(_size(item) for item in value)
    return 1024
