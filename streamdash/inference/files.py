"""Trained estimators on disk: one file of plain arrays each, and a card of text; nothing is unpickled."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from streamdash import paths
from streamdash.config import ConfigError, StreamModel
from streamdash.inference.calibration import NODES
from streamdash.inference.estimator import Estimator
from streamdash.inference.network import Network
from streamdash.inference.nonsense import Critic
from streamdash.prior import PRIORS, Prior
from streamdash.statistics.features import FeatureMap, FeatureSet
from streamdash.store.entry import write_file
from streamdash.streams import named_stream
from streamdash.survey.design import Design

FORMAT = "streamdash-estimator-1"
SHIPPED = paths.CACHE / "estimators"
MAX_BYTES = 64 * 2**20
"""No file of an estimator is as large as this; larger ones are refused unread."""
MAX_KEPT = 20
"""Estimators for people's own designs that are kept; those unused for longest go first."""
DEFAULT_PRIOR = "rate"
HELD_OUT = "held-out"
"""Folder beside estimators with streams that they have not learnt from."""


class EstimatorFileError(ValueError):
    """A file that is not an estimator; the message names it and says why."""


def save(estimator: Estimator, path: Path) -> None:
    """Write an estimator, whole or not at all."""
    design, features = estimator.design, estimator.features
    arrays: dict[str, Any] = {
        "low": design.low,
        "high": design.high,
        "sigma": design.sigma,
        "feature_mean": features.mean,
        "feature_scale": features.scale,
        "components": features.components.astype(np.float32),
        "variance": features.variance,
        "center": estimator.center,
        "scale": estimator.scale,
        "odds": estimator.critic.odds,
        "middle": estimator.critic.middle,
        "whitening": estimator.critic.whitening.astype(np.float16),
        "distances": estimator.critic.distances,
        "powers": np.array(estimator.powers),
    }
    arrays |= {f"grid_{name}": edges for name, edges in estimator.grid.items()}
    arrays |= {f"curve_{name}": curve for name, curve in zip(estimator.grid, estimator.curves, strict=True)}
    networks = {f"{j}_{m}": net for j, nets in enumerate(estimator.factors) for m, net in enumerate(nets)}
    for name, network in {"critic": estimator.critic.network, **networks}.items():
        for layer, (w, b) in enumerate(zip(network.weights, network.biases, strict=True)):
            # Nothing is lost: `network.train` gives numbers of half precision.
            arrays[f"w_{name}_{layer}"], arrays[f"b_{name}_{layer}"] = w.astype(np.float16), b
    card = {
        "format": FORMAT,
        "prior": estimator.prior.model_dump(mode="json"),
        "stream": estimator.stream.model_dump(mode="json"),
        "features": features.features.model_dump(mode="json"),
        "design": [design.coordinate, design.quantity, design.order],
        "grid": list(estimator.grid),
        "members": [len(members) for members in estimator.factors],
        "card": dict(estimator.card),
    }
    arrays["card"] = np.frombuffer(json.dumps(card).encode(), np.uint8)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    write_file(path, file.getvalue())


