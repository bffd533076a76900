"""What goes wrong in one visitor's handler stays with that visitor.

Every Python function a browser reaches (buttons, sliders, downloads, uploads, timers, next ticks, a
document's events, the end of a session) is run by Bokeh inside ``bokeh.io.doc.patch_curdoc``, which
puts the session's document on a stack of the whole process and takes it off again, but not when the
function raises (Bokeh 3.9.2). The dead document then answers for ``curdoc()`` in other visitors'
sessions ("Patched curdoc has been previously destroyed") until the server is restarted.

So there are two guards. `repair_curdoc` holds for all of them, whoever calls: an exception does not
pass through Bokeh's context manager any more, but around it. `say_fault` is Panel's public
``exception_handler``: for what Panel calls, it writes the log and tells the visitor in a sentence.

A visitor who goes away while the server writes is no fault: `keep_closed_sockets_short` makes one line of
the traceback that asyncio and Tornado would log for each message that was still to be sent.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bokeh.application.handlers.code
import bokeh.io.doc
import panel as pn
import panel.io.handlers
from tornado.iostream import StreamClosedError
from tornado.websocket import WebSocketClosedError

from app.services.services import Unavailable
from streamdash.store.cache import StoreError

logger = logging.getLogger(__name__)

CLOSED = (WebSocketClosedError, StreamClosedError)
"""What is raised when a browser is no more there to be written to."""
SOCKET_LOGS = ("asyncio", "tornado.application", "tornado.general")
"""Who logs what nobody awaited: Panel 1.9.4 drops messages of a session that has ended."""
FAILED = "That failed unexpectedly; the server's log has the details."
SHOWN_MS = 8000
USERS = (bokeh.io.doc, bokeh.application.handlers.code, panel.io.handlers)
"""Modules that hold a name ``patch_curdoc``; ``tests/app/test_guard.py`` fails when there are others."""


def repair_curdoc() -> None:
    """Have Bokeh's ``patch_curdoc`` put back what was there also after an exception; once a process.

    It wraps the function Bokeh offers, whatever that does inside, and is needed no more when
    ``test_bokeh_still_needs_the_repair`` fails.
    """
    original = bokeh.io.doc.patch_curdoc
    if getattr(original, "repaired", False):
        return

    @functools.wraps(original)
    @contextmanager
    def patch_curdoc(doc: Any) -> Iterator[None]:
        raised: BaseException | None = None
        with original(doc):
            del doc
            try:
                yield
            except BaseException as error:
                raised = error
        if raised is not None:
            raise raised

    patch_curdoc.repaired = True  # type: ignore[attr-defined]
    for module in USERS:
        vars(module)["patch_curdoc"] = patch_curdoc


def keep_closed_sockets_short() -> None:
    """Have the log say in one line, without a traceback, that a browser went away; once a process."""
    for name in SOCKET_LOGS:
        log = logging.getLogger(name)
        if without_closed_traceback not in log.filters:
            log.addFilter(without_closed_traceback)


def without_closed_traceback(record: logging.LogRecord) -> bool:
    """Shorten a record whose exception is a closed socket; all others stay as they are."""
    if isinstance(record.exc_info, tuple) and isinstance(record.exc_info[1], CLOSED):
        record.exc_info = record.exc_text = None
        record.levelno, record.levelname = logging.INFO, logging.getLevelName(logging.INFO)
        record.msg, record.args = "a browser went away while it was written to", ()
    return True


def say_fault(error: BaseException) -> None:
    """Tell the visitor whose handler raised, in one sentence; Panel calls this in the session concerned."""
    if isinstance(error, CLOSED):
        logger.info("a browser went away while it was written to")
        return
    expected = isinstance(error, Unavailable | StoreError)
    if not expected:
        logger.error("a handler failed", exc_info=error)
    notifications = pn.state.notifications
    if notifications is not None:
        notifications.error(str(error) if expected else FAILED, duration=SHOWN_MS)
