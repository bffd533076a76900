"""The cache: ensembles, geometries and spectra by the content of their configuration.

An entry is complete, partial, damaged or foreign, and which of these it is can be read off its
files alone (`streamdash.store_entry`): there is no other record of progress. One process at a time
writes to an entry (a file lock); any number read.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import filelock
import numpy as np
import platformdirs
import xarray as xr

from streamdash.config import Config, EnsembleConfig, SpectraConfig, StreamModel
from streamdash.store_codec import (
    CHUNK,
    chunk_count,
    decode,
    encode_chunk,
    encode_dataset,
    encode_ensemble_header,
)
from streamdash.store_entry import (
    DATA,
    FORMATS,
    SET_ASIDE,
    Entry,
    ForeignError,
    Manifest,
    StoreError,
    create,
    explained,
    file_problems,
    geometry_label,
    inspect,
    key_of,
    new_manifest,
    now,
    problems_of,
    read_manifest,
    read_verified,
    set_aside,
    sha256,
    spectra_label,
    streams_in,
    write_file,
    write_model,
)

__all__ = ["CHUNK", "BusyError", "Cache", "Entry", "ForeignError", "StoreError", "Writer", "geometry_label"]

SHIPPED = Path(__file__).resolve().parent.parent / "cache"
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
                    found.append(inspect(path, kind, shipped=root != self.writable))
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

        Parameters
        ----------
        config_or_key : the configuration or its key.
        n_streams : how many streams, from the first; all by default.

        Returns
        -------
        xarray.Dataset
            ``density``, ``omega`` (stream, theta) float32, ``n_impacts`` (stream,), ``smooth``,
            ``omega_smooth`` (theta,); density in units of the smooth stream's near the
            progenitor, frequencies in natural units, theta in rad.

        Raises
        ------
        StoreError
            When there is no such ensemble, it is damaged, or streams asked for are not there yet.
        """
        key = config_or_key if isinstance(config_or_key, str) else config_or_key.key
        refusals = []
        for path in self._paths("ensembles", key):
            try:
                return _read_ensemble(path, n_streams)
            except StoreError as error:
                refusals.append(f"The ensemble {path.name} cannot be opened: {error}.")
        if not refusals:
            raise StoreError(f"There is no ensemble with the key {key[:16]!r} in the cache.")
        raise StoreError(refusals[-1])

    def begin(self, config: EnsembleConfig, background: xr.Dataset, timeout: float = -1) -> Writer:
        """Create or continue the ensemble of `config`; the only way to write to it.

        Damaged chunks of an entry count as missing. An entry that cannot be continued (damaged in
        another way, foreign, or made by other code or from another smooth stream) is renamed, not
        deleted.

        Parameters
        ----------
        background : Dataset with ``theta``, ``smooth`` and ``omega_smooth``, each (theta,).
        timeout : seconds to wait for another process that writes to the entry; -1 for ever.

        Raises
        ------
        BusyError
            When the other process has not finished in time.
        StoreError
            When the cache cannot be written to.
        """
        root = self._writable()
        path = root / "ensembles" / f"{config.perturbers.label}-{config.key}"
        lock = _lock(root, config.key, timeout)
        try:
            with explained(root):
                manifest = _continue_ensemble(path, config, background)
        except BaseException:
            lock.release()
            raise
        return Writer(path, config, manifest, lock)

    # ------------------------------------------------------------ geometries and spectra

    def open_geometry(self, stream: StreamModel) -> xr.Dataset | None:
        """The stored geometry of a stream, or None when it has to be computed.

        A damaged one is named in the log and passed over.
        """
        return self._open_whole("geometries", stream)

    def open_spectra(self, config: SpectraConfig) -> xr.Dataset | None:
        """The stored spectra of an ensemble, as `open_geometry` gives a geometry."""
        return self._open_whole("spectra", config)

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
        with _lock(root, entry.key or entry.path.name, timeout=0), explained(root):
            doomed = entry.path.with_name(f".removed-{uuid.uuid4().hex}")
            os.replace(entry.path, doomed)
            shutil.rmtree(doomed)

    # ------------------------------------------------------------ inside

    def _open_whole(self, kind: str, config: Config) -> xr.Dataset | None:
        for path in self._paths(kind, config.key):
            try:
                manifest, _ = read_manifest(path, kind)
                return decode(read_verified(path, manifest.header))
            except StoreError as error:
                log.warning("The entry %s of %s is left out: %s.", path.name, kind, error)
        return None

    def _save_whole(self, kind: str, config: Config, label: str, dataset: xr.Dataset, cost_s: float) -> None:
        root = self._writable()
        path = root / kind / f"{label}-{config.key}"
        files = encode_dataset(dataset)
        manifest = new_manifest(kind, config, label, files, cost_s)
        with _lock(root, config.key, timeout=-1), explained(root):
            if path.exists():
                if not problems_of(path, kind):
                    return
                set_aside(path)
            create(path, config, manifest, files)

    def _writable(self) -> Path:
        if self.writable is None:
            raise StoreError("This cache is only read; choose a folder with --cache or STREAMDASH_CACHE.")
        return self.writable

    def _paths(self, kind: str, key: str) -> list[Path]:
        return [path for root in self.roots for path in _children(root / kind) if key_of(path.name) == key]


