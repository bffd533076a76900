"""What the engine's version decides: what of a cache may be continued, mixed and computed with."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from streamdash.config import ENGINE_VERSION, StreamModel
from streamdash.store import entry as entries
from streamdash.store import parts
from streamdash.store.cache import Cache
from streamdash.store.entry import read_manifest
from streamdash.store.parts import part_files, parts_folder

STREAM = StreamModel(n_times=2)
GEOMETRY = xr.Dataset({"track": ("time", np.array([1.0, 2.0]))})


def written(path, **values) -> None:
    """Change what a manifest says; None takes a field out."""
    manifest = json.loads((path / "manifest.json").read_text()) | values
    text = json.dumps({name: value for name, value in manifest.items() if value is not None})
    (path / "manifest.json").write_text(text)


def sized(toy, n: int):
    return toy.CONFIG.model_copy(update={"n_streams": n})


def test_the_package_s_version_is_only_recorded(toy, cache):
    """An entry that another release has begun is continued, and its chunks are taken over."""
    path = toy.fill(cache, [1])
    written(path, code_version="99.9")
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 2]
    with cache.begin(sized(toy, 210), toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 2, 3, 4]
    assert {entry.code_version for entry in cache.entries()} > {"99.9"}


def test_a_manifest_without_an_engine_is_of_the_first(toy, cache):
    path = toy.fill(cache)
    before = cache.open_ensemble(toy.CONFIG)
    written(path, engine_version=None)
    assert read_manifest(path, "ensembles")[0].engine_version == 1
    xr.testing.assert_identical(cache.open_ensemble(toy.CONFIG), before)
    (entry,) = cache.entries()
    assert (entry.state, entry.engine_version) == ("complete", 1)


def test_every_shipped_entry_is_of_this_engine(shipped_cache):
    cache = Cache((shipped_cache,))
    assert {entry.engine_version for entry in cache.entries()} == {ENGINE_VERSION}


@pytest.mark.parametrize("engine", [ENGINE_VERSION + 1, ENGINE_VERSION + 40])
def test_an_entry_of_another_engine_is_read_but_not_continued(toy, cache, engine, caplog):
    path = toy.fill(cache, [0, 1])
    written(path, engine_version=engine)
    assert cache.open_ensemble(toy.CONFIG, 100).sizes["stream"] == 100
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 1, 2]
    assert f"engine {engine} made it, this is engine {ENGINE_VERSION}" in caplog.text
    assert sorted(entry.state for entry in cache.entries()) == ["damaged", "partial"]


def test_chunks_of_another_engine_are_not_taken_over(toy, cache):
    written(toy.fill(cache), engine_version=ENGINE_VERSION + 1)
    with cache.begin(sized(toy, 210), toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 1, 2, 3, 4]


def test_a_geometry_of_another_engine_is_computed_again(cache, caplog):
    cache.save_geometry(STREAM, GEOMETRY)
    (entry,) = cache.entries()
    written(entry.path, engine_version=ENGINE_VERSION + 1)
    assert cache.open_geometry(STREAM) is None
    assert "engine" in caplog.text
    assert cache.times_done(STREAM) == 0
    cache.save_geometry(STREAM, 2 * GEOMETRY)
    xr.testing.assert_identical(cache.open_geometry(STREAM), 2 * GEOMETRY)


def test_a_later_engine_leaves_what_this_one_has_begun(toy, cache, monkeypatch):
    """The same from the other side: the code is exchanged, not the manifest."""
    toy.fill(cache, [0])
    with cache.begin_geometry(STREAM) as writer:
        writer.write(0, {"track": np.array([1.0])})
    for module in (entries, parts):
        monkeypatch.setattr(module, "ENGINE_VERSION", ENGINE_VERSION + 1)
    with cache.begin_geometry(STREAM) as writer:
        assert writer.parts() == {}
    assert part_files(parts_folder(cache.writable, STREAM)) == {}
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 1, 2]
        assert writer.manifest.engine_version == ENGINE_VERSION + 1


def test_an_engine_before_the_first_is_refused(toy, cache):
    written(toy.fill(cache), engine_version=0)
    (entry,) = cache.entries()
    assert (entry.state, entry.engine_version) == ("damaged", 0)
    assert "engine_version" in entry.reason
