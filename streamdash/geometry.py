"""The smooth stream and its geometry at each impact time, from galpy.

Natural units inside: lengths in `R0` = 8 kpc, velocities in `V0` = 220 km/s, so one unit
of time is 0.035556 Gyr and frequencies are radians per that time.

The expensive part, building a `galpy.df.streamgapdf` per impact time (seconds each), is
done once per `StreamModel`, in parallel, and kept in the cache as the few dozen numbers
per time that it comes down to: the phase-space track and the frequency Jacobian at the
nodes along the stream between which galpy interpolates.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import joblib
import numpy as np
import xarray as xr
from scipy import interpolate, special

from streamdash.config import StreamModel

if TYPE_CHECKING:
    from streamdash.store import Cache

R0_KPC = 8.0
V0_KMS = 220.0
TRACK_CHUNKS = 11
"""Nodes of today's track (galpy's ``nTrackChunks``), as in Bovy, Erkal & Sanders (2017)."""
LENGTH_THRESHOLD = 0.2
"""The stream ends where its density is this fraction of that near the progenitor."""
TABLE_STEP = 1e-3
"""Spacing in rad of the tables in which the track is looked up; linear interpolation
between entries is then off by at most ~0.01 pc, far below the smallest subhalo."""

# Rotation from equatorial to GD-1 coordinates, Koposov, Rix & Hogg (2010), appendix.
GD1_ROTATION = np.array(
    [
        [-0.4776303088, -0.1738432154, 0.8611897727],
        [0.510844589, -0.8524449229, 0.111245042],
        [0.7147776536, 0.4930681392, 0.4959603976],
    ]
)


@dataclass(frozen=True)
class Geometry:
    """A smooth stream, and what is needed to kick it at each of its impact times.

    Attributes
    ----------
    stream : StreamModel
        What this is the geometry of.
    mean_omega, sigma_omega : float
        Mean and dispersion of the parallel-frequency offset, ΔΩ and σ (natural units).
    t_disrupt : float
        Time since disruption began (natural units).
    mean_radius, width : float
        Mean spherical radius of the progenitor's orbit (natural units) and angular width
        of the stream (rad); both enter the encounter rate.
    times : (n_times,) array
        Impact times before today, increasing (natural units).
    node_theta : (n_times, n_node) array
        Angles of galpy's track nodes at each time (rad); NaN where a time has fewer.
    node_xv : (n_times, n_node, 6) array
        Rectangular Galactocentric position and velocity at the nodes (natural units).
    node_jac : (n_times, n_node, 3) array
        ∂Ω∥/∂(vR, vT, vz) at the nodes (natural units).
    track_theta, track_ell, track_b, track_dist, track_phi1, track_phi2 : (n,) arrays
        Today's track: rad, deg, deg, kpc, deg, deg. Longitudes are unwrapped.
    """

    stream: StreamModel
    mean_omega: float
    sigma_omega: float
    t_disrupt: float
    mean_radius: float
    width: float
    times: np.ndarray
    node_theta: np.ndarray
    node_xv: np.ndarray
    node_jac: np.ndarray
    track_theta: np.ndarray
    track_ell: np.ndarray
    track_b: np.ndarray
    track_dist: np.ndarray
    track_phi1: np.ndarray
    track_phi2: np.ndarray

    @property
    def length(self) -> float:
        """Length today in rad: density down to 20 % of that near the progenitor."""
        return float(self.length_at(0.0))

    def length_at(self, time: np.ndarray | float) -> np.ndarray | float:
        """Length in rad at `time` before today (natural units), same definition.

        ρ̄(θ, T) depends on θ/T alone, so the length grows linearly with the time T since
        disruption began.
        """
        return (self.t_disrupt - time) * (
            self.mean_omega - self.sigma_omega * special.ndtri(LENGTH_THRESHOLD)
        )

    def smooth_density(self, theta: np.ndarray, time: np.ndarray | float = 0.0) -> np.ndarray:
        """Unperturbed density ρ̄(θ), 1 near the progenitor (BES17 eq. 9).

        `time` before today is in natural units; the stream is then so much younger.
        """
        age = self.t_disrupt - time
        return special.ndtr((self.mean_omega - np.asarray(theta) / age) / self.sigma_omega)

    def smooth_omega(self, theta: np.ndarray) -> np.ndarray:
        """Unperturbed mean parallel frequency ⟨Ω∥⟩(θ), natural units."""
        z = (self.mean_omega - np.asarray(theta) / self.t_disrupt) / self.sigma_omega
        # Mean of a Gaussian cut from below; log_ndtr keeps the far tail finite.
        ratio = np.exp(-0.5 * z**2 - special.log_ndtr(z)) / np.sqrt(2 * np.pi)
        return self.mean_omega + self.sigma_omega * ratio

    @cached_property
    def tables(self) -> np.ndarray:
        """Track and Jacobian every `TABLE_STEP` rad at each time, for the kick kernel.

        Returns
        -------
        (n_times, n_entry, 9) array
            x, y, z, vx, vy, vz and the rectangular 3-vector L with δΩ∥ = L·δv (natural
            units). Entries beyond a time's `table_ends` repeat the last one.
        """
        n_entry = int(np.ceil(np.nanmax(self.node_theta) / TABLE_STEP)) + 2
        return np.stack([self._table(k, np.arange(n_entry) * TABLE_STEP) for k in range(len(self.times))])

    @cached_property
    def table_ends(self) -> np.ndarray:
        """Largest angle of each time's tables in rad; kicks are zero beyond."""
        return np.nanmax(self.node_theta, axis=1)

    @cached_property
    def arc_lengths(self) -> np.ndarray:
        """Physical length along the stream at each table entry, (n_times, n_entry), kpc."""
        steps = np.linalg.norm(np.diff(self.tables[:, :, :3], axis=1), axis=2)
        return R0_KPC * np.pad(np.cumsum(steps, axis=1), ((0, 0), (1, 0)))

    def _table(self, k: int, theta: np.ndarray) -> np.ndarray:
        used = np.isfinite(self.node_theta[k])
        nodes, xv, jac = self.node_theta[k][used], self.node_xv[k][used], self.node_jac[k][used]
        theta = np.minimum(theta, nodes[-1])
        track = interpolate.make_interp_spline(nodes, xv, k=3)(theta)
        row = _blend_jacobians(theta, track[:, :3], nodes, xv[:, :3], jac)
        phi = np.arctan2(track[:, 1], track[:, 0])
        cos, sin = np.cos(phi), np.sin(phi)
        rectangular = np.stack(
            [row[:, 0] * cos - row[:, 1] * sin, row[:, 0] * sin + row[:, 1] * cos, row[:, 2]], axis=1
        )
        return np.concatenate([track, rectangular], axis=1)

    def to_dataset(self) -> xr.Dataset:
        """The geometry as a Dataset of plain numbers, for the cache."""
        data = {name: (dims, getattr(self, name)) for name, dims in _DIMS.items() if dims}
        scalars = {name: float(getattr(self, name)) for name, dims in _DIMS.items() if not dims}
        return xr.Dataset(data, attrs=scalars)

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset, stream: StreamModel) -> Geometry:
        """Rebuild from `to_dataset`.

        Raises
        ------
        ValueError
            When a variable is missing or of the wrong shape, by name.
        """
        values: dict = {}
        for name, dims in _DIMS.items():
            source = dataset.variables if dims else dataset.attrs
            if name not in source:
                raise ValueError(f"geometry has no {name!r}")
            if not dims:
                values[name] = float(dataset.attrs[name])
                continue
            if dataset[name].dims != dims:
                raise ValueError(f"geometry's {name!r} has dimensions {dataset[name].dims}, not {dims}")
            values[name] = np.asarray(dataset[name].values, dtype=float)
        if len(values["times"]) != len(stream.impact_times_gyr):
            raise ValueError("geometry's 'times' are not those of its stream model")
        return cls(stream=stream, **values)


