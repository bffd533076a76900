"""Trained models on disk: a bounded store, and files that are checked before they are used.

A model is a folder named by its key with three files: ``card.json`` (everything it depends
on, its scores, and the checksums of the other two), ``booster.ubj`` (XGBoost's own UBJSON)
and ``arrays.npz`` (plain arrays, read with pickle forbidden). A file that is missing, foreign
or changed is refused by name.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import tempfile
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import xgboost
from pydantic import Field

from streamdash.classifier.model import SCHEMA, Classifier, ModelCard
from streamdash.config import Config, ConfigError
from streamdash.statistics.features import FeatureMap

CARD, BOOSTER, ARRAYS = "card.json", "booster.ubj", "arrays.npz"
ARRAY_NAMES = ("mean", "scale", "components", "variance")
MAX_FILE_BYTES = 64 * 2**20
"""No file of a model is as large as this; larger ones are refused unread."""
MAX_MODELS = 30
ASIDE = ".new-"
LEFT_S = 3600.0
"""A folder that is written aside and is older than this was left by a process that was killed."""


class ModelFileError(ValueError):
    """A model file that is refused; the message names it and says why."""


class Envelope(Config):
    """What ``card.json`` holds: the card and what proves that all three files belong together."""

    model: str = Field(pattern=r"^[0-9a-f]{16}$", description="see `streamdash.classifier.train.model_key`")
    card: ModelCard
    card_key: str = Field(description="content hash of the card")
    booster_sha256: str
    arrays_sha256: str


class ModelStore:
    """At most ``max_models`` models in one folder; the ones unused for longest are dropped.

    Parameters
    ----------
    directory : Path
        Made when the first model is saved.
    max_models : int
    """

    def __init__(self, directory: Path, max_models: int = MAX_MODELS) -> None:
        self.directory = Path(directory)
        self.max_models = max_models

    @classmethod
    def default(cls) -> ModelStore:
        """The folder that STREAMDASH_MODELS names, or ``models`` in the user's cache folder."""
        chosen = os.environ.get("STREAMDASH_MODELS")
        return cls(Path(chosen) if chosen else platformdirs.user_cache_path("streamdash") / "models")

    def keys(self) -> list[str]:
        """Models there are, the last used first."""
        if not self.directory.is_dir():
            return []
        folders = [p for p in self.directory.iterdir() if not p.name.startswith(".") and (p / CARD).is_file()]
        return [p.name for p in sorted(folders, key=_last_used, reverse=True)]

    def save(self, key: str, classifier: Classifier) -> Path:
        """Write a model, whole or not at all, and drop the ones there are too many of."""
        target = self.directory / key
        if not target.is_dir():
            self.directory.mkdir(parents=True, exist_ok=True)
            aside = Path(tempfile.mkdtemp(prefix=ASIDE, dir=self.directory))
            try:
                write_model(aside, key, classifier)
                # refused when another process was faster; its files are the same
                aside.rename(target)
            except OSError:
                if not target.is_dir():
                    raise
            finally:
                shutil.rmtree(aside, ignore_errors=True)
        left = [p for p in self.directory.glob(f"{ASIDE}*") if time.time() - _last_used(p) > LEFT_S]
        for old in (*left, *(self.directory / name for name in self.keys()[self.max_models :])):
            shutil.rmtree(old, ignore_errors=True)
        return target

    def open(self, key: str) -> Classifier | None:
        """The model of that key, or None when there is none.

        Raises
        ------
        ModelFileError
            When its files are damaged, foreign, or those of another key.
        """
        folder = self.directory / key
        if key not in self.keys():
            return None
        classifier = read_model(folder, key)
        os.utime(folder)
        return classifier

    def remove(self, key: str) -> None:
        """Forget a model; nothing happens when there is none."""
        if key in self.keys():
            shutil.rmtree(self.directory / key, ignore_errors=True)


