"""Single fly-bys chosen by hand: their kicks, and a film of the gap from the impact until today.

For teaching and for looking at the engine at work; ensembles draw theirs at random (`impacts`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from pydantic import Field

from streamdash.config import Accuracy, Config, Finite, Perturbers, Population
from streamdash.engine.density import trace_back
from streamdash.engine.galpy_streams import LENGTH_THRESHOLD, R0_KPC, V0_KMS, time_unit_gyr
from streamdash.engine.geometry import TABLE_STEP, Geometry
from streamdash.engine.impacts import COLUMNS, Impacts, check_impacts, sample_impacts
from streamdash.engine.impulse import gravity, velocity_kick
from streamdash.engine.kicks import kick_tables
from streamdash.engine.mass_function import scale_radius

FRAMES = 151
"""Frames of a film."""
FILM_ANGLES = 360
"""Angles of a film."""
FILM_END = 1.25
"""A film shows this times the stream's length today."""
KICK_POINTS = 301


class Flyby(Config):
    """One object that flies past the stream, in terms a person can choose.

    Its velocity is that in the Galaxy's rest frame, its direction is relative to the stream's motion
    where they meet.
    """

    log10_mass: Finite = Field(7.5, ge=3, le=9, description="log₁₀ of the mass in M☉")
    size: Finite = Field(1.0, ge=0.2, le=5, description="scale radius relative to the usual one of that mass")
    b: Finite = Field(0.5, ge=0, le=5, description="impact parameter in scale radii")
    speed: Finite = Field(200.0, ge=50, le=500, description="speed, km/s")
    pitch: Finite = Field(90.0, ge=20, le=160, description="angle to the stream's motion, degrees")
    azimuth: Finite = Field(
        0.0, ge=0, le=360, description="side it comes from, degrees; 0: from outside the orbit"
    )
    time_gyr: Finite = Field(4.0, gt=0, le=13.8, description="time before today, Gyr; the nearest one counts")
    place: Finite = Field(0.5, ge=0.02, le=1, description="where, as a fraction of the stream's length then")

    def time_index(self, geometry: Geometry) -> int:
        """Index of the stream's impact time that is nearest to `time_gyr`."""
        return int(np.abs(np.asarray(geometry.stream.impact_times_gyr) - self.time_gyr).argmin())

    def angle(self, geometry: Geometry) -> float:
        """Parallel angle of the impact then (rad)."""
        k = self.time_index(geometry)
        return float(min(self.place * geometry.length_at(geometry.times[k]), geometry.table_ends[k]))

    @property
    def mass_msun(self) -> float:
        """Mass in M☉."""
        return 10**self.log10_mass

    @property
    def r_s_kpc(self) -> float:
        """Scale radius in kpc."""
        return float(self.size * scale_radius(self.mass_msun, Perturbers()))


