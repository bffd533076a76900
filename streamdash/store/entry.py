"""One cache entry on disk: a Zarr group as named, checksummed files, with its config and manifest.

Layout of an entry directory::

    config.json     the configuration whose content hash names the directory
    manifest.json   who made it, when, at what cost, and the SHA-256 of every file below
    data.zarr/      a Zarr v3 group; an array's chunk holds CHUNK streams and all angles

A file is either listed in the manifest with a checksum that fits, or it is not data: what is
decoded here are the very bytes whose checksum was just compared.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import shutil
import uuid
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from streamdash import __version__
from streamdash.config import ENGINE_VERSION, Config, ConfigError, EnsembleConfig, SpectraConfig, StreamModel
from streamdash.store.codec import DENSITY_BITS, OMEGA_BITS, chunk_count, chunk_files, chunk_streams
from streamdash.store.titles import check_title

DATA = "data.zarr"
SET_ASIDE = ".damaged-"
"""In the name of a directory that was an entry and could not be used any more."""
FORMATS = {
    "ensembles": "streamdash-ensemble-1",
    "geometries": "streamdash-geometry-1",
    "spectra": "streamdash-spectra-1",
}
"""Schema of each kind of entry: raise the number when the layout changes."""
CONFIGS: dict[str, type[Config]] = {
    "ensembles": EnsembleConfig,
    "geometries": StreamModel,
    "spectra": SpectraConfig,
}
KINDS: dict[str, Literal["ensemble", "geometry", "spectra"]] = {
    "ensembles": "ensemble",
    "geometries": "geometry",
    "spectra": "spectra",
}
"""What one entry of each kind is called."""


FileName = Annotated[str, Field(pattern=r"^\w[\w.]*(/\w[\w.]*)*$", max_length=120)]
"""Name of a file inside the Zarr group: it cannot lead out of it."""


class StoreError(RuntimeError):
    """The cache cannot do what was asked; the message is one sentence for people."""


class ForeignError(StoreError):
    """A directory that is not an entry of this schema of streamdash."""


class Manifest(Config):
    """What an entry says about itself (``manifest.json``).

    ``header`` holds the files written when the entry is created, ``chunks`` those of each
    finished chunk; both map file names inside ``data.zarr`` to their SHA-256. ``engine_version``
    decides what may be mixed with it (`check_engine`); ``code_version`` is for the record.
    """

    format: str
    config_key: str
    label: str
    title: Annotated[str, AfterValidator(check_title)] = ""
    code_version: str
    engine_version: int = Field(1, ge=1, description="entries from before it was written are of the first")
    created: str
    updated: str
    cost_s: float = Field(0.0, ge=0, allow_inf_nan=False, description="core seconds of computing")
    precision: dict[str, str] = {}
    header: dict[FileName, str]
    chunks: dict[int, dict[FileName, str]] = {}

    def listed(self) -> dict[str, str]:
        """Checksums of all files by name."""
        return self.header | {name: sums for files in self.chunks.values() for name, sums in files.items()}


@contextlib.contextmanager
def explained(root: Path) -> Iterator[None]:
    """Turn an operating system's refusal to write under `root` into a `StoreError` sentence."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            why = "the disk is full; what was finished is kept, so free some space and run this again"
        elif error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            why = "it is read-only; choose another folder with --cache or STREAMDASH_CACHE"
        else:
            why = f"{error.strerror or error}; what was finished before is kept"
        raise StoreError(f"Cannot write to the cache {root}: {why}.") from error


