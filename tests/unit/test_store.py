"""The cache: what is whole is read back exactly, what is not is named and never loaded."""

from __future__ import annotations

import contextlib
import errno
import json
import resource
import shutil
import stat
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.store import reading
from streamdash.store.cache import CHUNK, BusyError, Cache, StoreError
from streamdash.store.entry import explained


@pytest.fixture
def public_dir():
    """A directory another user can reach (pytest's own are private)."""
    path = Path(tempfile.mkdtemp())
    path.chmod(0o755)
    yield path
    shutil.rmtree(path)


# ------------------------------------------------------------------ whole entries


def test_what_is_written_is_read_back_within_the_documented_rounding(toy, cache):
    toy.fill(cache)
    dataset = cache.open_ensemble(toy.CONFIG)
    assert dict(dataset.sizes) == {"stream": 120, "theta": 64}
    assert dataset.density.dtype == dataset.omega.dtype == np.float32
    expected = [
        np.concatenate(part)
        for part in zip(*(toy.profiles(i, toy.chunk_size(i)) for i in range(3)), strict=True)
    ]
    np.testing.assert_allclose(dataset.density, expected[0], rtol=2.0**-13 + 1e-7, atol=0)
    np.testing.assert_allclose(dataset.omega, expected[1], rtol=2.0**-15 + 1e-7, atol=0)
    np.testing.assert_array_equal(dataset.n_impacts, expected[2])
    xr.testing.assert_identical(dataset[["smooth", "omega_smooth"]].drop_attrs(), toy.BACKGROUND)


def test_the_key_opens_the_same_ensemble(toy, cache):
    toy.fill(cache)
    xr.testing.assert_identical(cache.open_ensemble(toy.CONFIG.key), cache.open_ensemble(toy.CONFIG))


def test_reading_the_first_streams_needs_only_their_chunks(toy, cache):
    path = toy.fill(cache)
    whole = cache.open_ensemble(toy.CONFIG)
    (path / "data.zarr/density/c/2/0").unlink()
    xr.testing.assert_identical(cache.open_ensemble(toy.CONFIG, n_streams=70), whole.isel(stream=slice(70)))
    with pytest.raises(StoreError, match=r"density/c/2/0 cannot be read"):
        cache.open_ensemble(toy.CONFIG)


def test_a_large_ensemble_stays_on_disk_and_is_checked_where_it_is_used(toy, cache, monkeypatch):
    path = toy.fill(cache)
    whole = cache.open_ensemble(toy.CONFIG)
    monkeypatch.setattr(reading, "IN_MEMORY", 10)
    on_disk = cache.open_ensemble(toy.CONFIG)
    xr.testing.assert_identical(on_disk.isel(stream=slice(40, 110)).load(), whole.isel(stream=slice(40, 110)))
    few = cache.open_ensemble(toy.CONFIG, n_streams=70)
    xr.testing.assert_identical(few.load(), whole.isel(stream=slice(70)))

    chunk = path / "data.zarr/density/c/1/0"
    chunk.write_bytes(bytes(chunk.stat().st_size))
    np.testing.assert_array_equal(on_disk.density[:50], whole.density[:50])  # nothing else is read
    with pytest.raises(StoreError, match=r"density/c/1/0 does not match its checksum"):
        on_disk.density[50:100].load()
    chunk.unlink()
    with pytest.raises(StoreError, match=r"density/c/1/0 cannot be read"):
        cache.open_ensemble(toy.CONFIG)


@pytest.mark.parametrize("n", [0, -1, 121])
def test_more_streams_than_there_are_cannot_be_read(toy, cache, n):
    toy.fill(cache)
    with pytest.raises(StoreError, match="120"):
        cache.open_ensemble(toy.CONFIG, n_streams=n)


def test_the_manifest_can_be_checked_by_hand(toy, cache):
    import hashlib

    path = toy.fill(cache)
    manifest = json.loads((path / "manifest.json").read_text())
    assert manifest["label"] == "1e3-1e5"
    assert manifest["cost_s"] == 6.0
    assert path.name == f"1e3-1e5-{toy.CONFIG.key}"
    assert EnsembleConfig.parse((path / "config.json").read_text()) == toy.CONFIG
    listed = dict(manifest["header"])
    for files in manifest["chunks"].values():
        listed.update(files)
    on_disk = {name: hashlib.sha256(data).hexdigest() for name, data in toy.data_bytes(path).items()}
    assert listed == on_disk
    assert str(cache.roots[0]) not in (path / "manifest.json").read_text()


