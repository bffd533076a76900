"""Entries as one file: what is exported is imported byte by byte, and hostile files are refused."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from streamdash.cli.main import app
from streamdash.config import StreamModel
from streamdash.simulation.geometry import check_geometry
from streamdash.store.bundle import export_entry, import_entry
from streamdash.store.cache import Cache, StoreError
from streamdash.store.codec import decode, encode_dataset
from streamdash.store.entry import sha256


@pytest.fixture
def elsewhere(tmp_path) -> Cache:
    return Cache.default(tmp_path / "elsewhere")


@pytest.fixture
def exported(toy, cache, tmp_path) -> Path:
    """The toy's ensemble as a file."""
    toy.fill(cache)
    export_entry(cache, toy.CONFIG.key, tmp_path / "toy.zip")
    return tmp_path / "toy.zip"


def contents(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {info.filename: archive.read(info) for info in archive.infolist()}


def pack(path: Path, files: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, compression)
    return path


def resigned(files: dict[str, bytes], changed: dict[str, bytes]) -> dict[str, bytes]:
    """An archive's files with some replaced and the manifest's checksums made to fit."""
    manifest = json.loads(files["manifest.json"])
    for name, data in changed.items():
        inside = name.removeprefix("data.zarr/")
        for sums in (manifest["header"], *manifest["chunks"].values()):
            if inside in sums:
                sums[inside] = sha256(data)
    return {**files, **changed, "manifest.json": json.dumps(manifest).encode()}


def refused(cache: Cache, path: Path, **options) -> str:
    """The sentence of the refusal; nothing may have been written."""
    with pytest.raises(StoreError) as error:
        import_entry(cache, path, **options)
    assert not [p for p in cache.roots[0].rglob("*") if p.is_file() and p.suffix != ".lock"]
    assert "\n" not in str(error.value)
    return str(error.value)


# ------------------------------------------------------------------ there and back


@pytest.mark.parametrize("chunks", [None, [0, 2]])
def test_an_ensemble_travels_byte_by_byte(toy, cache, elsewhere, tmp_path, chunks):
    path = toy.fill(cache, chunks)
    export_entry(cache, toy.CONFIG.key, tmp_path / "toy.zip")
    entry = import_entry(elsewhere, tmp_path / "toy.zip")
    assert entry.state == ("partial" if chunks else "complete")
    assert toy.data_bytes(entry.path) == toy.data_bytes(path)
    assert (entry.path / "config.json").read_bytes() == (path / "config.json").read_bytes()
    assert elsewhere.verify(entry) == []
    with pytest.raises(StoreError, match="is in the cache already"):
        import_entry(elsewhere, tmp_path / "toy.zip")


def test_the_same_entry_is_the_same_file(toy, cache, exported, tmp_path):
    export_entry(cache, toy.CONFIG.key, tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == exported.read_bytes()
    with pytest.raises(StoreError, match="exists already"):
        export_entry(cache, toy.CONFIG.key, exported)


def test_a_geometry_travels_too(shipped_cache, elsewhere, tmp_path):
    shipped = Cache.default(shipped_cache)
    export_entry(shipped, StreamModel().key, tmp_path / "geometry.zip")
    import_entry(elsewhere, tmp_path / "geometry.zip")
    assert elsewhere.open_geometry(StreamModel()).identical(shipped.open_geometry(StreamModel()))


def test_an_import_adds_to_a_smaller_part_and_replaces_damage(toy, cache, exported, elsewhere):
    toy.fill(elsewhere, [1])
    assert import_entry(elsewhere, exported).state == "complete"
    path = elsewhere.find(toy.CONFIG.key).path
    toy.damage(path / "data.zarr/density/c/1/0", "missing")
    assert import_entry(elsewhere, exported).state == "complete"


def test_damaged_entries_are_not_exported(toy, cache, tmp_path):
    toy.damage(toy.fill(cache) / "data.zarr/density/c/1/0", "bit-flipped")
    with pytest.raises(StoreError, match="density/c/1/0 does not match its checksum"):
        export_entry(cache, toy.CONFIG.key, tmp_path / "toy.zip")
    assert not list(tmp_path.glob("*toy.zip*"))


# ------------------------------------------------------------------ hostile files


@pytest.mark.parametrize(
    "name", ["../evil", "/etc/evil", "data.zarr/../../evil", "evil", "data.zarr/c:\\evil"]
)
def test_names_that_the_manifest_does_not_list_are_refused(exported, elsewhere, tmp_path, name):
    path = pack(tmp_path / "evil.zip", {**contents(exported), name: b"x"})
    assert "which its manifest.json does not list" in refused(elsewhere, path)


@pytest.mark.parametrize("name", ["../../evil", "/etc/evil", "density/../../evil"])
def test_a_manifest_cannot_name_files_outside(exported, elsewhere, tmp_path, name):
    files = contents(exported)
    manifest = json.loads(files["manifest.json"])
    manifest["header"][name] = sha256(b"x")
    files |= {"manifest.json": json.dumps(manifest).encode(), f"data.zarr/{name}": b"x"}
    assert "header" in refused(elsewhere, pack(tmp_path / "evil.zip", files))


def test_symbolic_links_are_not_followed_or_made(exported, elsewhere, tmp_path):
    files = contents(exported)
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
        for name, data in files.items():
            info = zipfile.ZipInfo(name)
            if name == "data.zarr/theta/c/0":
                info.external_attr, data = 0o120777 << 16, b"/etc/passwd"
            archive.writestr(info, data)
    assert "theta/c/0 does not match its checksum" in refused(elsewhere, tmp_path / "evil.zip")


def test_bombs_are_refused_before_they_unpack(toy, exported, elsewhere, tmp_path):
    files = contents(exported)
    packed = pack(tmp_path / "deflated.zip", {**files, "manifest.json": b"0" * 10**8}, zipfile.ZIP_DEFLATED)
    assert "is compressed or encrypted" in refused(elsewhere, packed)
    # A chunk that says it unpacks to 2 GB, signed with a checksum that fits.
    chunk = bytearray(files["data.zarr/density/c/1/0"])
    chunk[4:8] = (2**31 - 1).to_bytes(4, "little")
    bomb = pack(tmp_path / "blosc.zip", resigned(files, {"data.zarr/density/c/1/0": bytes(chunk)}))
    assert "does not unpack to the size" in refused(elsewhere, bomb)
    from numcodecs import Zstd

    zeros = Zstd().encode(np.zeros(10**7))
    bomb = pack(tmp_path / "zstd.zip", resigned(files, {"data.zarr/theta/c/0": bytes(zeros)}))
    assert "cannot be decoded" in refused(elsewhere, bomb)
    metadata = json.loads(files["data.zarr/density/zarr.json"])
    metadata["shape"] = [10**9, 10**9]
    bomb = pack(
        tmp_path / "shape.zip",
        resigned(files, {"data.zarr/density/zarr.json": json.dumps(metadata).encode()}),
    )
    assert "density/zarr.json is not that of an ensemble" in refused(elsewhere, bomb)
    assert "more than the 0 MB allowed" in refused(elsewhere, exported, limit=1000)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"shape": [10**5, 10**5]}, "too many"),
        ({"data_type": "object"}, "plain numbers|cannot be decoded"),
        ({"codecs": [{"name": "gzip"}]}, "an encoding that exports do not have"),
    ],
)
def test_geometries_with_strange_arrays_are_refused(shipped_cache, elsewhere, tmp_path, changes, words):
    export_entry(Cache.default(shipped_cache), StreamModel().key, tmp_path / "geometry.zip")
    files = contents(tmp_path / "geometry.zip")
    name = "data.zarr/node_theta/zarr.json"
    changed = {name: json.dumps({**json.loads(files[name]), **changes}).encode()}
    sentence = refused(elsewhere, pack(tmp_path / "evil.zip", resigned(files, changed)))
    assert any(word in sentence for word in words.split("|"))


