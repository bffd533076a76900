"""Worker processes for all that takes longer than a figure, and one fair queue before them.

The server's process only waits: what is computed in it holds the interpreter's lock, and with it every
visitor's slider. Each worker is a process with lower priority and a thread here that hands it one piece
of work at a time, ends it when a piece takes too long, and replaces it when it dies.

Who comes next is decided between visitors first (by network address, where it is known, then by
session), then between kinds of work: whoever has least running and has used least of late. No Panel.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import tempfile
import threading
import time
import weakref
from collections.abc import Callable, Hashable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from cachetools import LRUCache
from loky import ProcessPoolExecutor

from streamdash.classifier.data import Cancelled
from streamdash.simulation.workers import (
    IDLE_S,
    ONE_THREAD,
    before_loky_waits,
    settle,
    spared_from_ctrl_c,
)

Compute = Callable[[Callable[[int, int], None], Callable[[], bool]], Any]
"""Called with ``progress(done, total)`` and ``should_stop()``; raises `Cancelled` when stopped.

It is sent to another process: a function of a module with `functools.partial`, or a local one whose
variables can be pickled; `app.services.results.Results` (and `Services`) can.
"""
Visitor = tuple[Hashable, ...]
"""Who asks: network address, session. Shares are equal at every level."""

logger = logging.getLogger(__name__)
NICE = 10
LONG_S = 900.0
"""Processor seconds that a training, a study or an answer may take."""
SHORT_S = 60.0
"""The same for what follows a slider."""
PATIENCE = 10.0
"""On a busy machine that may last this many times longer."""
STOP_S = 10.0
"""A piece that was asked to stop is ended by force after this long."""
START_S = 300.0
"""A worker has this long to start."""
LOOK_S = 0.1
SOON_S = 5.0
"""A worker that would end this soon does not count as there."""
WAITING_MAX = 400
"""Pieces that wait at the same time."""
WAITING_PER_LEVEL = (200, 30)
"""Those of one network address, and of one session."""
HALF_LIFE_S = 60.0
"""What a visitor has used counts half after this long."""
REMEMBERED = 4096
DIED = (
    "The process that computed this was ended from outside, perhaps for want of memory; nothing else was "
    "lost: try again."
)


class Full(ValueError):
    """The queue takes no more; the message is one sentence."""


class Piece:
    """One piece of work: waiting, running or ended (then `future` is done).

    Attributes
    ----------
    future : Future
        Its result or what it raised; `TimeoutError`, with a sentence, when it took too long.
    done, total : float
        How far it says it is.
    version : int
        Rises with every change, for those who look.
    """

    def __init__(self, compute: Compute, visitor: Visitor, kind: str, short: bool, limit_s: float) -> None:
        self.compute, self.short, self.limit_s = compute, short, limit_s
        self.paths = tuple((*visitor, kind)[: i + 1] for i in range(len(visitor) + 1))
        self.future: Future = Future()
        self.done, self.total = 0.0, 1.0
        self.version = 0
        self._stop = threading.Event()

    def stop(self) -> None:
        """Ask it to end: at once when it waits, else at its next step, or by force soon after."""
        self._stop.set()
        self.future.cancel()
        self.version += 1

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end."""
        return self._stop.is_set()

    def look(self, board: np.ndarray) -> None:
        """Take over how far it is."""
        if (self.done, self.total) != (board[0], board[1]):
            self.done, self.total = float(board[0]), float(board[1])
            self.version += 1