@contextmanager
def arrays_of(path: Path, what: str) -> Iterator[dict[str, np.ndarray]]:
    """The arrays of a file, never unpickled; also says in one sentence what is wrong with what they hold.

    Raises
    ------
    EstimatorFileError
        When the file is missing, damaged, or something else; or when the ``with`` block finds it so.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise EstimatorFileError(f"{path} is larger than any {what}.")
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        yield arrays
    except FileNotFoundError:
        raise EstimatorFileError(f"There is no {what} {path}.") from None
    except (OSError, KeyError, TypeError, IndexError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, EstimatorFileError):
            raise
        raise EstimatorFileError(f"{path} is not a whole {what} ({type(error).__name__}).") from None


def load(path: Path) -> Estimator:
    """Read what `save` wrote.

    Raises
    ------
    EstimatorFileError
        When the file is missing, damaged, or something else.
    """
    with arrays_of(path, "estimator") as arrays:
        card = json.loads(arrays["card"].tobytes())
        if card["format"] != FORMAT:
            raise EstimatorFileError(f"{path} is of another format than {FORMAT}.")
        estimator = _read(arrays, card)
        estimator.posterior(np.ones((1, estimator.design.n_bin)))  # shapes that do not fit are found here
    return estimator


def _read(arrays: dict[str, np.ndarray], card: dict[str, Any]) -> Estimator:
    coordinate, quantity, order = card["design"]
    design = Design(coordinate, arrays["low"], arrays["high"], arrays["sigma"], quantity, order)
    features = FeatureMap(
        FeatureSet.parse(card["features"]),
        arrays["feature_mean"],
        arrays["feature_scale"],
        arrays["components"],
        arrays["variance"],
    )
    factors = tuple(
        tuple(_network(arrays, f"{j}_{m}") for m in range(members))
        for j, members in enumerate(card["members"])
    )
    return Estimator(
        Prior.parse(card["prior"]),
        StreamModel.parse(card["stream"]),
        design,
        {name: arrays[f"grid_{name}"] for name in card["grid"]},
        features,
        arrays["center"],
        arrays["scale"],
        _critic(arrays),
        factors,
        tuple(float(power) for power in arrays["powers"]),
        tuple(arrays.get(f"curve_{name}", NODES) for name in card["grid"]),
        card["card"],
    )


def _critic(arrays: dict[str, np.ndarray]) -> Critic:
    network = _network(arrays, "critic")
    n_input = len(network.weights[0])
    return Critic(
        network,
        arrays["odds"].reshape(len(arrays["odds"]), -1),
        arrays.get("middle", np.zeros(n_input, np.float32)),
        arrays.get("whitening", np.zeros((n_input, 0))).astype(np.float32),
        arrays.get("distances", np.zeros(0, np.float32)),
    )


def _network(arrays: dict[str, np.ndarray], name: str) -> Network:
    depth = sum(key.startswith(f"w_{name}_") for key in arrays)
    layers = range(depth)
    weights = tuple(arrays[f"w_{name}_{layer}"].astype(np.float32) for layer in layers)
    return Network(weights, tuple(arrays[f"b_{name}_{layer}"] for layer in layers))


def shipped_path(stream: str, prior: str = DEFAULT_PRIOR, told: bool = False) -> Path:
    """Where the estimator of a named stream and prior is shipped."""
    return (SHIPPED / "told" if told else SHIPPED) / f"{stream}-{prior}.npz"


def load_estimator(stream: str = "gd1-like", prior: str = DEFAULT_PRIOR, told: bool = False) -> Estimator:
    """The shipped estimator of a named stream at its default design.

    Parameters
    ----------
    stream : name of a stream, as `streamdash.streams.named_stream` knows it.
    prior : "rate" for the abundance alone; "population" for abundance, half-mode mass and excess.
    told : the one that knows other ages and is told the size of the errors, instead of one age and error.

    Raises
    ------
    ConfigError
        When there is no such stream or prior.
    EstimatorFileError
        When none is shipped, or the file is damaged.

    Examples
    --------
    >>> estimator = load_estimator("gd1-like")
    >>> {name: len(edges) for name, edges in estimator.grid.items()}
    {'log10_rate': 41}
    """
    name = named_stream(stream).name
    if prior not in PRIORS:
        raise ConfigError(f"prior: {str(prior)[:40]!r} is none of {', '.join(PRIORS)}.")
    path = shipped_path(name, prior, told)
    if not path.exists():
        there = sorted(file.stem for file in SHIPPED.glob("*.npz"))
        raise EstimatorFileError(
            f"No estimator of {name} with the prior {prior} is shipped; there are {', '.join(there)}."
        )
    return load(path)


def kept_folder() -> Path:
    """Where estimators for people's own designs are kept."""
    return platformdirs.user_cache_path("streamdash") / "estimators"


def kept(key: str, folder: Path | None = None) -> Estimator | None:
    """The kept estimator of a key (`streamdash.inference.estimator.estimator_key`), or None."""
    path = (folder or kept_folder()) / f"{key}.npz"
    try:
        estimator = load(path)
        path.touch()
    except (EstimatorFileError, OSError):
        return None
    return estimator


def keep(key: str, estimator: Estimator, folder: Path | None = None) -> None:
    """Keep an estimator for its design, and drop those that there are too many of."""
    folder = folder or kept_folder()
    folder.mkdir(parents=True, exist_ok=True)
    save(replace(estimator), folder / f"{key}.npz")
    files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in files[MAX_KEPT:]:
        file.unlink(missing_ok=True)
        (folder / HELD_OUT / file.name).unlink(missing_ok=True)