def write_model(folder: Path, key: str, classifier: Classifier) -> None:
    """Write the three files of a model into an existing folder."""
    files = {BOOSTER: bytes(classifier.booster.save_raw("ubj")), ARRAYS: _pack(classifier.features)}
    envelope = Envelope(
        model=key,
        card=classifier.card,
        card_key=classifier.card.key,
        booster_sha256=_sha256(files[BOOSTER]),
        arrays_sha256=_sha256(files[ARRAYS]),
    )
    for name, data in files.items():
        (folder / name).write_bytes(data)
    (folder / CARD).write_text(envelope.model_dump_json(indent=1) + "\n", encoding="utf-8")


def read_model(folder: Path, key: str | None = None) -> Classifier:
    """Read a model and check every file of it.

    Parameters
    ----------
    folder : Path
    key : str, optional
        The key that the model must have.

    Raises
    ------
    ModelFileError
        Naming the file and what is wrong with it.
    """
    folder = Path(folder)
    envelope = _read_envelope(folder / CARD)
    card = envelope.card
    if key is not None and envelope.model != key:
        raise ModelFileError(f"{folder / CARD} is the card of model {envelope.model}, not of {key}.")
    booster_data = _checked(folder / BOOSTER, envelope.booster_sha256)
    features = _unpack(folder / ARRAYS, _checked(folder / ARRAYS, envelope.arrays_sha256), card)
    booster = xgboost.Booster({"nthread": 1})
    try:
        booster.load_model(bytearray(booster_data))
    except xgboost.core.XGBoostError:
        raise ModelFileError(f"{folder / BOOSTER} is not an XGBoost model; train it again.") from None
    if booster.num_features() != len(features.names) or booster.num_boosted_rounds() != card.n_trees:
        raise ModelFileError(f"{folder / BOOSTER} does not belong to its card; train it again.")
    return Classifier(card, features, booster)


def _read_envelope(path: Path) -> Envelope:
    data = _read(path)
    try:
        envelope = Envelope.parse(data)
    except ConfigError as error:
        raise ModelFileError(f"{path} is not a streamdash model card: {error}") from None
    if envelope.card.schema_name != SCHEMA:
        raise ModelFileError(
            f"{path} was written as {envelope.card.schema_name[:40]!r}; this version reads {SCHEMA!r}. "
            "Train the model again."
        )
    if envelope.card.key != envelope.card_key:
        raise ModelFileError(f"{path} was changed after it was written; train the model again.")
    return envelope


def _read(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ModelFileError(f"{path} is larger than any model file; it is not read.")
        return path.read_bytes()
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read ({error.strerror}); train the model again.") from None


def _checked(path: Path, sha256: str) -> bytes:
    data = _read(path)
    if _sha256(data) != sha256:
        raise ModelFileError(f"{path} was changed after it was written; train the model again.")
    return data


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _pack(features: FeatureMap) -> bytes:
    """Arrays of a feature map as npz; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {name: getattr(features, name) for name in ARRAY_NAMES}
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _unpack(path: Path, data: bytes, card: ModelCard) -> FeatureMap:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise ModelFileError(f"{path} is not an archive of plain arrays ({error}).") from None
    n_bins = len(card.ell)
    shapes = {
        "mean": (n_bins,),
        "scale": (n_bins,),
        "components": (len(arrays.get("variance", ())), n_bins),
        "variance": (len(arrays.get("variance", ())),),
    }
    if {name: array.shape for name, array in arrays.items()} != shapes:
        raise ModelFileError(f"{path} does not hold the arrays {', '.join(ARRAY_NAMES)} of its card.")
    if any(a.dtype != np.float64 or not np.all(np.isfinite(a)) for a in arrays.values()):
        raise ModelFileError(f"{path} holds values that are not finite numbers.")
    return FeatureMap(card.settings.features, **arrays)


def _last_used(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # removed by another process meanwhile
        return 0.0
