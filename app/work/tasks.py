"""Long computations with progress and cancel, shared by all sessions of the process.

The workers of `app.work.pool` compute; they never touch a Bokeh document. Sessions that wait for a `Task`
look at it from their own event loop (`Watch`), and only while they wait.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import CancelledError, Future
from typing import Any

import panel as pn
from cachetools import LRUCache

from app.services.results import Unavailable
from app.session.visitor import this_visitor
from app.work.pool import Compute, Full, Piece, Pool
from streamdash.classifier.data import Cancelled
from streamdash.store.cache import StoreError

__all__ = ["Compute", "Task", "Watch", "Work"]

logger = logging.getLogger(__name__)
KEPT = 64
"""Tasks that are remembered, with their results."""
POLL_MS = 250
SENTENCES = (ValueError, TimeoutError, ChildProcessError, Unavailable, StoreError)
"""Errors whose message is a sentence for the person who waits."""
UNEXPECTED = "This computation failed unexpectedly; the server's log has the details."


class Task:
    """One computation: waiting, running, done, failed or cancelled.

    Attributes
    ----------
    state : str
    fraction : float
        How much of it is done, 0 to 1.
    version : int
        Rises with every change, for those who look.
    result : Any
        When it is done.
    error : str
        When it has failed: one sentence.
    """

    def __init__(self, key: Hashable) -> None:
        self.key = key
        self.result: Any = None
        self.error = ""
        self.waiting_for_it = 0
        self._ended = ""
        self._version = 0
        self._piece: Piece | None = None
        self._over = threading.Event()

    @property
    def state(self) -> str:
        """What becomes of it now."""
        if self._ended:
            return self._ended
        return "running" if self._piece is not None and self._piece.future.running() else "waiting"

    @property
    def fraction(self) -> float:
        """How much of it is done."""
        if self._ended == "done":
            return 1.0
        piece = self._piece
        return 0.0 if piece is None else min(piece.done / max(piece.total, 1.0), 1.0)

    @property
    def version(self) -> int:
        """Another number whenever something has changed."""
        return self._version + (0 if self._piece is None else self._piece.version)

    @property
    def active(self) -> bool:
        """Whether it waits or runs."""
        return not self._ended

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end."""
        return self._piece is not None and self._piece.stopping

    def wait(self) -> None:
        """Wait until it has ended; only for those who keep nobody else waiting."""
        self._over.wait()

    def stop(self) -> None:
        """Ask it to end; it does at its next step."""
        if self._piece is not None:
            self._piece.stop()

    def follow(self, piece: Piece) -> None:
        """Become what becomes of a piece of work."""
        self._piece = piece
        piece.future.add_done_callback(self._settle)

    def fail(self, sentence: str) -> None:
        """End without having begun."""
        self.error = sentence
        self._end("failed")

    def _settle(self, future: Future) -> None:
        try:
            self.result = future.result()
        except (Cancelled, CancelledError):
            self._end("cancelled")
        except SENTENCES as error:
            self.fail(str(error))
        except BaseException as error:
            logger.error("task %r failed", self.key, exc_info=error)
            self.fail(UNEXPECTED)
        else:
            self._end("done")

    def _end(self, state: str) -> None:
        self._ended = state
        self._version += 1
        self._over.set()


class Work:
    """The tasks of one server process, by key, and the pool that computes them.

    Parameters
    ----------
    pool : Pool, optional
        Without one, a thread of this process computes one task after the other.
    """

    def __init__(self, pool: Pool | None = None) -> None:
        self.pool = pool or Pool(1, processes=False)
        self._tasks: LRUCache[Hashable, Task] = LRUCache(KEPT)
        self._lock = threading.Lock()

    def find(self, key: Hashable) -> Task | None:
        """The task of that key, unless it was never asked for, has failed, was cancelled or is forgotten."""
        with self._lock:
            task = self._tasks.get(key)
        return task if task is not None and (task.active or task.state == "done") else None

    def ask(self, key: Hashable, compute: Compute, short: bool = False) -> Task:
        """Start a task, or join the one of the same key; the share is that of the session that asks.

        Parameters
        ----------
        key
            Everything that the result depends on, starting with a name of its kind.
        compute
            See `app.work.pool.Compute`: it runs in another process.
        short
            Whether it is one of those that take about a second.
        """
        with self._lock:
            task = self._tasks.get(key)
            if task is not None and task.state in ("waiting", "running", "done") and not task.stopping:
                return task
            task = Task(key)
            self._tasks[key] = task
        kind = str(key[0]) if isinstance(key, tuple) and key else str(key)
        try:
            task.follow(self.pool.submit(compute, this_visitor(), kind, short))
        except Full as refusal:
            task.fail(str(refusal))
        return task

    def forget(self, key: Hashable) -> None:
        """Let go of a task, and of its result, unless somebody waits for it."""
        with self._lock:
            task = self._tasks.get(key)
            if task is not None and task.waiting_for_it <= 0:
                del self._tasks[key]


class Watch:
    """One session's interest in one task at a time.

    Parameters
    ----------
    show : callable
        Called with the task on the session's event loop whenever it has changed.

    Attributes
    ----------
    following : Task or None
        The task that is looked at.
    """

    def __init__(self, show: Callable[[Task], None]) -> None:
        self._show = show
        self.following: Task | None = None
        self._seen = -1
        self._timer: Any = None

    def follow(self, task: Task) -> None:
        """Show this task from now on, instead of any other."""
        task.waiting_for_it += 1  # before it is left: nobody else may be waiting for it
        self.leave()
        self.following, self._seen = task, -1
        if pn.state.curdoc is not None and task.active:
            # What changes while the browser still builds the page would never reach it.
            pn.state.onload(self._look_on)
        self.look()

    def cancel(self) -> None:
        """Stop waiting; the task is stopped when nobody else waits for it."""
        task = self.following
        self.leave()
        if task is not None:
            self._show(task)

    def leave(self) -> None:
        """Look no more; a task that nobody waits for is stopped."""
        if self._timer is not None:
            self._timer.stop()
            self._timer = None
        if self.following is not None:
            self.following.waiting_for_it -= 1
            if self.following.waiting_for_it <= 0 and self.following.active:
                self.following.stop()
            self.following = None

    def _look_on(self) -> None:
        if self._timer is None and self.following is not None:
            self._timer = pn.state.add_periodic_callback(self.look, POLL_MS)

    def look(self) -> None:
        """Show the task if it has changed; called by a timer on the session's event loop."""
        task = self.following
        if task is None or task.version == self._seen:
            return
        self._seen = task.version
        active = task.active
        with pn.io.hold():
            self._show(task)
        if not active:
            self.leave()
