"""One stream that fly-bys chosen by hand and random ones have hit, as a survey sees it today."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.config import EnsembleConfig, Population
from streamdash.engine.density import perturbed_stream
from streamdash.engine.flyby import Film, Flyby, combine, film, flyby_impacts, random_impacts
from streamdash.engine.galpy_streams import time_unit_gyr
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import Impacts
from streamdash.simulation.ensemble import theta_grid
from streamdash.survey.design import default_design
from streamdash.survey.sky import observe, shot_noise

FALL_GYR = 0.5
"""How long before an impact it is announced in films."""


@dataclass(frozen=True)
class Scene:
    """What happens to one stream: fly-bys chosen by hand, the last of them in hand, and random ones.

    Attributes
    ----------
    flybys : tuple of Flyby
        At least one.
    crowd : int
        Number of random fly-bys.
    population : Population
        What they are drawn from.
    seed : int
        Seed of the random fly-bys and of the shot noise.
    """

    flybys: tuple[Flyby, ...]
    crowd: int = 0
    population: Population = Population()
    seed: int = 0

    def impacts(self, geometry: Geometry) -> Impacts:
        """All impacts, those by hand first."""
        chosen = flyby_impacts(geometry, self.flybys)
        return combine([chosen, self.random(geometry)]) if self.crowd else chosen

    def random(self, geometry: Geometry) -> Impacts:
        """The random impacts alone."""
        return random_impacts(geometry, self.population, self.crowd, self.seed)


@dataclass(frozen=True)
class Seen:
    """Today's stream in bins of longitude; arrays of shape (n_bin,).

    Attributes
    ----------
    position : centres of the bins in `coordinate` (deg)
    coordinate : str
    clean, noisy : Qρ without and with shot noise of ``noise`` per bin
    alone : Qρ if there were the fly-by in hand only
    n_impacts : int
    """

    position: np.ndarray
    coordinate: str
    clean: np.ndarray
    noisy: np.ndarray
    alone: np.ndarray
    noise: float
    n_impacts: int

    @property
    def share(self) -> float:
        """How much of the whole pattern the fly-by in hand explains: r² of Qρ - 1 with its own, 0 to 1."""
        own, all_of_it = self.alone - 1, self.clean - 1
        norm = (own @ own) * (all_of_it @ all_of_it)
        return float((own @ all_of_it) ** 2 / norm) if norm > 0 else 0.0


def make_film(geometry: Geometry, scene: Scene) -> Film:
    """All frames from the oldest fly-by until today."""
    return film(geometry, scene.impacts(geometry))


def see(geometry: Geometry, scene: Scene, noise: float) -> Seen:
    """Today's Qρ in the bins of the stream's description."""
    theta, design = theta_grid(EnsembleConfig(stream=geometry.stream)), default_design(geometry)
    impacts = scene.impacts(geometry)

    def binned(density: np.ndarray) -> np.ndarray:
        return observe(geometry, theta, density, design.edges, design.coordinate)

    smooth = binned(geometry.smooth_density(theta))

    def q(table: Impacts) -> np.ndarray:
        return binned(perturbed_stream(geometry, table, theta).density.values) / smooth

    clean = q(impacts)
    alone = clean if len(impacts) == 1 else q(flyby_impacts(geometry, scene.flybys[-1:]))
    noisy = clean + noise * shot_noise((1, len(clean)), scene.seed)[0]
    return Seen(design.centers, design.coordinate, clean, noisy, alone, noise, len(impacts))


def drops(impacts: Impacts, time_gyr: np.ndarray) -> np.ndarray:
    """How far each of several impacts is still to come, to be drawn as drops that fall.

    Returns
    -------
    (n_frames, n_impacts) array
        From 1, `FALL_GYR` before the impact, to 0 at it; NaN before and after.
    """
    left = (np.asarray(time_gyr)[:, None] - np.asarray(impacts.time_gyr)[None, :]) / FALL_GYR
    return np.where((left > -1e-9) & (left <= 1), np.maximum(left, 0), np.nan)


def struck(geometry: Geometry, flybys: Sequence[Flyby], time_gyr: np.ndarray) -> np.ndarray:
    """Where the stars are that fly-bys passed closest, had they kept their mean frequency.

    Returns
    -------
    (n_frames, n_flybys) array
        Parallel angles (rad); NaN before the fly-by.
    """
    angles = np.full((len(time_gyr), len(flybys)), np.nan)
    for i, flyby in enumerate(flybys):
        k = flyby.time_index(geometry)
        theta, then = flyby.angle(geometry), geometry.times[k]
        age = geometry.t_disrupt - then
        # ρ̄ and ⟨Ω⟩ depend on θ/age alone: read them off today's stream.
        omega = float(geometry.smooth_omega(theta * geometry.t_disrupt / age))
        since = then - np.asarray(time_gyr) / time_unit_gyr()
        angles[:, i] = np.where(since >= -1e-9, theta + omega * since, np.nan)
    return angles
