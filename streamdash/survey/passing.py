"""Films of orbits: an object that flies past a stream, and stars that it has pulled forward or back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamdash.engine.flyby import Flyby, flyby_impacts
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS, time_unit_gyr
from streamdash.engine.geometry import TABLE_STEP, Geometry
from streamdash.engine.orbits import follow

SUN = np.array([1.0, 0.0, 0.0])
"""Where the Sun is in Galactocentric coordinates (natural units)."""
PASSING_MYR = 60.0
"""The film of a fly-by begins and ends so long before and after it."""
PASSING_FRAMES = 81
STARS = 160
PULL_KMS = 10.0
"""Kick of the neighbouring stars: many times that of a real fly-by, so that the orbits can be told apart."""
PULLED_GYR = 0.7
PULLED_FRAMES = 151


@dataclass(frozen=True)
class Passing:
    """The sky around the stars that are hit, which stay in the middle; angles in deg.

    Attributes
    ----------
    time_myr : (n_frames,) array
        0 at the fly-by.
    along, across : (n_frames, n_stars) arrays
        Where stars of the stream are, along it and across.
    object_along, object_across : (n_frames,) arrays
        Where the object is.
    """

    time_myr: np.ndarray
    along: np.ndarray
    across: np.ndarray
    object_along: np.ndarray
    object_across: np.ndarray


@dataclass(frozen=True)
class Pulled:
    """Three stars that were at one place: one left alone, one pulled forward, one held back.

    Attributes
    ----------
    time_gyr : (n_frames,) array
        Since the pull.
    place : (n_frames, 3, 2) array
        Where they are in the plane of their orbit (kpc), in the order named.
    lead : (n_frames, 2) array
        How far the second and the third are ahead of the first, seen from the Galaxy's centre (deg).
    kick : float
        The pull (km/s).
    """

    time_gyr: np.ndarray
    place: np.ndarray
    lead: np.ndarray
    kick: float

    @property
    def falls_back(self) -> float:
        """When the star that was pulled forward is behind for good (Gyr); infinite if never."""
        ahead = np.flatnonzero(self.lead[:, 0] >= 0)
        last = int(ahead[-1]) if len(ahead) else 0
        return float(self.time_gyr[last + 1]) if last + 1 < len(self.time_gyr) else float("inf")


def passing(geometry: Geometry, flyby: Flyby) -> Passing:
    """A fly-by as it would have been seen from where the Sun is; every body on its own orbit."""
    k, hit = flyby.time_index(geometry), flyby.angle(geometry)
    table = geometry.tables[k][:, :6]
    place = np.arange(len(table)) * TABLE_STEP
    ends = np.linspace(0.0, min(place[-1], float(geometry.length_at(geometry.times[k]))), STARS)
    angles = np.concatenate([[hit, min(hit + TABLE_STEP, place[-1])], ends])
    if angles[1] == hit:
        angles[1] = hit - TABLE_STEP
    stars = np.stack([np.interp(angles, place, column) for column in table.T], axis=1)
    impact = flyby_impacts(geometry, [flyby])
    velocity = np.array([impact.vx_kms[0], impact.vy_kms[0], impact.vz_kms[0]]) / V0_KMS
    # The closest approach is at right angles to both motions, as the engine's kick has it.
    relative = np.cross(velocity - stars[0, 3:], stars[0, 3:])
    away = relative / np.linalg.norm(relative) * impact.b_kpc[0] / R0_KPC
    body = np.concatenate([stars[0, :3] + away, velocity])
    times = np.linspace(-PASSING_MYR, PASSING_MYR, PASSING_FRAMES)
    seen = follow(geometry.stream, np.vstack([body, stars]), times / 1000 / time_unit_gyr())[..., :3] - SUN
    ahead = 1.0 if angles[1] > hit else -1.0
    middle = _unit(seen[:, 1])
    along = seen[:, 2] - np.einsum("tc,tc->t", seen[:, 2], middle)[:, None] * middle
    along = ahead * _unit(along)
    across = np.cross(middle, along)
    forward, sideways, upwards = (np.einsum("tnc,tc->tn", seen, axis) for axis in (middle, along, across))
    longitude = np.rad2deg(np.arctan2(sideways, forward))
    latitude = np.rad2deg(np.arctan2(upwards, np.hypot(forward, sideways)))
    return Passing(times, longitude[:, 3:], latitude[:, 3:], longitude[:, 0], latitude[:, 0])


def pulled(geometry: Geometry, flyby: Flyby, kick: float = PULL_KMS) -> Pulled:
    """What becomes of stars of the stream that are pulled forward or back by `kick` km/s."""
    k = flyby.time_index(geometry)
    table = geometry.tables[k]
    star = table[min(round(flyby.angle(geometry) / TABLE_STEP), len(table) - 1), :6]
    push = np.concatenate([np.zeros(3), kick / V0_KMS * _unit(star[3:])])
    times = np.linspace(0.0, PULLED_GYR, PULLED_FRAMES)
    bodies = np.vstack([star, star + push, star - push])
    orbits = follow(geometry.stream, bodies, times / time_unit_gyr())
    normal = _unit(np.cross(orbits[:, 0, :3], orbits[:, 0, 3:]))
    middle = _unit(orbits[:, 0, :3])
    onward = np.cross(normal, middle)
    lead = [
        np.rad2deg(
            np.arctan2(
                np.einsum("tc,tc->t", orbits[:, i, :3], onward),
                np.einsum("tc,tc->t", orbits[:, i, :3], middle),
            )
        )
        for i in (1, 2)
    ]
    plane = np.stack([middle[0], onward[0]])
    return Pulled(times, R0_KPC * orbits[..., :3] @ plane.T, np.stack(lead, axis=1), kick)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
