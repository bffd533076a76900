"""Long computations with progress and cancel, shared by all sessions of the process.

One thread works; it never touches a Bokeh document. It writes to a `Task`; sessions that wait for
it look at it from their own event loop (`Watch`), and only while they wait.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import panel as pn
from cachetools import LRUCache

from streamdash.classifier.data import Cancelled

Compute = Callable[[Callable[[int, int], None], Callable[[], bool]], Any]
"""Called with ``progress(done, total)`` and ``should_stop()``; raises `Cancelled` when stopped."""

logger = logging.getLogger(__name__)
KEPT = 64
"""Tasks that are remembered, with their results."""
POLL_MS = 250


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
        self.state = "waiting"
        self.fraction = 0.0
        self.version = 0
        self.result: Any = None
        self.error = ""
        self.waiting_for_it = 0
        self._stop = threading.Event()

    @property
    def active(self) -> bool:
        """Whether it waits or runs."""
        return self.state in ("waiting", "running")

    @property
    def stopping(self) -> bool:
        """Whether it was asked to end."""
        return self._stop.is_set()

    def stop(self) -> None:
        """Ask it to end; it does at its next step."""
        self._stop.set()

    def run(self, compute: Compute) -> None:
        """Work it off, on the calling thread."""
        if self.stopping:
            self._change("cancelled")
            return
        self._change("running")
        try:
            self.result = compute(self._progress, self._stop.is_set)
        except Cancelled:
            self._change("cancelled")
        except ValueError as error:
            self.error = str(error)
            self._change("failed")
        except Exception:
            logger.exception("task %r failed", self.key)
            self.error = "This computation failed unexpectedly; the server's log has the details."
            self._change("failed")
        else:
            self.fraction = 1.0
            self._change("done")

    def _progress(self, done: int, total: int) -> None:
        self.fraction = done / max(total, 1)
        self.version += 1

    def _change(self, state: str) -> None:
        self.state = state
        self.version += 1


class Work:
    """The tasks of one server process, by key, and the thread that does them one after the other."""

    def __init__(self) -> None:
        self._tasks: LRUCache[Hashable, Task] = LRUCache(KEPT)
        self._lock = threading.Lock()
        self._thread = ThreadPoolExecutor(1, "work", initializer=_be_nice)

    def find(self, key: Hashable) -> Task | None:
        """The task of that key, unless it was never asked for, has failed, was cancelled or is forgotten."""
        with self._lock:
            task = self._tasks.get(key)
        return task if task is not None and (task.active or task.state == "done") else None

    def ask(self, key: Hashable, compute: Compute) -> Task:
        """Start a task, or join the one of the same key."""
        with self._lock:
            task = self._tasks.get(key)
            if task is not None and task.state in ("waiting", "running", "done") and not task.stopping:
                return task
            task = Task(key)
            self._tasks[key] = task
        self._thread.submit(task.run, compute)
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
        self.leave()
        self.following, self._seen = task, -1
        task.waiting_for_it += 1
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


def _be_nice() -> None:
    """Let the event loop go first where threads can be ranked: moving sliders matter more."""
    with contextlib.suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 5)