@dataclass(frozen=True)
class Film:
    """The stream from the oldest impact until today, every frame of it computed by the engine.

    Attributes
    ----------
    theta : (n_theta,) array
        Parallel angles, rad.
    time_gyr : (n_frames,) array
        Time before today, decreasing to 0, Gyr.
    density, smooth : (n_frames, n_theta) float32 arrays
        ρ with and without fly-bys, 1 near the progenitor.
    """

    theta: np.ndarray
    time_gyr: np.ndarray
    density: np.ndarray
    smooth: np.ndarray

    @property
    def q_rho(self) -> np.ndarray:
        """ρ/ρ̄ (n_frames, n_theta); NaN beyond the end that the stream had then."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.smooth > LENGTH_THRESHOLD, self.density / self.smooth, np.float32(np.nan))


def flyby_impacts(geometry: Geometry, flybys: Sequence[Flyby]) -> Impacts:
    """The table of impacts, for the engine, of fly-bys chosen by hand."""
    return combine([_impact(geometry, flyby) for flyby in flybys])


def random_impacts(geometry: Geometry, perturbers: Perturbers | Population, count: int, seed: int) -> Impacts:
    """`count` of the impacts drawn for one stream, of whatever component; fewer where fewer were drawn."""
    rng = np.random.default_rng(seed)
    drawn = sample_impacts(geometry, perturbers, rng)
    rows = np.arange(len(drawn))
    if isinstance(perturbers, Population) and len(perturbers.components) > 1:
        rows = rng.permutation(rows)  # they were drawn one component after the other
    return Impacts(*(getattr(drawn, name)[rows[:count]] for name in COLUMNS))


def combine(tables: Sequence[Impacts]) -> Impacts:
    """All impacts of several tables in one."""
    return Impacts.joined(tables)


def kick_along_stream(geometry: Geometry, flyby: Flyby) -> xr.Dataset:
    """What one fly-by does to the stars at the moment of the impact.

    Returns
    -------
    xarray.Dataset
        Over ``theta`` (rad, denser near the impact): ``dv_along`` and ``dv_across``, the velocity
        kick along the stream's motion and the size of the rest (km/s), and ``d_omega``, the change
        of parallel frequency δΩ∥ = L·δv (rad/Gyr; BES17 §2.2).
    """
    k, closest = flyby.time_index(geometry), flyby.angle(geometry)
    impact = flyby_impacts(geometry, [flyby])
    theta = _angles_around(closest, float(geometry.table_ends[k]), flyby)
    stars = _columns(geometry, k, theta)
    here = _columns(geometry, k, np.array([closest]))[0]
    w = np.array([impact.vx_kms[0], impact.vy_kms[0], impact.vz_kms[0]]) / V0_KMS
    kick = velocity_kick(
        stars[:, 3:6],
        stars[:, :3],
        impact.b_kpc[0] / R0_KPC,
        w,
        here[:3],
        here[3:6],
        impact.mass_msun[0] * gravity(),
        impact.r_s_kpc[0] / R0_KPC,
    )
    motion = stars[:, 3:6] / np.linalg.norm(stars[:, 3:6], axis=1, keepdims=True)
    along = np.einsum("nc,nc->n", kick, motion)
    across = np.linalg.norm(kick - along[:, None] * motion, axis=1)
    d_omega = np.einsum("nc,nc->n", stars[:, 6:], kick) / time_unit_gyr()
    columns = {"dv_along": along * V0_KMS, "dv_across": across * V0_KMS, "d_omega": d_omega}
    return xr.Dataset({name: ("theta", values) for name, values in columns.items()}, {"theta": theta})


def film(geometry: Geometry, impacts: Impacts, n_frames: int = FRAMES, n_theta: int = FILM_ANGLES) -> Film:
    """The stream at `n_frames` moments from its oldest impact until today.

    Each frame is the exact map of `streamdash.engine.density` for a "today" that lies earlier: stars are
    traced back from that moment, through the impacts before it, to the start of disruption.

    Raises
    ------
    ImpactsError
        When an impact is not one on this stream.
    ValueError
        When there is none.
    """
    check_impacts(impacts, geometry)
    if not len(impacts):
        raise ValueError("a film needs at least one impact")
    accuracy = Accuracy()
    kicks = kick_tables(geometry, impacts, accuracy=accuracy)
    theta = np.linspace(0, FILM_END * geometry.length, n_theta + 1)[1:]
    times = np.linspace(kicks.times[-1], 0.0, n_frames)
    density = np.empty((n_frames, n_theta), dtype=np.float32)
    for frame, time in enumerate(times):
        density[frame], _ = trace_back(geometry, kicks.before(time), theta, accuracy, time)
    smooth = geometry.smooth_density(theta, times[:, None]).astype(np.float32)
    return Film(theta, times * time_unit_gyr(), density, smooth)


def _impact(geometry: Geometry, flyby: Flyby) -> Impacts:
    k, closest = flyby.time_index(geometry), flyby.angle(geometry)
    star = _columns(geometry, k, np.array([closest]))[0]
    along = star[3:6] / np.linalg.norm(star[3:6])
    outwards = star[:3] - (star[:3] @ along) * along
    outwards /= np.linalg.norm(outwards)
    sideways = np.cross(outwards, along)
    pitch, azimuth = np.deg2rad(flyby.pitch), np.deg2rad(flyby.azimuth)
    inwards = -(np.cos(azimuth) * outwards + np.sin(azimuth) * sideways)
    vx, vy, vz = flyby.speed * (np.cos(pitch) * along + np.sin(pitch) * inwards)
    time, r_s = geometry.stream.impact_times_gyr[k], flyby.r_s_kpc
    return Impacts(*map(np.atleast_1d, (time, closest, flyby.b * r_s, vx, vy, vz, flyby.mass_msun, r_s)))


def _columns(geometry: Geometry, k: int, theta: np.ndarray) -> np.ndarray:
    """Position, velocity and L of the stream at time k, (n, 9), natural units."""
    table = geometry.tables[k]
    place = np.arange(len(table)) * TABLE_STEP
    return np.stack([np.interp(theta, place, table[:, c]) for c in range(table.shape[1])], axis=1)


def _angles_around(closest: float, end: float, flyby: Flyby) -> np.ndarray:
    """Angles from 0 to `end`, ever denser towards the impact."""
    scale = 0.02 * flyby.r_s_kpc / R0_KPC
    reach = np.arcsinh(end / scale)
    around = closest + scale * np.sinh(np.linspace(-reach, reach, KICK_POINTS))
    return np.unique(np.clip(np.append(around, np.linspace(0, end, KICK_POINTS)), 0, end))