@pytest.fixture
def geometry_files(shipped_cache, tmp_path) -> dict[str, bytes]:
    """The files of an exported geometry."""
    export_entry(Cache.default(shipped_cache), StreamModel().key, tmp_path / "geometry.zip")
    return contents(tmp_path / "geometry.zip")


def listing(files: dict[str, bytes], more: dict[str, bytes], **says) -> dict[str, bytes]:
    """An archive with more files, all of them listed with checksums that fit, and another manifest."""
    manifest = {**json.loads(files["manifest.json"]), **says}
    manifest["header"] |= {name.removeprefix("data.zarr/"): sha256(data) for name, data in more.items()}
    return {**files, **more, "manifest.json": json.dumps(manifest).encode()}


ARRAY = "data.zarr/node_xv/zarr.json"


@pytest.mark.parametrize(
    "attributes",
    [
        {"_FillValue": "%%%"},
        {"_FillValue": {"a": [1]}},
        {"_FillValue": 3},
        {"scale_factor": 2.0},
        {"add_offset": 1.0},
        {"units": "days since 1970-01-01"},
        {"dtype": "object"},
        {"coordinates": "\u001b[2J"},
    ],
    ids=str,
)
def test_attributes_that_change_numbers_are_refused(geometry_files, elsewhere, tmp_path, attributes):
    about = json.loads(geometry_files[ARRAY])
    about["attributes"] |= attributes
    evil = resigned(geometry_files, {ARRAY: json.dumps(about).encode()})
    assert "attributes that change its numbers" in refused(elsewhere, pack(tmp_path / "evil.zip", evil))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("data.zarr/zarr.json/x", "is no array"),
        ("data.zarr/" + "n" * 100 + "/zarr.json", "is no array"),
        ("data.zarr/" + "n" * 300, "header"),
        ("data.zarr/unneeded", "is no array"),
        ("data.zarr/node_xv/c/9/9/9", "belongs to none of its arrays"),
        ("data.zarr/node_xv/zarr.json.bak", "belongs to none of its arrays"),
    ],
    ids=["file as folder", "long", "longer", "unneeded", "chunk", "beside"],
)
def test_listed_files_that_nothing_needs_are_refused(geometry_files, elsewhere, tmp_path, name, words):
    evil = listing(geometry_files, {name: b"x"})
    if name == "data.zarr/zarr.json/x":
        del evil["data.zarr/zarr.json"]
        manifest = json.loads(evil["manifest.json"])
        del manifest["header"]["zarr.json"]
        evil["manifest.json"] = json.dumps(manifest).encode()
        words = "is not that of an export"
    assert words in refused(elsewhere, pack(tmp_path / "evil.zip", evil))