class Pool:
    """Workers with one fair queue.

    Parameters
    ----------
    workers : int
        How many pieces are computed at the same time; one of them, where there are two or more, only
        takes short ones, so that no figure waits for a training.
    processes : bool
        False computes on threads of this process, which cannot be ended by force.
    long_s, short_s : float
        Processor seconds that a piece may take, and by the clock `PATIENCE` times as long.
    nice : int
        How much worker processes stand back for the page itself (0 to 19).
    """

    def __init__(
        self,
        workers: int = 2,
        processes: bool = True,
        long_s: float = LONG_S,
        short_s: float = SHORT_S,
        nice: int = NICE,
    ) -> None:
        self.long_s, self.short_s, self.nice = long_s, short_s, nice
        self._waiting: list[Piece] = []
        self._running: list[Piece] = []
        self._idle: set[_Lane] = set()
        self._used: LRUCache[tuple, tuple[float, float]] = LRUCache(REMEMBERED)
        self._changed = threading.Condition()
        self._closed = False
        self._lanes = [_Lane(self, processes, only_short=0 < i == workers - 1) for i in range(workers)]
        self._ends_with_process = False

    def submit(self, compute: Compute, visitor: Visitor = (), kind: str = "", short: bool = False) -> Piece:
        """Queue a piece of work.

        Raises
        ------
        Full
            When too much waits already, of all visitors or of this one.
        """
        piece = Piece(compute, visitor, kind, short, self.short_s if short else self.long_s)
        with self._changed:
            self._waiting = [other for other in self._waiting if not other.future.cancelled()]
            self._check_room(piece, len(visitor))
            self._waiting.append(piece)
            for lane in self._lanes:
                lane.start()
            self._changed.notify_all()
        return piece

    def _check_room(self, piece: Piece, levels: int) -> None:
        counts = [sum(path in other.paths for other in self._waiting) for path in piece.paths[:levels]]
        mine = any(count >= most for count, most in zip(counts, WAITING_PER_LEVEL, strict=False))
        if mine or len(self._waiting) >= WAITING_MAX:
            raise Full(
                f"As much work {'of yours ' if mine else ''}waits on this server as it takes; try again in a "
                "few minutes."
            )

    @property
    def waiting(self) -> int:
        """How many pieces wait."""
        with self._changed:
            return sum(not piece.future.cancelled() for piece in self._waiting)

    def close(self) -> None:
        """Compute nothing more; what runs is ended."""
        with self._changed:
            self._closed = True
            for piece in (*self._waiting, *self._running):
                piece.stop()
            self._changed.notify_all()
        for lane in self._lanes:
            lane.close()

    # ------------------------------------------------------------ for the lanes

    def end_with_process(self) -> None:
        """Have a process that ends close this pool; asked for once its first worker is there."""
        with self._changed:
            if self._ends_with_process:
                return
            self._ends_with_process = True
        here = weakref.ref(self)
        before_loky_waits(lambda: None if (pool := here()) is None else pool.close())

    def take(self, lane: _Lane) -> Piece | None:
        """Wait for the next piece; None when there will be none."""
        with self._changed:
            while not self._closed:
                fit = [piece for piece in self._waiting if piece.short or not lane.only_short]
                if fit and not self._left_to_another(lane, fit):
                    piece = min(fit, key=self._claim)  # the earliest of equals
                    self._waiting.remove(piece)
                    if piece.future.set_running_or_notify_cancel():
                        piece.version += 1
                        self._running.append(piece)
                        return piece
                    continue
                self._idle.add(lane)
                self._changed.wait()
                self._idle.discard(lane)
        return None

    def _left_to_another(self, lane: _Lane, fit: list[Piece]) -> bool:
        """Whether lanes that wait have a worker already, for all the pieces that this one could take."""
        if lane.warm:
            return False
        ready = [other for other in self._idle if other is not lane and other.warm]
        long = sum(not piece.short for piece in fit)
        return len(ready) >= len(fit) and sum(not other.only_short for other in ready) >= long

    def release(self, piece: Piece, seconds: float) -> None:
        """A piece has ended; what it took is held against who asked."""
        with self._changed:
            self._running.remove(piece)
            now = time.monotonic()
            for path in piece.paths:
                self._used[path] = (self._recently(path, now) + seconds, now)

    def _claim(self, piece: Piece) -> tuple:
        """The smaller, the sooner: at each level how much runs, then how much was used of late."""
        now = time.monotonic()
        return tuple(
            number
            for path in piece.paths
            for number in (sum(path in other.paths for other in self._running), self._recently(path, now))
        )

    def _recently(self, path: tuple, now: float) -> float:
        seconds, then = self._used.get(path, (0.0, now))
        return round(seconds * 0.5 ** ((now - then) / HALF_LIFE_S), 2)


