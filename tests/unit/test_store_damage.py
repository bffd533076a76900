"""What is damaged or foreign in a cache is named, never loaded, and made anew."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from streamdash.store.cache import StoreError

# ------------------------------------------------------------------ damage


@pytest.mark.parametrize("how", ["truncated", "bit-flipped", "missing"])
@pytest.mark.parametrize(
    "name", ["density/c/1/0", "omega/c/0/0", "n_impacts/c/2", "density/zarr.json", "theta/c/0", "zarr.json"]
)
def test_a_damaged_file_is_named_and_never_loaded(toy, cache, name, how):
    path = toy.fill(cache)
    assert [e.state for e in cache.entries()] == ["complete"]
    toy.damage(path / "data.zarr" / name, how)
    (entry,) = cache.entries()
    assert entry.state == "damaged"
    assert name in entry.reason
    problems = cache.verify(entry)
    assert len(problems) == 1
    assert name in problems[0]
    with pytest.raises(StoreError, match=name):
        cache.open_ensemble(toy.CONFIG)


def test_damage_that_keeps_size_and_time_is_found_when_opening_and_verifying(toy, cache):
    path = toy.fill(cache)
    (entry,) = cache.entries()
    file = path / "data.zarr/density/c/1/0"
    before = file.stat()
    toy.damage(file, "bit-flipped")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert cache.verify(entry) == ["data.zarr/density/c/1/0 does not match its checksum"]
    with pytest.raises(StoreError, match="checksum"):
        cache.open_ensemble(toy.CONFIG)


def test_complete_ensembles_are_those_that_are_wanted_and_whole(toy, cache):
    path = toy.fill(cache)
    assert [e.path for e in cache.complete_ensembles(lambda config: config == toy.CONFIG)] == [path]
    assert cache.complete_ensembles(lambda config: config != toy.CONFIG) == []
    toy.damage(path / "data.zarr/density/c/1/0", "truncated")
    assert cache.complete_ensembles(lambda config: config == toy.CONFIG) == []


def test_every_problem_is_listed(toy, cache):
    path = toy.fill(cache)
    toy.damage(path / "data.zarr/density/c/1/0", "missing")
    toy.damage(path / "data.zarr/omega/c/1/0", "truncated")
    (entry,) = cache.entries()
    assert entry.reason.endswith("(and 1 more problems)")
    assert cache.verify(entry) == [
        "data.zarr/density/c/1/0 cannot be read (No such file or directory)",
        "data.zarr/omega/c/1/0 does not match its checksum",
    ]


def test_damaged_chunks_are_computed_again(toy, cache):
    path = toy.fill(cache)
    good = toy.data_bytes(path)
    toy.damage(path / "data.zarr/density/c/1/0", "truncated")
    with cache.begin(toy.CONFIG, toy.BACKGROUND) as writer:
        assert writer.missing() == [1]
    assert toy.data_bytes(toy.fill(cache)) == good
    assert [e.state for e in cache.entries()] == ["complete"]


@pytest.mark.parametrize("name", ["manifest.json", "config.json", "data.zarr/theta/c/0"])
@pytest.mark.parametrize("how", ["truncated", "missing"])
def test_an_entry_that_cannot_be_continued_is_set_aside_and_made_anew(toy, cache, name, how):
    path = toy.fill(cache)
    good = toy.data_bytes(path)
    toy.damage(path / name, how)
    assert [e.state for e in cache.entries()] == ["damaged"]
    with pytest.raises(StoreError, match=Path(name).name.split(".")[0] if name.endswith("json") else name):
        cache.open_ensemble(toy.CONFIG)
    assert toy.data_bytes(toy.fill(cache)) == good
    complete, aside = cache.entries()
    assert (complete.state, aside.state) == ("complete", "damaged")
    cache.remove(aside.path.name)
    assert [e.path for e in cache.entries()] == [path]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("seed", 1),
        ("n_streams", 119),
    ],
)
def test_an_edited_config_no_longer_fits_its_key(toy, cache, field, value):
    path = toy.fill(cache)
    config = json.loads((path / "config.json").read_text())
    (path / "config.json").write_text(json.dumps({**config, field: value}))
    (entry,) = cache.entries()
    assert (entry.state, entry.config) == ("damaged", None)
    assert "hashes to" in entry.reason
    with pytest.raises(StoreError, match="hashes to"):
        cache.open_ensemble(toy.CONFIG)


@pytest.mark.parametrize("name", ["../../../etc/passwd", "/etc/passwd", "density/../../config.json"])
def test_a_manifest_cannot_point_outside_its_entry(toy, cache, name):
    path = toy.fill(cache)
    manifest = json.loads((path / "manifest.json").read_text())
    manifest["header"][name] = "0" * 64
    (path / "manifest.json").write_text(json.dumps(manifest))
    (entry,) = cache.entries()
    assert entry.state == "damaged"
    assert "manifest.json is not valid" in entry.reason


# ------------------------------------------------------------------ foreign


def test_foreign_directories_are_named_and_left_alone(toy, cache):
    folder = cache.roots[0] / "ensembles" / f"1e3-1e5-{toy.CONFIG.key}"
    folder.mkdir(parents=True)
    (folder / "thesis.txt").write_text("important")
    (entry,) = cache.entries()
    assert entry.state == "foreign"
    assert "no manifest.json" in entry.reason
    with pytest.raises(StoreError, match="no manifest"):
        cache.open_ensemble(toy.CONFIG)
    with pytest.raises(StoreError, match="by hand"):
        cache.remove(entry.key)
    toy.fill(cache)
    assert [p.read_text() for p in cache.roots[0].rglob("thesis.txt")] == ["important"]


def test_another_schema_is_foreign(toy, cache):
    path = toy.fill(cache)
    text = (path / "manifest.json").read_text()
    (path / "manifest.json").write_text(text.replace("streamdash-ensemble-1", "streamdash-ensemble-99"))
    (entry,) = cache.entries()
    assert entry.state == "foreign"
    assert "another schema" in entry.reason
    with pytest.raises(StoreError, match="another schema"):
        cache.open_ensemble(toy.CONFIG)


def test_a_stray_file_is_foreign(cache):
    (cache.roots[0] / "ensembles").mkdir()
    (cache.roots[0] / "ensembles" / "notes.txt").write_text("hello")
    assert [(e.state, e.reason) for e in cache.entries()] == [("foreign", "it is not a directory")]
