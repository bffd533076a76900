"""Minutes with visitors who come and go: sliders, time-outs, and whether the server's memory stays.

    python -m tests.benchmarks.visitors                              # 120 visitors in ten minutes
    python -m tests.benchmarks.visitors --minutes 2 --visitors 24

They come evenly spread over the time. Each stays for `--stay` seconds on the average, looks at three pages
one after the other, every page a session of its own, and moves the noise slider every two seconds. A move's
time ends when the arrays of the figures have arrived; no browser paints. Clients and server share the
machine. Memory is the server's own (resident) from two minutes on, or from a fifth of the time where it is
shorter: median of the first minute of that against median of the last minute.
"""

from __future__ import annotations

import argparse
import asyncio
import time

import numpy as np

from tests.benchmarks.visitor import Visitor, processor_s, resident_mb, served_copy, table

PAGES = ("profiles", "pdf", "evidence", "spectrum")
OWN = ("", "&mass=1e3-1e5,1e5-1e7,1e7-1e9", "&mass=1e3-1e5,1e5-1e7")
EVERY_S = 2.0
SETTLED_S = 120.0
LOOK_S = 2.0


class Measured:
    """What the visitors saw."""

    def __init__(self) -> None:
        self.moves: list[float] = []
        self.figures: list[float] = []
        self.memory: list[tuple[float, float]] = []
        self.timeouts = self.lost = self.here = self.most = 0


async def visit(number: int, address: str, stay_s: float, measured: Measured) -> None:
    """One visitor: three pages, a move every `EVERY_S` on each."""
    rng = np.random.default_rng(number)
    stay = stay_s * rng.uniform(0.5, 1.5)
    measured.here += 1
    measured.most = max(measured.most, measured.here)
    for page in rng.choice(PAGES, 3, p=[0.4, 0.2, 0.2, 0.2]):
        visitor = None
        try:
            visitor = await Visitor.open(address, f"page={page}{rng.choice(OWN)}")
            measured.figures.append(visitor.figure_s)
            left = time.monotonic() + stay / 3
            while time.monotonic() < left:
                due = time.monotonic() + EVERY_S
                measured.moves.append(await visitor.move(round(rng.uniform(0.05, 0.3), 2)))
                await asyncio.sleep(max(0.0, due - time.monotonic()))
        except TimeoutError:
            measured.timeouts += 1
        except ConnectionError:
            measured.lost += 1
        finally:
            if visitor is not None:
                visitor.close()
    measured.here -= 1


async def measure(address: str, pid: int, visitors: int, minutes: float, stay_s: float) -> Measured:
    """All visitors, and the server's memory meanwhile."""
    measured, start = Measured(), time.monotonic()

    async def look() -> None:
        while True:
            measured.memory.append((time.monotonic() - start, resident_mb(pid)))
            await asyncio.sleep(LOOK_S)

    async def come(number: int) -> None:
        await asyncio.sleep(number * 60 * minutes / visitors)
        await visit(number, address, stay_s, measured)

    looking = asyncio.create_task(look())
    await asyncio.gather(*(come(number) for number in range(visitors)))
    looking.cancel()
    return measured


def growth(memory: list[tuple[float, float]], minutes: float) -> tuple[float, float]:
    """Memory once it has settled, and at the end of the visitors' coming, MB."""
    begin = min(SETTLED_S, 12 * minutes)
    window = min(60.0, 12 * minutes)
    after = [mb for s, mb in memory if begin <= s < begin + window]
    last = [mb for s, mb in memory if 60 * minutes - window <= s < 60 * minutes]
    return float(np.median(after)), float(np.median(last))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0, help="how long visitors come")
    parser.add_argument("--visitors", type=int, default=120, help="how many come in this time")
    parser.add_argument("--stay", type=float, default=90.0, help="seconds that one stays on the average")
    arguments = parser.parse_args()
    with served_copy() as (address, process):
        begin = processor_s(process.pid)
        measured = asyncio.run(
            measure(address, process.pid, arguments.visitors, arguments.minutes, arguments.stay)
        )
        spent = processor_s(process.pid) - begin
    if not measured.moves:
        raise SystemExit("No visitor got as far as moving a slider.")
    moves, figures = 1e3 * np.array(measured.moves), np.array(measured.figures)
    first, last = growth(measured.memory, arguments.minutes)
    print(
        table(
            [
                (
                    f"{arguments.visitors} visitors in {arguments.minutes:g} minutes",
                    f"{len(figures)} sessions, {measured.most} visitors at the same time at most",
                    "",
                ),
                (
                    f"{len(moves)} moves of the noise slider",
                    "p50 {:.0f} ms, p95 {:.0f} ms".format(*np.percentile(moves, [50, 95]))
                    + f", worst {moves.max():.0f} ms",
                    "p95 ≤ 400 ms",
                ),
                ("moves without an answer in 20 s", f"{measured.timeouts}", "0"),
                ("connections lost", f"{measured.lost}", "0"),
                (
                    "a page's first figure has arrived",
                    "p50 {:.2f} s, p95 {:.2f} s".format(*np.percentile(figures, [50, 95])),
                    "",
                ),
                (
                    "memory when settled → at the end",
                    f"{first:.0f} → {last:.0f} MB ({100 * (last / first - 1):+.0f} %), highest "
                    f"{max(mb for _, mb in measured.memory):.0f} MB",
                    "within 10 %",
                ),
                ("server's processor time", f"{spent:.0f} s of {measured.memory[-1][0]:.0f} s", ""),
            ]
        )
    )


if __name__ == "__main__":
    main()
