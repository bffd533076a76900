"""Slow results that follow a slider: computed off the event loop once it rests, then shown."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import panel as pn

from app.services.services import Services

REST_S = 0.3
"""How long inputs must rest before the computation starts."""
LOOK_MS = 100
"""How often a session that waits looks whether its result is there."""
FAILED = "This result failed unexpectedly; the server's log has the details."

logger = logging.getLogger(__name__)


class Later:
    """One slow result of a page, always for the newest question.

    Everything but ``compute`` runs on the session's own event loop. All sessions of the process
    take turns on one thread, so that sliders stay quick while results are made. In contrast to
    `app.work.tasks` there is nothing to follow or to cancel: a result takes about a second.

    Parameters
    ----------
    services
        Holds the thread.
    show
        Called with the result.
    fail
        Called with a sentence when the computation raised.
    """

    def __init__(self, services: Services, show: Callable[[Any], None], fail: Callable[[str], None]) -> None:
        self.services = services
        self._show = show
        self._fail = fail
        self._wanted: Callable[[], Any] | None = None
        self._due = 0.0
        self._future: Future | None = None
        self._timer: Any = None

    def ask(self, compute: Callable[[], Any], rest_s: float = REST_S) -> None:
        """Show ``compute()`` when it is there, unless something newer is asked for by then."""
        self._wanted, self._future = compute, None
        self._due = time.monotonic() + rest_s
        if pn.state.curdoc is None:  # outside a server there is no event loop to keep free
            self._finish(_settled(compute))
        else:
            # What changes while the browser still builds the page would never reach it.
            pn.state.onload(self._watch)

    def cancel(self) -> None:
        """Show nothing any more that was asked for until now."""
        self._wanted = self._future = None
        if self._timer is not None:
            self._timer.stop()
            self._timer = None

    def _watch(self) -> None:
        if self._timer is None and self._wanted is not None:
            self._timer = pn.state.add_periodic_callback(self._look, LOOK_MS)

    def _look(self) -> None:
        """Start what has rested long enough; show what is there."""
        if self._future is None and self._wanted is not None:
            if time.monotonic() >= self._due:
                self._future = self.services.later.submit(self._wanted)
        elif self._future is not None and self._future.done():
            future = self._future
            self.cancel()
            with pn.io.hold():
                self._finish(future)

    def _finish(self, future: Future) -> None:
        error = future.exception()
        if error is None:
            self._show(future.result())
        elif isinstance(error, ValueError):
            self._fail(str(error))
        else:
            logger.error("a later result failed", exc_info=error)
            self._fail(FAILED)


def _settled(compute: Callable[[], Any]) -> Future:
    future: Future = Future()
    try:
        future.set_result(compute())
    except Exception as error:
        future.set_exception(error)
    return future
