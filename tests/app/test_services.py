"""Shared results: computed once, bounded, and honest about failures."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from app.services.services import Services
from streamdash.store.cache import Cache
from tests.waiting import PATIENCE_S


@pytest.fixture
def services(cache_dir) -> Services:
    return Services(Cache.default(), memory=1_000_000)


def test_many_threads_asking_at_once_compute_once(services):
    calls = []
    start = threading.Barrier(8)

    def compute() -> int:
        calls.append(threading.get_ident())
        time.sleep(0.1)
        return 42

    results = []

    def ask() -> None:
        start.wait()
        results.append(services.shared(("answer",), compute))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert results == [42] * 8
    assert len(calls) == 1


def test_different_keys_do_not_wait_for_one_another(services):
    release = threading.Event()
    slow = threading.Thread(target=lambda: services.shared("slow", lambda: release.wait(PATIENCE_S)))
    slow.start()
    try:
        assert services.shared("quick", lambda: 1) == 1
    finally:
        release.set()
        slow.join(PATIENCE_S)


def test_results_are_forgotten_when_memory_is_used_up_the_oldest_first(services):
    calls = []

    def make(i: int) -> np.ndarray:
        return services.shared(("array", i), lambda: calls.append(i) or np.zeros(300_000, dtype=np.uint8))

    for i in range(3):
        make(i)
    make(0)  # used again, so 1 is the oldest
    make(3)
    assert calls == [0, 1, 2, 3]
    make(0)
    make(1)
    assert calls == [0, 1, 2, 3, 1]


def test_a_result_larger_than_the_memory_is_given_but_not_kept(services):
    calls = []
    for _ in range(2):
        big = services.shared("big", lambda: calls.append(1) or np.zeros(2_000_000, dtype=np.uint8))
        assert big.nbytes == 2_000_000
    assert len(calls) == 2


def test_a_failure_reaches_everyone_who_waits_and_is_not_kept(services):
    started, release = threading.Event(), threading.Event()
    failures = []

    def fail() -> None:
        started.set()
        release.wait(PATIENCE_S)
        raise ValueError("not today")

    def ask() -> None:
        try:
            services.shared("key", fail)
        except ValueError as error:
            failures.append(str(error))

    first = threading.Thread(target=ask)
    first.start()
    started.wait(PATIENCE_S)
    second = threading.Thread(target=ask)
    second.start()
    time.sleep(0.05)
    release.set()
    first.join(PATIENCE_S)
    second.join(PATIENCE_S)
    assert failures == ["not today"] * 2
    assert services.shared("key", lambda: "better") == "better"


def test_a_computation_may_ask_for_others_but_not_for_itself(services):
    assert services.shared("outer", lambda: services.shared("inner", lambda: 1) + 1) == 2
    with pytest.raises(RuntimeError, match="asks for itself"):
        services.shared("loop", lambda: services.shared("loop", lambda: 1))


def test_an_empty_cache_has_an_empty_catalog(services):
    assert services.catalog().streams == ()
    assert services.catalog().problems == ()
