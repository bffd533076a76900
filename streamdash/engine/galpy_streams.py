"""Streams as galpy builds them: the smooth stream, and its track and Jacobian at an impact time.

Natural units: lengths in `R0_KPC`, velocities in `V0_KMS`.
"""

from __future__ import annotations

import time
import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from streamdash.stream_model import EquatorialProgenitor, LogarithmicHalo, SkyPlace, StreamModel
from streamdash.streams import stream_of

R0_KPC = 8.0
V0_KMS = 220.0
KMS_IN_PC_MYR = 1.0227121655399913
GRAVITY = 4.302 * 10.0**-3.0
"""km/s in pc/Myr, and G in pc (km/s)² / M☉, as galpy has them where astropy is not installed. With astropy
it takes others (G lower by 2.5·10⁻⁴), and streams would depend on what else a machine has."""
TRACK_CHUNKS = 11
"""Nodes of today's track (galpy's ``nTrackChunks``), as in Bovy, Erkal & Sanders (2017)."""


RADIUS_MIN_KPC, RADIUS_MAX_KPC = 0.4, 300.0
"""An orbit that comes nearer to the centre or goes farther from it carries no thin stream."""
LENGTH_THRESHOLD = 0.2
"""The stream ends where its density is this fraction of that near the progenitor."""
LENGTH_MIN = 0.05
"""Shortest stream that is one (rad)."""
COARSE_POINTS, COARSE_TOLERANCE = 1500, 1e-10
"""A coarse geometry integrates orbits over fewer points than galpy's 10⁴, less exactly, and only half as many
of them: derivatives are one-sided. It takes a quarter of the time, and frequencies and tracks are off by up
to a permille. With 10⁻⁸ tracks were off by degrees, with 10⁻⁹ derivatives by 4·10⁻³."""


class StreamError(ValueError):
    """A model that is no stream; the message says why in one sentence, and what to change."""


class Nodes(NamedTuple):
    """galpy's track nodes at one impact time: angle (n,), phase space (n, 6), ∂Ω∥/∂v (n, 3)."""

    theta: np.ndarray
    xv: np.ndarray
    jac: np.ndarray


def time_unit_gyr() -> float:
    """Length of one natural time unit in Gyr (0.035556)."""
    return R0_KPC / V0_KMS / KMS_IN_PC_MYR


def _galpy_arguments(stream: StreamModel, compiled: bool, coarse: bool = False) -> dict[str, Any]:
    """Keyword arguments that galpy's stream classes share, units natural."""
    from galpy.actionAngle import actionAngleIsochroneApprox

    from streamdash.engine.action_angles import CompiledIsochroneApprox

    potential = galpy_potential(stream)
    if compiled:
        options = {"ntintJ": COARSE_POINTS} if coarse else {}
        approximation = CompiledIsochroneApprox(pot=potential, b=stream.isochrone_b, **options)
        approximation.tolerance = COARSE_TOLERANCE if coarse else None
        approximation.one_sided = coarse
    else:
        approximation = actionAngleIsochroneApprox(pot=potential, b=stream.isochrone_b)
    return {
        **_progenitor_and_sun(stream),
        "pot": potential,
        "aA": approximation,
        "leading": stream.arm == "leading",
        "nTrackChunks": TRACK_CHUNKS,
        "tdisrupt": stream.age_gyr / time_unit_gyr(),
        "vo": V0_KMS,
        "ro": R0_KPC,
    }


def galpy_potential(stream: StreamModel) -> Any:
    """The galpy potential of `stream`, or galpy's list of them, circular velocity 1 at radius 1."""
    from galpy import potential

    if isinstance(stream.potential, LogarithmicHalo):
        return potential.LogarithmicHaloPotential(normalize=1.0, q=stream.potential.q)
    return potential.MWPotential2014


def _progenitor_and_sun(stream: StreamModel) -> dict[str, Any]:
    """The progenitor as an orbit in natural units, and, where it was seen from it, the Sun."""
    from galpy.orbit import Orbit

    given = stream.progenitor
    if not isinstance(given, SkyPlace):
        return {"progenitor": Orbit(list(given))}
    equatorial = isinstance(given, EquatorialProgenitor)
    seen = Orbit(
        [*given.place, given.distance_kpc, *given.proper_motion, given.v_los_kms],
        radec=equatorial,
        lb=not equatorial,
        ro=given.r0_kpc,
        vo=given.v0_kms,
        zo=given.z_sun_kpc,
        solarmotion=list(given.solar_motion_kms),
    )
    length, speed = given.r0_kpc / R0_KPC, given.v0_kms / V0_KMS
    units = np.array([length, speed, speed, length, speed, 1.0])
    u, v, w = given.solar_motion_kms
    return {
        "progenitor": Orbit(list(units * seen.vxvv[0])),
        "R0": given.r0_kpc,
        "Zsun": given.z_sun_kpc,
        "vsun": np.array([u, v + given.v0_kms, w]),
    }


def progenitor_orbit(stream: StreamModel) -> Any:
    """The progenitor today as a `galpy.orbit.Orbit` in natural units, not integrated."""
    return _progenitor_and_sun(stream)["progenitor"]


def progenitor_radius(stream: StreamModel, times_gyr: np.ndarray) -> np.ndarray:
    """Distance of the progenitor from the Galactic centre (kpc) at times before today (Gyr, from 0 up)."""
    orbit, times = progenitor_orbit(stream), -np.asarray(times_gyr) / time_unit_gyr()
    orbit.integrate(times, galpy_potential(stream))
    return R0_KPC * np.asarray(orbit.r(times, use_physical=False))


