"""A visitor without a browser: Bokeh's own WebSocket protocol, from the page's HTML to clicks and uploads."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.browser.driving import ROOT, started

GIVEN_UP_S = 20.0
"""A move that is not answered after this long is a time-out."""
PATIENCE_S = 120.0
"""The same for a page that is opened: a server that is just too slow is measured, not given up."""
READY = {
    "kind": "MessageSent",
    "msg_type": "bokeh_event",
    "msg_data": {"type": "event", "name": "document_ready", "values": {"type": "map"}},
}
"""What a browser says once it has drawn the page; until then the server sends no changes."""


class Visitor:
    """One session: its WebSocket, and the models that it has been sent.

    Attributes
    ----------
    figure_s : float
        Seconds from asking for the page until the first figure has arrived.
    figures : int
        Figures that have arrived so far.
    """

    def __init__(self, connection: WebSocketClientConnection) -> None:
        self.connection = connection
        self.models: dict[str, dict] = {}
        self.figure_s = float("nan")
        self.figures = 0
        self._arrays = asyncio.Event()
        self._figure = asyncio.Event()
        self._pulled = asyncio.Event()
        self._reader: asyncio.Task | None = None

    @classmethod
    async def open(cls, address: str, query: str, figure: bool = True) -> Visitor:
        """Load the page, connect as its script would, and wait until it has a figure."""
        start = time.perf_counter()
        times = {"connect_timeout": PATIENCE_S, "request_timeout": PATIENCE_S}
        page = await AsyncHTTPClient(force_instance=True).fetch(f"{address}/main?{query}", **times)
        found = re.search(r'"token":\s*"([^"]+)"', page.body.decode())
        if found is None:
            raise LookupError("the page has no session")
        request = HTTPRequest(
            f"{address.replace('http', 'ws', 1)}/main/ws", headers={"Origin": address}, **times
        )
        connection = await websocket_connect(
            request, subprotocols=["bokeh", found.group(1)], max_message_size=2**28
        )
        visitor = cls(connection)
        for _ in range(3):  # the server's greeting: it listens from now on
            await connection.read_message()
        visitor._reader = asyncio.create_task(visitor._read())
        await visitor._send("PULL-DOC-REQ", {})
        await visitor._until(visitor._pulled, PATIENCE_S)
        await visitor._say(READY)
        if figure:
            await visitor._until(visitor._figure, PATIENCE_S)
            visitor.figure_s = time.perf_counter() - start
        return visitor

    async def move(self, value: float, label: str = "Shot noise") -> float:
        """Move a slider; seconds until arrays have arrived.

        Raises
        ------
        TimeoutError, ConnectionError
            When they do not.
        """
        slider = await self.find(label)
        start = time.perf_counter()
        self._arrays.clear()
        await self._say({"kind": "ModelChanged", "model": {"id": slider}, "attr": "value", "new": value})
        await self._until(self._arrays, GIVEN_UP_S)
        return time.perf_counter() - start

    async def click(self, label: str) -> None:
        """Press the first button with this label."""
        await self.press(await self.find(label))

    async def press(self, ref: str) -> None:
        """Press the button with this id."""
        await self._event("dom_event", ref, node="click", data={})

    async def upload(self, content: bytes, name: str) -> None:
        """Drop a file on the page's field."""
        field = await self.find("FileDrop", "class_name")
        data = {"data": base64.b64encode(content).decode(), "name": name}
        await self._event("data_event", field, data=data)

    async def find(self, label: str, attribute: str = "label") -> str:
        """Id of the first model whose label begins so, once it is there."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for ref, model in self.models.items():
                if str(model.get(attribute, "")).startswith(label):
                    return ref
            if self._reader is None or self._reader.done():
                if self._reader is not None:
                    self._reader.result()
                raise ConnectionError("the server closed the connection")
            await asyncio.sleep(0.05)
        raise LookupError(f"the page has nothing with {attribute} {label!r}")

    def close(self) -> None:
        """Go away."""
        if self._reader is not None:
            self._reader.cancel()
        self.connection.close()

    # ------------------------------------------------------------ protocol

    async def _event(self, name: str, model: str, **values: Any) -> None:
        entries = [["model", {"id": model}], *([key, _encoded(value)] for key, value in values.items())]
        data = {"type": "event", "name": name, "values": {"type": "map", "entries": entries}}
        await self._say({"kind": "MessageSent", "msg_type": "bokeh_event", "msg_data": data})

    async def _say(self, event: dict) -> None:
        await self._send("PATCH-DOC", {"events": [event]})

    async def _send(self, kind: str, content: dict) -> None:
        for part in ({"msgid": f"{time.monotonic_ns():X}", "msgtype": kind}, {}, content):
            await self.connection.write_message(json.dumps(part))

    async def _until(self, event: asyncio.Event, seconds: float) -> None:
        assert self._reader is not None
        waiting = asyncio.create_task(event.wait())
        done, _ = await asyncio.wait(
            {waiting, self._reader}, timeout=seconds, return_when=asyncio.FIRST_COMPLETED
        )
        if waiting not in done:
            waiting.cancel()
            if not done:
                raise TimeoutError
            self._reader.result()
            raise ConnectionError("the server closed the connection")

    async def _read(self) -> None:
        """Take whatever comes: models, and whether there were arrays."""
        while (header := await self.connection.read_message()) is not None:
            head = json.loads(header)
            await self.connection.read_message()
            content = await self.connection.read_message()
            buffers = head.get("num_buffers", 0)
            for _ in range(2 * buffers):
                await self.connection.read_message()
            if head["msgtype"] not in ("PULL-DOC-REPLY", "PATCH-DOC"):
                continue
            for found in _walk(json.loads(content)):
                if found.get("name") == "Figure":
                    self.figures += 1
                    self._figure.set()
                if "id" in found and "attributes" in found:
                    self.models[found["id"]] = {**found["attributes"]}
                elif found.get("kind") == "ModelChanged" and found["model"]["id"] in self.models:
                    self.models[found["model"]["id"]][found["attr"]] = found["new"]
            if head["msgtype"] == "PULL-DOC-REPLY":
                self._pulled.set()
            if buffers:
                self._arrays.set()


def _encoded(value: Any) -> Any:
    if isinstance(value, dict):
        return {"type": "map", "entries": [[key, _encoded(item)] for key, item in value.items()]}
    return value


def _walk(value: Any) -> Iterator[dict]:
    if isinstance(value, dict):
        yield value
        for item in value.values():
            yield from _walk(item)
    elif isinstance(value, list):
        for item in value:
            yield from _walk(item)


@contextlib.contextmanager
def served_copy(*options: str) -> Iterator[tuple[str, subprocess.Popen]]:
    """A server on a copy of the shipped cache, in which visitors may simulate: its address and process."""
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(shutil.copytree(ROOT / "cache", Path(folder) / "cache"))
        with started(cache, *options) as server:
            yield server


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(re.search(r"VmRSS:\s+(\d+) kB", status).group(1)) / 1024


def processor_s(pid: int) -> float:
    """Processor time of a process, without its children, s."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def table(rows: list[tuple[str, str, str]]) -> str:
    """What was measured as a table in Markdown: what, number, goal."""
    lines = ["| what | measured | goal |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {what} | {number} | {goal} |" for what, number, goal in rows)])
