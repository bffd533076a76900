"""Notices what comes into the cache and what goes, whoever does it: this server or any other process."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from pathlib import Path
from typing import Any

from app.session.catalog import SHOWN, Catalog, read_catalog
from streamdash.store.cache import Cache

logger = logging.getLogger(__name__)
LOOK_S = 1.0


class CacheWatch:
    """One thread of the server process that replaces `catalog` when the cache has changed.

    It never touches a session; sessions look at `version` from their own event loops.

    Attributes
    ----------
    catalog : Catalog or None
        Frozen picture of the cache; None until the thread has looked.
    version : int
        Rises whenever `catalog` is replaced.
    """

    def __init__(self, cache: Cache) -> None:
        self.cache = cache
        self.catalog: Catalog | None = None
        self.version = 0
        self._seen: Any = None
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread, once."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="cache watch", daemon=True)
                self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stop.set()

    def look(self) -> None:
        """Read the catalog anew if a manifest was written, or an entry came or went."""
        signature = self._signature()
        if signature == self._seen:
            return
        catalog = read_catalog(self.cache.entries(SHOWN))
        self._seen = signature
        if catalog != self.catalog:
            self.catalog = catalog
            self.version += 1

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except Exception:  # a folder that cannot be read now may be later
                logger.exception("the cache could not be looked at")
            self._stop.wait(LOOK_S)

    def _signature(self) -> tuple:
        found = []
        for root in self.cache.roots:
            for kind in SHOWN:
                with contextlib.suppress(OSError):
                    for entry in os.scandir(root / kind):
                        with contextlib.suppress(OSError):
                            stat = Path(entry.path, "manifest.json").stat()
                            found.append((entry.path, stat.st_mtime_ns, stat.st_ino))
        return tuple(sorted(found))
