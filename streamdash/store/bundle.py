"""An entry of the cache as one file, to be carried elsewhere; and such a file, from anybody, as an entry.

The file is a ZIP archive without compression that holds config.json, manifest.json and the files that
the manifest lists. A file from elsewhere is not trusted: nothing is unpacked to names it chooses,
nothing larger than announced is read, and nothing is stored that has not been decoded and compared
with what its configuration says it must be.
"""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import xarray as xr
from numcodecs import blosc

from streamdash.config import Config, ConfigError, EnsembleConfig
from streamdash.store.cache import Cache
from streamdash.store.codec import CHUNK, decode, encode_ensemble_header
from streamdash.store.entry import (
    CONFIGS,
    DATA,
    FORMATS,
    Entry,
    Manifest,
    StoreError,
    check_chunks,
    create,
    explained,
    inspect,
    problems_of,
    read_manifest,
    set_aside,
    sha256,
)
from streamdash.store.titles import label_of

LIMIT = 1_000_000_000
"""Largest file that is imported by default, in bytes."""
DIRECTORY_BYTES = 10_000_000
"""Largest table of contents of an archive that is read; an ensemble of a million streams needs 7 MB."""
MODEL_BYTES, METADATA_BYTES = 50_000_000, 1_000_000
"""Largest manifest.json or config.json, and largest zarr.json, accepted."""
VALUES_MAX = 20_000_000
"""Most numbers in all arrays of a geometry or of spectra that are imported."""
WORD, PLAIN = r"[A-Za-z_][A-Za-z0-9_]{0,39}", r"[ -~]{0,80}"
RECORD = {
    "code_version": re.compile(r"[A-Za-z0-9.+_-]{1,64}"),
    "created": re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,6})?(\+00:00|Z)"),
    "updated": re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d{1,6})?(\+00:00|Z)"),
}
"""How our own manifests put what is shown of them."""
NAN = "AAAAAAAA+H8="
"""Not a number, as xarray writes it down for the missing values of an array."""


def export_entry(cache: Cache, name: str, target: Path) -> Entry:
    """Write an intact entry as one file; `target` appears whole or not at all.

    Raises
    ------
    StoreError
        When there is no such entry, it is not intact, or the file cannot be written or exists.
    """
    entry = cache.find(name)
    kind = entry.path.parent.name
    if problems := problems_of(entry.path, kind):
        raise StoreError(f"{entry.path.name} cannot be exported: {problems[0]}.")
    if target.exists():
        raise StoreError(f"{target} exists already; choose another name or delete it.")
    manifest, _ = read_manifest(entry.path, kind)
    names = ["config.json", "manifest.json", *(f"{DATA}/{file}" for file in manifest.listed())]
    try:
        handle, aside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        try:
            with os.fdopen(handle, "wb") as file, zipfile.ZipFile(file, "w") as archive:
                for inside in names:
                    # A fixed date, so that the same entry is always the same file.
                    archive.writestr(zipfile.ZipInfo(inside), (entry.path / inside).read_bytes())
            Path(aside).replace(target)
        except BaseException:
            Path(aside).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise StoreError(f"{target} cannot be written ({error.strerror or error}).") from error
    return entry


