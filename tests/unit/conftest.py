"""What the unit tests share: a small ensemble of made-up profiles to fill caches with."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.store.cache import CHUNK, Cache

CONFIG = EnsembleConfig(
    stream=StreamModel(n_times=4), perturbers=Perturbers(mass_range="1e3-1e5"), n_streams=120, n_theta=64
)
THETA = np.linspace(CONFIG.theta_min, CONFIG.theta_max, CONFIG.n_theta)
BACKGROUND = xr.Dataset(
    {"smooth": ("theta", np.exp(-((THETA / 0.8) ** 4))), "omega_smooth": ("theta", 0.003 + 0.001 * THETA)},
    coords={"theta": THETA},
)


def profiles(index: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(index)
    bumps = np.cumsum(rng.normal(0, 0.05, (2, n, CONFIG.n_theta)), axis=-1)
    density = np.clip(BACKGROUND.smooth.values * (1 + bumps[0]), 0, None)
    return density, BACKGROUND.omega_smooth.values * (1 + 0.1 * bumps[1]), rng.poisson(60, n)


def chunk_size(index: int) -> int:
    return min(CHUNK, CONFIG.n_streams - index * CHUNK)


def fill(cache: Cache, chunks=None) -> Path:
    with cache.begin(CONFIG, BACKGROUND) as writer:
        for index in writer.missing() if chunks is None else chunks:
            writer.write(index, *profiles(index, chunk_size(index)), cost_s=2.0)
        return writer.path


def data_bytes(entry: Path) -> dict[str, bytes]:
    data = entry / "data.zarr"
    return {str(f.relative_to(data)): f.read_bytes() for f in data.rglob("*") if f.is_file()}


def damage(path: Path, how: str) -> None:
    data = path.read_bytes()
    if how == "truncated":
        path.write_bytes(data[: len(data) // 2])
    elif how == "bit-flipped":
        middle = len(data) // 2
        path.write_bytes(data[:middle] + bytes([data[middle] ^ 16]) + data[middle + 1 :])
    else:
        path.unlink()


@pytest.fixture(scope="session")
def toy():
    """This module: `CONFIG`, `BACKGROUND` and the functions above."""
    return sys.modules[__name__]


@pytest.fixture(scope="session")
def geometry_root(shipped_cache, tmp_path_factory) -> Path:
    """Folder of a cache that holds nothing but the geometry of the default stream."""
    root = tmp_path_factory.mktemp("geometry") / "cache"
    (default,) = (shipped_cache / "geometries").glob(f"*-{StreamModel().key}")
    shutil.copytree(default, root / "geometries" / default.name)
    return root


@pytest.fixture
def geometry_cache(geometry_root, tmp_path) -> Cache:
    """A cache of the test's own that holds the geometry of the default stream."""
    shutil.copytree(geometry_root, tmp_path / "cache")
    return Cache.default(tmp_path / "cache")


@pytest.fixture
def cache(tmp_path) -> Cache:
    """An empty cache."""
    return Cache.default(tmp_path)
