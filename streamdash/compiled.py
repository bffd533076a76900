"""numba's ``njit``, for which a folder of compiled code that cannot be written to is no fault.

numba keeps what it compiles (``NUMBA_CACHE_DIR``, else beside the source). With no place for it on the disk
it raises, though the code has been compiled by then: here it is used, and one line says so.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache

logger = logging.getLogger(__name__)
NOT_KEPT = (
    "Compiled code cannot be kept (%s), so that every start compiles it again; make room on the disk, or set "
    "NUMBA_CACHE_DIR to a folder that can be written to."
)


@functools.cache
def say_not_kept(reason: str) -> None:
    """Say once in the log that compiled code is not kept."""
    logger.warning(NOT_KEPT, reason)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """As ``numba.njit(**options)``; where there is no folder to keep compiled code in, it is not kept."""
    spare_full_disks()

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(**options)(function)
        except RuntimeError as error:
            if not options.get("cache") or "cannot cache function" not in str(error):
                raise
            say_not_kept("there is no folder for it that can be written to")
            return numba.njit(**{**options, "cache": False})(function)

    return decorate


def spare_full_disks() -> None:
    """Have numba go on when what it has compiled cannot be written, once a process."""
    save = FunctionCache.save_overload
    if getattr(save, "spared", False):
        return

    @functools.wraps(save)
    def save_overload(cache: Any, *compiled: Any) -> None:
        try:
            save(cache, *compiled)
        except OSError as error:
            say_not_kept(error.strerror or str(error))

    save_overload.spared = True  # type: ignore[attr-defined]
    FunctionCache.save_overload = save_overload  # type: ignore[method-assign]
