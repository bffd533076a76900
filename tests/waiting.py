"""Waiting for what happens in its own time: for the event, not for seconds."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 300.0
"""Seconds that anything is waited for; a wait ends with what is awaited, so only failures take long."""


def wait_until(
    condition: Callable[[], object], what: object = "it did not happen", pause_s: float = 0.02
) -> None:
    """Wait until a condition holds, looking again and again.

    Parameters
    ----------
    what : said when it never does.
    """
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(pause_s)
