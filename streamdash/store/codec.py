"""Ensembles and geometries as the files of a Zarr v3 group, and back, all in memory.

Nothing here touches the disk: `streamdash.store.entry` writes, names and checks what is made here.
The same values give the same bytes, whatever the number of threads, so that checksums mean something.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
import zarr
from numcodecs import BitRound
from zarr.abc.buffer import Buffer
from zarr.buffer import cpu
from zarr.codecs import BloscCodec, ZstdCodec
from zarr.storage import MemoryStore

from streamdash.config import EnsembleConfig

CHUNK = 50
"""Streams in one chunk, the unit in which ensembles are computed, written and resumed."""
DENSITY_BITS, OMEGA_BITS = 12, 14
"""Mantissa bits kept of density and mean frequency (float32 has 23).

Rounding to the nearest leaves relative errors of at most 2^-13 = 1.2e-4 and 2^-15 = 3.1e-5, a
tenth or less of the engine's own error, and halves the size of the shipped cache.
"""


def encode_ensemble_header(config: EnsembleConfig, background: xr.Dataset) -> dict[str, bytes]:
    """Files of an ensemble without streams: metadata, angles and the smooth stream.

    Parameters
    ----------
    config : EnsembleConfig
    background : xarray.Dataset
        ``smooth (theta)`` and ``omega_smooth (theta)`` with the coordinate ``theta`` (rad).
    """
    files: dict[str, Buffer] = {}
    group = zarr.create_group(MemoryStore(files))
    for name in ("theta", "smooth", "omega_smooth"):
        values = np.asarray(background[name], dtype=float)
        if values.shape != (config.n_theta,) or not np.isfinite(values).all():
            raise ValueError(f"{name} must be {config.n_theta} finite numbers")
        array = group.create_array(
            name, shape=values.shape, dtype=float, chunks=values.shape, compressors=[ZstdCodec()],
            dimension_names=["theta"], config={"write_empty_chunks": True},
        )  # fmt: skip
        array[:] = values
    _create_stream_arrays(group, config)
    return {name: buffer.to_bytes() for name, buffer in files.items()}


def encode_chunk(
    config: EnsembleConfig, index: int, density: np.ndarray, omega: np.ndarray, n_impacts: np.ndarray
) -> dict[str, bytes]:
    """Files of chunk `index`: streams ``index·CHUNK`` onwards.

    Parameters
    ----------
    density, omega : array (n, n_theta)
        Kept to `DENSITY_BITS` and `OMEGA_BITS` bits of mantissa.
    n_impacts : array (n,)

    Raises
    ------
    ValueError
        When a shape is not that of the chunk, or a value is not finite.
    """
    streams = chunk_streams(config, index)
    shape = (len(streams), config.n_theta)
    density, omega = np.asarray(density), np.asarray(omega)
    for name, values in (("density", density), ("omega", omega)):
        if values.shape != shape:
            raise ValueError(f"{name} of chunk {index} has shape {values.shape}, not {shape}")
    if not np.isfinite(density).all():
        raise ValueError(f"density of chunk {index} is not finite everywhere")
    if not np.isfinite(omega[density > 0]).all():  # where there are no stars it may be undefined
        raise ValueError(f"omega of chunk {index} is not finite where there are stars")
    if np.shape(n_impacts) != shape[:1]:
        raise ValueError(f"n_impacts of chunk {index} has shape {np.shape(n_impacts)}, not {shape[:1]}")
    files: dict[str, Buffer] = {}
    arrays = _create_stream_arrays(zarr.create_group(MemoryStore(files)), config)
    where = slice(streams.start, streams.stop)
    arrays["density"][where] = _rounded(density, DENSITY_BITS)
    arrays["omega"][where] = _rounded(omega, OMEGA_BITS)
    arrays["n_impacts"][where] = np.asarray(n_impacts, dtype="int32")
    return {name: files[name].to_bytes() for name in chunk_files(index)}


def encode_dataset(dataset: xr.Dataset) -> dict[str, bytes]:
    """Files of a Dataset of numbers, without loss.

    Raises
    ------
    TypeError
        When a variable is not numeric: nothing that needs pickling is ever stored.
    """
    for name, variable in dataset.variables.items():
        if variable.dtype.kind not in "fiub":
            raise TypeError(f"variable {name} is not numeric and cannot be stored")
    files: dict[str, Buffer] = {}
    encoding = {
        name: {"compressors": (_blosc(variable.dtype, variable.nbytes),), "chunks": variable.shape}
        for name, variable in dataset.variables.items()
        if variable.ndim
    }
    dataset.drop_encoding().to_zarr(MemoryStore(files), zarr_format=3, consolidated=False, encoding=encoding)
    return {name: buffer.to_bytes() for name, buffer in files.items()}


def decode(files: Mapping[str, bytes], streams: slice | list[int] | None = None) -> xr.Dataset:
    """Dataset, in memory, of the files of a group; optionally of some of its streams only."""
    store = MemoryStore({name: cpu.Buffer.from_bytes(data) for name, data in files.items()})
    dataset = xr.open_zarr(store, consolidated=False, zarr_format=3, chunks=None, decode_times=False)
    if streams is not None:
        dataset = dataset.isel(stream=streams)
    return dataset.load().drop_encoding()


def chunk_streams(config: EnsembleConfig, index: int) -> range:
    """Numbers of the streams in chunk `index`."""
    return range(index * CHUNK, min((index + 1) * CHUNK, config.n_streams))


def chunk_count(n_streams: int) -> int:
    """How many chunks hold `n_streams` streams."""
    return -(-n_streams // CHUNK)


def chunk_files(index: int) -> tuple[str, str, str]:
    """Names of the files of chunk `index`, inside the Zarr group."""
    return f"density/c/{index}/0", f"omega/c/{index}/0", f"n_impacts/c/{index}"


def _create_stream_arrays(group: zarr.Group, config: EnsembleConfig) -> dict[str, zarr.Array]:
    arrays = {}
    profile: dict[str, Any] = {
        "shape": (config.n_streams, config.n_theta),
        "chunks": (CHUNK, config.n_theta),
        "dimension_names": ["stream", "theta"],
    }
    count: dict[str, Any] = {"shape": (config.n_streams,), "chunks": (CHUNK,), "dimension_names": ["stream"]}
    for name, dtype, layout in (
        ("density", "float32", profile),
        ("omega", "float32", profile),
        ("n_impacts", "int32", count),
    ):
        codec = _blosc(np.dtype(dtype), 4 * int(np.prod(layout["chunks"])))
        # An array of zeros (no impacts) must still be a file: files that exist are the progress.
        arrays[name] = group.create_array(
            name, dtype=dtype, compressors=[codec], config={"write_empty_chunks": True}, **layout
        )
    return arrays


def _blosc(dtype: np.dtype, nbytes: int) -> BloscCodec:
    # One block for the whole chunk: Blosc writes blocks in the order its threads finish them,
    # so several blocks would make the bytes, and with them the checksums, a matter of chance.
    return BloscCodec(
        cname="zstd", clevel=7, shuffle="bitshuffle", typesize=dtype.itemsize, blocksize=max(nbytes, 128)
    )


def _rounded(values: np.ndarray, bits: int) -> np.ndarray:
    codec = BitRound(keepbits=bits)
    return codec.decode(codec.encode(np.ascontiguousarray(values, dtype="float32")))