def test_order_of_chunks_does_not_change_a_byte(toy, tmp_path):
    one, other = (
        toy.fill(Cache.default(tmp_path / n), order) for n, order in (("a", [0, 1, 2]), ("b", [2, 0, 1]))
    )
    assert toy.data_bytes(one) == toy.data_bytes(other)


def test_an_ensemble_of_zeros_is_complete(toy, cache):
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        for index in writer.missing():
            n = toy.chunk_size(index)
            writer.write(index, np.zeros((n, 64)), np.zeros((n, 64)), np.zeros(n))
    assert not cache.open_ensemble(toy.CONFIG).density.any()
    assert [e.state for e in cache.entries()] == ["complete"]


def test_smooth_random_profiles_stay_small(tmp_path):
    cache = Cache.default(tmp_path)
    config = EnsembleConfig(n_streams=100)
    theta = np.linspace(config.theta_min, config.theta_max, config.n_theta)
    none = ("theta", np.zeros(400))
    zeros = xr.Dataset({"smooth": none, "omega_smooth": none}, coords={"theta": theta})
    rng = np.random.default_rng(0)
    waves = sum(
        rng.normal(size=(100, 1)) * np.sin(k * np.pi * theta + rng.uniform(0, 6, (100, 1))) / k
        for k in range(1, 60)
    )
    with cache.begin(config, zeros) as writer:
        for index in writer.missing():
            part = waves[index * CHUNK : (index + 1) * CHUNK]
            writer.write(index, np.exp(0.3 * part), 0.0034 * (1 + 0.05 * part), np.full(len(part), 60))
    (entry,) = cache.entries()
    assert entry.size_bytes * 4 * 2000 / 100 < 16e6  # the four shipped ensembles, of 30 MB allowed


# ------------------------------------------------------------------ parts and resuming


def test_a_partial_entry_resumes_with_the_same_bytes(toy, tmp_path):
    undisturbed = toy.fill(Cache.default(tmp_path / "a"))
    cache = Cache.default(tmp_path / "b")
    toy.fill(cache, [1])
    (entry,) = cache.entries()
    assert (entry.state, entry.n_done, entry.n_total) == ("partial", 50, 120)
    with pytest.raises(StoreError, match="not finished, 1 of 3 chunks"):
        cache.open_ensemble(toy.CONFIG)
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 2]
        assert writer.n_done == 50
    assert toy.data_bytes(toy.fill(cache)) == toy.data_bytes(undisturbed)
    (entry,) = cache.entries()
    assert (entry.state, entry.n_done, entry.cost_s) == ("complete", 120, 6.0)


def test_chunk_files_without_a_manifest_entry_are_not_data(toy, cache):
    """As after a kill between the files of a chunk and the manifest."""
    path = toy.fill(cache)
    manifest = json.loads((path / "manifest.json").read_text())
    del manifest["chunks"]["2"]
    (path / "manifest.json").write_text(json.dumps(manifest))
    assert [e.state for e in cache.entries()] == ["partial"]
    with pytest.raises(StoreError, match="not finished"):
        cache.open_ensemble(toy.CONFIG)
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [2]


@pytest.mark.parametrize(
    ("density", "omega", "n_impacts", "message"),
    [
        (np.ones((50, 63)), np.ones((50, 64)), np.ones(50), r"density of chunk 0 has shape \(50, 63\)"),
        (np.ones((50, 64)), np.ones((49, 64)), np.ones(50), r"omega of chunk 0 has shape"),
        (np.ones((50, 64)), np.ones((50, 64)), np.ones(20), r"n_impacts of chunk 0 has shape"),
        (np.full((50, 64), np.nan), np.ones((50, 64)), np.ones(50), "density of chunk 0 is not finite"),
    ],
)
def test_wrong_chunks_are_refused(toy, cache, density, omega, n_impacts, message):
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        with pytest.raises(ValueError, match=message):
            writer.write(0, density, omega, n_impacts)
        assert writer.missing() == [0, 1, 2]


