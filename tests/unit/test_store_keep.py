"""Disk that people's own simulations may use, and what is cleared away; damaged entries made whole."""

from __future__ import annotations

import json
import os
import time

import pytest
from typer.testing import CliRunner

from streamdash.cli.main import app
from streamdash.config import EnsembleConfig, Perturbers
from streamdash.simulation.ensemble import simulate
from streamdash.store.cache import Cache, StoreError
from streamdash.store.keeping import IN_USE_S, last_used, make_room, mark_used, own_entries, prune, room_for


@pytest.fixture
def aged(toy, cache):
    """Fill the cache with ensembles of several seeds, the first the oldest; gives their entries."""

    def make(count: int) -> list:
        made = []
        for seed in range(count):
            config = toy.CONFIG.model_copy(update={"seed": seed, "n_streams": 50})
            with cache.begin(config, toy.BACKGROUND) as writer:
                writer.write(0, *toy.profiles(0, 50))
            age(writer.path / "manifest.json", 10_000 - 100 * seed)
            made.append(cache.find(config.key))
        return made

    return make


def age(path, seconds: float) -> None:
    """Make a file look as if it had been written so long ago."""
    then = time.time() - seconds
    os.utime(path, (then, then))


def keys(cache: Cache) -> list[str]:
    return sorted(entry.key for entry in cache.entries())


def test_the_least_recently_used_goes_first(cache, aged):
    a, b, c = aged(3)
    mark_used(cache, a.key)
    age(cache.roots[0] / ".used" / a.key, IN_USE_S + 10)
    limit = sum(e.size_bytes for e in (a, b, c))
    assert make_room(cache, 0, limit) == []
    assert [e.key for e in make_room(cache, 10, limit)] == [b.key]
    assert keys(cache) == sorted([a.key, c.key])
    assert [e.key for e in make_room(cache, a.size_bytes, limit)] == []


def test_what_is_in_use_being_written_or_wanted_stays(toy, cache, aged):
    used, written, wanted = aged(3)
    mark_used(cache, used.key)
    config = written.config
    with cache.begin(config, toy.BACKGROUND):
        with pytest.raises(
            StoreError, match="may take 0 MB, this one needs up to .* are in use; ask for fewer"
        ):
            make_room(cache, 1, 1000, keep=[wanted.key])
    assert len(keys(cache)) == 3


def test_nothing_is_removed_when_that_would_not_do(cache, aged):
    a, b = aged(2)
    mark_used(cache, b.key)
    with pytest.raises(StoreError):
        make_room(cache, a.size_bytes * 2, a.size_bytes * 2)
    assert len(keys(cache)) == 2


def test_shipped_entries_are_never_removed(toy, cache, tmp_path, shipped_cache):
    toy.fill(cache)
    both = Cache((cache.roots[0], tmp_path / "own"), tmp_path / "own")
    with pytest.raises(StoreError):
        make_room(both, 2, 1)
    assert len(both.entries()) == 1
    writable = Cache.default(shipped_cache)
    assert own_entries(writable) == []  # even where they could be written to
    mark_used(writable, writable.entries()[0].key)
    assert not (shipped_cache / ".used").exists()


def test_a_clock_that_was_set_back_protects_nothing_for_long(cache, aged):
    (entry,) = aged(1)
    age(entry.path / "manifest.json", -1_000_000)
    mark_used(cache, entry.key)
    age(cache.roots[0] / ".used" / entry.key, -2_000_000)
    assert last_used(cache, entry) == 0
    mark_used(cache, entry.key)
    assert last_used(cache, entry) == pytest.approx(time.time(), abs=5)


def test_an_ensemble_never_takes_more_than_the_room_made_for_it(toy, cache):
    toy.fill(cache)
    assert cache.entries()[0].size_bytes < room_for(toy.CONFIG)


def test_prune_clears_what_interrupted_work_left_and_no_more(toy, cache, aged, tmp_path):
    aged(1)
    path = toy.fill(cache, [0])
    (path / "data.zarr/density/c/1").mkdir()
    (path / "data.zarr/density/c/1/.0.tmp").write_bytes(b"half")
    for name in (".new-1e3-1e5-0123456789abcdef", f"{path.name}.damaged-00000000"):
        (path.parent / name).mkdir()
        (path.parent / name / "file").write_bytes(b"12345")
    would = prune(cache, dry_run=True)
    assert len(would) == 3
    assert prune(cache) == would
    assert prune(cache) == []
    assert sorted(e.state for e in cache.entries()) == ["complete", "partial"]
    result = CliRunner().invoke(
        app, ["cache", "prune", "--unfinished", "--cache", str(tmp_path), "--json"], catch_exceptions=False
    )
    assert [found["path"] for found in json.loads(result.stdout)] == [str(path)]
    assert [e.state for e in cache.entries()] == ["complete"]


# ------------------------------------------------------------------ repair


@pytest.fixture
def config() -> EnsembleConfig:
    return EnsembleConfig(perturbers=Perturbers(mass_range="1e7-1e9"), n_streams=60, n_theta=30)


def verify(cache: Cache, *options: str, exit_code: int = 0) -> str:
    line = ["cache", "verify", *options, "--workers", "1", "--cache", str(cache.roots[0])]
    result = CliRunner().invoke(app, line, catch_exceptions=False)
    assert result.exit_code == exit_code, result.output
    return result.stdout


def test_repair_computes_damaged_chunks_again(toy, geometry_cache, config):
    simulate(config, "inline", cache=geometry_cache)
    path = geometry_cache.find(config.key).path
    good = toy.data_bytes(path)
    toy.damage(path / "data.zarr/density/c/0/0", "truncated")
    toy.damage(path / "data.zarr/omega/c/1/0", "missing")
    assert "does not match its checksum" in verify(geometry_cache, exit_code=1)
    assert "what was damaged is computed again" in verify(geometry_cache, "--repair")
    assert toy.data_bytes(path) == good
    assert "intact" in verify(geometry_cache, config.key)


def test_repair_keeps_what_is_sound_of_an_unfinished_ensemble(toy, geometry_cache, config):
    from streamdash.simulation.ensemble import Stopped

    reported = []
    with pytest.raises(Stopped):
        simulate(
            config,
            "inline",
            cache=geometry_cache,
            progress=lambda done, _: reported.append(done),
            should_stop=lambda: reported[-1] > 0,
        )
    toy.damage(geometry_cache.find(config.key).path / "data.zarr/density/c/0/0", "bit-flipped")
    verify(geometry_cache, config.key, "--repair")
    entry = geometry_cache.find(config.key)
    assert (entry.state, entry.n_done, geometry_cache.verify(entry)) == ("partial", 0, [])


def test_repair_sets_aside_what_cannot_be_read(toy, cache):
    path = toy.fill(cache)
    toy.damage(path / "config.json", "truncated")
    assert "set aside" in verify(cache, "--repair")
    assert not path.exists()
    assert "prune" in verify(cache, "--repair", exit_code=1)
    prune(cache)
    assert cache.entries() == []