def import_entry(
    cache: Cache,
    source: Path,
    limit: int = LIMIT,
    compare: Callable[[Config, xr.Dataset], None] | None = None,
) -> Entry:
    """Take the entry that a file holds into the cache; nothing is written before all of it is checked.

    Parameters
    ----------
    limit : largest file accepted, in bytes.
    compare : callable (config, dataset), optional
        Asked at last, for geometries and spectra; raises `ValueError`, in a sentence, when they are not what
        their configuration gives: `streamdash.simulation.geometry.check_geometry` for geometries.

    Raises
    ------
    StoreError
        When the file is not an entry, is damaged or does not keep to the rules, with the reason;
        when an intact entry of that key is there already; when the cache cannot be written to.
    """
    try:
        manifest, config, files = _read(source, limit)
        kind = next(kind for kind, name in FORMATS.items() if name == manifest.format)
        _check_record(manifest)
        dataset = _check_content(config, manifest, files)
        if dataset is not None and compare is not None:
            _compare(compare, config, dataset)
    except (OSError, zipfile.BadZipFile, NotImplementedError) as error:
        raise StoreError(f"{source} cannot be read as an exported entry ({error}).") from None
    except (StoreError, ConfigError) as error:
        raise StoreError(f"{source} is refused: {str(error).rstrip('.')}.") from None
    cache.check_writable()
    root = cache.writable
    assert root is not None
    path = root / kind / f"{label_of(config)}-{config.key}"
    with cache.writing(config.key), explained(root):
        if path.exists():
            if not problems_of(path, kind) and not _adds(path, manifest):
                raise StoreError(f"{path.name} is in the cache already.")
            set_aside(path)
        create(path, config, manifest.model_copy(update={"label": label_of(config)}), files)
    return inspect(path, kind, shipped=False)


def _adds(path: Path, manifest: Manifest) -> bool:
    """Whether a manifest lists chunks that the entry at `path` does not have."""
    there, _ = read_manifest(path, path.parent.name)
    return there.header == manifest.header and set(there.chunks) < set(manifest.chunks)


# ---------------------------------------------------------------- reading


def _read(source: Path, limit: int) -> tuple[Manifest, Any, dict[str, bytes]]:
    """Manifest, configuration and data files of an archive, names, sizes and checksums compared."""
    size = source.stat().st_size
    if size > limit:
        raise StoreError(f"it has {size / 1e6:.0f} MB, more than the {limit / 1e6:.0f} MB allowed")
    _check_directory(source)
    with zipfile.ZipFile(source) as archive:
        infos = {info.filename: info for info in archive.infolist()}
        if len(infos) != len(archive.infolist()):
            raise StoreError("it holds a name twice")
        for info in infos.values():
            stored = info.compress_type == zipfile.ZIP_STORED and info.file_size == info.compress_size
            if not stored or info.flag_bits & 1:
                raise StoreError(f"{_shown(info.filename)} is compressed or encrypted, which exports are not")
        if sum(info.file_size for info in infos.values()) > limit:
            raise StoreError("its contents are larger than the file itself may be")

        def read(name: str, most: int) -> bytes:
            info = infos.pop(name, None)
            if info is None:
                raise StoreError(f"{name} is missing")
            if info.file_size > most:
                raise StoreError(f"{name} is too large")
            return archive.read(info)

        manifest = Manifest.parse(read("manifest.json", MODEL_BYTES))
        kinds = [kind for kind, name in FORMATS.items() if name == manifest.format]
        if not kinds:
            raise StoreError(
                f"its format is {_shown(manifest.format)}, not one of {', '.join(FORMATS.values())}"
            )
        config: Config = CONFIGS[kinds[0]].parse(read("config.json", MODEL_BYTES))
        if config.key != manifest.config_key:
            raise StoreError(f"config.json hashes to {config.key}, manifest.json says another key")
        if isinstance(config, EnsembleConfig):
            check_chunks(manifest, config)
        files = {}
        for name, checksum in manifest.listed().items():
            files[name] = read(f"{DATA}/{name}", METADATA_BYTES if name.endswith("zarr.json") else limit)
            if sha256(files[name]) != checksum:
                raise StoreError(f"{DATA}/{name} does not match its checksum")
    if infos:
        raise StoreError(f"it holds {_shown(min(infos))}, which its manifest.json does not list")
    return manifest, config, files


def _check_directory(source: Path) -> None:
    """Refuse archives whose table of contents alone would exhaust the memory.

    It must end the file as in our exports: no comment, no ZIP64 extension.
    """
    with source.open("rb") as file:
        file.seek(max(source.stat().st_size - 42, 0))
        tail = file.read()
    locator, end = tail[:-22], tail[-22:]
    plain = len(end) == 22 and end.startswith(b"PK\5\6") and not locator.startswith(b"PK\6\7")
    if not plain or int.from_bytes(end[12:16], "little") > DIRECTORY_BYTES:
        raise StoreError("it is not a ZIP archive as `streamdash cache export` writes it")


