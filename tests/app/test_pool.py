"""Worker processes: fair turns, bounds, and what becomes of work whose worker dies."""

from __future__ import annotations

import os
import signal
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from app.services.results import Results
from app.work.pool import NICE, Full, Piece, Pool, plain
from app.work.tasks import Task, Work
from streamdash.classifier.data import Cancelled
from streamdash.store.cache import Cache
from tests.waiting import PATIENCE_S, wait_until


@pytest.fixture(scope="module")
def pool():
    """One worker process for all tests of this file."""
    pool = Pool(1)
    yield pool
    pool.close()


def result(piece: Piece):
    return piece.future.result(PATIENCE_S)


def wait_for(path: Path) -> str:
    """What a worker has written."""
    wait_until(lambda: path.exists() and path.read_text(), "the worker wrote nothing")
    return path.read_text()


def endless(path: Path, progress, should_stop) -> None:
    """Says who computes it, and does not listen."""
    path.write_text(str(os.getpid()))
    progress(1, 4)
    while True:
        time.sleep(0.01)


def busy(path: Path, progress, should_stop) -> None:
    path.write_text(str(os.getpid()))
    while True:
        pass


def obedient(path: Path, progress, should_stop) -> None:
    path.write_text(str(os.getpid()))
    while not should_stop():
        time.sleep(0.01)
    raise Cancelled


# ---------------------------------------------------------------- processes


def test_work_is_done_in_another_process_that_stands_back(pool):
    mine = os.getpriority(os.PRIO_PROCESS, 0)
    worker, priority = result(
        pool.submit(partial(plain, lambda: (os.getpid(), os.getpriority(os.PRIO_PROCESS, 0))))
    )
    assert worker != os.getpid()
    assert priority == NICE > mine


def test_a_worker_reads_the_same_cache_and_keeps_what_it_has_read(pool, shipped_cache):
    results = Results(Cache.default(shipped_cache))
    results.keep("mine", 1)

    def look(there: Results) -> tuple[int, tuple[Path, ...], object, type]:
        return id(there), there.cache.roots, there.known("mine"), type(there)

    first = result(pool.submit(partial(plain, partial(look, results))))
    second = result(pool.submit(partial(plain, partial(look, results))))
    assert first == second == (first[0], results.cache.roots, None, Results)


def test_a_worker_that_is_killed_ends_in_a_sentence_and_is_replaced(pool, tmp_path):
    work = Work(pool)
    task = work.ask("endless", partial(endless, tmp_path / "pid"))
    victim = int(wait_for(tmp_path / "pid"))
    os.kill(victim, signal.SIGKILL)
    task.wait()
    assert task.state == "failed" and "ended from outside" in task.error and task.error.endswith(".")
    assert result(pool.submit(partial(plain, os.getpid))) not in (victim, os.getpid())


def test_what_takes_too_long_is_ended_in_a_sentence_that_names_the_limit(tmp_path):
    pool = Pool(1, long_s=2.0)
    try:
        task = Work(pool).ask("busy", partial(busy, tmp_path / "pid"))
        worker = int(wait_for(tmp_path / "pid"))
        task.wait()
        assert task.state == "failed" and "longer than the 2 seconds" in task.error
        gone(worker)
    finally:
        pool.close()


def test_cancelled_work_ends_at_its_next_step_or_by_force(pool, tmp_path, monkeypatch):
    work = Work(pool)
    task = work.ask("obedient", partial(obedient, tmp_path / "pid"))
    worker = int(wait_for(tmp_path / "pid"))
    task.stop()
    task.wait()
    assert task.state == "cancelled"
    assert result(pool.submit(partial(plain, os.getpid))) == worker
    monkeypatch.setattr("app.work.pool.STOP_S", 0.2)
    task = work.ask("deaf", partial(endless, tmp_path / "deaf"))
    assert int(wait_for(tmp_path / "deaf")) == worker
    task.stop()
    task.wait()
    assert task.state == "cancelled"
    gone(worker)


def test_progress_comes_from_the_worker(pool, tmp_path):
    task: Task = Work(pool).ask("progress", partial(endless, tmp_path / "pid"))
    before = task.version
    worker = int(wait_for(tmp_path / "pid"))
    wait_until(lambda: task.fraction == 0.25, "no progress came")
    assert task.version > before and task.state == "running"
    os.kill(worker, signal.SIGKILL)
    task.wait()