def test_another_smooth_stream_is_not_mixed_in(toy, cache, caplog):
    toy.fill(cache, [0])
    with cache.begin(toy.CONFIG, toy.BACKGROUND * 1.001) as writer:
        assert writer.missing() == [0, 1, 2]
    assert "smooth stream differs" in caplog.text
    assert sorted(e.state for e in cache.entries()) == ["damaged", "partial"]


# ------------------------------------------------------------------ folders


def test_an_empty_or_absent_folder_is_an_empty_cache(toy, tmp_path):
    assert Cache.default(tmp_path / "nowhere").entries() == []
    assert not (tmp_path / "nowhere").exists()
    with pytest.raises(StoreError, match="There is no ensemble"):
        Cache.default(tmp_path).open_ensemble(toy.CONFIG)


def test_a_file_is_not_a_cache(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="is a file"):
        Cache.default(tmp_path / "file")


def test_the_environment_chooses_the_folder_unless_it_is_given(tmp_path, monkeypatch):
    monkeypatch.setenv("STREAMDASH_CACHE", str(tmp_path / "environment"))
    assert Cache.default().roots == (tmp_path / "environment",)
    assert Cache.default(tmp_path / "given").roots == (tmp_path / "given",)
    monkeypatch.delenv("STREAMDASH_CACHE")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "own"))
    shipped, own = Cache.default().roots
    assert shipped == Path(__file__).parents[2] / "cache"
    assert own == Cache.default().writable != shipped


def test_a_complete_entry_in_a_read_only_root_is_opened_and_stays(toy, tmp_path):
    toy.fill(Cache.default(tmp_path / "shipped"))
    cache = Cache((tmp_path / "shipped", tmp_path / "own"), tmp_path / "own")
    assert cache.open_ensemble(toy.CONFIG).sizes["stream"] == 120
    (entry,) = cache.entries()
    assert entry.shipped
    with pytest.raises(StoreError, match="only read and stays"):
        cache.remove(toy.CONFIG.key)
    toy.fill(cache)
    assert [e.shipped for e in cache.entries()] == [True, False]
    cache.remove(toy.CONFIG.key)
    assert [e.shipped for e in cache.entries()] == [True]


def test_a_good_copy_is_used_when_another_is_damaged(toy, tmp_path):
    bad = toy.fill(Cache.default(tmp_path / "shipped"))
    toy.fill(Cache.default(tmp_path / "own"))
    toy.damage(bad / "data.zarr/density/c/0/0", "bit-flipped")
    cache = Cache((tmp_path / "shipped", tmp_path / "own"), tmp_path / "own")
    assert cache.open_ensemble(toy.CONFIG).sizes["stream"] == 120


def test_a_cache_without_a_writable_folder_says_so(toy, tmp_path):
    with pytest.raises(StoreError, match="only read"):
        Cache((tmp_path,)).begin(toy.CONFIG, toy.BACKGROUND)


SCRIPT = textwrap.dedent(
    """
    import os, sys
    sys.path[:0] = sys.argv[2:4]
    from conftest import *
    from streamdash.store.cache import StoreError
    fill(Cache.default(sys.argv[4]))  # everything is imported before rights are given up
    if os.geteuid() == 0:
        os.setgroups([]); os.setgid(65534); os.setuid(65534)
    cache = Cache.default(sys.argv[1])
    print(len(cache.entries()), cache.open_ensemble(CONFIG, n_streams=50).sizes["stream"])
    try:
        fill(cache)
    except StoreError as error:
        sys.exit(str(error))
    """
)


def test_a_read_only_folder_is_read_and_refused_in_a_sentence(toy, public_dir, tmp_path):
    toy.fill(Cache.default(public_dir), [0])
    everything = [public_dir, *public_dir.rglob("*")]
    for path in everything:
        path.chmod(stat.S_IMODE(path.stat().st_mode) & ~0o222)
    paths = [Path(__file__).parent, Path(__file__).parents[2]]
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT, public_dir, *paths, tmp_path], capture_output=True, text=True
    )
    for path in everything:
        path.chmod(0o755)
    assert result.stdout.split() == ["1", "50"]
    assert result.stderr.strip() == (
        f"Cannot write to the cache {public_dir}: it is read-only; "
        "choose another folder with --cache or STREAMDASH_CACHE."
    )