def _shown(text: str) -> str:
    return repr(text[:60])


# ---------------------------------------------------------------- believing


def _check_record(manifest: Manifest) -> None:
    """Refuse what an entry says of itself in other words than ours: it is shown on terminals."""
    for name, pattern in RECORD.items():
        if pattern.fullmatch(getattr(manifest, name)) is None:
            raise StoreError(
                f"manifest.json: {name} is {_shown(getattr(manifest, name))}, which no export says"
            )
    if any(re.fullmatch(PLAIN, word) is None for pair in manifest.precision.items() for word in pair):
        raise StoreError("manifest.json: precision holds what no export says")


def _compare(compare: Callable[[Config, xr.Dataset], None], config: Config, dataset: xr.Dataset) -> None:
    try:
        compare(config, dataset)
    except ValueError as error:
        raise StoreError(str(error)) from None


def _check_content(config: Any, manifest: Manifest, files: Mapping[str, bytes]) -> xr.Dataset | None:
    """Decode everything, within known sizes, and compare it with what the configuration says.

    What geometries and spectra hold is returned.
    """
    try:
        if isinstance(config, EnsembleConfig):
            _check_ensemble(config, manifest, files)
            return None
        return _check_arrays(manifest, files)
    except StoreError:
        raise
    except Exception as error:  # whatever the libraries make of hostile bytes
        raise StoreError(f"its data cannot be decoded ({type(error).__name__})") from None


def _check_ensemble(config: EnsembleConfig, manifest: Manifest, files: Mapping[str, bytes]) -> None:
    theta = np.linspace(config.theta_min, config.theta_max, config.n_theta)
    nothing = xr.Dataset(dict.fromkeys(("smooth", "omega_smooth"), ("theta", 0 * theta)), {"theta": theta})
    ours = encode_ensemble_header(config, nothing)
    if set(manifest.header) != set(ours):
        raise StoreError("its manifest.json lists other files than an ensemble has")
    for name, data in ours.items():
        if name.endswith("zarr.json") and json.loads(files[name]) != json.loads(data):
            raise StoreError(f"{DATA}/{name} is not that of an ensemble of this configuration")
    for name, data in files.items():
        if name.startswith(("density/c", "omega/c")):
            _unpacked_blosc(data, 4 * CHUNK * config.n_theta)
        elif name.startswith("n_impacts/c"):
            _unpacked_blosc(data, 4 * CHUNK)
        elif not name.endswith("zarr.json"):
            _unpacked_zstd(data, 8 * config.n_theta)
    done = [i * CHUNK + j for i in sorted(manifest.chunks) for j in range(CHUNK)]
    dataset = decode(files, [i for i in done if i < config.n_streams])
    density = dataset["density"].values
    sound = (
        np.array_equal(dataset["theta"], theta)
        and all(np.isfinite(dataset[name]).all() for name in ("smooth", "omega_smooth", "density"))
        and np.isfinite(dataset["omega"].values[density > 0]).all()
        and (density >= 0).all()
    )
    if not sound:
        raise StoreError("its profiles are not finite, or not on the angles of its configuration")


