"""Today's density and mean frequency of a stream that subhalos have kicked.

The line-of-parallel-angle model (BES17 §2.1, §2.4), solved exactly by tracing the points
(θ, Ω) of phase space back in time: phase-space density is conserved along a path, so

    ρ(θ) = ∫ dΩ p(θ, Ω),     ⟨Ω⟩(θ) = ∫ dΩ Ω p(θ, Ω) / ρ(θ),

with p the Gaussian of the path's original frequency where the path reaches the
progenitor (θ = 0) after disruption began, and zero where it does not.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from streamdash.config import Accuracy
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import Impacts, check_impacts
from streamdash.engine.kicks import KickTables, kick_tables
from streamdash.engine.march import integrate_lines


def perturbed_stream(
    geometry: Geometry,
    impacts: Impacts,
    theta: np.ndarray,
    accuracy: Accuracy | None = None,
) -> xr.Dataset:
    """One stream today, after the given impacts.

    Parameters
    ----------
    geometry : Geometry
    impacts : Impacts
    theta : (n,) array
        Parallel angles from the progenitor (rad), positive.
    accuracy : Accuracy, optional

    Returns
    -------
    xarray.Dataset
        Over ``theta``: ``density`` and ``smooth`` (1 near the progenitor), ``q_rho`` their
        ratio, ``omega`` and ``omega_smooth`` (mean parallel frequency offset, natural
        units of 1/0.035556 Gyr; ``omega`` is NaN where no star is left).

    Raises
    ------
    ImpactsError
        When an impact is not one on this stream; names row and column.
    ValueError
        When `theta` is not a one-dimensional array of positive finite angles.
    """
    theta = np.asarray(theta, dtype=float)
    if theta.ndim != 1 or not np.isfinite(theta).all() or (theta <= 0).any():
        raise ValueError("theta must be a one-dimensional array of positive angles in rad")
    check_impacts(impacts, geometry)
    density, omega = stream_profile(geometry, impacts, theta, accuracy)
    smooth, omega_smooth = geometry.smooth_density(theta), geometry.smooth_omega(theta)
    columns = {
        "density": density,
        "smooth": smooth,
        "q_rho": density / smooth,
        "omega": omega,
        "omega_smooth": omega_smooth,
    }
    return xr.Dataset({name: ("theta", values) for name, values in columns.items()}, {"theta": theta})


def stream_profile(
    geometry: Geometry,
    impacts: Impacts,
    theta: np.ndarray,
    accuracy: Accuracy | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Density and mean frequency at `theta`, unchecked: the inner call of ensembles.

    Parameters and units as in `perturbed_stream`; two (n,) arrays.
    """
    if not len(impacts):
        return geometry.smooth_density(theta), geometry.smooth_omega(theta)
    accuracy = accuracy or Accuracy()
    kicks = kick_tables(geometry, impacts, accuracy)
    return trace_back(geometry, kicks, theta, accuracy)


def trace_back(
    geometry: Geometry, kicks: KickTables, theta: np.ndarray, accuracy: Accuracy, time: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Density and mean frequency at `theta` for given kicks; two (n,) arrays.

    Parameters
    ----------
    theta : (n,) array
        Parallel angles of the stream as it was then, rad.
    time : float, optional
        Look at the stream as it was this long before today (natural units); the kicks must
        be those of earlier impacts only, see `KickTables.before`.
    """
    density, omega = np.empty(len(theta)), np.empty(len(theta))
    # From then to each impact time, and on from the oldest to the start of disruption.
    steps = np.diff(kicks.times, prepend=time, append=geometry.t_disrupt)
    tables = (kicks.start, kicks.size, 1.0 / kicks.step, kicks.values)
    bends = (kicks.bend_start, kicks.bend_size, 1.0 / kicks.bend_step, kicks.bends)
    integrate_lines(
        np.ascontiguousarray(theta, dtype=float),
        geometry.mean_omega,
        geometry.sigma_omega,
        accuracy.frequency_step,
        accuracy.frequency_tolerance,
        kicks.largest(),
        steps,
        tables,
        bends,
        density,
        omega,
    )
    return density, omega