def write_file(path: Path, data: bytes) -> None:
    """Write `data` aside, then rename: `path` holds its old or its new content, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.tmp")
    try:
        aside.write_bytes(data)
        aside.replace(path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise


def sha256(data: bytes) -> str:
    """Hexadecimal SHA-256 of `data`."""
    return hashlib.sha256(data).hexdigest()


def read_manifest(entry: Path, kind: str) -> tuple[Manifest, Config]:
    """Manifest and configuration of an entry directory.

    Raises
    ------
    ForeignError
        When the directory was not made by this schema of streamdash.
    StoreError
        When it was, but cannot be trusted.
    """
    if not entry.is_dir():
        raise ForeignError("it is not a directory")
    try:
        text = (entry / "manifest.json").read_bytes()
    except FileNotFoundError:
        if (entry / "config.json").exists():
            raise StoreError("manifest.json is missing") from None
        raise ForeignError("it has no manifest.json and no config.json") from None
    except OSError as error:
        raise StoreError(f"manifest.json cannot be read ({error.strerror})") from None
    if b'"format"' in text and f'"{FORMATS[kind]}"'.encode() not in text:
        raise ForeignError(f"its manifest.json is of another schema than {FORMATS[kind]}")
    try:
        manifest = Manifest.parse(text)
    except ConfigError as error:
        raise StoreError(f"manifest.json is not valid: {error}") from None
    try:
        config = CONFIGS[kind].parse((entry / "config.json").read_bytes())
    except OSError as error:
        raise StoreError(f"config.json cannot be read ({error.strerror})") from None
    except ConfigError as error:
        raise StoreError(f"config.json is not valid: {error}") from None
    if not manifest.config_key == config.key == key_of(entry.name):
        raise StoreError(
            f"config.json hashes to {config.key}, manifest.json says {manifest.config_key[:16]!r}, "
            f"and the directory is named {entry.name}"
        )
    if isinstance(config, EnsembleConfig):
        check_chunks(manifest, config)
    return manifest, config


def check_chunks(manifest: Manifest, config: EnsembleConfig) -> None:
    """Raise a `StoreError` when a manifest lists chunks that the ensemble cannot have."""
    for index, files in manifest.chunks.items():
        if not 0 <= index < chunk_count(config.n_streams) or set(files) != set(chunk_files(index)):
            raise StoreError(f"manifest.json lists a chunk {index} that this ensemble cannot have")


def check_engine(manifest: Manifest) -> None:
    """Raise a `StoreError` when an entry holds results of another engine than this one."""
    if manifest.engine_version != ENGINE_VERSION:
        raise StoreError(f"engine {manifest.engine_version} made it, this is engine {ENGINE_VERSION}")


def key_of(name: str) -> str | None:
    """The key in an entry's directory name ``<label>-<key>``, or None."""
    match = re.fullmatch(r".+-([0-9a-f]{16})", name)
    return match[1] if match else None


def read_verified(entry: Path, checksums: Mapping[str, str]) -> dict[str, bytes]:
    """Bytes of the named files of an entry, each compared with its checksum.

    Raises
    ------
    StoreError
        Naming the first file that is missing, cut short or altered.
    """
    files = {}
    for name, checksum in checksums.items():
        try:
            data = (entry / DATA / name).read_bytes()
        except OSError as error:
            raise StoreError(f"{DATA}/{name} cannot be read ({error.strerror})") from None
        if sha256(data) != checksum:
            raise StoreError(f"{DATA}/{name} does not match its checksum")
        files[name] = data
    return files


def file_problems(entry: Path, checksums: Mapping[str, str], fresh: bool) -> list[str]:
    """What is wrong with the named files of an entry, in words.

    With `fresh` every file is read anew; otherwise a checksum computed earlier for the same
    modification time and size is believed, so that listing a cache stays cheap.
    """
    found = []
    for name, checksum in checksums.items():
        try:
            stat = (entry / DATA / name).stat()
            digest = _sha256_of.__wrapped__ if fresh else _sha256_of
            intact = digest(str(entry / DATA / name), stat.st_mtime_ns, stat.st_size, stat.st_ino) == checksum
        except OSError as error:
            found.append(f"{DATA}/{name} cannot be read ({error.strerror})")
        else:
            if not intact:
                found.append(f"{DATA}/{name} does not match its checksum")
    return found


@lru_cache(maxsize=100_000)
def _sha256_of(path: str, _mtime_ns: int, _size: int, _inode: int) -> str:
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


# ---------------------------------------------------------------- what an entry is


@dataclass(frozen=True)
class Entry:
    """What a cache holds in one directory.

    Attributes
    ----------
    kind : "ensemble", "geometry" or "spectra"
    key : content hash of `config`; empty for a directory without one.
    label : mass range of an ensemble or of spectra, arm and age of a geometry.
    title : name that somebody gave to an ensemble; text to be shown with care.
    path : the directory.
    state : "complete", "partial", "damaged" or "foreign".
    reason : why it is damaged or foreign, in words; empty otherwise.
    config : what it holds; None when that cannot be read.
    n_done, n_total : finished and requested streams (1 and 1 for what has no streams).
    size_bytes : of all its files.
    date : ISO date and time of the last change.
    cost_s : core seconds it took to compute.
    code_version : of the streamdash that made it.
    engine_version : of the engine whose results it holds; 0 when that cannot be read.
    shipped : whether it lies in a folder that is only read.
    """

    kind: Literal["ensemble", "geometry", "spectra"]
    key: str
    label: str
    path: Path
    state: Literal["complete", "partial", "damaged", "foreign"]
    reason: str
    config: Any  # which of the two kinds of configuration follows from `kind`, beyond a type checker
    n_done: int
    n_total: int
    size_bytes: int
    date: str
    cost_s: float
    code_version: str
    shipped: bool
    title: str = ""
    engine_version: int = 0


