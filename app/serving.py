"""From a new browser session to its page, and the server settings all sessions share."""

from __future__ import annotations

from typing import Any

import panel as pn
from bokeh.server.views.ws import WSHandler
from panel.viewable import Viewable

from app.pages import PAGES
from app.services import Services
from app.shell import Shell
from app.state import Session


def open_session(services: Services) -> Viewable:
    """Build the app for the browser session that is being served now."""
    send_small_messages_at_once()
    pn.extension(
        notifications=True,
        reconnect=True,
        disconnect_notification="The connection to the server was lost; trying again …",
    )
    session = Session(tuple(page.key for page in PAGES), services.catalog())
    session.load(pn.state.location.search if pn.state.location else "")
    shell = Shell(session, services, PAGES)
    notifications = pn.state.notifications

    def end(_: Any) -> None:
        shell.close()
        forget(notifications)

    pn.state.on_session_destroyed(end)
    return shell.view


def forget(notifications: Any) -> None:
    """Drop the process-wide entry of a session's notification area.

    Panel 1.9.4 removes every other view of a session that ends but leaves this one, and with it
    the session's document; ``tests/app/test_leaks.py`` fails when it stays.
    """
    views = pn.state._views
    for ref in [ref for ref, (view, *_) in views.items() if view is notifications]:
        del views[ref]


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