def check_progenitor(stream: StreamModel) -> None:
    """Refuse a progenitor whose orbit leaves no stream behind.

    Raises
    ------
    StreamError
        When it is unbound, plunges into the centre, or is younger than one radial period.
    """
    from galpy.potential import evaluatePotentials

    orbit, potential = progenitor_orbit(stream), galpy_potential(stream)
    times = np.linspace(0.0, -stream.age_gyr / time_unit_gyr(), 2001)
    orbit.integrate(times, potential, method="dop853_c")
    radius = R0_KPC * np.asarray(orbit.r(times))
    speed = np.sqrt(orbit.vR() ** 2 + orbit.vT() ** 2 + orbit.vz() ** 2)
    # A logarithmic potential has no escape speed, and is zero somewhere.
    free = not isinstance(stream.potential, LogarithmicHalo) and (
        0.5 * speed**2 + evaluatePotentials(potential, orbit.R(), orbit.z()) >= 0
    )
    if free or not radius.max() < RADIUS_MAX_KPC:
        raise StreamError(
            f"progenitor: it is not bound to the Galaxy (it reaches {radius.max():.0f} kpc within its "
            f"{stream.age_gyr:g} Gyr, at {V0_KMS * speed:.0f} km/s today); give it less speed."
        )
    if radius.min() < RADIUS_MIN_KPC:
        raise StreamError(
            f"progenitor: it plunges to {radius.min():.2f} kpc from the centre, where a stream is torn "
            f"apart; its orbit must stay beyond {RADIUS_MIN_KPC:g} kpc."
        )
    turns = np.count_nonzero(np.diff(np.sign(np.diff(radius))))
    if turns < 2:
        raise StreamError(
            f"age_gyr: in {stream.age_gyr:g} Gyr the progenitor does not even oscillate once in radius, "
            "so it has shed no stream; make it older."
        )


def galpy_stream(stream: StreamModel, compiled: bool = False, coarse: bool = False) -> Any:
    """The smooth `galpy.df.streamdf` of `stream`.

    Parameters
    ----------
    compiled : whether galpy uses `streamdash.engine.action_angles` instead of its own; so does `galpy_gap`.
    coarse : whether those are computed to a permille only, in a quarter of the time; for previews.
    """
    from galpy.df import streamdf

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        smooth = streamdf(stream.dispersion_kms / V0_KMS, **_galpy_arguments(stream, compiled, coarse))
    smooth.turn_physical_off()
    return smooth


def galpy_gap(
    stream: StreamModel, time_gyr: float, compiled: bool = False, coarse: bool = False, **impact: Any
) -> Any:
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
            **_galpy_arguments(stream, compiled, coarse),
        )


def stream_length(mean_omega: float, sigma_omega: float, age: Any) -> Any:
    """Length in rad of a stream of this age: density down to `LENGTH_THRESHOLD` of that at its start."""
    return age * (mean_omega - sigma_omega * special.ndtri(LENGTH_THRESHOLD))


def smooth_stream(stream: StreamModel, coarse: bool = False) -> dict[str, Any]:
    """The attributes of `streamdash.engine.geometry.Geometry` that no impact time enters, by name."""
    from galpy.util import coords

    smooth = galpy_stream(stream, compiled=True, coarse=coarse)
    ell, b, dist = smooth._interpolatedObsTrackLB[:, :3].T
    ra, dec = coords.lb_to_radec(ell, b, degree=True).T
    rotation = np.array(stream_of(stream).frame.rotation)
    longitude, latitude = coords.radec_to_custom(ra, dec, T=rotation, degree=True).T
    longitude = np.rad2deg(np.unwrap(np.deg2rad(longitude)))
    length = stream_length(smooth._meandO, np.sqrt(smooth._sortedSigOEig[2]), smooth._tdisrupt)
    if length < LENGTH_MIN:
        raise StreamError(
            f"sigma_v_kms: with {stream.dispersion_kms:g} km/s the stream is only {length:.2g} rad long "
            f"after {stream.age_gyr:g} Gyr; make the dispersion larger or the stream older."
        )
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
        # In (-180, 180] where the stream starts, as observers quote it.
        "track_longitude": longitude - 360.0 * np.round(longitude[0] / 360.0),
        "track_latitude": np.asarray(latitude),
    }


def timed_part(stream: StreamModel, k: int | None, coarse: bool = False) -> tuple[int | None, Any, float]:
    """Impact time k and its nodes, or None and the smooth stream; and the core seconds that took."""
    start = time.process_time()
    check_progenitor(stream)
    part = smooth_stream(stream, coarse) if k is None else impact_nodes(stream, k, coarse)
    return k, part, time.process_time() - start


def impact_nodes(stream: StreamModel, k: int, coarse: bool = False) -> Nodes:
    """The nodes of impact time k."""
    gap = galpy_gap(stream, stream.impact_times_gyr[k], compiled=True, coarse=coarse)
    row = gap._sigMeanSign * np.einsum(
        "f,nfv->nv", gap._dsigomeanProgDirection, gap._gap_alljacsTrack[:, :3, :]
    )
    # Columns are R, vR, vT, z, vz, φ; only the velocities are kicked.
    return Nodes(np.array(gap._gap_thetasTrack), np.array(gap._gap_ObsTrackXY), row[:, [1, 2, 4]])
