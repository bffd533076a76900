"""What hits the stream: how many subhalos, when, where, how fast, how massive.

Sampling follows Bovy, Erkal & Sanders (2017) §2.3, in the order of the paper's eq. 1.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from streamdash.config import Perturbers, Population, StreamModel
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.geometry import TABLE_STEP, Geometry
from streamdash.engine.mass_function import (
    SCALE_RADIUS_KPC,
    mass_decades,
    sample_masses,
    scale_radius,
    subhalo_count,
    suppressed_fraction,
)

NUMBERS = ("time_gyr", "theta", "b_kpc", "vx_kms", "vy_kms", "vz_kms", "mass_msun", "r_s_kpc")
COLUMNS = (*NUMBERS, "profile")
MAX_IMPACTS = 200_000
"""Most impacts accepted from a file, so that a mistake cannot exhaust the memory."""
TIME_TOLERANCE_GYR = 1e-3
"""How far a given impact time may be from one of the stream's."""
MAX_TIMES = 512
"""Most impact times of a stream."""


class ImpactsError(ValueError):
    """A table of impacts that cannot be used; names the row, the column and the fix."""


@dataclass(frozen=True)
class Impacts:
    """Subhalo fly-bys: equal-length arrays, one entry per impact.

    Attributes
    ----------
    time_gyr : time before today (Gyr)
    theta : parallel angle of closest approach, from the progenitor outwards (rad)
    b_kpc : impact parameter; the sign chooses the side (kpc)
    vx_kms, vy_kms, vz_kms : velocity of the subhalo in the Galactocentric rectangular
        frame of galpy's track (km/s)
    mass_msun, r_s_kpc : mass (M☉) and scale radius (kpc)
    profile : ``hernquist`` or ``plummer``; one word for all, or one each
    """

    time_gyr: np.ndarray
    theta: np.ndarray
    b_kpc: np.ndarray
    vx_kms: np.ndarray
    vy_kms: np.ndarray
    vz_kms: np.ndarray
    mass_msun: np.ndarray
    r_s_kpc: np.ndarray
    profile: np.ndarray | str = "hernquist"

    def __post_init__(self) -> None:
        for name in NUMBERS:
            object.__setattr__(self, name, np.atleast_1d(np.asarray(getattr(self, name), dtype=float)))
        profile = np.asarray(self.profile, dtype=str)
        object.__setattr__(self, "profile", profile if profile.ndim else np.full(len(self), profile))
        lengths = {len(getattr(self, name)) for name in COLUMNS}
        if len(lengths) != 1:
            raise ImpactsError(f"the columns of a table of impacts differ in length: {sorted(lengths)}")

    def __len__(self) -> int:
        return len(self.time_gyr)

    @classmethod
    def none(cls) -> Impacts:
        """No impacts at all."""
        return cls(*(np.empty(0) for _ in NUMBERS))

    @classmethod
    def joined(cls, tables: Iterable[Impacts]) -> Impacts:
        """All impacts of several tables, one table after the other."""
        tables = [cls.none(), *tables]
        return cls(*(np.concatenate([getattr(table, name) for table in tables]) for name in COLUMNS))

    def to_frame(self) -> pd.DataFrame:
        """The impacts as a table with the columns `COLUMNS`."""
        return pd.DataFrame(dict(zip(COLUMNS, astuple(self), strict=True)))

    def to_csv(self, path: Path | str) -> None:
        """Write the table; `read_csv` reads the same numbers back."""
        self.to_frame().to_csv(path, index=False)

    @classmethod
    def read_csv(
        cls, path: Path | str, geometry: Geometry | None = None, profile: str = "hernquist"
    ) -> Impacts:
        """Read a table written by `to_csv` or by hand.

        Parameters
        ----------
        path : path
        geometry : Geometry, optional
            When given, times and angles are checked against this stream.
        profile : {"hernquist", "plummer"}
            Of all impacts, where the table has no such column.

        Raises
        ------
        ImpactsError
            Naming the row (counted from 1 below the header), the column and the fix.
        """
        try:
            frame = pd.read_csv(path, comment="#", skipinitialspace=True, nrows=MAX_IMPACTS + 1)
        except OSError as error:
            raise ImpactsError(f"{path}: {error.strerror or error}") from None
        except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
            raise ImpactsError(f"{path}: not a table of comma-separated text ({error})") from None
        frame.columns = frame.columns.astype(str).str.strip().str.lstrip("\ufeff")
        missing = [name for name in NUMBERS if name not in frame.columns]
        if missing:
            raise ImpactsError(
                f"{path}: column {missing[0]!r} is missing; the header must name {', '.join(NUMBERS)}"
            )
        if len(frame) > MAX_IMPACTS:
            raise ImpactsError(f"{path}: more than {MAX_IMPACTS} rows")
        values: dict[str, Any] = {
            "profile": frame["profile"].to_numpy(str) if "profile" in frame.columns else profile
        }
        for name in NUMBERS:
            numbers = pd.to_numeric(frame[name], errors="coerce").to_numpy(float)
            _refuse(~np.isfinite(numbers), name, frame[name], "must be a finite number")
            values[name] = numbers
        impacts = cls(**values)
        check_impacts(impacts, geometry)
        return impacts


