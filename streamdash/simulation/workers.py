"""Who computes: this process, worker processes of this machine, or a Dask cluster.

One way of handing out independent pieces of work for all three, so that what is computed is the same
code wherever it runs.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
import weakref
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from itertools import islice
from typing import Any, TypeVar

from loky import cpu_count, get_reusable_executor
from threadpoolctl import threadpool_limits

T = TypeVar("T")

PARENT_POLL_S = 1.0
IDLE_S = 300
"""Worker processes without work end after this long."""
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
)
"""Environment of worker processes: one core each."""
_ending = threading.Event()
"""This process is about to end."""
_handing_out = threading.Lock()
"""Held while worker processes are given work; none is given once `_ending` is set."""
_given: weakref.WeakSet[Future] = weakref.WeakSet()
"""What worker processes have been given and somebody waits for."""
SETTLED_S = 2.0
"""Seconds that a process which ends waits at most for loky to take up what it was given last."""
ENDING = "This process is ending; what was finished is kept."


class WorkerError(RuntimeError):
    """A worker could not do its part; what was finished is kept."""


def results(
    function: Callable[..., T],
    pieces: Iterable[tuple],
    executor: str = "processes",
    workers: int | None = None,
    nice: int = 0,
) -> Generator[T]:
    """``function(*piece)`` for every piece, in the order in which they are finished.

    Parameters
    ----------
    executor : {"inline", "processes", "dask"}
        This process, worker processes of this machine, or the Dask cluster of the active
        ``distributed.Client``.
    workers : how many worker processes; one per core by default.
    nice : how much worker processes of this machine stand back for others (0 to 19).

    Raises
    ------
    WorkerError
        When a worker was killed, or the cluster is gone.
    ValueError
        When the executor does not exist; whatever `function` raises is passed on as well.
    """
    with _as_worker_error():
        if executor == "inline":
            yield from (_work(function, piece) for piece in pieces)
        elif executor == "processes":
            yield from _from_processes(function, pieces, workers or cpu_count(), nice)
        elif executor == "dask":
            yield from _from_cluster(function, pieces)
        else:
            raise ValueError(f"executor: {executor!r} is none of inline, processes, dask")


def _from_processes(
    function: Callable[..., T], pieces: Iterable[tuple], n_workers: int, nice: int
) -> Generator[T]:
    """Results from worker processes of this machine, which all computations of this process share.

    What is given up is only taken out of the queue: others compute there too.
    """
    coming = iter(pieces)

    def submit(most: int) -> set[Future[T]]:
        with _handing_out, spared_from_ctrl_c():
            if _ending.is_set():
                raise WorkerError(ENDING)
            # Asked for each time, as workers that were killed or ended are replaced as a whole.
            executor = get_reusable_executor(
                n_workers, timeout=IDLE_S, initializer=settle, initargs=(os.getpid(), nice), env=ONE_THREAD
            )
            given = {executor.submit(_work, function, piece) for piece in islice(coming, most)}
            _given.update(given)
            return given

    waiting = submit(2 * n_workers)  # no worker waits for this process
    _end_workers_at_exit()
    try:
        while waiting:
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
            waiting |= submit(len(finished))
    finally:
        for future in waiting:
            future.cancel()


def _from_cluster(function: Callable[..., T], pieces: Iterable[tuple]) -> Generator[T]:
    """Results from the Dask cluster of the active client."""
    from distributed import as_completed, get_client

    client, coming = get_client(), iter(pieces)

    def submit(most: int) -> set[Any]:
        return {client.submit(_work, function, piece, pure=False) for piece in islice(coming, most)}

    waiting = submit(2 * max(1, sum(client.nthreads().values())))  # no worker waits for this process
    finished = as_completed(waiting)
    try:
        for future in finished:
            yield future.result()
            more = submit(1)
            waiting = waiting - {future} | more  # what nobody holds is let go of by the cluster
            finished.update(more)
    finally:
        with contextlib.suppress(Exception):  # the cluster may be gone
            client.cancel(waiting)


def is_ending() -> bool:
    """Whether this process is about to end, so that new workers would be of no use."""
    return _ending.is_set()


@lru_cache(maxsize=1)
def _end_workers_at_exit() -> None:
    """Have a process that ends kill its workers, instead of waiting for all they have been given."""

    def end() -> None:
        with _handing_out:
            _ending.set()
        # Killed before it has taken up what it was given, loky's thread fails with a KeyError (3.6).
        deadline = time.monotonic() + SETTLED_S
        while any(not (one.running() or one.done()) for one in list(_given)):
            if time.monotonic() > deadline:  # more than its queue holds: then it takes nothing up
                break
            time.sleep(0.01)
        kill_workers()

    before_loky_waits(end)


def kill_workers() -> None:
    """End the worker processes that all computations of this process share; what they compute is lost."""
    get_reusable_executor(reuse=True).shutdown(wait=False, kill_workers=True)


def before_loky_waits(end: Callable[[], None]) -> None:
    """Have `end` called when this process ends, before loky waits for what its workers were given.

    loky waits in a callback that it registers just like this when it starts; the latest is called
    first, and those of ``atexit`` come too late.
    """
    register = getattr(threading, "_register_atexit", None)
    if register is not None:
        register(end)


@contextlib.contextmanager
def spared_from_ctrl_c() -> Generator[None]:
    """Start processes that Ctrl-C on the terminal does not reach: the parent ends them, and a worker
    that is still importing would print a traceback."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(function: Callable[..., T], piece: tuple) -> T:
    """One piece, wherever it is computed."""
    with threadpool_limits(limits=1):  # one core a worker, and sums in one order
        return function(*piece)


def settle(parent: int, nice: int) -> None:
    """Make this worker process, which has just begun, end when process `parent` does, and stand back."""

    # Workers of a killed process would wait for work for ever: each holds the others' pipe open.
    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_POLL_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    with contextlib.suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # for workers that loky replaced later
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, 0, nice)


@contextlib.contextmanager
def _as_worker_error() -> Generator[None]:
    """Say in one sentence what became of the workers."""
    try:
        yield
    except BrokenProcessPool as error:
        raise WorkerError(
            "A worker process was killed, perhaps for want of memory; what was finished is kept: "
            "run this again with fewer workers to resume."
        ) from error
    except Exception as error:
        if _ending.is_set():
            raise WorkerError(ENDING) from error
        if not _is_of_dask(error):
            raise
        raise WorkerError(
            f"The Dask cluster lost its workers ({type(error).__name__}); what was finished is kept: "
            "run this again to resume."
        ) from error


def _is_of_dask(error: Exception) -> bool:
    """Whether an exception is Dask's own, without importing what may not be installed."""
    return any(cls.__module__.split(".")[0] in ("distributed", "dask") for cls in type(error).__mro__)


def cluster(scheduler: str | None) -> Any:
    """A client of the Dask cluster at an address, or of a new one on this machine.

    Raises
    ------
    WorkerError
        When Dask is not installed or the scheduler does not answer.
    """
    try:
        from distributed import Client
    except ImportError:
        raise WorkerError("Dask is not installed: pip install 'streamdash[dask]'.") from None
    try:
        if scheduler:
            return Client(scheduler, timeout="10s")
        return Client(threads_per_worker=1, dashboard_address=None)
    except (OSError, ValueError, TypeError) as error:  # TypeError: tls:// without certificates
        raise WorkerError(f"The Dask scheduler {scheduler} cannot be reached ({error}).") from None