@contextlib.contextmanager
def no_large_files():
    """The operating system refuses files beyond 5 kB, as a full disk refuses any.

    Not for the whole test: the file that the test run itself is written to may be larger.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_when_writing_fails_half_way_what_was_finished_stays(toy, cache):
    flat, noise = np.ones((50, 64)), np.random.default_rng(0).uniform(1, 2, (50, 64))
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        writer.write(0, flat, flat, np.ones(50))
        refused = pytest.raises(StoreError, match="Cannot write to the cache .*: .* before is kept")
        with refused, no_large_files():
            writer.write(1, noise, noise, np.ones(50))
        assert writer.missing() == [1, 2]
        writer.write(2, flat[:20], flat[:20], np.ones(20))
    (entry,) = cache.entries()
    assert (entry.state, entry.n_done) == ("partial", 70)
    assert not list(cache.roots[0].rglob("*.tmp"))


def test_a_full_disk_is_called_that(tmp_path):
    with pytest.raises(StoreError, match="the disk is full; what was finished is kept"), explained(tmp_path):
        raise OSError(errno.ENOSPC, "No space left on device")


# ------------------------------------------------------------------ several writers


def test_only_one_writer_at_a_time(toy, cache):
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        writer.write(0, *toy.profiles(0, 50))
        with pytest.raises(BusyError, match="Another process"):
            cache.begin(toy.CONFIG, toy.BACKGROUND, timeout=0)
        with pytest.raises(BusyError):
            cache.remove(toy.CONFIG.key)
        assert [e.state for e in cache.entries()] == ["partial"]  # readers see what is there
    with cache.begin(toy.CONFIG, toy.BACKGROUND, timeout=0) as writer:
        assert writer.missing() == [1, 2]


def test_the_second_writer_waits_and_finds_the_work_done(toy, cache):
    seen = []

    def second():
        with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
            seen.append(writer.missing())

    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        thread = threading.Thread(target=second)
        thread.start()
        for index in writer.missing():
            writer.write(index, *toy.profiles(index, toy.chunk_size(index)))
            time.sleep(0.05)
        assert seen == []
    thread.join(300)
    assert seen == [[]]


# ------------------------------------------------------------------ geometries


GEOMETRY = xr.Dataset(
    {
        "track": (("time", "x"), np.random.default_rng(0).normal(size=(4, 300))),
        "length": 0.98,
        "n": ("time", range(4)),
    },
    coords={"time": np.arange(4.0)},
    attrs={"arm": "leading"},
)


def test_a_geometry_is_read_back_without_loss(cache):
    stream = StreamModel(n_times=4)
    assert cache.open_geometry(stream) is None
    cache.save_geometry(stream, GEOMETRY, cost_s=12.5)
    xr.testing.assert_identical(cache.open_geometry(stream), GEOMETRY)
    assert cache.open_geometry(StreamModel(n_times=5)) is None
    (entry,) = cache.entries()
    assert (entry.kind, entry.state, entry.label, entry.cost_s) == (
        "geometry", "complete", "leading-9Gyr-4times", 12.5,
    )  # fmt: skip


@pytest.mark.parametrize("how", ["truncated", "bit-flipped", "missing"])
def test_a_damaged_geometry_is_named_passed_over_and_replaced(toy, cache, caplog, how):
    stream = StreamModel(n_times=4)
    cache.save_geometry(stream, GEOMETRY)
    (entry,) = cache.entries()
    toy.damage(entry.path / "data.zarr/track/c/0/0", how)
    assert [e.state for e in cache.entries()] == ["damaged"]
    assert cache.open_geometry(stream) is None
    assert "track/c/0/0" in caplog.text
    cache.save_geometry(stream, GEOMETRY)
    xr.testing.assert_identical(cache.open_geometry(stream), GEOMETRY)


@pytest.mark.parametrize("values", [np.array([{}, []], dtype=object), np.array(["a", "b"])])
def test_what_is_not_a_number_is_not_stored(cache, values):
    with pytest.raises(TypeError, match="variable x is not numeric"):
        cache.save_geometry(StreamModel(), xr.Dataset({"x": ("n", values)}))
    assert cache.entries() == []
