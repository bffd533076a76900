"""Jobs when processes are killed, disks fill up, several servers share a cache: all of it really happens."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.simulation.ensemble import simulate
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.jobs import Jobs, Limits
from streamdash.store.cache import Cache
from tests.unit.processes import children, living
from tests.waiting import PATIENCE_S, wait_until

ROOT = Path(__file__).resolve().parents[2]

# A server as far as jobs go: it submits what it is told to and says how that ended.
SERVER = """
import sys
from streamdash.config import EnsembleConfig
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.jobs import Jobs, Limits
from streamdash.store.cache import Cache
jobs = Jobs(Cache.default(sys.argv[1]), Limits(workers=2, nice=0))
key = jobs.submit(EnsembleConfig.parse(sys.argv[2]), "me")
status = jobs.wait(key, 300)
print("done" if status is None else status.state, flush=True)
jobs.close()
"""


@pytest.fixture(scope="module")
def config() -> EnsembleConfig:
    return EnsembleConfig(perturbers=Perturbers(mass_range="1e5-1e7"), n_streams=230, n_theta=40)


@pytest.fixture(scope="module")
def undisturbed(config, geometry_root, tmp_path_factory, toy) -> dict[str, bytes]:
    """Files of the ensemble computed in one go."""
    root = tmp_path_factory.mktemp("undisturbed") / "cache"
    shutil.copytree(geometry_root, root)
    cache = Cache.default(root)
    simulate(config, "processes", 2, cache=cache)
    return toy.data_bytes(cache.find(config.key).path)


@pytest.fixture
def launch():
    """Start a process in a session of its own; whatever is left of it is killed afterwards."""
    processes = []

    def begin(*arguments: object, **environment: str) -> subprocess.Popen:
        process = subprocess.Popen(
            [str(a) for a in arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            start_new_session=True,
            env={**os.environ, **environment},
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture
def server(launch, config):
    """Start a process that computes `config` as a background job on a cache."""
    return lambda cache: launch(sys.executable, "-c", SERVER, cache.roots[0], config.model_dump_json())


def run_here(cache: Cache, config: EnsembleConfig, **limits):
    """Have a job done by this process; returns its last status."""
    jobs = Jobs(cache, Limits(**{"workers": 2, "nice": 0, **limits}))
    try:
        return jobs.wait(jobs.submit(config, "me"), PATIENCE_S)
    finally:
        jobs.close()


def wait_for_streams(cache: Cache, config: EnsembleConfig, process: subprocess.Popen) -> None:
    def going() -> bool:
        assert process.poll() is None, process.communicate()
        return cache.streams_done(config) > 0

    wait_until(going, "the simulation did not get going", 0.01)


def files(toy, cache: Cache, config: EnsembleConfig) -> dict[str, bytes]:
    return toy.data_bytes(cache.find(config.key).path)


# ------------------------------------------------------------------ kill -9


def test_a_job_goes_on_when_its_workers_are_killed(config, undisturbed, geometry_cache, toy):
    from loky import reusable_executor

    jobs = Jobs(geometry_cache, Limits(workers=2, nice=0))
    key = jobs.submit(config, "me")
    wait_until(lambda: jobs.find(key).done > 0, pause_s=0.01)
    for pid in list(reusable_executor._executor._processes):
        os.kill(pid, signal.SIGKILL)
    status = jobs.wait(key, PATIENCE_S)
    jobs.close()
    assert (status.state, status.error) == ("done", "")
    assert files(toy, geometry_cache, config) == undisturbed


def test_a_killed_server_loses_nothing_that_was_finished(config, undisturbed, geometry_cache, toy, server):
    process = server(geometry_cache)
    wait_for_streams(geometry_cache, config, process)
    workers = children(process.pid)
    process.kill()
    process.wait()
    entry = geometry_cache.find(config.key)
    kept = toy.data_bytes(entry.path)
    assert (entry.state, geometry_cache.verify(entry)) == ("partial", [])
    assert run_here(geometry_cache, config).state == "done"
    after = files(toy, geometry_cache, config)
    assert after == undisturbed
    assert all(after[name] == data for name, data in kept.items() if not name.endswith(".tmp"))
    wait_until(lambda: not living(workers))  # they notice


def test_a_server_that_ends_does_not_wait_for_what_its_workers_were_given(config, geometry_cache, launch):
    many = config.model_copy(update={"n_streams": 5000})
    begins = SERVER.partition("status =")[0]
    script = f"{begins}\nimport time\nwhile not jobs.find(key).done:\n    time.sleep(0.01)\n"
    process = launch(sys.executable, "-c", script, geometry_cache.roots[0], many.model_dump_json())
    wait_for_streams(geometry_cache, many, process)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "Traceback" not in errors
    entry = geometry_cache.find(many.key)
    assert (entry.state, geometry_cache.verify(entry)) == ("partial", [])
    assert entry.n_done < 1000


@pytest.mark.slow
def test_two_servers_and_the_command_line_on_one_cache_in_an_odd_place(
    config, undisturbed, geometry_root, tmp_path, toy, server, launch
):
    root = tmp_path / "Ölüm yıldızı 'İ' \n $HOME"
    shutil.copytree(geometry_root, root)
    cache = Cache.default(root)
    command = ["--mass", config.population.label, "--streams", config.n_streams, "--n-theta", config.n_theta]
    program = [sys.executable, "-m", "streamdash.cli.main", "simulate"]
    line = [*program, *command, "--workers", 2, "--cache", root]
    both = [server(cache) for _ in range(2)]
    one = launch(*line, LC_ALL="C", LANG="tr_TR", TZ="Antarctica/Troll", PYTHONUTF8="0")
    for process in both:
        output, errors = process.communicate(timeout=PATIENCE_S)
        assert output.strip() == "done", errors
    output, errors = one.communicate(timeout=PATIENCE_S)
    assert one.returncode == 0 and "streams of 1e5-1e7" in output, errors
    assert files(toy, cache, config) == undisturbed
    assert [e.state for e in cache.entries() if e.kind == "ensemble"] == ["complete"]


@pytest.mark.slow
def test_a_cluster_goes_on_when_a_worker_is_killed_and_says_so_when_its_scheduler_is(
    config, undisturbed, geometry_cache, toy, launch, tmp_path
):
    pytest.importorskip("distributed")
    dask = [sys.executable, "-m", "dask"]
    contact = tmp_path / "scheduler.json"
    scheduler = launch(
        *dask, "scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", contact
    )
    common = ["--nthreads", 1, "--no-dashboard", "--scheduler-file", contact, "--no-nanny"]
    common += ["--local-directory", tmp_path / "scratch"]
    workers = [launch(*dask, "worker", *common) for _ in range(2)]
    wait_until(contact.exists, "the scheduler did not start")
    address = _address(contact)
    jobs = Jobs(geometry_cache, Limits(scheduler=address))
    key = jobs.submit(config, "me")
    wait_until(lambda: jobs.find(key).done or not jobs.find(key).active, pause_s=0.01)
    assert jobs.find(key).done, jobs.find(key).error
    workers[0].kill()
    assert jobs.wait(key, PATIENCE_S).state == "done"
    assert files(toy, geometry_cache, config) == undisturbed
    many = config.model_copy(update={"seed": 1, "n_streams": 5000})
    jobs.submit(many, "me")  # the one worker left computes it, not this process
    wait_until(lambda: jobs.find(many.key).done or not jobs.find(many.key).active, pause_s=0.01)
    scheduler.kill()
    status = jobs.wait(many.key, PATIENCE_S)
    jobs.close()
    assert status.state == "failed"
    assert status.error.startswith(f"The Dask scheduler {address} cannot be reached")
    entry = geometry_cache.find(many.key)
    assert 0 < entry.n_done == status.done < 5000
    assert geometry_cache.verify(entry) == []


def _address(contact: Path) -> str:
    import json

    return json.loads(contact.read_text())["address"]


@pytest.mark.slow
def test_a_killed_geometry_goes_on_where_it_was_and_is_computed_once(tmp_path, launch):
    stream = StreamModel(times_gyr=(0.3, 0.6))
    cache = Cache.default(tmp_path / "cache")
    script = """
