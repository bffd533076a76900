"""Ensembles that differ in their number of streams only share what they have; names that people give."""

from __future__ import annotations

import threading

import pytest
import xarray as xr

from streamdash.config import StreamModel
from streamdash.store.cache import BusyError, Cache, StoreError
from streamdash.store.parts import part_files, parts_folder
from streamdash.store.titles import check_title


@pytest.fixture
def sized(toy):
    """The toy's configuration with another number of streams."""
    return lambda n: toy.CONFIG.model_copy(update={"n_streams": n})


@pytest.mark.parametrize("n", [1, 50, 70, 119])
def test_fewer_streams_are_read_from_a_larger_ensemble(toy, cache, sized, n):
    path = toy.fill(cache)
    whole = cache.open_ensemble(toy.CONFIG)
    xr.testing.assert_identical(cache.open_ensemble(sized(n)), whole.isel(stream=slice(n)))
    assert cache.covering(sized(n)).path == path
    assert len(cache.entries()) == 1


def test_a_partial_ensemble_gives_the_streams_that_it_has(toy, cache, sized):
    toy.fill(cache, [0, 2])
    assert cache.open_ensemble(sized(50)).sizes["stream"] == 50
    assert cache.covering(sized(60)) is None
    with pytest.raises(StoreError):
        cache.open_ensemble(sized(60))


@pytest.mark.parametrize("change", [{"seed": 1}, {"n_theta": 65}, {"theta_max": 0.9}])
def test_nothing_else_may_differ(toy, cache, sized, change):
    toy.fill(cache)
    other = sized(50).model_copy(update=change)
    assert cache.covering(other) is None
    with pytest.raises(StoreError):
        cache.open_ensemble(other)


def test_more_streams_begin_with_the_chunks_of_a_smaller_ensemble(toy, cache, sized):
    path = toy.fill(cache)
    before = cache.entries()[0].cost_s
    with cache.begin(sized(210), toy.BACKGROUND) as writer:
        assert writer.missing() == [2, 3, 4]  # the third was not full
        assert toy.data_bytes(writer.path)["density/c/1/0"] == toy.data_bytes(path)["density/c/1/0"]
        assert writer.manifest.cost_s == pytest.approx(before * 100 / 120)
    assert all(cache.verify(entry) == [] for entry in cache.entries())


def test_damaged_chunks_and_other_smooth_streams_are_not_taken_over(toy, cache, sized):
    path = toy.fill(cache)
    toy.damage(path / "data.zarr/omega/c/0/0", "bit-flipped")
    with cache.begin(sized(210), toy.BACKGROUND) as writer:
        assert writer.missing() == [0, 2, 3, 4]
    with cache.begin(sized(310), toy.BACKGROUND * 1.01) as writer:
        assert len(writer.missing()) == 7


def test_finished_streams_can_be_looked_at_before_the_others(toy, cache):
    assert cache.open_finished(toy.CONFIG.key, 1000) is None
    toy.fill(cache, [2, 0])
    found = cache.open_finished(toy.CONFIG.key, 1000)
    assert found.stream.values.tolist() == [*range(50), *range(100, 120)]
    toy.fill(cache)
    whole = cache.open_ensemble(toy.CONFIG)
    xr.testing.assert_equal(found.density.drop_vars("stream"), whole.density.isel(stream=found.stream.values))
    assert cache.open_finished(toy.CONFIG.key, 60).sizes["stream"] == 100
    assert cache.streams_done(toy.CONFIG) == 120


# ------------------------------------------------------------------ names


def test_an_entry_keeps_the_first_name_it_was_given(toy, cache):
    with cache.begin(toy.CONFIG, toy.BACKGROUND):
        pass
    for title in ("Ωμέγα 🌌", "another"):
        with cache.begin(toy.CONFIG, toy.BACKGROUND, title=title):
            pass
    assert [e.title for e in cache.entries()] == ["Ωμέγα 🌌"]


@pytest.mark.parametrize("text", ["", "plain", "  much   space ", "日本語", "İstanbul ß", "<b>&amp;"])
def test_names_may_be_of_any_script(text):
    assert check_title(text) == " ".join(text.split())


@pytest.mark.parametrize(
    "text", ["a\nb", "\u202eevil", "nul\0", "\ud800", "a\u00a0b", "x" * 61, "\ufeff", "\x1b[0m"]
)
def test_names_that_would_deceive_or_break_lines_are_refused(text):
    with pytest.raises(ValueError, match="a name may"):
        check_title(text)


# ------------------------------------------------------------------ geometries in parts


def test_parts_of_a_geometry_outlive_their_writer_and_damaged_ones_do_not_count(toy, cache, tmp_path):
    stream = StreamModel(n_times=4)
    arrays = {"theta": xr.DataArray([1.0, 2.0]).values}
    with cache.begin_geometry(stream) as writer:
        for k in (0, 1, 3):
            writer.write(k, arrays)
    assert (cache.times_done(stream), cache.entries()) == (3, [])
    toy.damage(part_files(parts_folder(tmp_path, stream))[1], "bit-flipped")
    with cache.begin_geometry(stream) as writer:
        assert sorted(writer.parts()) == [0, 3]
        assert writer.parts()[3]["theta"].tolist() == [1.0, 2.0]
        writer.finish(xr.Dataset({"x": ("n", [1.0])}))
    assert cache.times_done(stream) == 4
    assert not parts_folder(tmp_path, stream).exists()


def test_one_process_at_a_time_computes_a_geometry(cache):
    stream = StreamModel(n_times=4)
    with cache.begin_geometry(stream):
        assert cache.busy(stream.key)
        with pytest.raises(BusyError):
            cache.begin_geometry(stream, timeout=0)
    assert not cache.busy(stream.key)


# ------------------------------------------------------------------ listing


def test_entries_that_come_and_go_do_not_disturb_a_listing(toy, tmp_path):
    cache = Cache.default(tmp_path)
    stop = threading.Event()

    def churn() -> None:
        while not stop.is_set():
            toy.fill(cache, [0])
            cache.remove(toy.CONFIG.key)

    thread = threading.Thread(target=churn)
    thread.start()
    try:
        states = {entry.state for _ in range(150) for entry in cache.entries()}
    finally:
        stop.set()
        thread.join()
    assert states <= {"partial", "damaged"}  # damaged: seen while its files were going