def gone(pid: int) -> None:
    """Wait until a process has ended."""

    def ended() -> bool:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        return False

    wait_until(ended, "the process goes on")


# ---------------------------------------------------------------- turns


class Queue:
    """A pool of one thread that is kept busy until all have asked."""

    def __init__(self) -> None:
        self.pool, self.order, self._go = Pool(1, processes=False), [], threading.Event()
        begun = threading.Event()
        self.pool.submit(lambda *_: (begun.set(), self._go.wait(PATIENCE_S)), ("nobody", ""))
        assert begun.wait(PATIENCE_S)

    def ask(self, name: str, visitor: tuple[str, str], kind: str = "", short: bool = False) -> Piece:
        return self.pool.submit(lambda *_: self.order.append(name), visitor, kind, short)

    def turns(self, pieces: list[Piece]) -> list[str]:
        self._go.set()
        for piece in pieces:
            result(piece)
        return self.order


def test_visitors_take_turns_and_a_second_session_buys_no_second_share(monkeypatch):
    # Each piece counts as a second of work, so that the order does not hang on this machine's clock.
    monkeypatch.setattr(Pool, "release", counted(Pool.release))
    queue = Queue()
    greedy = [queue.ask(f"greedy {i}", ("10.0.0.1", f"session {i % 2}"), "training") for i in range(4)]
    modest = [queue.ask(f"modest {i}", ("10.0.0.2", "session"), "training") for i in range(2)]
    order = queue.turns(greedy + modest)
    assert order == ["greedy 0", "modest 0", "greedy 1", "modest 1", "greedy 2", "greedy 3"]


def test_kinds_take_turns_within_a_session(monkeypatch):
    monkeypatch.setattr(Pool, "release", counted(Pool.release))
    queue = Queue()
    me = ("10.0.0.1", "session")
    pieces = [queue.ask(f"study {i}", me, "study") for i in range(3)] + [queue.ask("answer", me, "answer")]
    assert queue.turns(pieces) == ["study 0", "answer", "study 1", "study 2"]


def counted(release):
    return lambda pool, piece, seconds: release(pool, piece, 1.0)


def test_one_worker_is_kept_for_what_is_short():
    pool, started, go = Pool(2, processes=False), threading.Semaphore(0), threading.Event()

    def long(*_) -> None:
        started.release()
        go.wait(PATIENCE_S)

    longs = [pool.submit(long, ("a", "")) for _ in range(3)]
    assert started.acquire(timeout=PATIENCE_S)
    assert result(pool.submit(lambda *_: "there", ("b", ""), short=True)) == "there"
    assert sum(piece.future.running() for piece in longs) == 1
    go.set()
    for piece in longs:
        result(piece)


def test_a_full_queue_refuses_in_a_sentence_and_takes_more_once_all_is_cancelled(monkeypatch):
    monkeypatch.setattr("app.work.pool.WAITING_MAX", 5)
    monkeypatch.setattr("app.work.pool.WAITING_PER_LEVEL", (4, 3))
    queue = Queue()
    pieces = [queue.ask("mine", ("a", "one")) for _ in range(3)]
    with pytest.raises(Full, match="of yours waits"):
        queue.ask("mine", ("a", "one"))
    pieces.append(queue.ask("mine", ("a", "two")))
    with pytest.raises(Full, match="of yours waits"):
        queue.ask("mine", ("a", "two"))
    pieces.append(queue.ask("another's", ("b", "one")))
    with pytest.raises(Full, match="^As much work waits on this server"):
        queue.ask("third", ("c", "one"))
    for piece in pieces:
        piece.stop()
    assert queue.pool.waiting == 0
    assert queue.turns([queue.ask("again", ("a", "one"))]) == ["again"]


def test_a_refused_task_says_why(monkeypatch):
    monkeypatch.setattr("app.work.pool.WAITING_MAX", 0)
    task = Work().ask("key", lambda *_: 1)
    assert task.state == "failed" and task.error.startswith("As much work waits")