import sys
from streamdash.config import StreamModel
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
load_geometry(StreamModel.parse(sys.argv[2]), Cache.default(sys.argv[1]), workers=1)
"""
    process = launch(sys.executable, "-c", script, cache.roots[0], stream.model_dump_json())

    def going() -> bool:
        assert process.poll() is None, process.communicate()
        return bool(cache.times_done(stream))

    wait_until(going, "the geometry did not get going")
    workers = children(process.pid)
    process.kill()
    process.wait()
    assert not cache.busy(stream.key)
    seen: dict[int, list] = {0: [], 1: []}
    geometries = {}

    def load(i: int) -> None:
        report = seen[i].append
        geometries[i] = load_geometry(stream, cache, 1, lambda done, total: report((done, total)))

    threads = [threading.Thread(target=load, args=(i,)) for i in seen]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert {done for reports in seen.values() for done, _ in reports} <= {1, 2}
    assert geometries[0].to_dataset().identical(geometries[1].to_dataset())
    assert np.isfinite(geometries[0].table_ends).all() and len(geometries[0].table_ends) == 2
    assert [(e.kind, e.state) for e in cache.entries()] == [("geometry", "complete")]
    wait_until(lambda: not living(workers))


# ------------------------------------------------------------------ disks


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system of 1 MB."""
    if os.geteuid() != 0 or sys.platform != "linux":
        pytest.skip("only root may make a small file system")
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", folder], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"no file system can be made here: {mounted.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)


def remount(folder: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)


def test_full_and_read_only_disks_end_a_job_in_a_sentence_and_keep_what_is_finished(
    config, undisturbed, geometry_root, small_disk, toy
):
    shutil.copytree(geometry_root, small_disk / "cache")
    cache = Cache.default(small_disk / "cache")
    room = os.statvfs(small_disk)
    (small_disk / "other").write_bytes(bytes(room.f_bavail * room.f_frsize - 80_000))
    status = run_here(cache, config)
    assert status.state == "failed"
    assert status.error == (
        f"Cannot write to the cache {small_disk / 'cache'}: the disk is full; what was finished is kept, "
        "so free some space and run this again."
    )
    assert 0 < status.done < config.n_streams
    entry = cache.find(config.key)
    assert (entry.state, entry.n_done, cache.verify(entry)) == ("partial", status.done, [])
    remount(small_disk, "ro")
    status = run_here(cache, config)
    assert (status.state, status.done) == ("failed", entry.n_done)
    assert "it is read-only; choose another folder with --cache or STREAMDASH_CACHE" in status.error
    remount(small_disk, "rw,size=5m")
    assert run_here(cache, config).state == "done"
    assert files(toy, cache, config) == undisturbed
