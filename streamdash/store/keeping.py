"""What may go: the least recently used entries when disk is short, and what interrupted work left behind."""

from __future__ import annotations

import contextlib
import logging
import shutil
import time
from collections.abc import Collection, Iterator
from pathlib import Path

from streamdash.config import EnsembleConfig
from streamdash.store.cache import SHIPPED, BusyError, Cache
from streamdash.store.codec import chunk_count
from streamdash.store.entry import FORMATS, SET_ASIDE, Entry, StoreError, explained

log = logging.getLogger(__name__)

IN_USE_S = 600
"""Whoever uses an entry marks it more often than this."""
CLOCK_SLACK_S = 60
LEFT_ALONE_S = 86_400
"""Unfinished geometries younger than this may still be wanted."""


def mark_used(cache: Cache, key: str) -> None:
    """Note that an entry is in use now; without effect in a cache that cannot be written to or is shipped."""
    if cache.writable is None or cache.writable == SHIPPED:
        return
    with contextlib.suppress(OSError):
        mark = _mark(cache.writable, key)
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.touch()


def last_used(cache: Cache, entry: Entry) -> float:
    """Seconds since the epoch at which an entry was last written or marked; 0 for damaged ones.

    Times that lie in the future, of a clock that was set back, count as long ago: whoever does use
    the entry marks it again within minutes.
    """
    if entry.state in ("damaged", "foreign"):
        return 0.0
    found = [0.0]
    for path in (entry.path / "manifest.json", _mark(entry.path.parent.parent, entry.key)):
        with contextlib.suppress(OSError):
            found.append(path.stat().st_mtime)
    return max(t for t in found if t <= time.time() + CLOCK_SLACK_S)


def own_entries(cache: Cache) -> list[Entry]:
    """Entries that people made here: neither shipped nor foreign."""
    return [
        entry
        for entry in cache.entries()
        if not entry.shipped and entry.state != "foreign" and not entry.path.is_relative_to(SHIPPED)
    ]


def room_for(config: EnsembleConfig) -> int:
    """Bytes that an ensemble takes at most: its profiles uncompressed, and room for the rest."""
    per_value, n_files = 4, 3 * chunk_count(config.n_streams)
    return 2 * per_value * config.n_streams * config.n_theta + 4096 * n_files


def make_room(cache: Cache, needed: int, limit: int, keep: Collection[str] = ()) -> list[Entry]:
    """Remove the least recently used entries of people's own until `needed` bytes fit in `limit`.

    Shipped entries, those being written, those used within `IN_USE_S` and geometries of ensembles
    that stay are never removed.

    Parameters
    ----------
    keep : keys of entries that stay as well.

    Returns
    -------
    list of Entry
        What was removed.

    Raises
    ------
    StoreError
        When it cannot be done; nothing is removed then.
    """
    entries = own_entries(cache)
    total = sum(entry.size_bytes for entry in entries)
    doomed: list[Entry] = []
    for entry in _removable(cache, entries, keep):
        if total + needed <= limit:
            break
        doomed.append(entry)
        total -= entry.size_bytes
    if total + needed > limit:
        raise StoreError(
            f"The simulations kept here may take {limit / 1e6:.0f} MB, this one needs up to "
            f"{needed / 1e6:.1f} MB, and {total / 1e6:.1f} MB are in use; ask for fewer streams, or remove "
            "some with `streamdash cache prune`."
        )
    return [entry for entry in doomed if _removed(cache, entry)]


def prune(
    cache: Cache, unfinished: bool = False, limit: int | None = None, dry_run: bool = False
) -> list[tuple[Path, int]]:
    """Remove what is of no use: entries set aside, and what killed processes left behind.

    Parameters
    ----------
    unfinished : remove partial ensembles as well.
    limit : bytes that people's own entries may keep; the least recently used ones go first.
    dry_run : only say what would go.

    Returns
    -------
    list of (path, bytes)
        What was, or would be, removed.

    Raises
    ------
    StoreError
        When the cache cannot be written to.
    """
    entries = own_entries(cache)
    doomed = [e for e in entries if SET_ASIDE in e.path.name or (unfinished and e.state == "partial")]
    doomed = [entry for entry in doomed if not (entry.key and cache.busy(entry.key))]
    if limit is not None:
        left = [entry for entry in entries if entry not in doomed]
        total = sum(entry.size_bytes for entry in left)
        for entry in _removable(cache, left, ()):
            if total > limit:
                doomed.append(entry)
                total -= entry.size_bytes
    found = [(entry.path, entry.size_bytes) for entry in doomed if dry_run or _removed(cache, entry)]
    for path in _leftovers(cache):
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        found.append((path, size or path.stat().st_size))
        if not dry_run:
            with explained(path):
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    return found


def _removable(cache: Cache, entries: list[Entry], keep: Collection[str]) -> Iterator[Entry]:
    """Entries that may go, the least recently used first, geometries after what is based on them."""
    now = time.time()
    stays = set()
    for entry in sorted(entries, key=lambda e: (e.kind == "geometry", last_used(cache, e))):
        used = last_used(cache, entry)
        free = entry.key not in keep and now - used > IN_USE_S and not (entry.key and cache.busy(entry.key))
        if entry.kind != "geometry":
            if free:
                yield entry
            elif entry.config is not None:
                ensemble = entry.config if entry.kind == "ensemble" else entry.config.ensemble
                stays.add(ensemble.stream.key)
        elif free and entry.key not in stays:
            yield entry


def _removed(cache: Cache, entry: Entry) -> bool:
    try:
        cache.remove(entry.path.name)
    except BusyError:
        return False
    except StoreError:
        if entry.path.exists():
            raise
        return False  # somebody else was quicker
    if cache.writable is not None and entry.key:
        _mark(cache.writable, entry.key).unlink(missing_ok=True)
    log.info("%s was removed to make room.", entry.path.name)
    return True


def _leftovers(cache: Cache) -> Iterator[Path]:
    """What killed processes left behind under the folder that is written to, and nobody writes now."""
    if cache.writable is None:
        return
    for kind in FORMATS:
        folder = cache.writable / kind
        for path in sorted(folder.glob(".*")):
            key = path.name.rpartition("-")[2]
            young = time.time() - path.stat().st_mtime < LEFT_ALONE_S
            if cache.busy(key) or (path.name.startswith(".parts-") and young):
                continue
            if path.name.startswith((".new-", ".removed-", ".parts-")):
                yield path
        for path in sorted(folder.glob("*/**/.*.tmp")):
            key = path.relative_to(folder).parts[0].rpartition("-")[2]
            if not cache.busy(key):
                yield path


def _mark(root: Path, key: str) -> Path:
    return root / ".used" / key