def inspect(path: Path, kind: str, shipped: bool) -> Entry:
    """Read off its files what the directory `path` is."""
    entry = Entry(
        kind=KINDS[kind],
        key=key_of(path.name.split(SET_ASIDE)[0]) or "",
        label=path.name,
        path=path,
        state="damaged",
        reason="",
        config=None,
        n_done=0,
        n_total=0,
        size_bytes=_size(path),
        date="",
        cost_s=0.0,
        code_version="",
        shipped=shipped,
    )
    if SET_ASIDE in path.name:
        return replace(entry, reason="it could not be used, was set aside, and can be removed")
    try:
        manifest, config = read_manifest(path, kind)
    except ForeignError as error:
        return replace(entry, state="foreign", reason=str(error))
    except StoreError as error:
        return replace(entry, reason=str(error))
    done = total = 1
    if isinstance(config, EnsembleConfig):
        total, done = config.n_streams, streams_in(config, manifest.chunks)
    problems = file_problems(path, manifest.listed(), fresh=False)
    more = f" (and {len(problems) - 1} more problems)" if len(problems) > 1 else ""
    return replace(
        entry,
        label=manifest.label,
        state="damaged" if problems else "complete" if done == total else "partial",
        reason=problems[0] + more if problems else "",
        config=config,
        n_done=done,
        n_total=total,
        date=manifest.updated,
        cost_s=manifest.cost_s,
        code_version=manifest.code_version,
        title=manifest.title,
        engine_version=manifest.engine_version,
    )


def problems_of(path: Path, kind: str) -> list[str]:
    """Every problem of an entry in words, all its files read anew."""
    if SET_ASIDE in path.name:
        return ["it could not be used, was set aside, and can be removed"]
    try:
        manifest, _ = read_manifest(path, kind)
    except StoreError as error:
        return [str(error)]
    return file_problems(path, manifest.listed(), fresh=True)


def streams_in(config: EnsembleConfig, chunks: Iterable[int]) -> int:
    """How many streams the given chunks hold together."""
    return sum(len(chunk_streams(config, index)) for index in chunks)


def _size(path: Path) -> int:
    total = 0
    with contextlib.suppress(OSError), os.scandir(path) as children:  # files may be removed meanwhile
        for child in children:
            with contextlib.suppress(OSError):
                inside = child.is_dir(follow_symlinks=False)
                total += _size(Path(child)) if inside else child.stat().st_size
    return total


# ---------------------------------------------------------------- making entries


def new_manifest(
    kind: str,
    config: Config,
    label: str,
    header: Mapping[str, bytes],
    cost_s: float = 0.0,
    title: str = "",
) -> Manifest:
    """Manifest of an entry that is about to be created from the files `header`."""
    kept = {"density": DENSITY_BITS, "omega": OMEGA_BITS} if kind == "ensembles" else {}
    return Manifest(
        format=FORMATS[kind],
        config_key=config.key,
        label=label,
        title=title,
        code_version=__version__,
        engine_version=ENGINE_VERSION,
        created=now(),
        updated=now(),
        cost_s=cost_s,
        precision={
            name: f"{bits} bits of mantissa, relative error at most {2.0 ** -(bits + 1):.1e}"
            for name, bits in kept.items()
        },
        header={name: sha256(data) for name, data in sorted(header.items())},
    )


def create(path: Path, config: Config, manifest: Manifest, files: Mapping[str, bytes]) -> None:
    """Make an entry appear at `path` at once, with everything in it."""
    aside = path.with_name(f".new-{path.name}")
    if aside.exists():  # of a process that was killed here
        shutil.rmtree(aside)
    try:
        for name, data in files.items():
            write_file(aside / DATA / name, data)
        write_model(aside / "config.json", config)
        write_model(aside / "manifest.json", manifest)
        aside.replace(path)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise


def set_aside(path: Path) -> None:
    """Rename a directory that cannot be used, so that another can take its place."""
    path.replace(path.with_name(f"{path.name}{SET_ASIDE}{uuid.uuid4().hex[:8]}"))


def write_model(path: Path, model: Config) -> None:
    """Write a model as JSON that people can read, whole or not at all."""
    write_file(path, (model.model_dump_json(indent=1) + "\n").encode())


def now() -> str:
    """Date and time, ISO, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")
