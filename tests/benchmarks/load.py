"""How many people one server process takes: real WebSocket sessions that move a slider.

    python tests/benchmarks/load.py                  # 30 sessions, one move a second each, for 30 s
    python tests/benchmarks/load.py --sessions 60
    python tests/benchmarks/load.py --churn 200      # opened, moved and closed one after another

The first prints the time from sending a move until the new arrays of the figures have arrived; the
second the server's memory (resident) after 60 sessions and after all of them. No browser paints:
clients and server share the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClientConnection, websocket_connect

from tests.browser.driving import ROOT, started

THREE_CLASSES = "1e3-1e5,1e5-1e7,1e7-1e9"
GIVEN_UP_S = 10.0
WARM = 60


READY = {
    "kind": "MessageSent",
    "msg_type": "bokeh_event",
    "msg_data": {"type": "event", "name": "document_ready", "values": {"type": "map"}},
}
"""What a browser says once it has drawn the page; until then the server sends no changes."""


class Visitor:
    """One session: its WebSocket, and the id of the slider's model."""

    def __init__(self, connection: WebSocketClientConnection, slider: str) -> None:
        self.connection, self.slider = connection, slider

    @classmethod
    async def open(cls, address: str, query: str) -> Visitor:
        """Load the page, connect as its script would, and find the noise slider."""
        page = await asyncio.to_thread(_read, f"{address}/main?{query}")
        token = re.search(r'"token":\s*"([^"]+)"', page).group(1)
        request = HTTPRequest(f"{address.replace('http', 'ws', 1)}/main/ws", headers={"Origin": address})
        connection = await websocket_connect(request, subprotocols=["bokeh", token], max_message_size=2**28)
        await connection.read_message(), await connection.read_message(), await connection.read_message()
        await _send(connection, "PULL-DOC-REQ", {})
        document = (await _receive(connection, "PULL-DOC-REPLY"))[0]
        await _send(connection, "PATCH-DOC", {"events": [READY]})
        return cls(connection, _slider(document))

    async def move(self, value: float) -> float:
        """Move the slider; seconds until arrays have arrived.

        Raises
        ------
        TimeoutError, ConnectionError
            When they do not.
        """
        event = {"kind": "ModelChanged", "model": {"id": self.slider}, "attr": "value", "new": value}
        start = time.perf_counter()
        await _send(self.connection, "PATCH-DOC", {"events": [event]})

        async def arrays() -> None:
            while not (await _receive(self.connection, "PATCH-DOC"))[1]:
                pass

        await asyncio.wait_for(arrays(), GIVEN_UP_S)
        return time.perf_counter() - start


def _read(url: str) -> str:
    with urllib.request.urlopen(url, timeout=120) as answer:
        return answer.read().decode()


async def _send(connection: WebSocketClientConnection, kind: str, content: dict) -> None:
    for part in ({"msgid": f"{time.monotonic_ns():X}", "msgtype": kind}, {}, content):
        await connection.write_message(json.dumps(part))


async def _receive(connection: WebSocketClientConnection, kind: str) -> tuple[Any, int]:
    """Content of the next message of this kind, and how many arrays came with it."""
    while True:
        header = await connection.read_message()
        if header is None:
            raise ConnectionError("the server closed the connection")
        head = json.loads(header)
        await connection.read_message()
        content = await connection.read_message()
        buffers = head.get("num_buffers", 0)
        for _ in range(2 * buffers):
            await connection.read_message()
        if head["msgtype"] == kind:
            return json.loads(content), buffers


def _walk(value: Any) -> Iterator[dict]:
    if isinstance(value, dict):
        yield value
        for item in value.values():
            yield from _walk(item)
    elif isinstance(value, list):
        for item in value:
            yield from _walk(item)


def _slider(document: Any) -> str:
    for item in _walk(document):
        if str(item.get("attributes", {}).get("label", "")).startswith("Shot noise"):
            return item["id"]
    raise LookupError("the page has no noise slider")


def resident_mb(pid: int) -> float:
    """Resident memory of a process, MB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(re.search(r"VmRSS:\s+(\d+) kB", status).group(1)) / 1024


async def moving(address: str, query: str, sessions: int, seconds: float) -> tuple[np.ndarray, int]:
    """Seconds of every move, and how many sessions were dropped."""
    visitors = [await Visitor.open(address, query) for _ in range(sessions)]
    times: list[float] = []
    dropped = 0

    async def live(visitor: Visitor, start: float) -> None:
        nonlocal dropped
        await asyncio.sleep(start)
        for i in range(int(seconds)):
            due = time.perf_counter() + 1.0
            try:
                times.append(await visitor.move(round(0.05 + 0.01 * (i % 30), 2)))
            except (TimeoutError, ConnectionError):
                dropped += 1
                return
            await asyncio.sleep(max(0.0, due - time.perf_counter()))

    await asyncio.gather(*(live(visitor, i / sessions) for i, visitor in enumerate(visitors)))
    return np.array(times), dropped


async def churn(address: str, query: str, sessions: int, pid: int) -> dict[int, float]:
    """Memory of the server after `WARM` and after all sessions, MB."""
    memory = {}
    for n in range(1, sessions + 1):
        visitor = await Visitor.open(address, query)
        await visitor.move(0.2)
        visitor.connection.close()
        if n in (WARM, sessions):
            await asyncio.sleep(5)  # unused sessions are let go of once a second
            memory[n] = resident_mb(pid)
    return memory


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--page", default="profiles", help="key of the page")
    parser.add_argument("--sessions", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=30)
    parser.add_argument("--churn", type=int, default=0, help="sessions to open and close instead")
    arguments = parser.parse_args()
    query = f"page={arguments.page}&mass={THREE_CLASSES}"
    lifetime = ("--check-unused-sessions", "1000", "--unused-session-lifetime", "1000")
    with started(ROOT / "cache", *(lifetime if arguments.churn else ())) as (address, process):
        if arguments.churn:
            memory = asyncio.run(churn(address, query, arguments.churn, process.pid))
            print(", ".join(f"after {n} sessions {mb:.0f} MB" for n, mb in memory.items()))
            return
        times, dropped = asyncio.run(moving(address, query, arguments.sessions, arguments.seconds))
    p50, p95 = 1e3 * np.percentile(times, [50, 95])
    print(
        f"{arguments.page}: {arguments.sessions} sessions, {len(times)} moves, p50 {p50:.0f} ms, "
        f"p95 {p95:.0f} ms, worst {1e3 * times.max():.0f} ms, {dropped} dropped"
    )


if __name__ == "__main__":
    main()
