"""The cache: ensembles, geometries and spectra by the content of their configuration.

An entry is complete, partial, damaged or foreign, and which of these it is can be read off its
files alone (`streamdash.store.entry`): there is no other record of progress. One process at a time
writes to an entry (a file lock); any number read.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import filelock
import platformdirs
import xarray as xr

from streamdash import paths
from streamdash.config import Config, EnsembleConfig, SpectraConfig, StreamModel
from streamdash.store.codec import CHUNK, decode
from streamdash.store.entry import (
    FORMATS,
    SET_ASIDE,
    Entry,
    ForeignError,
    StoreError,
    check_engine,
    explained,
    inspect,
    key_of,
    problems_of,
    read_manifest,
    read_verified,
    streams_in,
)
from streamdash.store.parts import GeometryWriter, part_files, parts_folder, store_whole
from streamdash.store.reading import holds, holds_geometry, read_ensemble, read_finished
from streamdash.store.titles import geometry_label, spectra_label
from streamdash.store.writer import Writer, continue_ensemble, siblings

__all__ = ["CHUNK", "BusyError", "Cache", "Entry", "ForeignError", "StoreError", "Writer", "geometry_label"]

SHIPPED = paths.CACHE
"""The cache that comes with the code: read, never written, unless it is chosen by name."""

log = logging.getLogger(__name__)


class BusyError(StoreError):
    """Another process is writing the entry."""


@dataclass(frozen=True)
class Cache:
    """Ensembles, geometries and spectra in one or several folders.

    Parameters
    ----------
    roots : folders that are read, in this order.
    writable : the one of them that is written to; None to only read.
    """

    roots: tuple[Path, ...]
    writable: Path | None = None

    @classmethod
    def default(cls, directory: Path | str | None = None) -> Cache:
        """The cache a person means.

        `directory`, or else the environment variable ``STREAMDASH_CACHE``, is the only folder,
        read and written. Without either, the shipped folder is read and a folder of the user's
        own is read and written.

        Raises
        ------
        StoreError
            When the folder is in fact a file.
        """
        chosen = directory or os.environ.get("STREAMDASH_CACHE")
        if chosen:
            root = Path(chosen).expanduser().absolute()
            if root.exists() and not root.is_dir():
                raise StoreError(f"The cache {root} is a file; choose a folder.")
            return cls((root,), root)
        own = platformdirs.user_data_path("streamdash", appauthor=False) / "cache"
        return cls((SHIPPED, own), own)

    # ------------------------------------------------------------ looking

    def entries(self, kinds: Iterable[str] = tuple(FORMATS)) -> list[Entry]:
        """Everything of some kinds (all: `FORMATS`) in the cache, complete or not, ensembles first."""
        found = []
        for kind in kinds:
            for root in self.roots:
                for path in _children(root / kind):
                    entry = inspect(path, kind, shipped=root != self.writable)
                    if path.exists():  # not removed while it was looked at
                        found.append(entry)
        return found

    def complete_ensembles(self, wanted: Callable[[EnsembleConfig], bool]) -> list[Entry]:
        """Complete ensembles whose configuration is wanted; the streams of no others are looked at."""
        found = []
        for path in self._ensembles():
            with contextlib.suppress(StoreError):
                _, config = read_manifest(path, "ensembles")
                if isinstance(config, EnsembleConfig) and wanted(config):
                    entry = inspect(path, "ensembles", shipped=path.parent.parent != self.writable)
                    found += [entry] if entry.state == "complete" else []
        return found

    def verify(self, entry: Entry) -> list[str]:
        """Every problem of an entry in words, all its files read anew; empty when there is none."""
        return problems_of(entry.path, entry.path.parent.name)

    def find(self, name: str) -> Entry:
        """The entry with this key or directory name; the user's own before a shipped one.

        Raises
        ------
        StoreError
            When there is none.
        """
        fits = [e for e in self.entries() if name in (e.path.name, e.key)]
        if not fits:
            raise StoreError(
                f"No cache entry has the key or name {name[:80]!r}; `streamdash cache list` shows them."
            )
        return min(fits, key=lambda e: (e.shipped, e.path.name != name, SET_ASIDE in e.path.name))

    def check_writable(self) -> None:
        """Raise a `StoreError` when nothing can be written, before any work is done for it."""
        root = self._writable()
        with explained(root):
            root.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=root):
                pass

    # ------------------------------------------------------------ ensembles

    def open_ensemble(self, config_or_key: EnsembleConfig | str, n_streams: int | None = None) -> xr.Dataset:
        """Read an ensemble, its checksums compared on the way.

        Streams that a larger ensemble of otherwise the same configuration holds are read from there.

        Parameters
        ----------
        config_or_key : the configuration or its key.
        n_streams : how many streams, from the first; all by default.

        Returns
        -------
        xarray.Dataset
            ``density``, ``omega`` (stream, theta) float32, ``n_impacts`` (stream,), ``smooth``,
            ``omega_smooth`` (theta,); density in units of the smooth stream's near the
            progenitor, frequencies in natural units, theta in rad. Of more than
            `streamdash.store.reading.IN_MEMORY` streams, the profiles stay on disk: they are read, and
            compared with their checksums, where they are used, a part at a time.

        Raises
        ------
        StoreError
            When there is no such ensemble, it is damaged, or streams asked for are not there yet.
        """
        key = config_or_key if isinstance(config_or_key, str) else config_or_key.key
        refusals = []
        for path in self._paths("ensembles", key):
            try:
                return read_ensemble(path, n_streams)
            except StoreError as error:
                refusals.append(f"The ensemble {path.name} cannot be opened: {error}.")
        if isinstance(config_or_key, EnsembleConfig):
            wanted = config_or_key.n_streams if n_streams is None else n_streams
            for path in siblings(self._ensembles(), config_or_key):
                with contextlib.suppress(StoreError):
                    return read_ensemble(path, wanted)
        if not refusals:
            raise StoreError(f"There is no ensemble with the key {key[:16]!r} in the cache.")
        raise StoreError(refusals[-1])

    def open_finished(self, key: str, limit: int) -> xr.Dataset | None:
        """The finished streams of an ensemble that may be partial, at most about `limit` of them.

        Returns
        -------
        xarray.Dataset or None
            As from `open_ensemble`, with the streams' numbers as the coordinate ``stream``; None
            when nothing is finished.
        """
        for path in self._paths("ensembles", key):
            with contextlib.suppress(StoreError):
                return read_finished(path, limit)
        return None

    def covering(self, config: EnsembleConfig) -> Entry | None:
        """The intact entry that holds all streams of `config`: its own, or a larger one like it."""
        paths = [*self._paths("ensembles", config.key), *siblings(self._ensembles(), config)]
        for path in paths:
            if holds(path, config.n_streams):
                entry = inspect(path, "ensembles", shipped=path.parent.parent != self.writable)
                if entry.state in ("complete", "partial"):
                    return entry
        return None

    def streams_done(self, config: EnsembleConfig) -> int:
        """How many streams the entry of `config` lists as finished; a quick look, nothing is checked."""
        for path in self._paths("ensembles", config.key):
            with contextlib.suppress(StoreError):
                return streams_in(config, read_manifest(path, "ensembles")[0].chunks)
        return 0

    def times_done(self, stream: StreamModel) -> int:
        """How many impact times of a geometry are finished; a quick look, nothing is checked."""
        if any(holds_geometry(path) for path in self._paths("geometries", stream.key)):
            return len(stream.impact_times_gyr)
        return len(part_files(parts_folder(self.writable, stream))) if self.writable else 0

    def busy(self, key: str) -> bool:
        """Whether somebody is writing the entry of this key now."""
        if self.writable is None or not _lock_path(self.writable, key).exists():
            return False
        try:
            _lock(self.writable, key, timeout=0).release()
        except BusyError:
            return True
        except StoreError:  # cannot be written to by anybody here
            return False
        return False

    def begin(
        self, config: EnsembleConfig, background: xr.Dataset, timeout: float = -1, title: str = ""
    ) -> Writer:
        """Create or continue the ensemble of `config`; the only way to write to it.

        Damaged chunks of an entry count as missing. An entry that cannot be continued (damaged in
        another way, foreign, or made by another engine or from another smooth stream) is renamed, not
        deleted. Chunks that an ensemble with fewer or more streams has already are taken over.

        Parameters
        ----------
        background : Dataset with ``theta``, ``smooth`` and ``omega_smooth``, each (theta,).
        timeout : seconds to wait for another process that writes to the entry; -1 for ever.
        title : name for people; an entry keeps the first it was given.

        Raises
        ------
        BusyError
            When the other process has not finished in time.
        StoreError
            When the cache cannot be written to.
        """
        root = self._writable()
        path = root / "ensembles" / f"{config.label}-{config.key}"
        lock = _lock(root, config.key, timeout)
        try:
            with explained(root):
                others = list(siblings(self._ensembles(), config))
                manifest = continue_ensemble(path, config, background, others, title)
        except BaseException:
            lock.release()
            raise
        return Writer(path, config, manifest, lock)

    # ------------------------------------------------------------ geometries and spectra

    def open_geometry(self, stream: StreamModel) -> xr.Dataset | None:
        """The stored geometry of a stream, or None when it has to be computed.

        A damaged one, or one of another engine, is named in the log and passed over.
        """
        return self._open_whole("geometries", stream)

    def open_spectra(self, config: SpectraConfig) -> xr.Dataset | None:
        """The stored spectra of an ensemble, as `open_geometry` gives a geometry."""
        return self._open_whole("spectra", config)

    def begin_geometry(self, stream: StreamModel, timeout: float = -1) -> GeometryWriter:
        """Create or continue the geometry of `stream`; the only way to write to it.

        Parameters
        ----------
        timeout : seconds to wait for another process that computes it; -1 for ever.

        Raises
        ------
        BusyError
            When the other process has not finished in time.
        StoreError
            When the cache cannot be written to.
        """
        root = self._writable()
        path = root / "geometries" / f"{geometry_label(stream)}-{stream.key}"
        return GeometryWriter(path, stream, _lock(root, stream.key, timeout))

    def save_geometry(self, stream: StreamModel, dataset: xr.Dataset, cost_s: float = 0.0) -> None:
        """Store a geometry (any Dataset of numbers), unless an intact one is there already.

        Raises
        ------
        StoreError
            When the cache cannot be written to.
        TypeError
            When a variable is not numeric.
        """
        self._save_whole("geometries", stream, geometry_label(stream), dataset, cost_s)

    def save_spectra(self, config: SpectraConfig, dataset: xr.Dataset, cost_s: float = 0.0) -> None:
        """Store the spectra of an ensemble as `save_geometry` does; `cost_s` includes the ensemble's."""
        self._save_whole("spectra", config, spectra_label(config), dataset, cost_s)

    def writing(self, key: str, timeout: float = 0) -> filelock.BaseFileLock:
        """The sole right to write the entry of a key; a context manager that gives it back.

        Raises
        ------
        BusyError
            When somebody else has it and does not give it back in `timeout` seconds.
        StoreError
            When the cache cannot be written to.
        """
        return _lock(self._writable(), key, timeout)

    # ------------------------------------------------------------ removing

    def remove(self, name: str) -> None:
        """Delete the entry with this key or directory name.

        Raises
        ------
        StoreError
            When there is none, it is shipped, foreign, or being written to.
        """
        entry = self.find(name)
        if entry.shipped:
            raise StoreError(f"{entry.path.name} is part of a cache that is only read and stays.")
        if entry.state == "foreign":
            raise StoreError(f"{entry.path} was not made by streamdash ({entry.reason}); delete it by hand.")
        root = self._writable()
        with self.writing(entry.key or entry.path.name), explained(root):
            doomed = entry.path.with_name(f".removed-{uuid.uuid4().hex}")
            entry.path.replace(doomed)
            shutil.rmtree(doomed)

    # ------------------------------------------------------------ inside

    def _open_whole(self, kind: str, config: Config) -> xr.Dataset | None:
        for path in self._paths(kind, config.key):
            try:
                manifest, _ = read_manifest(path, kind)
                check_engine(manifest)
                return decode(read_verified(path, manifest.header))
            except StoreError as error:
                log.warning("The entry %s of %s is left out: %s.", path.name, kind, error)
        return None

    def _save_whole(self, kind: str, config: Config, label: str, dataset: xr.Dataset, cost_s: float) -> None:
        root = self._writable()
        with self.writing(config.key, timeout=-1), explained(root):
            store_whole(root / kind / f"{label}-{config.key}", config, label, dataset, cost_s)

    def _writable(self) -> Path:
        if self.writable is None:
            raise StoreError("This cache is only read; choose a folder with --cache or STREAMDASH_CACHE.")
        return self.writable

    def _ensembles(self) -> list[Path]:
        return [path for root in self.roots for path in _children(root / "ensembles")]

    def _paths(self, kind: str, key: str) -> list[Path]:
        return [path for root in self.roots for path in _children(root / kind) if key_of(path.name) == key]


def _children(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        yield from sorted(p for p in folder.iterdir() if not p.name.startswith("."))


def _lock(root: Path, key: str, timeout: float) -> filelock.BaseFileLock:
    path = _lock_path(root, key)
    with explained(root):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(path, thread_local=False)
        try:
            lock.acquire(timeout=timeout)
        except filelock.Timeout:
            raise BusyError(f"Another process is writing the cache entry {key}; wait for it.") from None
    return lock


def _lock_path(root: Path, key: str) -> Path:
    return root / ".locks" / f"{key}.lock"