class _Lane:
    """One worker process and the thread that hands it work."""

    def __init__(self, pool: Pool, processes: bool, only_short: bool) -> None:
        self._pool, self._processes, self.only_short = pool, processes, only_short
        self._ended = -math.inf
        self._executor: Executor | None = None
        self._board = np.zeros(5)
        self._file: Path | None = None
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread, once."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="lane", daemon=True)
            self._thread.start()

    @property
    def warm(self) -> bool:
        """Whether its worker is there, and does not end for want of work in the next moments."""
        return self._executor is not None and time.monotonic() - self._ended < IDLE_S - SOON_S

    def close(self) -> None:
        """End the worker."""
        self._kill()
        if self._file is not None:
            self._file.unlink(missing_ok=True)

    def _run(self) -> None:
        while (piece := self._pool.take(self)) is not None:
            start = time.monotonic()
            outcome: Any = None
            raised: BaseException | None = None
            try:
                outcome = self._work(piece)
            except BaseException as error:
                raised = error
            self._ended = time.monotonic()
            self._pool.release(piece, self._ended - start)
            if raised is not None:
                piece.future.set_exception(raised)
            else:
                piece.future.set_result(outcome)
            piece.version += 1
            del piece, outcome, raised  # nothing of it is kept while the lane waits

    def _work(self, piece: Piece) -> Any:
        """Result of a piece; the worker is ended when it takes too long."""
        start, stopped, begun = time.monotonic(), None, None
        try:
            inner = self._begin(piece)
            while not inner.done():
                with contextlib.suppress(TimeoutError):
                    inner.exception(LOOK_S)
                piece.look(self._board)
                now = time.monotonic()
                if piece.stopping and stopped is None:
                    self._board[2], stopped = 1.0, now
                if not self._board[3] and now - start < START_S:
                    continue  # the worker is still importing what it needs
                if begun is None:
                    begun, start = self._processor_s(), now
                used = min(self._processor_s() - begun, now - start)
                too_long = max(used, (now - start) / PATIENCE) > piece.limit_s
                if too_long or (stopped is not None and now - stopped > STOP_S):
                    self._kill()
                    if stopped is not None:
                        raise Cancelled
                    raise TimeoutError(
                        f"This took longer than the {_duration(piece.limit_s)} that this server gives to one "
                        "piece of work, and was stopped; choose fewer streams or coarser settings."
                    )
            outcome = inner.result()
            if piece.stopping:  # who asks again has begun anew: of one question there are not two results
                raise Cancelled
            return outcome
        except BrokenExecutor as error:
            self._kill()
            logger.warning("a worker process died: %s", error)
            raise ChildProcessError(DIED) from None

    def _processor_s(self) -> float:
        """Processor time of the worker; by the clock where the system does not say."""
        if self._processes:
            with contextlib.suppress(OSError, ValueError, IndexError, AttributeError):
                words = (
                    Path(f"/proc/{int(self._board[4])}/stat").read_text(encoding="ascii").rpartition(")")[2]
                )
                return sum(int(word) for word in words.split()[11:13]) / os.sysconf("SC_CLK_TCK")
        return time.monotonic()

    def _begin(self, piece: Piece) -> Future:
        if self._executor is None:
            self._executor = self._new()
        self._board[:] = (0.0, 1.0, 0.0, 0.0, 0.0)
        if self._processes:
            with spared_from_ctrl_c():
                begun = self._executor.submit(_compute, piece.compute)
            self._pool.end_with_process()
            return begun
        return self._executor.submit(_run_with, piece.compute, self._board)

    def _new(self) -> Executor:
        if not self._processes:
            return ThreadPoolExecutor(1, "lane")
        if self._file is None:
            handle, name = tempfile.mkstemp(prefix="streamdash-")
            with os.fdopen(handle, "wb") as file:
                file.write(self._board.tobytes())  # all its bytes have a place on the disk from now on
            self._file = Path(name)
            self._board = _board(name)
        return ProcessPoolExecutor(
            1,
            timeout=IDLE_S,
            initializer=_settle,
            initargs=(os.getpid(), self._pool.nice, str(self._file)),
            env=ONE_THREAD,
        )

    def _kill(self) -> None:
        executor, self._executor = self._executor, None
        if executor is None:
            return
        if self._processes:
            executor.shutdown(wait=False, kill_workers=True)  # type: ignore[call-arg]
        else:
            executor.shutdown(wait=False)


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} minutes" if seconds >= 120 else f"{seconds:.3g} seconds"


# ---------------------------------------------------------------- in the worker process

_own_board: list[np.ndarray] = []


def _board(name: str) -> np.ndarray:
    """Done, total, "stop", "begun" and who computes; without a lock, which a killed worker could hold."""
    return np.memmap(name, dtype=float, mode="r+", shape=(5,))


def plain(compute: Callable[[], Any], progress: Any, should_stop: Any) -> Any:
    """A computation that knows nothing of progress, as `Compute`."""
    return compute()


def _settle(parent: int, nice: int, board: str) -> None:
    settle(parent, nice)
    _own_board[:] = [_board(board)]


def _compute(compute: Compute) -> Any:
    return _run_with(compute, _own_board[0])


def _run_with(compute: Compute, board: np.ndarray) -> Any:
    board[4], board[3] = os.getpid(), 1.0

    def progress(done: int, total: int) -> None:
        board[:2] = (done, max(total, 1))

    return compute(progress, lambda: bool(board[2]))
