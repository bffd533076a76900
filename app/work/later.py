"""Slow results that follow a slider: computed by a worker once it rests, then shown."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any

import panel as pn

from app.services.services import Services
from app.work.pool import plain
from app.work.tasks import Task, Work

REST_S = 0.3
"""How long inputs must rest before the computation starts."""
LOOK_MS = 100
"""How often a session that waits looks whether its result is there."""


class Later:
    """One slow result of a page, always for the newest question.

    Everything but ``compute`` runs on the session's own event loop. In contrast to `app.work.tasks.Watch`
    there is no progress to follow: a result takes about a second.

    Parameters
    ----------
    services
        Has the workers, and keeps results.
    show
        Called with the result.
    fail
        Called with a sentence when the computation failed.
    work
        Who computes, if not `Services.quick`.
    """

    def __init__(
        self,
        services: Services,
        show: Callable[[Any], None],
        fail: Callable[[str], None],
        work: Work | None = None,
    ) -> None:
        self.services = services
        self._work = work or services.quick
        self._show = show
        self._fail = fail
        self._wanted: Callable[[], Any] | None = None
        self._key: Hashable = None
        self._keep = True
        self._due = 0.0
        self._task: Task | None = None
        self._timer: Any = None

    def ask(
        self, compute: Callable[[], Any], rest_s: float = REST_S, key: Hashable = None, keep: bool = True
    ) -> None:
        """Show ``compute()`` when it is there, unless something newer is asked for by then.

        Parameters
        ----------
        compute
            Sent to another process: see `app.work.pool.Compute`.
        rest_s
            How long nothing newer may be asked for before it starts.
        key
            Everything that the result depends on, starting with a name of its kind: the result is then
            kept for all sessions, and computed once for those who ask at the same time.
        keep
            False keeps nothing: the result is only shared by those who wait for it together.
        """
        self._let_go()
        self._wanted, self._key, self._keep = compute, key, keep
        self._due = time.monotonic() + rest_s
        if pn.state.curdoc is None:  # outside a server there is no event loop to keep free
            self._due = 0.0
            self._look()
            if self._task is not None:
                self._task.wait()
                self._look()
        else:
            # What changes while the browser still builds the page would never reach it.
            pn.state.onload(self._watch)

    def cancel(self) -> None:
        """Show nothing any more that was asked for until now."""
        self._let_go()
        self._wanted = None
        if self._timer is not None:
            self._timer.stop()
            self._timer = None

    def _let_go(self) -> None:
        """Compute no more what nobody waits for."""
        task, self._task = self._task, None
        if task is not None:
            task.waiting_for_it -= 1
            if task.waiting_for_it <= 0 and task.active:
                task.stop()

    def _watch(self) -> None:
        if self._timer is None and self._wanted is not None:
            self._timer = pn.state.add_periodic_callback(self._look, LOOK_MS)

    def _start(self) -> None:
        assert self._wanted is not None
        key = object() if self._key is None else self._key
        self._task = self._work.ask(key, partial(plain, self._wanted), short=True)
        self._task.waiting_for_it += 1

    def _look(self) -> None:
        """Start what has rested long enough; show what is there."""
        if self._wanted is None:
            return
        known = None if self._key is None or not self._keep else self.services.known(self._key)
        if known is not None:
            self.cancel()
            with pn.io.hold():
                self._show(known)
        elif self._task is None:
            if time.monotonic() >= self._due:
                self._start()
        elif not self._task.active:
            task, key = self._task, self._key
            self.cancel()
            self._work.forget(task.key)
            with pn.io.hold():
                if task.state == "done":
                    if key is not None and self._keep:
                        self.services.keep(key, task.result)
                    self._show(task.result)
                elif task.state == "failed":
                    self._fail(task.error)
