"""Tells sessions that something has changed; while nothing does, they cost nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import panel as pn
from bokeh.document import Document
from panel.io.state import set_curdoc
from tornado.ioloop import PeriodicCallback

LOOK_MS = 250


@dataclass
class _Follower:
    version: Callable[[], Hashable]
    react: Callable[[], Any]
    document: Document
    every_s: float
    seen: Hashable
    called: float = 0.0
    waits: bool = False


class Bell:
    """One timer of the server's event loop for all sessions.

    It compares what they follow with what they have seen, which takes a microsecond each, and calls only
    those for whom it has changed: a timer of its own would lock and unlock each session's document every
    time.
    """

    def __init__(self) -> None:
        self._followers: dict[int, _Follower] = {}
        self._count = 0
        self._timer: PeriodicCallback | None = None

    def follow(
        self, version: Callable[[], Hashable], react: Callable[[], Any], every_s: float = 0.0
    ) -> Callable[[], None]:
        """Call ``react()`` on this session's event loop whenever ``version()`` is another one.

        Parameters
        ----------
        version
            Quick, and of shared things only: it is called outside the session.
        react
            Called as a handler of the session that is being served now.
        every_s
            Least time between two calls.

        Returns
        -------
        callable
            Ends it.
        """
        document = pn.state.curdoc
        assert document is not None, "a browser session is being served"
        self._count += 1
        number = self._count
        self._followers[number] = _Follower(version, react, document, every_s, version())
        if self._timer is None:
            self._timer = PeriodicCallback(self._compare, LOOK_MS)
            self._timer.start()

        def leave() -> None:
            self._followers.pop(number, None)
            if not self._followers and self._timer is not None:
                self._timer.stop()
                self._timer = None

        return leave

    def __len__(self) -> int:
        return len(self._followers)

    def _compare(self) -> None:
        now = time.monotonic()
        for number, follower in list(self._followers.items()):
            if follower.waits or now - follower.called < follower.every_s:
                continue
            version = follower.version()
            if version != follower.seen:
                follower.seen, follower.called, follower.waits = version, now, True
                with set_curdoc(follower.document):
                    pn.state.execute(lambda number=number: self._call(number), schedule=True)  # type: ignore[misc]

    def _call(self, number: int) -> None:
        follower = self._followers.get(number)  # gone when its session has ended meanwhile
        if follower is not None:
            follower.waits = False
            follower.react()