@pytest.mark.parametrize("field", ["updated", "created", "code_version"])
@pytest.mark.parametrize("value", ["\x1b]0;owned\x07", "\x1b[31mred", "yesterday\n", "x" * 500])
def test_what_a_manifest_says_of_itself_reaches_no_terminal(exported, elsewhere, tmp_path, field, value):
    sentence = refused(
        elsewhere, pack(tmp_path / "evil.zip", listing(contents(exported), {}, **{field: value}))
    )
    assert f"manifest.json: {field} is" in sentence and sentence.isprintable()


def test_a_group_says_numbers_only(geometry_files, elsewhere, tmp_path):
    about = json.loads(geometry_files["data.zarr/zarr.json"])
    about["attributes"]["evil"] = "\x1b[2J"
    evil = resigned(geometry_files, {"data.zarr/zarr.json": json.dumps(about).encode()})
    assert "'evil' is not a finite number" in refused(elsewhere, pack(tmp_path / "evil.zip", evil))


def test_a_chunk_has_nothing_behind_it(geometry_files, elsewhere, tmp_path):
    name = "data.zarr/node_theta/c/0/0"
    evil = resigned(geometry_files, {name: geometry_files[name] + b"more"})
    assert "does not unpack to the size" in refused(elsewhere, pack(tmp_path / "evil.zip", evil))


def test_a_disk_that_is_full_leaves_nothing_of_an_import(exported, elsewhere, monkeypatch):
    from streamdash.store import entry

    written = []

    def full(path, data, write=entry.write_file):
        written.append(path)
        if len(written) > 3:
            raise OSError(28, "No space left on device")
        write(path, data)

    monkeypatch.setattr(entry, "write_file", full)
    assert "the disk is full" in refused(elsewhere, exported)


SMALL = StreamModel(n_times=2)