def check_impacts(impacts: Impacts, geometry: Geometry | None = None) -> None:
    """Refuse impacts that make no sense, or none on this stream.

    Raises
    ------
    ImpactsError
        Naming the row (counted from 1) and column of the first bad value.
    """
    for name in NUMBERS:
        _refuse(~np.isfinite(getattr(impacts, name)), name, getattr(impacts, name), "must be finite")
    known = np.isin(impacts.profile, list(SCALE_RADIUS_KPC))
    _refuse(~known, "profile", impacts.profile, f"must be {' or '.join(SCALE_RADIUS_KPC)}")
    _refuse(impacts.mass_msun <= 0, "mass_msun", impacts.mass_msun, "must be positive (M☉)")
    _refuse(impacts.r_s_kpc <= 0, "r_s_kpc", impacts.r_s_kpc, "must be positive (kpc)")
    speed = np.sqrt(impacts.vx_kms**2 + impacts.vy_kms**2 + impacts.vz_kms**2)
    _refuse(speed > 1e5, "vx_kms", impacts.vx_kms, "is part of a speed above 100000 km/s")
    if geometry is None or not len(impacts):
        return
    _check_times(impacts, geometry.stream)
    index, distance = _nearest_time(geometry.stream, impacts.time_gyr)
    bad = distance > TIME_TOLERANCE_GYR
    if bad.any():
        nearest = geometry.stream.impact_times_gyr[index[bad.argmax()]]
        fix = f"is not an impact time of this stream (nearest {nearest:.6g} Gyr)"
        _refuse(bad, "time_gyr", impacts.time_gyr, fix)
    ends = geometry.table_ends[index]
    outside = (impacts.theta <= 0) | (impacts.theta > ends)
    if outside.any():
        end = ends[outside.argmax()]
        _refuse(outside, "theta", impacts.theta, f"must lie on the stream as it was then, 0 to {end:.4g} rad")


def stream_with_times(stream: StreamModel, impacts: Impacts) -> StreamModel:
    """`stream`, or if some impacts are not at its impact times, `stream` with their own.

    Raises
    ------
    ImpactsError
        When a time lies outside the stream's life, or there are too many different ones.
    """
    _check_times(impacts, stream)
    if not len(impacts) or (_nearest_time(stream, impacts.time_gyr)[1] <= TIME_TOLERANCE_GYR).all():
        return stream
    times = np.unique(impacts.time_gyr)
    if len(times) > MAX_TIMES:
        raise ImpactsError(
            f"column time_gyr: {len(times)} different times, of which some are not the stream's own; "
            f"at most {MAX_TIMES} can be computed anew."
        )
    return stream.model_copy(update={"times_gyr": tuple(times.tolist())})


def time_index(geometry: Geometry, impacts: Impacts) -> np.ndarray:
    """Index of each impact's time among the stream's impact times."""
    return _nearest_time(geometry.stream, impacts.time_gyr)[0]


def _check_times(impacts: Impacts, stream: StreamModel) -> None:
    age, time = stream.age_gyr, impacts.time_gyr
    off = (time <= 0) | (time >= age)
    _refuse(off, "time_gyr", time, f"must lie within the stream's life, 0 to {age:g} Gyr")