_DIMS: dict[str, tuple[str, ...]] = {
    "mean_omega": (),
    "sigma_omega": (),
    "t_disrupt": (),
    "mean_radius": (),
    "width": (),
    "times": ("time",),
    "node_theta": ("time", "node"),
    "node_xv": ("time", "node", "phase"),
    "node_jac": ("time", "node", "velocity"),
    **{f"track_{name}": ("track",) for name in ("theta", "ell", "b", "dist", "phi1", "phi2")},
}


def time_unit_gyr() -> float:
    """Length of one natural time unit in Gyr (0.035556)."""
    from galpy.util import conversion

    return float(conversion.time_in_Gyr(V0_KMS, R0_KPC))


def load_geometry(
    stream: StreamModel,
    cache: Cache | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Geometry:
    """The geometry of `stream`: from the cache, or computed and then cached.

    Parameters
    ----------
    stream : StreamModel
    cache : Cache, optional
        Where to look and to keep; the default cache when not given.
    workers : int, optional
        Processes when it must be computed; all cores when not given.
    progress : callable, optional
        Called with (times done, times in all).
    """
    from streamdash.store import Cache

    cache = cache if cache is not None else Cache.default()
    dataset = cache.open_geometry(stream)
    if dataset is not None:
        return Geometry.from_dataset(dataset, stream)
    start = time.perf_counter()
    geometry = compute_geometry(stream, workers=workers, progress=progress)
    cache.save_geometry(stream, geometry.to_dataset(), cost_s=time.perf_counter() - start)
    return geometry


def compute_geometry(
    stream: StreamModel,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Geometry:
    """Build the geometry of `stream` with galpy, impact times in parallel.

    Raises
    ------
    ValueError
        When galpy cannot build a stream from this model (for example an unbound
        progenitor), naming the model's fields to change.
    """
    n = len(stream.impact_times_gyr)
    jobs = (joblib.delayed(_impact_nodes)(stream, k) for k in range(n))
    parallel = joblib.Parallel(n_jobs=min(n, workers or joblib.cpu_count()), return_as="generator")
    try:
        smooth = _smooth_stream(stream)
        nodes = []
        for result in parallel(jobs):
            nodes.append(result)
            if progress is not None:
                progress(len(nodes), n)
    except (ValueError, RuntimeError, IndexError, FloatingPointError, np.linalg.LinAlgError) as error:
        raise ValueError(
            "galpy cannot build a stream from this model: check progenitor, potential, age_gyr "
            f"and sigma_v_kms ({error})"
        ) from error
    width = max(len(theta) for theta, _, _ in nodes)
    theta, xv, jac = (np.stack([_pad(item, width) for item in part]) for part in zip(*nodes, strict=True))
    return Geometry(
        stream=stream,
        times=np.array(stream.impact_times_gyr) / time_unit_gyr(),
        node_theta=theta,
        node_xv=xv,
        node_jac=jac,
        **smooth,
    )


def _pad(values: np.ndarray, length: int) -> np.ndarray:
    padding = [(0, length - len(values))] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, padding, constant_values=np.nan)


@lru_cache(maxsize=4)
def _galpy_arguments(stream: StreamModel) -> dict:
    """Keyword arguments that galpy's stream classes share, units natural."""
    from galpy.actionAngle import actionAngleIsochroneApprox
    from galpy.orbit import Orbit
    from galpy.potential import LogarithmicHaloPotential

    potential = LogarithmicHaloPotential(normalize=1.0, q=stream.potential.q)
    return {
        "progenitor": Orbit(list(stream.progenitor)),
        "pot": potential,
        "aA": actionAngleIsochroneApprox(pot=potential, b=stream.isochrone_b),
        "leading": stream.arm == "leading",
        "nTrackChunks": TRACK_CHUNKS,
        "tdisrupt": stream.age_gyr / time_unit_gyr(),
        "vo": V0_KMS,
        "ro": R0_KPC,
    }


def progenitor_radius(stream: StreamModel, times_gyr: np.ndarray) -> np.ndarray:
    """Distance of the progenitor from the Galactic centre (kpc) at times before today (Gyr, from 0 up)."""
    arguments = _galpy_arguments(stream)
    orbit, times = arguments["progenitor"](), -np.asarray(times_gyr) / time_unit_gyr()
    orbit.integrate(times, arguments["pot"])
    return R0_KPC * np.asarray(orbit.r(times, use_physical=False))


def galpy_stream(stream: StreamModel):
    """The smooth `galpy.df.streamdf` of `stream`."""
    from galpy.df import streamdf

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        smooth = streamdf(stream.dispersion_kms / V0_KMS, **_galpy_arguments(stream))
    smooth.turn_physical_off()
    return smooth


def galpy_gap(stream: StreamModel, time_gyr: float, **impact):
    """The `galpy.df.streamgapdf` of `stream` with one impact at `time_gyr`.

    With no further arguments only its geometry is set up; `impact` takes galpy's
    ``impact_angle, impactb, subhalovel, GM, rs, hernquist, nKickPoints`` (natural units).
    """
    from galpy.df import streamgapdf

    sign = 1.0 if stream.arm == "leading" else -1.0
    if not impact:
        impact = {"impact_angle": 0.1 * sign, "GM": 1e-6, "rs": 1e-2, "nokicksetup": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return streamgapdf(
            stream.dispersion_kms / V0_KMS,
            timpact=time_gyr / time_unit_gyr(),
            **impact,
            **_galpy_arguments(stream),
        )


def _smooth_stream(stream: StreamModel) -> dict:
    from galpy.util import coords

    smooth = galpy_stream(stream)
    ell, b, dist = smooth._interpolatedObsTrackLB[:, :3].T
    ra, dec = coords.lb_to_radec(ell, b, degree=True).T
    phi1, phi2 = coords.radec_to_custom(ra, dec, T=GD1_ROTATION, degree=True).T
    radec_phi1 = np.rad2deg(np.unwrap(np.deg2rad(phi1)))
    orbit = smooth._progenitor.orbit[0]
    middle = smooth._meandO * smooth._tdisrupt
    return {
        "mean_omega": float(smooth._meandO),
        "sigma_omega": float(np.sqrt(smooth._sortedSigOEig[2])),
        "t_disrupt": float(smooth._tdisrupt),
        "mean_radius": float(np.mean(np.hypot(orbit[:, 0], orbit[:, 3]))),
        "width": float(smooth.sigangledAngle(middle, simple=True, use_physical=False)),
        "track_theta": np.asarray(smooth._interpolatedThetasTrack),
        "track_ell": np.rad2deg(np.unwrap(np.deg2rad(ell))),
        "track_b": np.asarray(b),
        "track_dist": np.asarray(dist),
        # φ1 in (-180, 180] where the stream starts, as observers quote it.
        "track_phi1": radec_phi1 - 360.0 * np.round(radec_phi1[0] / 360.0),
        "track_phi2": np.asarray(phi2),
    }


def _impact_nodes(stream: StreamModel, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, phase-space track and frequency Jacobian at the nodes of impact time k."""
    gap = galpy_gap(stream, stream.impact_times_gyr[k])
    row = gap._sigMeanSign * np.einsum(
        "f,nfv->nv", gap._dsigomeanProgDirection, gap._gap_alljacsTrack[:, :3, :]
    )
    # Columns are R, vR, vT, z, vz, φ; only the velocities are kicked.
    return np.array(gap._gap_thetasTrack), np.array(gap._gap_ObsTrackXY), row[:, [1, 2, 4]]


def _blend_jacobians(
    theta: np.ndarray, points: np.ndarray, node_theta: np.ndarray, nodes: np.ndarray, jac: np.ndarray
) -> np.ndarray:
    """Jacobian rows at angles `theta` (n,) and `points` (n, 3): of the nodes on either side,
    weighted by distance.

    ``galpy.df.streamdf._approxaA`` weights the nearest node and the nearer of its neighbours
    likewise. Where nodes are unevenly spaced (in kpc) the latter is, for some way past a node,
    the one left behind, and L jumps by some 10⁻³; between the nodes on either side it does not.
    """
    below = np.clip(np.searchsorted(node_theta, theta, side="right") - 1, 0, len(node_theta) - 2)
    left = np.linalg.norm(points - nodes[below], axis=1)
    right = np.linalg.norm(points - nodes[below + 1], axis=1)
    weight = (left / (left + right))[:, None]
    return (1 - weight) * jac[below] + weight * jac[below + 1]
