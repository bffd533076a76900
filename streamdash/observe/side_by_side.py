"""Steps of learning that do not need one another, side by side on the processors there are.

Trees are grown by one thread each, so that the same seed gives the same bytes on one machine; XGBoost and
NumPy let go of Python's lock while they compute, so that steps share nothing but their progress.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import ParamSpec, TypeVar

from loky import cpu_count
from threadpoolctl import threadpool_limits

from streamdash.classifier.data import Cancelled
from streamdash.classifier.train import Progress, ShouldStop

P = ParamSpec("P")
T = TypeVar("T")


class SideBySide:
    """Starts steps, and counts what is done of them in hundredths; a context manager.

    Parameters
    ----------
    progress : callable (done, total), optional
        Called at the beginning and after every step, from any thread, by one at a time.
    should_stop : callable, optional
        Asked before every step; once it says so, the steps that were not begun raise `Cancelled`.
    total : float
        What all steps cost together, in any unit.
    """

    def __init__(self, progress: Progress | None, should_stop: ShouldStop | None, total: float) -> None:
        self.progress, self.should_stop, self.total = progress, should_stop, total
        self._spent, self._lock = 0.0, threading.Lock()
        self._threads = ThreadPoolExecutor(cpu_count(), thread_name_prefix="learning")

    def __enter__(self) -> SideBySide:
        # Every processor has a step: threads of the linear algebra would only wait for one another, at
        # the cost of a third of all processor time.
        self._limits = threadpool_limits(1, "blas")
        self._spend(0.0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._threads.shutdown(cancel_futures=kind is not None)
        self._limits.restore_original_limits()

    def start(self, cost: float, step: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have a step done as soon as a processor is free; steps are begun in this order."""

        def run() -> T:
            if self.should_stop is not None and self.should_stop():
                raise Cancelled
            result = step(*args, **kwargs)
            self._spend(cost)
            return result

        return self._threads.submit(run)

    def within(self, cost: float) -> Progress:
        """Progress inside a step that is started at no cost of its own."""
        before = 0.0

        def report(done: int, total: int) -> None:
            nonlocal before
            now = cost * done / max(total, 1)
            self._spend(now - before)
            before = now

        return report

    def _spend(self, cost: float) -> None:
        with self._lock:
            self._spent += cost
            if self.progress is not None:
                self.progress(min(100, math.floor(100 * self._spent / self.total + 1e-6)), 100)
