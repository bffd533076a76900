"""Streams of the named priors that come with the package: an estimator for anybody's bins is only trained.

Densities are kept relative to the smooth stream's, in steps far below any measured error; the smooth stream
follows from the geometry, the parameters of each from its own generator.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import xarray as xr

from streamdash.config import EnsembleConfig, StreamModel
from streamdash.inference.files import SHIPPED, EstimatorFileError, arrays_of
from streamdash.inference.prior_ensemble import TRAINING_SEED, Member, PriorEnsemble, configs
from streamdash.prior import Prior
from streamdash.simulation.ensemble import background
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.store.entry import write_file

FOLDER = SHIPPED / "streams"
STEP, SOFT = 0.005, 0.01
"""Densities are rounded to a share `STEP` of themselves; those below `SOFT` of the smooth stream's to
`STEP` × `SOFT` of it. Steps are even in the inverse hyperbolic sine of density over `SOFT`."""


def path_of(config: EnsembleConfig, folder: Path | None = None) -> Path:
    """Where the streams of an ensemble are shipped, however many there are."""
    key = config.model_copy(update={"n_streams": 1}).key
    return (folder or FOLDER) / f"{config.label}-{key}.npz"


def are_shipped(prior: Prior, stream: StreamModel) -> bool:
    """Whether streams of a prior come with the package."""
    return not prior.ages_gyr and path_of(configs(prior, stream, 1, TRAINING_SEED)[0]).exists()


def save_streams(config: EnsembleConfig, streams: xr.Dataset, folder: Path | None = None) -> Path:
    """Write the densities of an ensemble, whole or not at all.

    Parameters
    ----------
    streams : ``density (stream, theta)`` and ``smooth (theta)``.
    """
    relative = streams.density.values / streams.smooth.values
    steps = np.round(np.arcsinh(relative / SOFT) / STEP).astype(np.int16)
    # Neighbouring angles differ little: differences take half of the room.
    file = io.BytesIO()
    np.savez_compressed(file, differences=np.diff(steps, axis=1, prepend=np.int16(0)))
    path = path_of(config, folder)
    write_file(path, file.getvalue())
    return path


def load_shipped(
    prior: Prior,
    stream: StreamModel,
    n_streams: int | None = None,
    cache: Cache | None = None,
    folder: Path | None = None,
) -> PriorEnsemble | None:
    """The streams that are shipped of a prior, or None where there are none, or not as many.

    Parameters
    ----------
    n_streams : how many; all of them by default.

    Raises
    ------
    EstimatorFileError
        When the file is damaged.
    """
    config = configs(prior, stream, 1, TRAINING_SEED)[0]
    path = path_of(config, folder)
    if prior.ages_gyr or not path.exists():
        return None
    with arrays_of(path, "file of streams") as arrays:
        differences = arrays["differences"]
        if differences.dtype != np.int16 or differences.ndim != 2 or differences.shape[1] != config.n_theta:
            raise EstimatorFileError(f"{path} does not hold densities at {config.n_theta} angles.")
    if n_streams is not None and n_streams > len(differences):
        return None
    steps = np.cumsum(differences[:n_streams], axis=1, dtype=np.int32)
    relative = SOFT * np.sinh(np.float32(STEP) * steps.astype(np.float32))
    geometry = load_geometry(stream, cache)
    smooth = background(geometry, config)
    density = relative * smooth.smooth.values.astype(np.float32)
    config = config.model_copy(update={"n_streams": len(density)})
    streams = smooth.assign(density=(("stream", "theta"), density))
    return PriorEnsemble(prior, (Member(config, geometry, streams),))
