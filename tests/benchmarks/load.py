"""How many people one server process takes: real WebSocket sessions that move a slider.

    python tests/benchmarks/load.py                  # 30 sessions, one move a second each, for 30 s
    python tests/benchmarks/load.py --sessions 60
    python tests/benchmarks/load.py --churn 200      # opened, moved and closed one after another

The first prints the time from sending a move until the new arrays of the figures have arrived, and how
much memory each open session takes; the second the server's memory (resident) after 60 sessions and after
all of them. No browser paints: clients and server share the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import time

import numpy as np

from tests.benchmarks.visitor import Visitor, resident_mb
from tests.browser.driving import ROOT, started

THREE_CLASSES = "1e3-1e5,1e5-1e7,1e7-1e9"
WARM = 60
FIRST = 5
"""Sessions after which the server has loaded what all share."""


async def moving(
    address: str, query: str, sessions: int, seconds: float, pid: int
) -> tuple[np.ndarray, int, float]:
    """Seconds of every move, how many sessions were dropped, and memory of each open session, MB."""
    first = min(FIRST, sessions // 2)
    visitors = [await Visitor.open(address, query) for _ in range(first)]
    before = resident_mb(pid)
    visitors += [await Visitor.open(address, query) for _ in range(sessions - first)]
    each = (resident_mb(pid) - before) / (sessions - first)
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
    for visitor in visitors:
        visitor.close()
    return np.array(times), dropped, each


async def churn(address: str, query: str, sessions: int, pid: int) -> dict[int, float]:
    """Memory of the server after `WARM` and after all sessions, MB."""
    memory = {}
    for n in range(1, sessions + 1):
        visitor = await Visitor.open(address, query)
        await visitor.move(0.2)
        visitor.close()
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
        times, dropped, each = asyncio.run(
            moving(address, query, arguments.sessions, arguments.seconds, process.pid)
        )
    p50, p95 = 1e3 * np.percentile(times, [50, 95])
    print(
        f"{arguments.page}: {arguments.sessions} sessions, {len(times)} moves, p50 {p50:.0f} ms, "
        f"p95 {p95:.0f} ms, worst {1e3 * times.max():.0f} ms, {dropped} dropped; "
        f"{each:.1f} MB of memory for each open session"
    )


if __name__ == "__main__":
    main()
