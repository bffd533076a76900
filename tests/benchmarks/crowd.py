"""One visitor's sliders and pages while all others have the server compute.

    python -m tests.benchmarks.crowd                 # two minutes under load, thirty idle pages
    python -m tests.benchmarks.crowd --minutes 0.5 --visitors 2 --idle 5

First thirty idle Simulate pages: what they cost a second once they have been built, the server's own
processor time. Then six visitors queue three simulations each, two have classifiers trained and press
every "Compute" of the Classifier page, and four upload tables of their own, another one as soon as there
is an answer. Meanwhile one visitor moves the noise slider of Profiles once a second, and another opens
Profiles, PDF and Evidence in turn. Times end when the figures' arrays have arrived; no browser paints.
Clients, server and workers share the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import time

import numpy as np

from streamdash.survey.mock import EXAMPLE
from tests.benchmarks.visitor import Visitor, processor_s, served_copy, table

OPENED = ("profiles", "pdf", "evidence")
SETTLED_S = 20.0
WATCHED_S = 20.0
UPLOADERS = 4
TRAINERS = 2


async def idle_cost(address: str, pid: int, pages: int) -> float:
    """Milliseconds of the server's processor time a second while Simulate pages are open and nobody moves."""
    visitors = [await Visitor.open(address, "page=simulate", figure=False) for _ in range(pages)]
    for visitor in visitors:
        await visitor.find("Simulate")
    before = await quiet(pid)
    start, begin = time.monotonic(), processor_s(pid)
    await asyncio.sleep(WATCHED_S)
    spent = (processor_s(pid) - begin) / (time.monotonic() - start)
    for visitor in visitors:
        visitor.close()
    return 1e3 * min(spent, before)


async def quiet(pid: int) -> float:
    """Wait until the pages' forecasts are there: processor time a second of the last ten seconds."""
    deadline, spent = time.monotonic() + 6 * SETTLED_S, 1.0
    while time.monotonic() < deadline and spent > 0.02:
        begin = processor_s(pid)
        await asyncio.sleep(SETTLED_S / 2)
        spent = (processor_s(pid) - begin) / (SETTLED_S / 2)
    return spent


async def simulate(address: str, number: int) -> list[Visitor]:
    """Three simulations of one visitor; the pages stay open."""
    opened = []
    for i in range(3):
        seed = 1000 + 3 * number + i
        query = f"page=simulate&sim_mass=1e3-1e5&sim_n=20000&sim_seed={seed}"
        visitor = await Visitor.open(address, query, figure=False)
        opened.append(visitor)
        await visitor.find("Simulate")
        await asyncio.sleep(1.0)
        await visitor.click("Simulate")
    return opened


async def train(address: str, number: int) -> Visitor:
    """A training with a noise of its own, then every study of the page."""
    visitor = await Visitor.open(address, f"page=classifier&noise=0.{20 + number}", figure=False)
    await visitor.find("Compute")
    for ref in [ref for ref, model in visitor.models.items() if model.get("label") == "Compute"]:
        await visitor.press(ref)
    return visitor


async def upload(address: str, number: int, counts: list[int]) -> None:
    """One table after the other, each as soon as the one before is answered."""
    visitor = await Visitor.open(address, "page=observe", figure=False)
    while True:
        content = another_table(len(counts) * 100 + number)
        answers = visitor.figures
        await visitor.upload(content, f"mine-{number}-{len(counts)}.csv")
        while visitor.figures == answers:  # the figures of an answer are drawn anew
            await asyncio.sleep(0.2)
        counts.append(number)


def another_table(seed: int) -> bytes:
    """The example with other errors of measurement, so that its answer is not known yet."""
    rng = np.random.default_rng(seed)
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    names, *rows = [line for line in lines if not line.startswith("#")]
    first = names.split(",").index("density") if "density" in names.split(",") else 1
    for i, row in enumerate(rows):
        cells = row.split(",")
        cells[first] = f"{float(cells[first]) * (1 + 0.02 * rng.standard_normal()):.6g}"
        rows[i] = ",".join(cells)
    return "\n".join([*head, names, *rows, ""]).encode()


async def under_load(
    address: str, visitors: int, minutes: float
) -> tuple[list[float], list[float], int, int]:
    """Seconds of moves and of first figures while all others compute; answers given, and time-outs."""
    counts: list[int] = []
    busy = [*await asyncio.gather(*(simulate(address, number) for number in range(visitors)))]
    training = await asyncio.gather(*(train(address, number) for number in range(TRAINERS)))
    uploads = [asyncio.create_task(upload(address, number, counts)) for number in range(UPLOADERS)]
    mover = await Visitor.open(address, "page=profiles&mass=1e3-1e5,1e5-1e7,1e7-1e9")
    end = time.monotonic() + 60 * minutes
    moves: list[float] = []
    figures: list[float] = []
    timeouts = 0

    async def move() -> None:
        nonlocal timeouts
        i = 0
        while time.monotonic() < end:
            due, i = time.monotonic() + 1.0, i + 1
            try:
                moves.append(await mover.move(round(0.05 + 0.01 * (i % 30), 2)))
            except TimeoutError:
                timeouts += 1
            await asyncio.sleep(max(0.0, due - time.monotonic()))

    async def arrive() -> None:
        i = 0
        while time.monotonic() < end:
            i += 1
            visitor = await Visitor.open(address, f"page={OPENED[i % len(OPENED)]}")
            figures.append(visitor.figure_s)
            visitor.close()
            await asyncio.sleep(8.0)

    await asyncio.gather(move(), arrive())
    for task in uploads:
        if task.done():
            task.result()
        task.cancel()
    for visitor in [mover, *training, *(one for several in busy for one in several)]:
        visitor.close()
    return moves, figures, len(counts), timeouts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=2.0, help="how long sliders are moved under load")
    parser.add_argument("--visitors", type=int, default=6, help="who queue three simulations each")
    parser.add_argument("--idle", type=int, default=30, help="idle Simulate pages; 0 for none")
    arguments = parser.parse_args()
    # All clients have one address here; each may have what its own would.
    os.environ["STREAMDASH_MAX_JOBS_PER_ADDRESS"] = "20"
    with served_copy() as (address, process):
        idle = asyncio.run(idle_cost(address, process.pid, arguments.idle)) if arguments.idle else None
        moves, figures, answers, timeouts = asyncio.run(
            under_load(address, arguments.visitors, arguments.minutes)
        )
    times = "p50 {:.0f} ms, p95 {:.0f} ms".format(*1e3 * np.percentile(moves, [50, 95]))
    first = f"p50 {np.median(figures):.2f} s, worst {max(figures):.2f} s"
    busy = f"{3 * arguments.visitors} simulations, {TRAINERS} trainings with studies, {UPLOADERS} uploads"
    rows = [
        (f"under {busy}: {len(moves)} moves", f"{times}, worst {1e3 * max(moves):.0f} ms", "p95 ≤ 300 ms"),
        ("moves without an answer in 20 s", f"{timeouts}", "0"),
        (f"{len(figures)} new pages, first figure", first, "≤ 5 s"),
        ("answers to uploads meanwhile", f"{answers}", ""),
    ]
    if idle is not None:
        rows.append((f"{arguments.idle} idle Simulate pages", f"{idle:.1f} ms of processor a second", "≈ 0"))
    print(table(rows))


if __name__ == "__main__":
    main()
