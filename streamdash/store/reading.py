"""Reading an ensemble: all of it, its first streams, or what is finished of it.

A large one stays on disk: its arrays are read where they are used, chunk by chunk, each compared with its
checksum at that moment. Memory then does not grow with the number of streams.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path

import xarray as xr
from xarray.backends import ZarrStore
from zarr.abc.buffer import Buffer
from zarr.buffer import cpu
from zarr.storage import MemoryStore

from streamdash.config import EnsembleConfig
from streamdash.store.codec import chunk_count, chunk_streams, decode
from streamdash.store.entry import DATA, StoreError, check_engine, read_manifest, read_verified

IN_MEMORY = 10_000
"""An ensemble of more streams stays on disk (about 8 kB a stream in memory)."""


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
    if wanted > IN_MEMORY:
        return _on_disk(path, manifest.header, names).isel(stream=slice(wanted))
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


class _Files(MutableMapping[str, Buffer]):
    """The files of an entry by name, each read and compared with its checksum when it is asked for."""

    def __init__(self, path: Path, header: Mapping[str, str], checksums: Mapping[str, str]) -> None:
        self._path, self._checksums = path, checksums
        self._header = read_verified(path, header)

    def __getitem__(self, name: str) -> Buffer:
        if name not in self._checksums:
            raise KeyError(name)
        try:
            data = self._header.get(name) or read_verified(self._path, {name: self._checksums[name]})[name]
        except StoreError as error:
            raise StoreError(f"The ensemble {self._path.name} cannot be read: {error}.") from None
        return cpu.Buffer.from_bytes(data)

    def __setitem__(self, name: str, value: Buffer) -> None:
        raise TypeError("an entry is only read")

    def __delitem__(self, name: str) -> None:
        raise TypeError("an entry is only read")

    def __iter__(self) -> Iterator[str]:
        return iter(self._checksums)

    def __len__(self) -> int:
        return len(self._checksums)


def _on_disk(path: Path, header: Mapping[str, str], checksums: Mapping[str, str]) -> xr.Dataset:
    """Dataset of an entry whose profiles are read when they are used, and never kept."""
    missing = next((name for name in checksums if not (path / DATA / name).is_file()), None)
    if missing is not None:
        raise StoreError(f"{DATA}/{missing} cannot be read (it is missing)")
    store = ZarrStore.open_group(
        MemoryStore(_Files(path, header, checksums), read_only=True), consolidated=False, zarr_format=3
    )
    dataset = xr.open_dataset(store, chunks=None, decode_times=False, cache=False)
    for name in set(dataset.variables) - {"density", "omega"}:
        dataset[name].load()
    return dataset.drop_encoding()