def _nearest_time(stream: StreamModel, time_gyr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    distance = np.abs(np.subtract.outer(time_gyr, stream.impact_times_gyr))
    index = distance.argmin(axis=1)
    return index, distance[np.arange(len(index)), index]


def _refuse(bad: np.ndarray, name: str, values: Any, fix: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        shown = str(values.iloc[row] if hasattr(values, "iloc") else values[row])[:40]
        raise ImpactsError(f"row {row + 1}, column {name}: {fix} (got {shown}).")


def expected_impacts(geometry: Geometry, perturbers: Perturbers | Population) -> float:
    """Mean number of impacts over the stream's life (paper §2, item 6); of a population, of all components.

    galpy's ``streamdf.subhalo_encounters`` summed over decades of mass, each with the r_s
    of its middle; b_max = X r_s, never below half the stream's width. That floor is galpy's, and so the
    paper's: small subhalos, of which X r_s is far less than the width, are counted as if they came as
    far, but pass within X r_s, so that close encounters are too many (without `width_floor` 10³–10⁵ M☉
    has 570 impacts and not 839). It scales with the
    rate factor, the length factor, and the fraction that warm dark matter or a cutoff mass leaves.

    Examples
    --------
    >>> from streamdash import Perturbers, StreamModel, load_geometry
    >>> geometry = load_geometry(StreamModel())
    >>> round(expected_impacts(geometry, Perturbers(mass_range="1e3-1e5")))  # the paper: about 839
    839
    """
    if isinstance(perturbers, Population):
        return sum(expected_impacts(geometry, component) for component in perturbers.components)
    floor = 0.5 * geometry.width * geometry.mean_radius if perturbers.width_floor else 0.0
    per_density_and_b = (
        np.sqrt(np.pi / 2)
        * geometry.mean_radius
        * (perturbers.sigma_h / V0_KMS)
        * geometry.t_disrupt**2
        * geometry.mean_omega
    )
    total = 0.0
    for low, high in mass_decades(perturbers.mass_range):
        b_max = perturbers.X * scale_radius(np.sqrt(low * high), perturbers) / R0_KPC
        total += subhalo_count(low, high, perturbers.slope) * max(b_max, floor)
    fraction = suppressed_fraction(perturbers)
    return float(per_density_and_b * total * perturbers.rate_factor * perturbers.length_factor * fraction)


def sample_impacts(
    geometry: Geometry, perturbers: Perturbers | Population, rng: np.random.Generator
) -> Impacts:
    """Draw the impacts of one stream (paper eq. 1; BES17 §2.3).

    Number: Poisson. Time: one of the stream's, with probability ∝ its physical length
    then. Angle: uniform in physical length, out to ``length_factor`` times the length.
    Mass: p(M) ∝ M^slope r_s(M). Impact parameter: uniform in ±X r_s. Velocity: Gaussian
    along the stream and tangentially, minus Rayleigh radially, at a uniform azimuth.
    Of a population, those of each component, one component after the other.

    Parameters
    ----------
    geometry : Geometry
    perturbers : Perturbers or Population
    rng : numpy.random.Generator

    Returns
    -------
    Impacts
    """
    if isinstance(perturbers, Population):
        return Impacts.joined(sample_impacts(geometry, component, rng) for component in perturbers.components)
    n = int(rng.poisson(expected_impacts(geometry, perturbers)))
    if n == 0:
        return Impacts.none()
    lengths = _arc_length_at(geometry, geometry.length_at(geometry.times))
    k = rng.choice(len(lengths), size=n, p=lengths / lengths.sum())
    theta = _sample_angles(geometry, k, perturbers.length_factor, rng.random(n))
    mass = sample_masses(perturbers, rng.random(n))
    r_s = scale_radius(mass, perturbers)
    b = perturbers.X * r_s * rng.uniform(-1.0, 1.0, n)
    velocity = _sample_velocities(geometry, k, theta, perturbers.sigma_h, rng)
    time = np.asarray(geometry.stream.impact_times_gyr)[k]
    vx, vy, vz = velocity.T
    return Impacts(time, theta, b, vx, vy, vz, mass, r_s, perturbers.profile)


def _arc_length_at(geometry: Geometry, theta: Any) -> np.ndarray:
    """Physical length from the progenitor to angle theta[k] at each time k, kpc."""
    grid = TABLE_STEP * np.arange(geometry.arc_lengths.shape[1])
    return np.array([np.interp(t, grid, arc) for t, arc in zip(theta, geometry.arc_lengths, strict=True)])


def _sample_angles(geometry: Geometry, k: np.ndarray, factor: float, u: np.ndarray) -> np.ndarray:
    ends = np.minimum(factor * geometry.length_at(geometry.times), geometry.table_ends)
    arc_end = _arc_length_at(geometry, ends)
    grid = TABLE_STEP * np.arange(geometry.arc_lengths.shape[1])
    theta = np.empty(len(k))
    for time in np.unique(k):
        here = k == time
        theta[here] = np.interp(u[here] * arc_end[time], geometry.arc_lengths[time], grid)
    # Never exactly at the progenitor, where no star has left yet.
    return np.maximum(theta, 1e-9)


def _sample_velocities(
    geometry: Geometry, k: np.ndarray, theta: np.ndarray, sigma: float, rng: np.random.Generator
) -> np.ndarray:
    """Velocities of shape (n, 3) in km/s: the stream's local frame, then rectangular."""
    n = len(k)
    entry = np.minimum(theta / TABLE_STEP, geometry.tables.shape[1] - 2)
    i = entry.astype(int)
    f = (entry - i)[:, None]
    along = (1 - f) * geometry.tables[k, i, 3:6] + f * geometry.tables[k, i + 1, 3:6]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Two perpendiculars: any pair will do, the azimuth between them is uniform. The axis
    # least along the stream keeps the cross product away from zero.
    axis = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(along, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    azimuth = rng.uniform(0.0, 2 * np.pi, (n, 1))
    radial = np.cos(azimuth) * first + np.sin(azimuth) * second
    tangential = -np.sin(azimuth) * first + np.cos(azimuth) * second
    parallel, sideways = rng.normal(0.0, sigma, (2, n, 1))
    inward = rng.rayleigh(sigma, (n, 1))
    return parallel * along + sideways * tangential - inward * radial


__all__ = [
    "COLUMNS",
    "NUMBERS",
    "Impacts",
    "ImpactsError",
    "check_impacts",
    "expected_impacts",
    "sample_impacts",
    "stream_with_times",
    "time_index",
]