@pytest.fixture(scope="module")
def small_geometry(tmp_path_factory) -> dict[str, bytes]:
    """Files of an exported geometry that galpy has just computed."""
    from streamdash.simulation.geometry import load_geometry

    folder = tmp_path_factory.mktemp("small")
    cache = Cache.default(folder / "cache")
    load_geometry(SMALL, cache, executor="inline")
    export_entry(cache, SMALL.key, folder / "small.zip")
    return contents(folder / "small.zip")


@pytest.mark.parametrize("name", ["", "node_xv", "node_jac", "track_dist", "mean_omega"])
def test_a_geometry_is_compared_with_its_model(small_geometry, elsewhere, tmp_path, name):
    files = dict(small_geometry)
    if name:  # twice as large, encoded as ours are, with checksums that fit
        dataset = decode({n.removeprefix("data.zarr/"): d for n, d in files.items() if n.startswith("data")})
        if name in dataset:
            dataset[name] = 2 * dataset[name]
        else:
            dataset.attrs[name] *= 2
        changed = {f"data.zarr/{inside}": data for inside, data in encode_dataset(dataset).items()}
        files = resigned(files, changed)
    path = pack(tmp_path / "geometry.zip", files)
    if name:
        sentence = refused(elsewhere, path, compare=check_geometry)
        assert f"{name} of its geometry is not that of its model" in sentence
    else:
        assert import_entry(elsewhere, path, compare=check_geometry).state == "complete"


def test_values_that_no_simulation_gives_are_refused(toy, exported, elsewhere, tmp_path):
    from streamdash.store.codec import encode_ensemble_header

    other = toy.BACKGROUND.assign_coords(theta=toy.THETA + 0.1)
    moved = {f"data.zarr/{n}": data for n, data in encode_ensemble_header(toy.CONFIG, other).items()}
    path = pack(tmp_path / "moved.zip", resigned(contents(exported), moved))
    assert "not on the angles of its configuration" in refused(elsewhere, path)


@pytest.mark.parametrize("name", ["data.zarr/density/c/1/0", "config.json", "manifest.json"])
def test_altered_or_missing_parts_are_named(exported, elsewhere, tmp_path, name):
    files = contents(exported)
    assert f"{name} is missing" in refused(
        elsewhere, pack(tmp_path / "short.zip", {n: d for n, d in files.items() if n != name})
    )
    altered = files[name].replace(b"1e3", b"1e4").replace(b"120", b"121") + b" "
    sentence = refused(elsewhere, pack(tmp_path / "altered.zip", {**files, name: altered}))
    assert "does not match its checksum" in sentence or "hashes to" in sentence or "this ensemble" in sentence


@pytest.mark.parametrize("data", [b"", b"PK", b"\x00" * 5000, b"PK\x05\x06" + b"\xff" * 18])
def test_what_is_no_archive_is_refused(elsewhere, tmp_path, data):
    (tmp_path / "junk.zip").write_bytes(data)
    assert "it is not a ZIP archive as" in refused(elsewhere, tmp_path / "junk.zip")


def test_a_comment_or_twice_the_same_name_is_refused(exported, elsewhere, tmp_path):
    shutil.copy(exported, tmp_path / "comment.zip")
    with zipfile.ZipFile(tmp_path / "comment.zip", "a") as archive:
        archive.comment = b"hello"
    assert "it is not a ZIP archive as" in refused(elsewhere, tmp_path / "comment.zip")
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(exported, "a") as archive:
        archive.writestr("config.json", b"{}")
    assert "holds a name twice" in refused(elsewhere, exported)


# ------------------------------------------------------------------ commands


def test_export_and_import_as_commands(toy, cache, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    toy.fill(cache)
    result = CliRunner().invoke(app, ["cache", "export", toy.CONFIG.key, "--cache", str(cache.roots[0])])
    assert result.exit_code == 0 and f"1e3-1e5-{toy.CONFIG.key}.zip" in result.output
    line = ["cache", "import", f"1e3-1e5-{toy.CONFIG.key}.zip", "--cache", str(tmp_path / "other")]
    result = CliRunner().invoke(app, line)
    assert result.exit_code == 0 and "is in the cache now (complete)" in result.output
    result = CliRunner().invoke(app, line)
    assert result.exit_code == 2 and "is in the cache already" in result.stderr
