"""Slow results that follow a slider: computed off the event loop once it rests, then shown."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import panel as pn

from app.services import Services

REST_MS = 300
"""How long inputs must rest before the computation starts, in ms."""


class Later:
    """One slow result of a page, always for the newest question.

    Everything but ``compute`` runs on the session's own event loop. All sessions of the process
    take turns on one thread, so that sliders stay quick while results are made.

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
        self._number = 0
        self._document = pn.state.curdoc

    def ask(self, compute: Callable[[], Any]) -> None:
        """Show ``compute()`` when it is there, unless something newer is asked for by then."""
        self._number += 1
        number, document = self._number, self._document
        if document is None:  # outside a server there is no event loop to keep free
            self._finish(number, _settled(compute))
            return
        document.add_timeout_callback(lambda: self._start(number, compute), REST_MS)

    def cancel(self) -> None:
        """Show nothing any more that was asked for until now."""
        self._number += 1

    def _start(self, number: int, compute: Callable[[], Any]) -> None:
        if number != self._number:
            return
        future = self.services.shared(("later",), lambda: ThreadPoolExecutor(1, "later")).submit(compute)
        document = self._document
        assert document is not None  # there was one when the timer was set
        # The one call on a document that another thread may make.
        future.add_done_callback(
            lambda done: document.add_next_tick_callback(lambda: self._finish(number, done))
        )

    def _finish(self, number: int, future: Future) -> None:
        if number != self._number:
            return
        error = future.exception()
        with pn.io.hold():
            if error is None:
                self._show(future.result())
            elif isinstance(error, ValueError):
                self._fail(str(error))
            else:
                self._fail("This result failed unexpectedly; the server's log has the details.")
                raise error


def _settled(compute: Callable[[], Any]) -> Future:
    future: Future = Future()
    try:
        future.set_result(compute())
    except Exception as error:
        future.set_exception(error)
    return future
