"""Models on disk: read back the same, bounded, and refused when anything was touched."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest

from streamdash.classifier.data import ClassifierError
from streamdash.classifier.model import Boosting, ClassifierConfig
from streamdash.classifier.store import ModelFileError, ModelStore, read_model, write_model
from streamdash.classifier.train import judge, model_key, train
from streamdash.statistics.features import FeatureSet
from streamdash.survey.observed import ObservedStreams
from tests.unit import made_up

SETTINGS = ClassifierConfig(
    features=FeatureSet(n_pca=4, scales=(3, 9)),
    boosting=Boosting(max_depth=3, n_estimators=15, early_stopping_rounds=None),
)


@pytest.fixture(scope="module")
def streams() -> ObservedStreams:
    rng = np.random.default_rng(0)
    q = tuple(
        (1 + a * rng.standard_normal((80, 40))).cumsum(axis=1).astype(np.float32) for a in (0.1, 0.2, 0.4)
    )
    draws = tuple(rng.standard_normal(x.shape, dtype=np.float32) for x in q)
    return made_up.observed(q, draws, ("1e3-1e5", "1e5-1e7", "1e7-1e9"))


@pytest.fixture(scope="module")
def classifier(streams):
    return train(streams, 0.1, SETTINGS).classifier


@pytest.fixture
def folder(tmp_path, classifier):
    write_model(tmp_path, "0" * 16, classifier)
    return tmp_path


def test_same_seed_gives_the_same_bytes(folder, tmp_path_factory, streams):
    again = tmp_path_factory.mktemp("again")
    write_model(again, "0" * 16, train(streams, 0.1, SETTINGS).classifier)
    for name in ("card.json", "booster.ubj", "arrays.npz"):
        assert (folder / name).read_bytes() == (again / name).read_bytes()


def test_other_seed_gives_other_bytes(folder, tmp_path_factory, streams):
    other = tmp_path_factory.mktemp("other")
    settings = SETTINGS.model_copy(update={"seed": 1})
    write_model(other, "0" * 16, train(streams, 0.1, settings).classifier)
    assert (folder / "booster.ubj").read_bytes() != (other / "booster.ubj").read_bytes()


def test_fresh_process_predicts_the_same(folder, streams, classifier):
    q = streams.observed(0.1)
    np.save(folder / "q.npy", q)
    code = (
        "import sys, numpy as np; from pathlib import Path\n"
        "from streamdash.classifier.store import read_model\n"
        "d = Path(sys.argv[1])\n"
        "np.save(d / 'p.npy', read_model(d).predict_proba(np.load(d / 'q.npy')))\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code, str(folder)], check=True, env=environment)
    np.testing.assert_array_equal(np.load(folder / "p.npy"), classifier.predict_proba(q))


def test_model_that_was_read_judges_as_it_did(folder, streams):
    trained, again = train(streams, 0.1, SETTINGS), judge(read_model(folder), streams)
    np.testing.assert_array_equal(again.probability, trained.probability)
    assert again.scores.to_dict() == trained.scores.to_dict() == again.classifier.card.scores
    with pytest.raises(ClassifierError, match="other streams"):
        judge(read_model(folder), streams.only([0, 1]))


def test_card_tells_what_the_model_depends_on(folder, streams):
    card = read_model(folder).card
    assert card.labels == streams.labels and card.data_keys == streams.keys
    assert card.noise == 0.1 and card.settings == SETTINGS and card.data_digest == streams.digest
    assert np.sum(card.scores["counts"]) == 60
    assert {"xgboost", "sklearn", "numpy"} <= set(card.versions)


@pytest.mark.parametrize("name", ["booster.ubj", "arrays.npz"])
def test_one_flipped_bit_is_refused_by_name(folder, name):
    data = bytearray((folder / name).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / name).write_bytes(data)
    with pytest.raises(ModelFileError, match=f"{name} was changed"):
        read_model(folder)


@pytest.mark.parametrize("name", ["card.json", "booster.ubj", "arrays.npz"])
def test_missing_and_truncated_files_are_refused_by_name(folder, name):
    data = (folder / name).read_bytes()
    (folder / name).write_bytes(data[: len(data) // 2])
    with pytest.raises(ModelFileError, match=name):
        read_model(folder)
    (folder / name).unlink()
    with pytest.raises(ModelFileError, match=f"{name} cannot be read"):
        read_model(folder)


def change_card(folder, change):
    data = json.loads((folder / "card.json").read_text())
    change(data)
    (folder / "card.json").write_text(json.dumps(data))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["card"].update(noise=0.3), "was changed"),
        (lambda d: d["card"]["scores"]["values"].update(overall_accuracy=1.0), "was changed"),
        (lambda d: d["card"].update(schema_name="somebody-else/7"), "somebody-else/7"),
        (lambda d: d["card"].update(surprise=1), "surprise"),
        (lambda d: d.pop("booster_sha256"), "booster_sha256"),
        (lambda d: d["card"].update(labels=["one"]), "labels"),
    ],
)
def test_changed_or_foreign_card_is_refused(folder, change, words):
    change_card(folder, change)
    with pytest.raises(ModelFileError, match=words):
        read_model(folder)


def test_pickled_arrays_are_refused_even_with_the_right_checksum(folder):
    import hashlib

    np.savez(folder / "arrays.npz", mean=np.array([{"a": 1}], dtype=object))
    digest = hashlib.sha256((folder / "arrays.npz").read_bytes()).hexdigest()
    change_card(folder, lambda d: d.update(arrays_sha256=digest))
    with pytest.raises(ModelFileError, match="arrays.npz is not an archive of plain arrays"):
        read_model(folder)


def test_booster_of_another_model_is_refused_even_with_the_right_checksum(folder, streams, tmp_path_factory):
    import hashlib

    other = tmp_path_factory.mktemp("other")
    settings = SETTINGS.model_copy(update={"features": FeatureSet(n_pca=2, summaries=())})
    write_model(other, "1" * 16, train(streams, 0.1, settings).classifier)
    data = (other / "booster.ubj").read_bytes()
    (folder / "booster.ubj").write_bytes(data)
    change_card(folder, lambda d: d.update(booster_sha256=hashlib.sha256(data).hexdigest()))
    with pytest.raises(ModelFileError, match="does not belong"):
        read_model(folder)
    (folder / "booster.ubj").write_bytes(b"not a model")
    change_card(folder, lambda d: d.update(booster_sha256=hashlib.sha256(b"not a model").hexdigest()))
    with pytest.raises(ModelFileError, match="not an XGBoost model"):
        read_model(folder)


def test_store_keeps_the_last_used_models_only(tmp_path, classifier):
    store = ModelStore(tmp_path / "models", max_models=2)
    assert store.keys() == [] and store.open("a" * 16) is None
    for i, key in enumerate(("a" * 16, "b" * 16)):
        os.utime(store.save(key, classifier), (i, i))
    assert store.open("a" * 16) is not None  # used now, so that b is the older
    store.save("c" * 16, classifier)
    assert set(store.keys()) == {"a" * 16, "c" * 16}
    assert not list((tmp_path / "models").glob(".new-*"))


def test_store_refuses_the_model_of_another_key(tmp_path, streams, classifier):
    store = ModelStore(tmp_path)
    key = model_key(streams, 0.1, SETTINGS)
    store.save(key, classifier).rename(tmp_path / ("f" * 16))
    with pytest.raises(ModelFileError, match=f"card of model {key}"):
        store.open("f" * 16)
    store.remove("f" * 16)
    assert store.keys() == []


def test_saving_twice_is_saving_once(tmp_path, classifier):
    store = ModelStore(tmp_path)
    assert store.save("a" * 16, classifier) == store.save("a" * 16, classifier)
    assert store.keys() == ["a" * 16]


def test_key_cannot_leave_the_folder(tmp_path):
    store = ModelStore(tmp_path / "models")
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "card.json").write_text("{}")
    assert store.open("../secret") is None


# ------------------------------------------------------------------ killed, or no room


def test_a_process_killed_while_it_saves_leaves_no_model_and_nothing_for_long(tmp_path, folder, classifier):
    """It is killed at the worst moment: all files are written, their folder has no name yet."""
    store = ModelStore(tmp_path / "models")
    code = f"""
import os, signal
from pathlib import Path
from streamdash.classifier.store import ModelStore, read_model
Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
ModelStore(Path({str(store.directory)!r})).save("a" * 16, read_model(Path({str(folder)!r})))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -signal.SIGKILL
    (left,) = store.directory.iterdir()
    assert (left / "card.json").is_file()
    assert store.keys() == [] and store.open("a" * 16) is None
    store.save("a" * 16, classifier)
    assert store.open("a" * 16) is not None
    assert left.is_dir(), "another process could still be writing it"
    os.utime(left, (0, 0))
    store.save("b" * 16, classifier)
    assert not left.exists() and set(store.keys()) == {"a" * 16, "b" * 16}


def test_a_full_disk_leaves_no_part_of_a_model(tmp_path, classifier):
    store = ModelStore(tmp_path / "models")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))  # what is written beyond is refused by the system
    try:
        with pytest.raises(OSError):
            store.save("a" * 16, classifier)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(store.directory.iterdir()) == []
    store.save("a" * 16, classifier)
    assert store.open("a" * 16) is not None
