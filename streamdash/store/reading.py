"""Reading an ensemble: all of it, its first streams, or what is finished of it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from streamdash.config import EnsembleConfig
from streamdash.store.codec import chunk_count, chunk_streams, decode
from streamdash.store.entry import StoreError, check_engine, read_manifest, read_verified


def read_ensemble(path: Path, n_streams: int | None) -> xr.Dataset:
    """The first streams of the entry at `path`, see `streamdash.store.cache.Cache.open_ensemble`."""
    manifest, config = read_manifest(path, "ensembles")
    assert isinstance(config, EnsembleConfig)
    wanted = config.n_streams if n_streams is None else n_streams
    if not 1 <= wanted <= config.n_streams:
        raise StoreError(f"it holds {config.n_streams} streams, so 1 to {config.n_streams} can be read")
    needed = range(chunk_count(wanted))
    if any(i not in manifest.chunks for i in needed):
        total = chunk_count(config.n_streams)
        raise StoreError(f"it is not finished, {len(manifest.chunks)} of {total} chunks are there")
    names = dict(manifest.header)
    for i in needed:
        names |= manifest.chunks[i]
    return decode(read_verified(path, names), slice(wanted))


def read_finished(path: Path, limit: int) -> xr.Dataset | None:
    """The finished streams of the entry at `path`, see `streamdash.store.cache.Cache.open_finished`."""
    manifest, config = read_manifest(path, "ensembles")
    assert isinstance(config, EnsembleConfig)
    names = dict(manifest.header)
    numbers: list[int] = []
    for i in sorted(manifest.chunks):
        if len(numbers) >= limit:
            break
        names |= manifest.chunks[i]
        numbers += chunk_streams(config, i)
    if not numbers:
        return None
    return decode(read_verified(path, names), numbers).assign_coords(stream=numbers)


def holds_geometry(path: Path) -> bool:
    """Whether a folder is a geometry of this engine by its manifest; its files are not read."""
    try:
        check_engine(read_manifest(path, "geometries")[0])
    except StoreError:
        return False
    return True


def holds(path: Path, n_streams: int) -> bool:
    """Whether an entry lists the first `n_streams` streams as finished; files are not read."""
    try:
        manifest, config = read_manifest(path, "ensembles")
    except StoreError:
        return False
    assert isinstance(config, EnsembleConfig)
    return n_streams <= config.n_streams and all(i in manifest.chunks for i in range(chunk_count(n_streams)))
