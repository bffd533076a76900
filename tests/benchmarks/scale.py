"""What many streams of one prior cost: time, disk, peak memory of writer, reader and trainer; Dask's workers.

    python -m tests.benchmarks.scale                          # all of it, streams by the thousand
    python -m tests.benchmarks.scale --streams 5000 100000    # how many are written, read and learnt from
    python -m tests.benchmarks.scale --only dask paper

Streams that are written, read and learnt from are those of the shipped ensemble of 10³ to 10⁵ M☉ over and
over: their files are as large as any others, and nothing here asks what they say. Every step runs in a
process of its own, so that its peak memory is its own. ``dask`` computes real streams; ``paper`` extrapolates
what was measured just before to larger numbers and machines.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.prior import RATE
from streamdash.store.cache import SHIPPED, Cache
from streamdash.store.codec import CHUNK, chunk_count, chunk_streams

CHEAP, LARGE = "1e7-1e9", "1e3-1e5"
STREAMS = (5_000, 10_000, 20_000)
WORKERS = (1, 2, 4, 8)
DASK_STREAMS, EMPTY_TASKS = 200, 2_000
ON_PAPER, CORES = (10**6, 10**7), (64, 1_000)
DAY_S = 86_400.0


def prior_config(n_streams: int) -> EnsembleConfig:
    """An ensemble of a prior's streams."""
    return EnsembleConfig(stream=StreamModel(), prior=RATE, n_streams=n_streams, seed=n_streams)


def place(folder: str) -> Cache:
    """What is shipped, and a folder to write to."""
    return Cache((SHIPPED, Path(folder)), Path(folder))


def shipped(cache: Cache, label: str) -> EnsembleConfig:
    """The shipped ensemble of a mass range."""
    fits = cache.complete_ensembles(
        lambda c: c.prior is None and c.label == label and c.stream == StreamModel()
    )
    return max((entry.config for entry in fits), key=lambda c: c.n_streams)


def write(n_streams: int, folder: str) -> dict[str, Any]:
    """Write streams chunk by chunk, as a simulation does."""
    cache = Cache.default()
    source = cache.open_ensemble(shipped(cache, LARGE))
    target, config = place(folder), prior_config(n_streams)
    n = source.sizes["stream"]
    density, omega, hits = (source[name].values for name in ("density", "omega", "n_impacts"))
    with target.begin(config, source[["smooth", "omega_smooth"]]) as writer:
        last = time.perf_counter()
        for index in range(chunk_count(n_streams)):
            rows = np.array(chunk_streams(config, index)) % n
            last = time.perf_counter()
            writer.write(index, density[rows], omega[rows], hits[rows])
        size = sum(file.stat().st_size for file in writer.path.rglob("*") if file.is_file())
        manifest = (writer.path / "manifest.json").stat().st_size
    return {"disk": size, "manifest": manifest, "last_chunk_s": time.perf_counter() - last}


def read(n_streams: int, folder: str) -> dict[str, Any]:
    """Put them into the default bins."""
    from streamdash.survey.observed import ObservedStreams

    streams = ObservedStreams.read(place(folder), [prior_config(n_streams)])
    return {"kept": sum(array.nbytes for array in (*streams.q, *streams.draws))}


def train(n_streams: int, folder: str) -> dict[str, Any]:
    """Train one network for two epochs in the bins of measured profiles; enough for the peak of memory."""
    from streamdash.inference.estimator import Estimator
    from streamdash.inference.prior_ensemble import PriorEnsemble, default_design
    from streamdash.inference.training import Training
    from streamdash.simulation.geometry import load_geometry

    cache = place(folder)
    ensemble = PriorEnsemble.load(RATE, StreamModel(), n_streams, cache, seed=n_streams)
    design = default_design(load_geometry(StreamModel(), cache))
    Estimator.fit(ensemble, design, Training(members=1, max_epochs=2))
    return {}


def dask(n_workers: int, folder: str) -> dict[str, Any]:
    """Compute streams on a cluster of this machine, and hand out tasks that do nothing."""
    from distributed import Client

    from streamdash.simulation.ensemble import complete, prepare_workers
    from streamdash.simulation.workers import results

    cache = place(folder)
    config = shipped(Cache.default(), CHEAP).model_copy(
        update={"n_streams": DASK_STREAMS, "seed": 10_000 + n_workers}
    )
    prepare_workers(cache, 1)
    with Client(n_workers=n_workers, threads_per_worker=1, dashboard_address=None) as client:
        client.wait_for_workers(n_workers)
        warm = config.model_copy(update={"n_streams": 10 * n_workers, "seed": 20_000 + n_workers})
        complete(warm, cache, "dask")
        begin, busy = time.perf_counter(), time.process_time()
        complete(config, cache, "dask")
        seconds, own = time.perf_counter() - begin, time.process_time() - busy
        begin, busy = time.perf_counter(), time.process_time()
        for _ in results(nothing, ((i,) for i in range(EMPTY_TASKS)), "dask"):
            pass
        empty, empty_own = time.perf_counter() - begin, time.process_time() - busy
    cost = cache.find(config.key)
    return {
        "seconds": seconds,
        "stream_core_s": cost.cost_s / DASK_STREAMS,
        "own_s_a_stream": own / DASK_STREAMS,
        "empty_s_a_task": empty / EMPTY_TASKS,
        "empty_own_s_a_task": empty_own / EMPTY_TASKS,
    }


