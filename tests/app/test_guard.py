"""The repair of Bokeh's stack of documents: what it needs of Bokeh, and what it promises."""

from __future__ import annotations

import asyncio
import gc
import logging
import socket
import struct
import sys

import bokeh.io.doc
import panel as pn
import pytest
from bokeh.document import Document
from bokeh.document.callbacks import invoke_with_curdoc
from bokeh.io import curdoc
from tornado.httpserver import HTTPServer
from tornado.testing import bind_unused_port
from tornado.web import Application
from tornado.websocket import WebSocketClosedError, WebSocketHandler, websocket_connect

from app.guard import (
    FAILED,
    SOCKET_LOGS,
    USERS,
    keep_closed_sockets_short,
    repair_curdoc,
    say_fault,
    without_closed_traceback,
)
from app.services.services import Unavailable


def fail() -> None:
    raise RuntimeError("on purpose")


def test_an_exception_in_a_handler_leaves_no_document_behind():
    repair_curdoc()
    before = curdoc()
    visitor = Document()
    with pytest.raises(RuntimeError, match="on purpose"):
        invoke_with_curdoc(visitor, fail)
    assert curdoc() is before
    del visitor
    gc.collect()
    assert curdoc() is before


def test_the_document_of_a_handler_is_its_own_and_handlers_nest():
    repair_curdoc()
    outer, inner = Document(), Document()

    def run() -> None:
        with pytest.raises(RuntimeError, match="on purpose"):
            invoke_with_curdoc(inner, fail)
        assert curdoc() is outer

    invoke_with_curdoc(outer, run)


def test_bokeh_still_needs_the_repair():
    """When this fails, Bokeh has mended it and `repair_curdoc` can go."""
    repair_curdoc()
    original = bokeh.io.doc.patch_curdoc.__wrapped__
    before, visitor = curdoc(), Document()
    with pytest.raises(RuntimeError, match="on purpose"), original(visitor):
        fail()
    try:
        assert curdoc() is visitor is not before
    finally:
        bokeh.io.doc._PATCHED_CURDOCS.pop()


def test_every_module_that_uses_it_has_the_repaired_one():
    repair_curdoc()
    holders = [m for name, m in sys.modules.items() if name.startswith(("bokeh", "panel"))]
    found = {m.__name__ for m in holders if "patch_curdoc" in vars(m)}
    assert found == {m.__name__ for m in USERS}
    assert all(m.patch_curdoc is bokeh.io.doc.patch_curdoc for m in USERS)
    once = bokeh.io.doc.patch_curdoc
    repair_curdoc()
    assert bokeh.io.doc.patch_curdoc is once


def test_a_fault_is_said_and_logged_and_what_is_meant_for_people_is_said_as_it_is(caplog, monkeypatch):
    said = []

    class Area:
        def error(self, sentence, duration):
            said.append(sentence)

    monkeypatch.setattr(type(pn.state), "notifications", property(lambda _: Area()))
    say_fault(Unavailable("There is nothing yet."))
    assert said == ["There is nothing yet."] and not caplog.records
    say_fault(ZeroDivisionError("secret"))
    assert said[1:] == [FAILED]
    assert "secret" in caplog.text


# ---------------------------------------------------------------- closed sockets


async def write_to_dropped_sockets(count: int) -> int:
    """Write as Panel does, awaiting nothing, to sockets that are reset; how many writes found that out."""
    found = 0

    class Writer(WebSocketHandler):
        def on_message(self, message: str | bytes) -> None:
            asyncio.ensure_future(self.go_on())

        async def go_on(self) -> None:
            nonlocal found
            try:
                while True:
                    self.write_message(b"0" * 2**20, binary=True)
                    await asyncio.sleep(0)
            except WebSocketClosedError:
                found += 1
                raise

    server = HTTPServer(Application([("/ws", Writer)]))
    listening, port = bind_unused_port()
    server.add_socket(listening)
    for _ in range(count):
        client = await websocket_connect(f"ws://127.0.0.1:{port}/ws")
        await client.write_message("go on")
        stream = client.protocol.stream
        stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        stream.close()  # with a reset, as when a laptop is closed
    while found < count:
        await asyncio.sleep(0.01)
    server.stop()
    gc.collect()
    await asyncio.sleep(0)
    return found


@pytest.fixture
def logs():
    """The loggers of sockets as a new process has them, and afterwards again."""
    loggers = [logging.getLogger(name) for name in SOCKET_LOGS]
    before = [list(log.filters) for log in loggers]
    for log in loggers:
        log.removeFilter(without_closed_traceback)
    yield
    for log, filters in zip(loggers, before, strict=True):
        log.filters[:] = filters


def test_dropped_sockets_are_tracebacks_until_they_are_kept_short(logs, caplog):
    caplog.set_level(logging.INFO)
    asyncio.run(write_to_dropped_sockets(3))
    assert any(record.exc_info for record in caplog.records), "nothing to keep short any more: remove it"
    caplog.clear()
    keep_closed_sockets_short()
    asyncio.run(write_to_dropped_sockets(20))
    assert [record.getMessage() for record in caplog.records if record.exc_info] == []
    assert "a browser went away while it was written to" in caplog.text


def test_other_exceptions_keep_their_traceback(logs, caplog):
    keep_closed_sockets_short()
    try:
        fail()
    except RuntimeError:
        logging.getLogger("asyncio").exception("task failed")
    assert "on purpose" in caplog.text


def test_a_handler_whose_browser_went_away_is_no_fault(caplog):
    caplog.set_level(logging.INFO, "app.guard")
    say_fault(WebSocketClosedError())
    assert [(record.levelname, record.exc_info) for record in caplog.records] == [("INFO", None)]
