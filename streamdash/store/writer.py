"""Adding to an ensemble: who may, what is there already, and what can be taken over from others.

Stream *i* does not depend on how many streams are asked for, so ensembles that differ in their number
of streams only (siblings) share their chunks: fewer streams are read from a larger sibling, more
streams begin with the chunks of a smaller one.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import filelock
import numpy as np
import xarray as xr

from streamdash.config import ConfigError, EnsembleConfig
from streamdash.store.codec import chunk_count, chunk_streams, encode_chunk, encode_ensemble_header
from streamdash.store.entry import (
    DATA,
    SET_ASIDE,
    Manifest,
    StoreError,
    check_engine,
    create,
    explained,
    file_problems,
    new_manifest,
    now,
    read_manifest,
    read_verified,
    set_aside,
    sha256,
    streams_in,
    write_file,
    write_model,
)

log = logging.getLogger(__name__)

SMOOTH_FILES = ("theta/c/0", "smooth/c/0", "omega_smooth/c/0")
"""What must be the same in two ensembles whose streams may stand side by side."""


@dataclass
class Writer:
    """The right to add chunks to one ensemble; a context manager that gives it back.

    Obtained from `streamdash.store.cache.Cache.begin`.
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
        with explained(self.path.parent.parent):
            self.manifest = _add(self.path, self.manifest, {index: files}, cost_s)

    def close(self) -> None:
        """Let others write."""
        self.lock.release()

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def continue_ensemble(
    path: Path, config: EnsembleConfig, background: xr.Dataset, others: Iterable[Path], title: str = ""
) -> Manifest:
    """Manifest of the entry at `path`, created when there is none that can be continued.

    Parameters
    ----------
    others : entries that may be siblings; what they have finished is copied.
    title : name for people, kept by an entry that has none.
    """
    header = encode_ensemble_header(config, background)
    fresh = new_manifest("ensembles", config, config.label, header, title=title)
    manifest = None
    if path.exists():
        try:
            manifest = _continued(path, fresh)
        except StoreError as error:
            log.warning("The entry %s cannot be continued and is set aside: %s.", path.name, error)
            set_aside(path)
    if manifest is None:
        create(path, config, fresh, header)
        manifest = fresh
    elif title and not manifest.title:
        manifest = manifest.model_copy(update={"title": title})
        write_model(path / "manifest.json", manifest)
    for other in others:
        manifest = _take_over(path, config, manifest, other)
    return manifest


def siblings(folders: Iterable[Path], config: EnsembleConfig) -> Iterator[Path]:
    """Entries whose configuration differs from `config` in its number of streams only."""
    for path in folders:
        if not path.name.startswith(f"{config.label}-") or SET_ASIDE in path.name:
            continue
        with contextlib.suppress(OSError, ConfigError):
            other = EnsembleConfig.parse((path / "config.json").read_bytes())
            alike = other.model_copy(update={"n_streams": config.n_streams}) == config
            if alike and other.n_streams != config.n_streams:
                yield path


def _continued(path: Path, fresh: Manifest) -> Manifest:
    """Manifest of an existing entry, without its damaged chunks; StoreError when it is of no use."""
    manifest, _ = read_manifest(path, "ensembles")
    if problems := file_problems(path, manifest.header, fresh=True):
        raise StoreError(problems[0])
    check_engine(manifest)
    if manifest.header != fresh.header:
        raise StoreError("its smooth stream differs from today's")
    sound = {i: files for i, files in manifest.chunks.items() if not file_problems(path, files, fresh=True)}
    if damaged := len(manifest.chunks) - len(sound):
        log.warning("%s: %d damaged chunks are computed again.", path.name, damaged)
        manifest = manifest.model_copy(update={"chunks": sound})
        write_model(path / "manifest.json", manifest)
    return manifest


def _take_over(path: Path, config: EnsembleConfig, manifest: Manifest, other: Path) -> Manifest:
    """Copy the chunks that are missing at `path` and finished in a sibling of the same engine."""
    try:
        theirs, their_config = read_manifest(other, "ensembles")
        check_engine(theirs)
    except StoreError:
        return manifest
    assert isinstance(their_config, EnsembleConfig)
    same_stream = all(theirs.header.get(name) == manifest.header[name] for name in SMOOTH_FILES)
    if not same_stream:
        return manifest
    found = {}
    for index, sums in theirs.chunks.items():
        wanted = index < chunk_count(config.n_streams) and index not in manifest.chunks
        # A last chunk that is not full has other bytes.
        if wanted and chunk_streams(config, index) == chunk_streams(their_config, index):
            with contextlib.suppress(StoreError):
                found[index] = read_verified(other, sums)
    if not found:
        return manifest
    share = streams_in(config, found) / streams_in(their_config, theirs.chunks)
    return _add(path, manifest, found, theirs.cost_s * share)


def _add(path: Path, manifest: Manifest, chunks: dict[int, dict[str, bytes]], cost_s: float) -> Manifest:
    """Write chunks, their files first, then the manifest that lists them."""
    sums = {index: {name: sha256(data) for name, data in files.items()} for index, files in chunks.items()}
    longer = manifest.model_copy(
        update={
            "chunks": dict(sorted({**manifest.chunks, **sums}.items())),
            "updated": now(),
            "cost_s": manifest.cost_s + cost_s,
        }
    )
    for files in chunks.values():
        for name, data in files.items():
            write_file(path / DATA / name, data)
    write_model(path / "manifest.json", longer)
    return longer