def nothing(number: int) -> int:
    """A task without work."""
    return number


STEPS: dict[str, Callable[[int, str], dict[str, Any]]] = {
    "write": write,
    "read": read,
    "train": train,
    "dask": dask,
}


def measured(step: str, number: int, folder: Path) -> dict[str, Any]:
    """What a step says, with its processor time, time by the clock and peak memory, in a fresh process."""
    command = [sys.executable, "-m", "tests.benchmarks.scale", "--step", step, str(number), str(folder)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def run_step(step: str, number: int, folder: str) -> None:
    """Run one step in this process and print what it cost."""
    begin = time.perf_counter()
    found = STEPS[step](number, folder)
    usage = resource.getrusage(resource.RUSAGE_SELF)
    found |= {
        "clock_s": time.perf_counter() - begin,
        "core_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss / 1024,
    }
    print(json.dumps(found))


def table(rows: list[list[str]]) -> None:
    """Print rows as a Markdown table, the first as its head."""
    for i, row in enumerate(rows):
        print(f"| {' | '.join(row)} |")
        if not i:
            print("|---" * len(row) + "|")
    print(flush=True)


def storage(numbers: list[int], folder: Path) -> dict[str, Any]:
    """Write, read and learn, for every number of streams; the last is returned."""
    rows = [
        [
            "streams",
            "step",
            "core s",
            "clock s",
            "peak MB",
            "disk MB",
            "kB a stream",
            "manifest MB",
            "last chunk ms",
        ]
    ]
    kept: dict[str, Any] = {}
    for n in numbers:
        for step in ("write", "read", "train"):
            found = measured(step, n, folder)
            kept[step] = {"n": n, **found}
            disk = found.get("disk")
            rows.append(
                [
                    f"{n:,}",
                    step,
                    f"{found['core_s']:.1f}",
                    f"{found['clock_s']:.1f}",
                    f"{found['peak_mb']:.0f}",
                    *(
                        [
                            f"{disk / 1e6:.0f}",
                            f"{disk / n / 1e3:.2f}",
                            f"{found['manifest'] / 1e6:.2f}",
                            f"{1e3 * found['last_chunk_s']:.0f}",
                        ]
                        if disk
                        else ["", "", "", ""]
                    ),
                ]
            )
    table(rows)
    return kept


def clusters(folder: Path) -> dict[str, Any]:
    """Streams over one and more Dask workers; the last but one is returned."""
    rows = [
        [
            "workers",
            "streams/s",
            "core ms a stream",
            "this process, ms a stream",
            "empty task, clock ms",
            "empty task, this process ms",
        ]
    ]
    kept: dict[str, Any] = {}
    for n in WORKERS:
        kept = measured("dask", n, folder)
        numbers = (
            1e3 * kept[k] for k in ("stream_core_s", "own_s_a_stream", "empty_s_a_task", "empty_own_s_a_task")
        )
        rows.append(
            [str(n), f"{DASK_STREAMS / kept['seconds']:.1f}", *(f"{number:.2f}" for number in numbers)]
        )
    table(rows)
    return kept


def on_paper(kept: dict[str, Any], stream_s: float, task_s: float) -> None:
    """What more streams cost on more cores, and what breaks first, from what was measured."""
    from streamdash.simulation.ensemble import PART

    wrote, learnt = kept["write"], kept["train"]
    per_chunk = wrote["manifest"] / chunk_count(wrote["n"])
    rows = [
        [
            "streams",
            "cores",
            "engine, hours",
            "scheduler, hours",
            "disk GB",
            "one manifest MB",
            "manifests written TB",
            "trainer GB",
        ]
    ]
    slope = (learnt["peak_mb"] - kept["read"]["peak_mb"]) / learnt["n"]
    for n in ON_PAPER:
        for cores in CORES:
            chunks = n / CHUNK
            rows.append(
                [
                    f"{n:.0e}",
                    f"{cores:,}",
                    f"{n * stream_s / cores / 3600:.2f}",
                    f"{n / PART * task_s / 3600:.2f}",
                    f"{n * wrote['disk'] / wrote['n'] / 1e9:.0f}",
                    f"{chunks * per_chunk / 1e6:.0f}",
                    f"{chunks**2 / 2 * per_chunk / 1e12:.2f}",
                    f"{n * slope / 1e3:.0f}",
                ]
            )
    table(rows)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--streams", type=int, nargs="+", default=list(STREAMS))
    parser.add_argument("--only", nargs="+", choices=("storage", "dask", "paper"))
    parser.add_argument("--step", nargs=3, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.step:
        run_step(asked.step[0], int(asked.step[1]), asked.step[2])
        return
    wanted = asked.only or ["storage", "dask", "paper"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kept = storage(asked.streams, folder) if {"storage", "paper"} & set(wanted) else {}
        spread = clusters(folder) if {"dask", "paper"} & set(wanted) else {}
        if "paper" in wanted:
            on_paper(kept, spread["stream_core_s"], spread["empty_own_s_a_task"])


if __name__ == "__main__":
    main()
