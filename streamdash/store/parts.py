"""A geometry that is being computed: one file per impact time, kept until all are there.

The files lie beside the geometries, in a folder that no listing shows. Each has its own checksum in
its name, so a file is either whole or not counted; progress can be read by any process.
"""

from __future__ import annotations

import contextlib
import io
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import filelock
import numpy as np
import xarray as xr

from streamdash.config import ENGINE_VERSION, Config, StreamModel
from streamdash.store.codec import encode_dataset
from streamdash.store.entry import (
    StoreError,
    check_engine,
    create,
    explained,
    new_manifest,
    problems_of,
    read_manifest,
    set_aside,
    sha256,
    write_file,
)
from streamdash.store.titles import geometry_label

DIGITS = 16
"""Hexadecimal digits of a part's checksum that are in its name."""


def parts_folder(root: Path, stream: StreamModel) -> Path:
    """Where this engine's parts of a geometry are kept under the cache folder `root`."""
    return root / "geometries" / f".parts-{ENGINE_VERSION}-{stream.key}"


def part_files(folder: Path) -> dict[int, Path]:
    """Parts that are there, by number of the impact time; their contents are not checked."""
    found = {}
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        for path in folder.iterdir():
            number, _, rest = path.name.partition("-")
            if number.isdecimal() and number.isascii() and len(rest) == DIGITS + len(".npz"):
                found[int(number)] = path
    return found


@dataclass
class GeometryWriter:
    """The right to compute one geometry; a context manager that gives it back.

    Obtained from `streamdash.store.cache.Cache.begin_geometry`.
    """

    path: Path
    stream: StreamModel
    lock: filelock.BaseFileLock = field(repr=False)

    @property
    def root(self) -> Path:
        """The cache folder."""
        return self.path.parent.parent

    def parts(self) -> dict[int, dict[str, np.ndarray]]:
        """Arrays of the finished impact times by their number; damaged files are left out."""
        found = {}
        for number, path in sorted(part_files(parts_folder(self.root, self.stream)).items()):
            with contextlib.suppress(OSError):
                data = path.read_bytes()
                if number < len(self.stream.impact_times_gyr) and path.stem.endswith(sha256(data)[:DIGITS]):
                    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                        found[number] = dict(arrays)
        return found

    def write(self, number: int, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep one impact time, whole or not at all.

        Raises
        ------
        StoreError
            When the disk is full or read-only; earlier ones stay.
        """
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        data = buffer.getvalue()
        name = f"{number:03d}-{sha256(data)[:DIGITS]}.npz"
        with explained(self.root):
            write_file(parts_folder(self.root, self.stream) / name, data)

    def finish(self, dataset: xr.Dataset, cost_s: float = 0.0) -> None:
        """Store the geometry, unless an intact one is there already, and drop its parts.

        Raises
        ------
        StoreError
            When the cache cannot be written to.
        TypeError
            When a variable is not numeric.
        """
        with explained(self.root):
            store_whole(self.path, self.stream, geometry_label(self.stream), dataset, cost_s)
            shutil.rmtree(parts_folder(self.root, self.stream), ignore_errors=True)

    def __enter__(self) -> GeometryWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.lock.release()


def store_whole(path: Path, config: Config, label: str, dataset: xr.Dataset, cost_s: float) -> None:
    """Make a Dataset of numbers the entry at `path`, unless an intact one of this engine is there already.

    Raises
    ------
    TypeError
        When a variable is not numeric.
    """
    kind = path.parent.name
    files = encode_dataset(dataset)
    if path.exists():
        with contextlib.suppress(StoreError):
            check_engine(read_manifest(path, kind)[0])
            if not problems_of(path, kind):
                return
        set_aside(path)
    create(path, config, new_manifest(kind, config, label, files, cost_s), files)
