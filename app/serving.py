"""From a new browser session to its page, and the server settings all sessions share."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from typing import Any

import panel as pn
from bokeh.server.views.ws import WSHandler
from panel.io.resources import LOCAL_DIST
from panel.viewable import Viewable

from app.borrowed import forget_view
from app.guard import keep_closed_sockets_short, repair_curdoc, say_fault
from app.pages.registry import PAGES
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from streamdash.store.keeping import mark_used

MARK_S = 120
"""How often a session notes which ensembles it uses; more often than they may be removed after."""


def open_session(services: Services) -> Viewable:
    """Build the app for the browser session that is being served now."""
    repair_curdoc()
    keep_closed_sockets_short()
    send_small_messages_at_once()
    pn.extension(
        exception_handler=say_fault,
        notifications=True,
        reconnect=True,
        disconnect_notification="The connection to the server was lost; trying again …",
    )
    load_styles_from_here()
    services.watch.start()
    seen = services.watch.version
    session = Session(tuple(page.key for page in PAGES), services.catalog())
    session.load(pn.state.location.search if pn.state.location else "")
    services.sessions.add(session)
    document = pn.state.curdoc
    assert document is not None, "a browser session is being served"
    # The browser loads its scripts while the page is built, instead of waiting for it.
    shell = Shell(session, services, PAGES, document.add_next_tick_callback)
    notifications = pn.state.notifications
    news = News(session, services, seen)
    pn.state.onload(news.start)

    def end(_: Any) -> None:
        with contextlib.ExitStack() as stack:  # each of them, also when another one raises
            stack.callback(forget_view, notifications)
            stack.callback(services.leave, session)
            stack.callback(shell.close)
            stack.callback(news.stop)

    pn.state.on_session_destroyed(end)
    return shell.view


class News:
    """Brings one session what has changed in the cache, on the session's own event loop."""

    def __init__(self, session: Session, services: Services, seen: int) -> None:
        self.session, self.services = session, services
        self._seen = seen
        self._marked = -math.inf
        self._leave: Callable[[], None] | None = None

    def start(self) -> None:
        """Look from now on whenever the cache has changed, and every `MARK_S`."""
        watch = self.services.watch
        self.look()
        self._leave = self.services.bell.follow(
            lambda: (watch.version, int(time.monotonic() / MARK_S)), self.look
        )

    def stop(self) -> None:
        """Look no more."""
        if self._leave is not None:
            self._leave()
            self._leave = None

    def look(self) -> None:
        """Hand a newer catalog to the session; note which ensembles it uses, so that they stay."""
        watch = self.services.watch
        if watch.version != self._seen and watch.catalog is not None:
            self._seen = watch.version
            with pn.io.hold():
                self.session.refresh(watch.catalog)
        if time.monotonic() - self._marked > MARK_S / 2:
            self._marked = time.monotonic()
            for key in self.session.mass:
                mark_used(self.services.cache, key)


def load_styles_from_here() -> None:
    """Have this session's components ask this server for their styles from the beginning.

    Panel 1.9.4 says so to a document only when its page is sent. What is built before, or for a browser
    that comes back by its WebSocket alone, would name Panel's public server, which the doors' policy forbids.
    """
    document = pn.state.curdoc
    if document is not None:
        here = "/".join(part for part in (pn.state.rel_path, LOCAL_DIST.rstrip("/")) if part)
        document.template_variables.setdefault("dist_url", f"{here}/")


def send_small_messages_at_once() -> None:
    """Turn Nagle's algorithm off on every WebSocket.

    Tornado leaves it on; a slider's small messages then wait for the browser's delayed
    acknowledgements (median 110 ms instead of 44 ms with 20 sessions).
    """
    if getattr(WSHandler.open, "nodelay", False):
        return
    opened = WSHandler.open

    def open_without_delay(handler: WSHandler, *args: Any, **kwargs: Any) -> Any:
        handler.set_nodelay(True)
        return opened(handler, *args, **kwargs)

    open_without_delay.nodelay = True  # type: ignore[attr-defined]
    WSHandler.open = open_without_delay  # type: ignore[method-assign]
