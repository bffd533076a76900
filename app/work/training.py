"""From a session's choices to a trained classifier: one for all sessions, kept on disk."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from functools import partial
from typing import Any

from app.services.services import Services
from app.session.listing import ensembles_code
from app.session.session import Session
from app.work.pieces import freed, trained
from app.work.pool import Compute
from streamdash.classifier.data import check_classes
from streamdash.classifier.model import PRESETS, ClassifierConfig
from streamdash.classifier.store import ModelStore
from streamdash.classifier.train import Judged
from streamdash.statistics.features import ALL_SUMMARIES
from streamdash.survey.observed import ObservedStreams


def settings_of(session: Session) -> ClassifierConfig:
    """The classifier that a session's choices describe."""
    preset = PRESETS[session.preset]
    features = preset.features.model_copy(
        update={
            "n_pca": 0 if session.features == "summaries" else session.n_pca,
            "summaries": () if session.features == "pca" else ALL_SUMMARIES,
        }
    )
    changes: dict[str, Any] = {}
    if session.depth:
        changes["max_depth"] = session.depth
    if session.trees:
        changes |= {"n_estimators": session.trees, "early_stopping_rounds": None}
    boosting = preset.boosting.model_copy(update=changes)
    return preset.model_copy(update={"features": features, "boosting": boosting})


def choices_of(settings: ClassifierConfig) -> Mapping[str, Any]:
    """The session's choices that give a preset's features; depth and trees are left to the preset."""
    features = settings.features
    both = "both" if features.n_pca else "summaries"
    return {
        "n_pca": max(features.n_pca, 1),
        "features": both if features.summaries else "pca",
        "depth": 0,
        "trees": 0,
    }


def streams_of(services: Services, session: Session) -> ObservedStreams:
    """The chosen classes' streams as observed by default, once they can be told apart.

    Raises
    ------
    ClassifierError
        When they are no classes that can be learnt.
    """
    return check_classes(services.observed(session.ensembles))


def data_key(session: Session) -> tuple[Hashable, ...]:
    """Everything that a trained model of the session's choices depends on."""
    return _key(session, session.noise, settings_of(session))


def _key(session: Session, noise: float, settings: ClassifierConfig) -> tuple[Hashable, ...]:
    return (*(choice.key for choice in session.ensembles), noise, settings.key)


def training(services: Services, session: Session) -> tuple[Hashable, Compute]:
    """Key and computation of the chosen classifier, for `app.work.tasks.Work.ask`."""
    return train_task(services, session, session.noise, settings_of(session))


def train_task(
    services: Services, session: Session, noise: float, settings: ClassifierConfig
) -> tuple[Hashable, Compute]:
    """Key and computation of a classifier of the chosen classes, for `app.work.tasks.Work.ask`."""
    streams_of(services, session)  # refuses here what are no classes
    compute = partial(trained, services, session.ensembles, noise, settings, ModelStore.default())
    return ("classifier", *_key(session, noise, settings)), compute


def free_task(services: Services, session: Session, fixed: Judged) -> tuple[Hashable, Compute]:
    """Key and computation of what changes if the abundance of the chosen classes is free."""
    noise, settings = session.noise, settings_of(session)
    compute = partial(freed, services, session.ensembles, fixed, noise, settings)
    return ("free", *_key(session, noise, settings)), compute


def code_head(session: Session, *modules: str) -> str:
    """First lines of a listing: imports, the chosen streams and the chosen classifier."""
    settings = settings_of(session)
    imports = sorted(
        {
            "from streamdash.survey.observed import ObservedStreams",
            "from streamdash.classifier.model import PRESETS, ClassifierConfig",
            "from streamdash.store.cache import Cache",
            *modules,
        }
    )
    chosen = f'PRESETS["{session.preset}"]'
    if settings != PRESETS[session.preset]:
        text = settings.model_dump_json(exclude_defaults=True)
        chosen = f"ClassifierConfig.parse('{text}')"
    return (
        "\n".join(["from pathlib import Path", "", *imports]) + "\n\n"
        f"{ensembles_code(session.ensembles)}"
        "streams = ObservedStreams.read(Cache.default(), ensembles)\n"
        f"settings = {chosen}\n"
    )
