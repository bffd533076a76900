"""Spectra along θ∥ of any configuration: from the cache, or from an ensemble simulated for them.

An ensemble that is simulated for its spectra alone is written to a folder of its own in the cache, so
that an interruption loses nothing, and removed once its spectra are kept. Geometries stay.
"""

from __future__ import annotations

import contextlib
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from streamdash.config import EnsembleConfig, SpectraConfig
from streamdash.convergence.theta_spectra import ThetaSpectra, theta_spectra
from streamdash.simulation.ensemble import Progress, Stopped, complete
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache, StoreError

WORKSHOP = "convergence"
"""Folder in the cache for ensembles of which only spectra will be kept."""
STEPS = 1000
"""Steps in which progress on several settings is told."""


def stored_spectra(config: SpectraConfig, cache: Cache) -> ThetaSpectra | None:
    """Spectra from the cache; None when they are not there or cannot be used."""
    dataset = cache.open_spectra(config)
    if dataset is None:
        return None
    with contextlib.suppress(ValueError):  # of another layout: computed anew
        return ThetaSpectra.from_dataset(dataset)
    return None


def ensemble_spectra(
    config: SpectraConfig,
    cache: Cache,
    workers: int | None = None,
    progress: Progress | None = None,
    should_stop: Callable[[], bool] | None = None,
    nice: int = 0,
) -> ThetaSpectra:
    """Spectra of a configuration: from the cache, or computed and kept there.

    Parameters
    ----------
    config : SpectraConfig
    cache : Cache
    workers : worker processes; one per core by default.
    progress : called with steps done and in all.
    should_stop : asked after every chunk.
    nice : how much worker processes stand back for others, 0 to 19.

    Raises
    ------
    Stopped
        When `should_stop` said so; what is finished is kept, the same call resumes.
    StoreError
        When the cache cannot be written to.
    """
    found = stored_spectra(config, cache)
    if found is not None:
        return found
    cache.check_writable()
    try:
        spectra = _from_cache(config, cache)
    except StoreError:  # the ensemble is not in the cache
        spectra = _simulated(config, cache, workers, progress, should_stop, nice)
    cache.save_spectra(config, spectra.to_dataset(), spectra.cost_s)
    return spectra


def missing(configs: Sequence[SpectraConfig], cache: Cache) -> list[SpectraConfig]:
    """Those of the configurations whose spectra are not in the cache."""
    return [config for config in configs if stored_spectra(config, cache) is None]


def compute_missing(
    configs: Sequence[SpectraConfig],
    cache: Cache,
    workers: int | None = None,
    progress: Progress | None = None,
    should_stop: Callable[[], bool] | None = None,
    nice: int = 0,
) -> None:
    """Compute and keep the spectra that the cache lacks; as `ensemble_spectra` of each.

    Every setting counts the same in `progress`.
    """
    wanted = list(dict.fromkeys(missing(configs, cache)))
    for i, config in enumerate(wanted):

        def report(done: int, total: int, i: int = i) -> None:
            if progress is not None:
                progress(int(STEPS * (i + done / max(total, 1))), STEPS * len(wanted))

        ensemble_spectra(config, cache, workers, report, should_stop, nice)
    if progress is not None:
        progress(1, 1)


def _needed(config: SpectraConfig) -> EnsembleConfig:
    """The streams that count, as an ensemble: the first of a larger one are those of a smaller one."""
    return config.ensemble.model_copy(update={"n_streams": config.n_streams})


def _from_cache(config: SpectraConfig, cache: Cache) -> ThetaSpectra:
    """Spectra of streams that are in the cache.

    Raises
    ------
    StoreError
        When they are not.
    """
    start = time.process_time()
    needed = _needed(config)
    spectra = theta_spectra(cache.open_ensemble(needed))
    entry = cache.covering(needed)
    simulated = entry.cost_s * needed.n_streams / entry.n_done if entry is not None else 0.0
    return replace(spectra, cost_s=simulated + time.process_time() - start)


def _simulated(
    config: SpectraConfig,
    cache: Cache,
    workers: int | None,
    progress: Progress | None,
    should_stop: Callable[[], bool] | None,
    nice: int,
) -> ThetaSpectra:
    root = cache.writable
    assert root is not None  # check_writable has been asked
    workshop = Cache((*cache.roots, root / WORKSHOP), root / WORKSHOP)
    needed = _needed(config)
    stop = should_stop or (lambda: False)

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, 2 * total)  # as the first half of the setting
        if stop():
            raise Stopped(0, needed.n_streams)

    load_geometry(needed.stream, cache, workers, report, nice=nice)
    complete(needed, workshop, workers=workers, progress=progress, should_stop=stop, nice=nice)
    spectra = _from_cache(config, workshop)
    _remove(needed, root / WORKSHOP)
    return spectra


def _remove(ensemble: EnsembleConfig, folder: Path) -> None:
    Cache((folder,), folder).remove(ensemble.key)
    if not any((folder / "ensembles").iterdir()):
        shutil.rmtree(folder)
