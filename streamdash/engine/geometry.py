"""The smooth stream and its geometry at each impact time, from galpy.

Natural units inside: lengths in `R0` = 8 kpc, velocities in `V0` = 220 km/s, so one unit
of time is 0.035556 Gyr and frequencies are radians per that time.

The expensive part, building a `galpy.df.streamgapdf` per impact time (seconds each), is
done once per `StreamModel`, in parallel, and kept in the cache as the few dozen numbers
per time that it comes down to: the phase-space track and the frequency Jacobian at the
nodes along the stream between which galpy interpolates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from scipy import interpolate, special

from streamdash.config import StreamModel
from streamdash.engine.galpy_streams import (
    R0_KPC,
    StreamError,
    check_progenitor,
    smooth_stream,
    stream_length,
    time_unit_gyr,
)
from streamdash.streams import SkyFrame, stream_of

TABLE_STEP = 1e-3
"""Spacing in rad of the tables in which the track is looked up; linear interpolation
between entries is then off by at most ~0.01 pc, far below the smallest subhalo."""


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
    track_theta, track_ell, track_b, track_dist, track_longitude, track_latitude : (n,) arrays
        Today's track: rad, deg, deg, kpc, and deg, deg in the stream's own frame
        (`streamdash.streams.SkyFrame`). Longitudes are unwrapped.
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
    track_longitude: np.ndarray
    track_latitude: np.ndarray

    @property
    def frame(self) -> SkyFrame:
        """The stream's own frame on the sky."""
        return stream_of(self.stream).frame

    @property
    def length(self) -> float:
        """Length today in rad: density down to 20 % of that near the progenitor."""
        return float(self.length_at(0.0))

    def length_at(self, time: np.ndarray | float) -> np.ndarray | float:
        """Length in rad at `time` before today (natural units), same definition.

        ρ̄(θ, T) depends on θ/T alone, so the length grows linearly with the time T since
        disruption began.
        """
        return stream_length(self.mean_omega, self.sigma_omega, self.t_disrupt - time)

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
        data = {_STORED.get(name, name): (dims, getattr(self, name)) for name, dims in _DIMS.items() if dims}
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
        values: dict[str, Any] = {}
        for name, dims in _DIMS.items():
            stored = _STORED.get(name, name)
            source = dataset.variables if dims else dataset.attrs
            if stored not in source:
                raise ValueError(f"geometry has no {stored!r}")
            if not dims:
                values[name] = float(dataset.attrs[name])
                continue
            if dataset[stored].dims != dims:
                raise ValueError(f"geometry's {stored!r} has dimensions {dataset[stored].dims}, not {dims}")
            values[name] = np.asarray(dataset[stored].values, dtype=float)
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
    **{f"track_{name}": ("track",) for name in ("theta", "ell", "b", "dist", "longitude", "latitude")},
}
_STORED = {"track_longitude": "track_phi1", "track_latitude": "track_phi2"}
"""Names in the cache, which are older than other streams, where they differ."""


def smooth_geometry(stream: StreamModel) -> Geometry:
    """The geometry of `stream` as far as no impact time enters, which takes galpy seconds: no tables.

    Raises
    ------
    ValueError
        When galpy cannot build a stream from this model.
    """
    try:
        check_progenitor(stream)
        smooth = smooth_stream(stream)
    except StreamError:
        raise
    except (ValueError, RuntimeError, IndexError, FloatingPointError, np.linalg.LinAlgError) as error:
        raise unbuildable(error) from error
    times = np.array(stream.impact_times_gyr) / time_unit_gyr()
    none = np.empty((len(times), 0))
    return Geometry(
        stream=stream,
        times=times,
        node_theta=none,
        node_xv=none.reshape(len(times), 0, 6),
        node_jac=none.reshape(len(times), 0, 3),
        **smooth,
    )


def unbuildable(error: Exception) -> ValueError:
    """One sentence for whatever galpy raised: which fields of the model to change."""
    return ValueError(
        "galpy cannot build a stream from this model: check progenitor, potential, age_gyr "
        f"and sigma_v_kms ({error})"
    )


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
