"""What a classifier is: its settings and presets, its card, and the trained model itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import xgboost
from pydantic import Field
from scipy.special import softmax

from streamdash.classifier.data import ClassifierError
from streamdash.config import Config, Finite
from streamdash.statistics.features import FeatureMap, FeatureSet, summarise

SCHEMA = "streamdash-classifier/1"
"""Changes whenever the same inputs would give a different model."""


class Boosting(Config):
    """Hyperparameters of the gradient-boosted trees (XGBoost's names)."""

    max_depth: int = Field(3, ge=1, le=128)
    n_estimators: int = Field(400, ge=1, le=5000, description="trees per class, at most")
    learning_rate: Finite = Field(0.15, gt=0, le=1)
    subsample: Finite = Field(0.8, gt=0, le=1)
    colsample_bytree: Finite = Field(0.4, gt=0, le=1)
    min_child_weight: Finite = Field(4.0, ge=0)
    reg_lambda: Finite = Field(2.0, ge=0)
    max_bin: int = Field(32, ge=2, le=1024)
    early_stopping_rounds: int | None = Field(
        20, ge=1, description="stop when the validation log loss has not improved for so many trees"
    )


class ClassifierConfig(Config):
    """Everything about a classifier but its data."""

    features: FeatureSet = FeatureSet()
    boosting: Boosting = Boosting()
    copies: int = Field(2, ge=1, le=20, description="times each training stream is seen, with fresh noise")
    calibration: Literal["temperature", "none"] = "temperature"
    seed: int = Field(0, ge=0, le=2**31 - 1, description="decides the split, the trees and the fresh noise")


PAPER = ClassifierConfig(
    features=FeatureSet(n_pca=8, summaries=()),
    boosting=Boosting(
        max_depth=8,
        n_estimators=200,
        learning_rate=0.3,
        subsample=1.0,
        colsample_bytree=1.0,
        min_child_weight=1.0,
        reg_lambda=1.0,
        max_bin=256,
        early_stopping_rounds=None,
    ),
    copies=1,
    calibration="none",
)
BEST = ClassifierConfig()
PRESETS: dict[str, ClassifierConfig] = {
    "best": BEST,
    "paper": PAPER,
    "paper, 30 components": PAPER.model_copy(update={"features": FeatureSet(n_pca=30, summaries=())}),
    "no summaries": BEST.model_copy(update={"features": FeatureSet(n_pca=30, summaries=())}),
    "summaries only": BEST.model_copy(update={"features": FeatureSet(n_pca=0)}),
}
"""Named choices; ``best`` is the default, ``paper`` the paper's."""

PAPER_SCORES: dict[int, dict[str, Any]] = {
    2: {
        "overall_accuracy": 0.99,
        "precision": (0.98, 0.99),
        "recall": (0.99, 0.99),
        "f1": (0.99, 0.99),
    },
    3: {"precision": (0.98, 0.90, 0.90), "recall": (0.98, 0.90, 0.90), "f1": (0.98, 0.90, 0.90)},
}
"""Paper's table 2 (two classes), and its text for three: ≳ 0.90, 0.98 for the smallest masses."""
PAPER_CLASSES = {2: ("1e3-1e5", "1e5-1e9"), 3: ("1e3-1e5", "1e5-1e7", "1e7-1e9")}
"""Mass ranges for which the paper states scores."""


def paper_scores(labels: Sequence[str]) -> dict[str, Any] | None:
    """What the paper states for these classes, or None when it did not look at them."""
    n_classes = len(labels)
    return PAPER_SCORES[n_classes] if PAPER_CLASSES.get(n_classes) == tuple(labels) else None


class ModelCard(Config):
    """What a model is: everything it depends on, and how good it is.

    `key` (from the base class) covers all of it; `model_key` names the model before training.
    """

    schema_name: str = SCHEMA
    labels: tuple[str, ...] = Field(min_length=2, max_length=4)
    data_keys: tuple[str, ...]
    data_digest: str = Field(pattern=r"^[0-9a-f]{64}$", description="hash of all data, draws and bins")
    n_streams: tuple[int, ...]
    ell: tuple[Finite, ...] = Field(description="centre of each bin along the stream")
    noise: Finite | tuple[Finite, ...] = Field(description="σ_ε, one number or one per bin")
    settings: ClassifierConfig
    n_trees: int = Field(ge=1, description="trees per class in the model")
    temperature: Finite = Field(gt=0)
    scores: dict[str, Any] = Field(
        default={}, description="on the test streams, see `streamdash.statistics.scores.Scores`"
    )
    versions: dict[str, str]


@dataclass(frozen=True, eq=False)
class Classifier:
    """A trained model.

    Attributes
    ----------
    card : ModelCard
    features : FeatureMap
    booster : xgboost.Booster
    """

    card: ModelCard
    features: FeatureMap
    booster: xgboost.Booster

    def predict_proba(self, q: np.ndarray) -> np.ndarray:
        """Probability of each class.

        Parameters
        ----------
        q : ndarray (n_streams, n_bins) or (n_bins,)
            Observed Qρ on the bins and at the noise that the model was trained with.

        Returns
        -------
        ndarray (n_streams, n_classes), or (n_classes,) for one profile
            Classes are taken to be equally likely beforehand.

        Raises
        ------
        ClassifierError
            When the profile has other bins, or values that are not finite.
        """
        q = np.asarray(q)
        profiles = np.atleast_2d(q)
        self.check(profiles)
        return self.probability(self.features(profiles)).reshape(*q.shape[:-1], -1)

    def check(self, profiles: np.ndarray) -> None:
        """Refuse profiles (n_streams, n_bins) that the model cannot be asked about.

        Raises
        ------
        ClassifierError
            When they have other bins, or values that are not finite.
        """
        if profiles.ndim != 2 or profiles.shape[1] != self.features.n_bins:
            raise ClassifierError(
                f"The model was trained on {self.features.n_bins} bins; "
                f"the profile has {profiles.shape[-1]}. Observe both in the same bins."
            )
        if not np.all(np.isfinite(profiles)):
            raise ClassifierError("The profile has values that are not finite; leave those bins out.")

    def probability(self, features: np.ndarray) -> np.ndarray:
        """Probability of each class (n_streams, n_classes) from `features` of profiles."""
        return softmax(class_margins(self.booster, features) / self.card.temperature, axis=1)

    def predict(self, q: np.ndarray) -> np.ndarray:
        """Most probable class, 0 for the lowest masses."""
        return self.predict_proba(q).argmax(axis=-1)


def committee_proba(models: Sequence[Classifier], q: np.ndarray) -> np.ndarray:
    """Every model's probabilities of profiles (n_models, …, n_classes).

    Models of the same features, trained on different streams: summaries are computed once for all.
    """
    profiles = np.atleast_2d(q)
    models[0].check(profiles)
    features = models[0].features.features
    summaries = summarise(profiles, features) if features.summaries else None
    said = [model.probability(model.features(profiles, summaries)) for model in models]
    return np.stack(said).reshape(len(models), *np.shape(q)[:-1], -1)


def class_margins(booster: xgboost.Booster, x: np.ndarray, n_trees: int = 0) -> np.ndarray:
    """Unnormalised log probabilities (n_rows, n_classes) of the first ``n_trees`` trees, or of all."""
    margins = booster.inplace_predict(
        x, predict_type="margin", iteration_range=(0, n_trees), strict_shape=True
    )
    if margins.shape[1] == 1:
        # XGBoost's logistic function is that of class 1
        return np.concatenate([np.zeros_like(margins), margins], axis=1)
    return margins
