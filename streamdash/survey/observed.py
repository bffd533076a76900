"""Simulated streams as they would be observed: ensembles seen through a `Design`.

Here, and nowhere else, ensembles are opened, put into bins and given their noise. What comes out is
shared by figures, statistics, classifier, inference and verdict.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr

from streamdash.config import Config, EnsembleConfig
from streamdash.engine.geometry import Geometry
from streamdash.naming import class_names
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey.design import Design, default_design, measured, observe_as, smooth_as, smooth_curve
from streamdash.survey.sky import shot_noise


@dataclass(frozen=True, eq=False)
class ObservedStreams:
    """Streams of one or more classes in the bins of a design, without noise, and the noise that is theirs.

    Attributes
    ----------
    configs : tuple of EnsembleConfig
        What each class is, lowest masses first. Two configurations are two classes, also with the
        same masses.
    design : Design
        How the streams are observed.
    q : tuple of ndarray (n_streams, n_bin) float32
        What the design measures of each class's streams: no noise, not divided by a polynomial.
    draws : tuple of ndarray (n_streams, n_bin)
        The fixed standard-normal draw per stream and bin that is its noise at σ_ε = 1.
    n_impacts : tuple of ndarray (n_streams,), optional
        Subhalos that hit each stream.
    smooth : ndarray (n_bin,), optional
        The unperturbed stream in the same bins and unit; ones by default.

    Raises
    ------
    ValueError
        When the arrays do not fit together, or a class is given twice.
    """

    configs: tuple[EnsembleConfig, ...]
    design: Design
    q: tuple[np.ndarray, ...]
    draws: tuple[np.ndarray, ...]
    n_impacts: tuple[np.ndarray, ...] = ()
    smooth: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not len(self.smooth):
            object.__setattr__(self, "smooth", np.ones(self.design.n_bin))
        if not len(self.q) == len(self.draws) == len(self.configs):
            raise ValueError("Each class needs its configuration, its streams and its noise draws.")
        if len(set(self.keys)) < len(self.keys):
            raise ValueError("The same ensemble is given twice; classes must differ from each other.")
        for label, q, draws in zip(self.labels, self.q, self.draws, strict=True):
            if q.ndim != 2 or q.shape != draws.shape or q.shape[1] != self.n_bins:
                raise ValueError(
                    f"{label}: streams and draws must both have shape (streams, {self.n_bins} bins), "
                    f"but have {q.shape} and {draws.shape}."
                )

    # ------------------------------------------------------------ made from

    @classmethod
    def read(
        cls, cache: Cache, ensembles: Sequence[str | EnsembleConfig], design: Design | None = None
    ) -> ObservedStreams:
        """Open ensembles of one stream and observe them.

        Parameters
        ----------
        ensembles : keys or configurations, lowest masses first. Two keys joined by ``+`` are the two
            arms of a stream, observed together.
        design : how they are observed; `default_design` by default.

        Raises
        ------
        StoreError
            When an ensemble is missing or damaged.
        ValueError
            When they are not of one stream, or a bin is not within the profiles.
        """
        if any(len(arm_keys(ensemble)) > 1 for ensemble in ensembles):
            return cls.join(
                [cls.beside([cls.read(cache, [arm], design) for arm in arm_keys(e)]) for e in ensembles]
            )
        opened = open_ensembles(cache, ensembles)
        pairs = zip(opened.configs, opened.datasets, strict=True)
        return cls.join([cls.of(opened.geometry, dataset, config, design) for config, dataset in pairs])

    @classmethod
    def of(
        cls, geometry: Geometry, ensemble: xr.Dataset, config: EnsembleConfig, design: Design | None = None
    ) -> ObservedStreams:
        """The streams of one ensemble that is open already, as one class.

        Parameters
        ----------
        ensemble : as `streamdash.store.cache.Cache.open_ensemble` gives it.
        """
        design = design or default_design(geometry)
        q, smooth = observe_as(geometry, ensemble, design), smooth_as(geometry, ensemble, design)
        if design.quantity == "density":  # its unit means nothing: the smooth stream's mean is 1
            scale = np.float32(smooth.mean())
            q, smooth = q / scale, smooth / scale
        return cls(
            (config,),
            design,
            (q,),
            (noise_draws(config, q.shape),),
            (ensemble["n_impacts"].to_numpy(),) if "n_impacts" in ensemble else (),
            smooth,
        )

    @classmethod
    def beside(cls, arms: Sequence[ObservedStreams]) -> ObservedStreams:
        """The arms of a stream as one: stream *i* is stream *i* of each arm, its bins one after the other.

        Every arm has impacts of its own, drawn from the population that hits both. A class goes by the
        configuration of its first arm.

        Raises
        ------
        ValueError
            When the arms are not hit by the same populations.
        """
        if len(arms) == 1:
            return arms[0]
        populations = {tuple((c.population.key, c.label) for c in arm.configs) for arm in arms}
        if len(populations) > 1:
            raise ValueError("Both arms are hit by one population; these are hit by different ones.")
        counts = [min(len(arm.q[c]) for arm in arms) for c in range(len(arms[0].q))]

        def wide(name: str) -> tuple[np.ndarray, ...]:
            return tuple(
                np.concatenate([getattr(arm, name)[c][:n] for arm in arms], axis=1)
                for c, n in enumerate(counts)
            )

        hits = all(arm.n_impacts for arm in arms)
        return cls(
            arms[0].configs,
            Design.beside([arm.design for arm in arms]),
            wide("q"),
            wide("draws"),
            tuple(np.sum([arm.n_impacts[c][:n] for arm in arms], axis=0) for c, n in enumerate(counts))
            if hits
            else (),
            np.concatenate([arm.smooth for arm in arms]),
        )

    @classmethod
    def join(cls, parts: Sequence[ObservedStreams]) -> ObservedStreams:
        """The classes of several, which are observed alike; nothing is copied.

        Raises
        ------
        ValueError
            When they are of different streams or designs.
        """
        check_stream([config for part in parts for config in part.configs])
        if len({part.design.key for part in parts}) > 1:
            raise ValueError("Classes are compared in the same bins and with the same errors.")
        return cls(
            tuple(config for part in parts for config in part.configs),
            parts[0].design,
            tuple(q for part in parts for q in part.q),
            tuple(draws for part in parts for draws in part.draws),
            tuple(n for part in parts for n in part.n_impacts),
            parts[0].smooth,
        )

    def only(self, classes: Sequence[int | str]) -> ObservedStreams:
        """Some of the classes, by their numbers or their `labels`.

        Raises
        ------
        ValueError
            When no class has such a label.
        """
        places = [self.labels.index(c) if isinstance(c, str) else c for c in classes]
        return ObservedStreams(
            tuple(self.configs[c] for c in places),
            self.design,
            tuple(self.q[c] for c in places),
            tuple(self.draws[c] for c in places),
            tuple(self.n_impacts[c] for c in places) if self.n_impacts else (),
            self.smooth,
        )

    def with_noise(self, noise: float | np.ndarray) -> ObservedStreams:
        """The same streams observed with other errors: one for all bins, or one each."""
        return replace(self, design=self.design.with_noise(noise))

    # ------------------------------------------------------------ what they are

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Short name of each class for files, for example ``1e3-1e5``; see `streamdash.naming`."""
        return tuple(class_names(self.configs))

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Identity of each class: the key of its configuration."""
        return tuple(config.key for config in self.configs)

    @property
    def n_bins(self) -> int:
        """Number of bins along the stream."""
        return self.design.n_bin

    @property
    def centers(self) -> np.ndarray:
        """Middle of every bin (n_bin,) in the design's coordinate."""
        return self.design.centers

    @cached_property
    def digest(self) -> str:
        """Hash of everything in the sample but the errors: data, draws, labels, keys and bins."""
        sha = hashlib.sha256(repr((self.labels, self.keys, [q.shape for q in self.q])).encode())
        fit = [] if self.design.fit is None else [self.design.fit]
        for array in (*self.q, *self.draws, self.centers, *fit):
            sha.update(np.ascontiguousarray(array).tobytes())
        return sha.hexdigest()

    # ------------------------------------------------------------ class by class

    def noisy(self, noise: float | np.ndarray | None = None, number: int = 0) -> list[np.ndarray]:
        """Each class's streams as observed, (n_streams, n_bin): with noise, divided as the design says.

        Parameters
        ----------
        noise : errors instead of the design's: one for all bins, or one each (n_bin,).
        number : of another draw of the noise; 0 is the streams' own.
        """
        design = self.design if noise is None else self.design.with_noise(noise)
        draws = self.draws
        if number:
            pairs = zip(self.configs, self.q, strict=True)
            draws = tuple(noise_draws(config, q.shape, number) for config, q in pairs)
        return [measured(q, d, design.sigma, design.fit) for q, d in zip(self.q, draws, strict=True)]

    def densities(self) -> list[np.ndarray]:
        """Each class's streams with noise, (n_streams, n_bin), before anything is divided out."""
        curves = [q if self.design.fit is None else smooth_curve(q, self.design.fit) for q in self.q]
        sigma = np.asarray(self.design.sigma, np.float32)
        return [q + sigma * curve * d for q, curve, d in zip(self.q, curves, self.draws, strict=True)]

    # ------------------------------------------------------------ all classes in one

    @cached_property
    def y(self) -> np.ndarray:
        """Class of every stream (n_total,), classes one after the other."""
        return np.repeat(np.arange(len(self.q)), [len(q) for q in self.q])

    @cached_property
    def clean(self) -> np.ndarray:
        """Every stream without noise (n_total, n_bin), float32."""
        return np.concatenate(self.q).astype(np.float32, copy=False)

    def observed(self, noise: float | np.ndarray | None = None) -> np.ndarray:
        """Every stream as observed (n_total, n_bin), float32; see `noisy`."""
        design = self.design if noise is None else self.design.with_noise(noise)
        return measured(self.clean, np.concatenate(self.draws), design.sigma, design.fit)

    def locate(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Class, and number within its ensemble, of rows of the pooled streams."""
        first = np.concatenate([[0], np.cumsum([len(q) for q in self.q])])
        owner = np.searchsorted(first, rows, side="right") - 1
        return owner, np.asarray(rows) - first[owner]


def arm_keys(ensemble: str | EnsembleConfig) -> list[str]:
    """Keys of the arms that a name of an ensemble joins by ``+``; of any other, the one key."""
    return ensemble.split("+") if isinstance(ensemble, str) else [ensemble.key]


def noise_draws(config: Config, shape: tuple[int, int], number: int = 0) -> np.ndarray:
    """The fixed standard-normal draws of an ensemble, (n_streams, n_bin) float32.

    The seed is the ensemble's key, so that no two ensembles share their noise; `number` above 0 names
    another draw.
    """
    return shot_noise(shape, int(config.key, 16) + number)


class Opened(NamedTuple):
    """Ensembles of one stream, open, and the stream's geometry."""

    geometry: Geometry
    configs: tuple[EnsembleConfig, ...]
    datasets: tuple[xr.Dataset, ...]


def open_ensembles(cache: Cache, ensembles: Sequence[str | EnsembleConfig]) -> Opened:
    """Open ensembles of one stream by their keys or configurations.

    Raises
    ------
    StoreError
        When one is missing or damaged.
    ValueError
        When they are not of one stream.
    """
    configs = tuple(cache.find(e).config if isinstance(e, str) else e for e in ensembles)
    check_stream(configs)
    geometry = load_geometry(configs[0].stream, cache)
    return Opened(geometry, configs, tuple(cache.open_ensemble(config) for config in configs))


def check_stream(configs: Sequence[EnsembleConfig]) -> None:
    """Refuse ensembles that are not all of one stream.

    Raises
    ------
    ValueError
        In one sentence.
    """
    if len({config.stream.key for config in configs}) > 1:
        raise ValueError("All ensembles must be simulated for the same stream.")