@dataclass
class Writer:
    """The right to add chunks to one ensemble; a context manager that gives it back.

    Obtained from `Cache.begin`.
    """

    path: Path
    config: EnsembleConfig
    manifest: Manifest
    lock: filelock.BaseFileLock = field(repr=False)

    def missing(self) -> list[int]:
        """Numbers of the chunks that are still to be computed."""
        return [i for i in range(chunk_count(self.config.n_streams)) if i not in self.manifest.chunks]

    @property
    def n_done(self) -> int:
        """Streams that are finished."""
        return streams_in(self.config, self.manifest.chunks)

    def write(
        self, index: int, density: np.ndarray, omega: np.ndarray, n_impacts: np.ndarray, cost_s: float = 0.0
    ) -> None:
        """Add one chunk: its files first, the manifest last, each whole or not at all.

        Parameters
        ----------
        density, omega : array (n, n_theta); density normalised, frequency in natural units
        n_impacts : array (n,)
        cost_s : core seconds it took

        Raises
        ------
        StoreError
            When the disk is full or read-only; earlier chunks stay.
        ValueError
            When an array has the wrong shape or is not finite.
        """
        files = encode_chunk(self.config, index, density, omega, n_impacts)
        sums = {name: sha256(data) for name, data in files.items()}
        manifest = self.manifest.model_copy(
            update={
                "chunks": dict(sorted({**self.manifest.chunks, index: sums}.items())),
                "updated": now(),
                "cost_s": self.manifest.cost_s + cost_s,
            }
        )
        with explained(self.path.parent.parent):
            for name, data in files.items():
                write_file(self.path / DATA / name, data)
            write_model(self.path / "manifest.json", manifest)
        self.manifest = manifest

    def close(self) -> None:
        """Let others write."""
        self.lock.release()

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


# ---------------------------------------------------------------- one entry


def _read_ensemble(path: Path, n_streams: int | None) -> xr.Dataset:
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
    return decode(read_verified(path, names), first=wanted)


def _continue_ensemble(path: Path, config: EnsembleConfig, background: xr.Dataset) -> Manifest:
    """Manifest of the entry at `path`, created when there is none that can be continued."""
    header = encode_ensemble_header(config, background)
    fresh = new_manifest("ensembles", config, config.perturbers.label, header)
    if path.exists():
        try:
            return _continued(path, fresh)
        except StoreError as error:
            log.warning("The entry %s cannot be continued and is set aside: %s.", path.name, error)
            set_aside(path)
    create(path, config, fresh, header)
    return fresh


def _continued(path: Path, fresh: Manifest) -> Manifest:
    """Manifest of an existing entry, without its damaged chunks; StoreError when it is of no use."""
    manifest, _ = read_manifest(path, "ensembles")
    if problems := file_problems(path, manifest.header, fresh=True):
        raise StoreError(problems[0])
    if manifest.code_version != fresh.code_version:
        raise StoreError(f"version {manifest.code_version} made it, this is version {fresh.code_version}")
    if manifest.header != fresh.header:
        raise StoreError("its smooth stream differs from today's")
    sound = {i: files for i, files in manifest.chunks.items() if not file_problems(path, files, fresh=True)}
    if damaged := len(manifest.chunks) - len(sound):
        log.warning("%s: %d damaged chunks are computed again.", path.name, damaged)
    return manifest.model_copy(update={"chunks": sound})


def _children(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        yield from sorted(p for p in folder.iterdir() if not p.name.startswith("."))


def _lock(root: Path, key: str, timeout: float) -> filelock.BaseFileLock:
    with explained(root):
        folder = root / ".locks"
        folder.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(folder / f"{key}.lock", thread_local=False)
        try:
            lock.acquire(timeout=timeout)
        except filelock.Timeout:
            raise BusyError(f"Another process is writing the cache entry {key}; wait for it.") from None
    return lock
