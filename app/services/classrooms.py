"""Results of classes that play the quiz together: in memory only, without names, and bounded."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from cachetools import TTLCache

CLASSROOMS = 200
"""Classes that are kept at the same time; the oldest go first."""
LASTS_S = 4 * 3600.0
"""A class is forgotten so long after it was opened."""
RESULTS_MAX = 300
"""Results that one class may bring in."""
CODE_BYTES = 9
"""Random bytes of a code: 72 bits, which nobody guesses."""


@dataclass(frozen=True)
class Result:
    """A finished game of somebody.

    Attributes
    ----------
    right : tuple of bool
        Whether each round was.
    points : float
    """

    right: tuple[bool, ...]
    points: float


class Classrooms:
    """The classes of one server process.

    Parameters
    ----------
    clock : callable
        Seconds that only rise.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._open: TTLCache[str, tuple[Hashable, dict[str, Result]]] = TTLCache(CLASSROOMS, LASTS_S, clock)
        self._lock = threading.Lock()

    def open(self, game: Hashable) -> str:
        """Open a class that plays a game; returns its code."""
        code = secrets.token_urlsafe(CODE_BYTES)
        with self._lock:
            self._open[code] = game, {}
        return code

    def knows(self, code: str) -> bool:
        """Whether a class of that code is open."""
        with self._lock:
            return code in self._open

    def add(self, code: str, game: Hashable, visitor: str, result: Result) -> bool:
        """Note a result, one of each visitor, in the game of the class; says whether it counts."""
        with self._lock:
            own, results = self._open.get(code, (None, {}))
            if own != game or (len(results) >= RESULTS_MAX and visitor not in results):
                return False
            return results.setdefault(visitor, result) is result

    def results(self, code: str) -> tuple[Result, ...]:
        """What has come in so far; nothing for a class that is not open."""
        with self._lock:
            return tuple(self._open.get(code, (None, {}))[1].values())
