"""Ensembles on the real engine: the same bytes whoever computes them and whatever happens meanwhile."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
import xarray as xr

from streamdash.config import Accuracy, EnsembleConfig, Perturbers
from streamdash.engine.density import perturbed_stream
from streamdash.engine.impacts import expected_impacts, sample_impacts
from streamdash.simulation import ensemble
from streamdash.simulation.ensemble import (
    CHUNK,
    Stopped,
    WorkerError,
    estimate,
    simulate,
    stream_rng,
    theta_grid,
)
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.workers import results
from streamdash.store.cache import Cache
from tests.unit.processes import children, living
from tests.waiting import PATIENCE_S, wait_until


@pytest.fixture(scope="module")
def config() -> EnsembleConfig:
    return EnsembleConfig(perturbers=Perturbers(mass_range="1e5-1e7"), n_streams=130, n_theta=40)


@pytest.fixture(scope="module")
def undisturbed(config, geometry_root, tmp_path_factory, toy) -> tuple[xr.Dataset, dict[str, bytes]]:
    """The ensemble computed in one go in this process, and its files."""
    root = tmp_path_factory.mktemp("undisturbed") / "cache"
    shutil.copytree(geometry_root, root)
    cache = Cache.default(root)
    return simulate(config, "inline", cache=cache), toy.data_bytes(cache.find(config.key).path)


def files(toy, cache: Cache, config: EnsembleConfig) -> dict[str, bytes]:
    return toy.data_bytes(cache.find(config.key).path)


# ------------------------------------------------------------------ content


def test_streams_are_those_of_the_engine(config, undisturbed, geometry_cache):
    geometry = load_geometry(config.stream, geometry_cache)
    dataset, _ = undisturbed
    for i in (0, 49, 50, 129):
        impacts = sample_impacts(geometry, config.perturbers, stream_rng(config, i))
        one = perturbed_stream(geometry, impacts, theta_grid(config), config.accuracy)
        assert dataset.n_impacts[i] == len(impacts)
        np.testing.assert_allclose(dataset.density[i], one.density, rtol=2.0**-13 + 1e-6)
        np.testing.assert_allclose(dataset.omega[i], one.omega, rtol=2.0**-15 + 1e-6)
    np.testing.assert_allclose(dataset.smooth, one.smooth, rtol=1e-12)
    np.testing.assert_allclose(dataset.omega_smooth, one.omega_smooth, rtol=1e-12)


def test_the_number_of_impacts_is_poisson_about_the_expected(config, undisturbed, geometry_cache):
    expected = expected_impacts(load_geometry(config.stream, geometry_cache), config.perturbers)
    counts = undisturbed[0].n_impacts
    assert float(counts.mean()) == pytest.approx(expected, abs=5 * np.sqrt(expected / counts.size))
    assert float(counts.var() / counts.mean()) == pytest.approx(1, abs=5 * np.sqrt(2 / counts.size))


def test_the_first_streams_do_not_depend_on_how_many_follow(config, undisturbed, geometry_cache):
    few = simulate(config.model_copy(update={"n_streams": 60}), "inline", cache=geometry_cache)
    xr.testing.assert_identical(few, undisturbed[0].isel(stream=slice(60)))


def test_random_numbers_depend_on_seed_stream_and_perturbers_only(config):
    def draw(**changes) -> float:
        return stream_rng(config.model_copy(update=changes), changes.pop("i", 0)).random()

    first = draw()
    assert draw(n_streams=5, n_theta=99, accuracy=Accuracy(kick_tolerance=1e-2)) == first
    others = [
        draw(seed=1),
        draw(perturbers=Perturbers(mass_range="1e5-1e9")),
        draw(stream=config.stream.model_copy(update={"age_gyr": 8.0})),
        stream_rng(config, 1).random(),
    ]
    assert len({first, *others}) == 5


def test_an_estimate_counts_impacts_and_seconds(config, geometry_cache):
    geometry = load_geometry(config.stream, geometry_cache)
    cost = estimate(config, geometry)
    assert cost.impacts_per_stream == expected_impacts(geometry, config.perturbers)
    assert 1e-5 < cost.seconds_per_stream < 1


# ------------------------------------------------------------------ executors


@pytest.mark.parametrize("workers", [1, 2])
def test_worker_processes_give_the_same_bytes(config, undisturbed, geometry_cache, toy, workers):
    dataset = simulate(config, "processes", workers, geometry_cache)
    assert files(toy, geometry_cache, config) == undisturbed[1]
    xr.testing.assert_identical(dataset, undisturbed[0])


@pytest.mark.parametrize("nice", [0, 1])
def test_giving_up_one_computation_leaves_another_alone(nice):
    """They share the worker processes, unless these are to stand back differently."""
    given_up = results(pow, [(2, i) for i in range(40)], "processes", 2)
    other = results(pow, [(3, i) for i in range(40)], "processes", 2, nice)
    found = [next(other), next(given_up) and next(other)]
    given_up.close()
    assert sorted([*found, *other]) == [3**i for i in range(40)]


@pytest.mark.parametrize("workers", [1, 2])
def test_this_process_only_hands_out_the_work(workers):
    pids = list(results(os.getpid, [()] * 9, "processes", workers))
    assert len(pids) == 9 and os.getpid() not in pids
    assert len(set(pids)) <= workers


def test_a_dask_cluster_gives_the_same_bytes(config, undisturbed, geometry_cache, toy):
    distributed = pytest.importorskip("distributed")
    with distributed.Client(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None):
        simulate(config, "dask", cache=geometry_cache)
    assert files(toy, geometry_cache, config) == undisturbed[1]


@pytest.mark.parametrize(
    ("executor", "workers", "words"),
    [
        ("abacus", None, "abacus"),
        ("processes", 0, "workers must be 1 or more"),
        ("inline", -1, "workers must"),
    ],
)
def test_unusable_executors_are_refused(config, geometry_cache, executor, workers, words):
    with pytest.raises(ValueError, match=words):
        simulate(config, executor, workers, geometry_cache)


def test_a_worker_without_the_geometry_says_so(config, tmp_path):
    with pytest.raises(WorkerError, match="all workers must see the same cache folder"):
        ensemble.compute_part(config, 0, range(10), Cache.default(tmp_path / "elsewhere"))


def test_what_is_complete_in_a_read_only_cache_is_opened(config, undisturbed, geometry_cache, tmp_path):
    simulate(config, "inline", cache=geometry_cache)
    own = tmp_path / "own"
    dataset = simulate(config, cache=Cache((geometry_cache.roots[0], own), own))
    xr.testing.assert_identical(dataset, undisturbed[0])
    assert not own.exists()


# ------------------------------------------------------------------ progress and interruptions


def test_progress_is_reported_from_none_to_all(config, geometry_cache):
    seen = []
    simulate(config, "processes", 2, geometry_cache, progress=lambda *numbers: seen.append(numbers))
    done = [d for d, _ in seen]
    assert {total for _, total in seen} == {130}
    assert (done[0], done[-1], len(done)) == (0, 130, 4)
    assert sorted(np.diff(done)) == [30, 50, 50]


@pytest.mark.parametrize("executor", ["inline", "processes"])
def test_a_stopped_simulation_keeps_its_chunks_and_resumes(
    config, undisturbed, geometry_cache, toy, executor
):
    reported = []
    with pytest.raises(Stopped, match="of 130 streams finished") as stopped:
        simulate(
            config,
            executor,
            2,
            geometry_cache,
            progress=lambda done, _: reported.append(done),
            should_stop=lambda: reported[-1] > 0,
        )
    entry = geometry_cache.find(config.key)
    assert (entry.state, entry.n_done) == ("partial", stopped.value.done)
    assert 0 < entry.n_done < 130
    seen = []
    simulate(config, executor, 2, geometry_cache, progress=lambda *numbers: seen.append(numbers))
    assert seen[0] == (entry.n_done, 130)
    assert files(toy, geometry_cache, config) == undisturbed[1]


def test_whether_to_stop_is_asked_within_a_chunk(config, geometry_cache):
    asked = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) == 3

    with pytest.raises(Stopped) as stopped:
        simulate(config, "inline", cache=geometry_cache, should_stop=stop)
    assert (stopped.value.done, geometry_cache.streams_done(config)) == (0, 0)


def test_an_interrupt_from_the_keyboard_keeps_chunks_and_frees_the_entry(
    config, undisturbed, geometry_cache, toy
):
    def interrupt(done: int, _total: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(config, "processes", 2, geometry_cache, progress=interrupt)
    assert geometry_cache.find(config.key).n_done in (30, 50)
    simulate(config, "processes", 2, geometry_cache)
    assert files(toy, geometry_cache, config) == undisturbed[1]


def test_a_killed_worker_is_reported_and_loses_only_its_chunk(config, undisturbed, geometry_cache):
    from loky import reusable_executor

    many = config.model_copy(update={"n_streams": 500})

    killed = []

    def kill_the_workers(done: int, _total: int) -> None:
        if done and not killed:
            killed.extend(process.pid for process in reusable_executor._executor._processes.values())
            for pid in killed:
                os.kill(pid, signal.SIGKILL)

    with pytest.raises(WorkerError, match="worker process was killed"):
        simulate(many, "processes", 2, geometry_cache, progress=kill_the_workers)
    entry = geometry_cache.find(many.key)
    assert 0 < entry.n_done < 500
    assert geometry_cache.verify(entry) == []
    resumed = simulate(many, "processes", 2, geometry_cache)
    xr.testing.assert_identical(resumed.isel(stream=slice(130)), undisturbed[0])


@pytest.mark.parametrize("how", ["truncated", "bit-flipped", "missing"])
def test_a_damaged_chunk_is_computed_again(config, undisturbed, geometry_cache, toy, how):
    simulate(config, "inline", cache=geometry_cache)
    toy.damage(geometry_cache.find(config.key).path / "data.zarr/omega/c/1/0", how)
    seen = []
    simulate(config, "inline", cache=geometry_cache, progress=lambda *numbers: seen.append(numbers))
    assert seen == [(80, 130), (130, 130)]
    assert files(toy, geometry_cache, config) == undisturbed[1]


def test_who_waits_for_another_sees_its_progress_and_can_stop(config, geometry_cache):
    geometry = load_geometry(config.stream, geometry_cache)
    seen = []
    with geometry_cache.begin(config, ensemble.background(geometry, config)) as writer:
        chunk = ensemble.compute_part(config, 1, range(50, 100), geometry_cache)
        writer.write(1, chunk.density, chunk.omega, chunk.n_impacts, chunk.cost_s)
        with pytest.raises(Stopped):
            simulate(
                config,
                cache=geometry_cache,
                progress=lambda *numbers: seen.append(numbers),
                should_stop=lambda: bool(seen),
            )
    assert seen == [(50, 130)]


# ------------------------------------------------------------------ processes of their own


def command(config: EnsembleConfig, cache: Cache, n_streams: int) -> list[str]:
    """Command line of a simulation like `config`, of `n_streams` streams."""
    return [
        *(sys.executable, "-m", "streamdash.cli.main", "simulate", "--mass", config.population.label),
        *("--streams", str(n_streams), "--n-theta", str(config.n_theta)),
        *("--workers", "2", "--cache", str(cache.roots[0])),
    ]


def wait_for_chunks(cache: Cache, key: str, n_done: int, process: subprocess.Popen) -> None:
    def going() -> bool:
        assert process.poll() is None, process.communicate()
        with contextlib.suppress(Exception):
            return cache.find(key).n_done >= n_done
        return False

    wait_until(going, "the simulation did not get going", 0.01)


@pytest.fixture
def start():
    """Start a process in a session of its own; whatever is left of it is ended afterwards."""
    processes = []

    def begin(arguments: list[str]) -> subprocess.Popen:
        process = subprocess.Popen(
            arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        processes.append(process)
        return process

    yield begin
    for process in processes:
        if process.poll() is None:
            process.kill()
            process.communicate()


@pytest.mark.slow
def test_after_a_kill_the_same_command_gives_the_same_bytes(config, geometry_cache, tmp_path, toy, start):
    many = config.model_copy(update={"n_streams": 600})
    process = start(command(config, geometry_cache, 600))
    wait_for_chunks(geometry_cache, many.key, CHUNK, process)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.send_signal(signal.SIGKILL)
    process.wait()
    entry = geometry_cache.find(many.key)
    assert entry.state == "partial"
    assert geometry_cache.verify(entry) == []
    assert start(command(config, geometry_cache, 600)).wait() == 0
    untouched = tmp_path / "untouched"
    shutil.copytree(geometry_cache.roots[0] / "geometries", untouched / "geometries")
    simulate(many, "processes", 2, Cache.default(untouched))
    wait_until(lambda: not living(workers))  # they notice
    assert files(toy, geometry_cache, many) == files(toy, Cache.default(untouched), many)


def test_workers_of_a_killed_process_end_even_when_they_never_had_work(start):
    script = (
        "import time; from streamdash.simulation.workers import results; "
        "list(results(time.sleep, [(0,)], workers=4))"
    )
    process = start([sys.executable, "-c", f"{script}; print('ready', flush=True); time.sleep(100)"])
    assert process.stdout.readline().strip() == "ready"
    workers = children(process.pid)
    assert len(workers) >= 4
    process.kill()
    process.wait()
    wait_until(lambda: not living(workers))


def test_ctrl_c_says_what_is_kept_and_how_to_resume(config, geometry_cache, start):
    many = config.model_copy(update={"n_streams": 3000})
    process = start(command(config, geometry_cache, 3000))
    wait_for_chunks(geometry_cache, many.key, CHUNK, process)
    os.killpg(process.pid, signal.SIGINT)
    output, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, errors
    assert output == ""
    done = geometry_cache.find(many.key).n_done
    assert 0 < done < 3000
    last = errors.strip().splitlines()[-1]
    assert last.startswith(f"Interrupted: {done} of 3000 streams ({done // CHUNK} chunks) are kept")
    assert "Traceback" not in errors


def test_two_processes_on_one_entry_share_the_work(config, undisturbed, geometry_cache, toy, start):
    both = [start(command(config, geometry_cache, 130)) for _ in range(2)]
    for process in both:
        output, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, errors
        assert "130 streams of 1e5-1e7" in output
    assert files(toy, geometry_cache, config) == undisturbed[1]
    (entry,) = [e for e in geometry_cache.entries() if e.kind == "ensemble"]
    assert (entry.state, entry.n_done) == ("complete", 130)


def test_two_threads_on_one_entry_share_the_work(config, undisturbed, geometry_cache):
    results = []

    def run() -> None:
        results.append(simulate(config, "inline", cache=geometry_cache))

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    for result in results:
        xr.testing.assert_identical(result, undisturbed[0])
    assert len(results) == 2