def _check_arrays(manifest: Manifest, files: Mapping[str, bytes]) -> xr.Dataset:
    """Arrays of plain numbers, each in one chunk of the size that its metadata announce, and nothing else."""
    if manifest.chunks:
        raise StoreError("its manifest.json lists chunks, which only ensembles have")
    names = {name.partition("/")[0] for name in files} - {"zarr.json"}
    wanted = {"zarr.json"}
    _check_group(json.loads(files.get("zarr.json", b"{}")))
    announced = 0
    for name in sorted(names):
        if re.fullmatch(WORD, name) is None or f"{name}/zarr.json" not in files:
            raise StoreError(f"{DATA}/{_shown(name)} is no array")
        about = json.loads(files[f"{name}/zarr.json"])
        shape, dtype = _check_metadata(name, about)
        size = math.prod(shape)
        announced += size
        if announced > VALUES_MAX:
            raise StoreError(f"its arrays announce {announced} numbers, too many")
        chunk = "/".join([name, "c", *("0" for _ in shape)])
        wanted |= {f"{name}/zarr.json", chunk}
        if chunk not in files:
            raise StoreError(f"{DATA}/{chunk} is missing")
        packed, unpacked = files[chunk], size * dtype.itemsize
        match about["codecs"][-1]["name"]:
            case "blosc":
                _unpacked_blosc(packed, unpacked)
            case "zstd":
                _unpacked_zstd(packed, unpacked)
            case _ if len(packed) != unpacked:
                raise StoreError(f"{DATA}/{chunk} has {len(packed)} bytes, not {unpacked}")
    if set(files) != wanted:
        raise StoreError(f"{DATA}/{_shown(min(set(files) ^ wanted))} belongs to none of its arrays")
    return decode(files)


def _check_group(about: Any) -> None:
    """A group that says nothing but a few numbers."""
    sound = about.get("node_type") == "group" and set(about) <= {
        "attributes", "zarr_format", "node_type", "consolidated_metadata"
    }  # fmt: skip
    attributes = about.get("attributes", {})
    if not sound or about.get("consolidated_metadata") or len(attributes) > 50:
        raise StoreError(f"{DATA}/zarr.json is not that of an export")
    for name, value in attributes.items():
        number = type(value) in (int, float) and math.isfinite(value)
        if re.fullmatch(WORD, name) is None or not number:
            raise StoreError(f"{DATA}/zarr.json: {_shown(name)} is not a finite number")


def _check_metadata(name: str, about: Any) -> tuple[list[int], np.dtype]:
    """Shape and type of an array whose numbers are what they seem: not scaled, masked or of other names."""
    shape, dtype = about["shape"], np.dtype(about["data_type"])
    if dtype.kind not in "fiub" or len(shape) > 4 or any(type(n) is not int or n < 0 for n in shape):
        raise StoreError(f"{DATA}/{name}/zarr.json describes something other than plain numbers")
    if math.prod(shape) > VALUES_MAX:
        raise StoreError(f"{DATA}/{name} announces {math.prod(shape)} numbers, too many")
    codecs = [codec["name"] for codec in about["codecs"]]
    chunk = about["chunk_grid"]["configuration"]["chunk_shape"]
    key = about.get("chunk_key_encoding", {"name": "default"})
    plain_key = key["name"] == "default" and key.get("configuration", {}).get("separator", "/") == "/"
    if (
        codecs not in (["bytes", "blosc"], ["bytes", "zstd"], ["bytes"])
        or chunk != shape
        or not plain_key
        or about.get("storage_transformers")
    ):
        raise StoreError(f"{DATA}/{name}/zarr.json uses an encoding that exports do not have")
    attributes = about.get("attributes", {})
    if not set(attributes) <= {"_FillValue"} or attributes.get("_FillValue", NAN) != NAN:
        raise StoreError(f"{DATA}/{name}/zarr.json has attributes that change its numbers")
    dimensions = about.get("dimension_names") or []
    if any(type(word) is not str or re.fullmatch(WORD, word) is None for word in dimensions):
        raise StoreError(f"{DATA}/{name}/zarr.json names dimensions as exports do not")
    return shape, dtype


def _unpacked_blosc(data: bytes, size: int) -> None:
    """Refuse what does not unpack to exactly `size` bytes; no more than these are ever allocated."""
    announced = int.from_bytes(data[4:8], "little") if len(data) >= 16 else -1
    if announced != size or int.from_bytes(data[12:16], "little") != len(data):
        raise StoreError("a chunk does not unpack to the size that its configuration says")
    blosc.decompress(data, np.empty(size, dtype="uint8"))


def _unpacked_zstd(data: bytes, size: int) -> None:
    numcodecs.Zstd().decode(data, np.empty(size, dtype="uint8"))
