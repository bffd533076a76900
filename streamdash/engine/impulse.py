"""The impulse approximation: how a subhalo's flyby changes the velocity of a star.

The star at x moving with v, passed by a subhalo of mass M and scale r_s moving with w at
impact parameter b of the stream point (x0, v0), is kicked by

    δv = -(2 G M / |w - v|) F(B) B,    B = (b b̂ + x - x0) without its part along w - v,

with b̂ = w × v0 / |w × v0| and F(B) = 1/(B² + r_s²) for a Plummer sphere, and
F = (1 - X(u)) / (B² - r_s²), u = B/r_s, for a Hernquist one (X from Hernquist 1990, eq. 33).
"""

from __future__ import annotations

import math

import numpy as np

from streamdash.compiled import njit
from streamdash.engine.galpy_streams import GRAVITY, R0_KPC, V0_KMS


def gravity() -> float:
    """G · 1 M☉ in natural units."""
    return 1.0 / (V0_KMS**2.0 * R0_KPC / GRAVITY * 10.0**3.0)


@njit(cache=True, error_model="numpy")
def hernquist_factor(u: float) -> float:
    """(1 - X(u)) / (u² - 1) of the Hernquist kick; regular (1/3) at u = 1.

    Examples
    --------
    >>> round(hernquist_factor(1.0), 6)
    0.333333
    """
    t = 1.0 - u * u
    if abs(t) < 0.05:
        return 1 / 3 + t * (1 / 5 + t * (1 / 7 + t * (1 / 9 + t * (1 / 11 + t * (1 / 13 + t / 15)))))
    if t > 0.0:
        return (math.log((1.0 + math.sqrt(t)) / u) / math.sqrt(t) - 1.0) / t
    return (math.acos(1.0 / u) / math.sqrt(-t) - 1.0) / t


@njit(cache=True, error_model="numpy")
def impulse(px, py, pz, vx, vy, vz, wx, wy, wz, gm, r_s, hernquist):
    """Kick of one star, as the vector B and the factor that makes it δv (module docstring).

    Parameters
    ----------
    px, py, pz, vx, vy, vz : float
        Star: offset from any point of the subhalo's path, and velocity.
    wx, wy, wz : float
        Velocity of the subhalo.
    gm, r_s : float
        G times mass, and scale radius.
    hernquist : bool
        Hernquist, else Plummer.

    Returns
    -------
    bx, by, bz, factor : float
        δv = factor · B.
    """
    rx, ry, rz = wx - vx, wy - vy, wz - vz
    speed2 = rx * rx + ry * ry + rz * rz
    along = (px * rx + py * ry + pz * rz) / speed2
    px, py, pz = px - along * rx, py - along * ry, pz - along * rz
    distance2 = px * px + py * py + pz * pz
    if hernquist:
        u = max(math.sqrt(distance2) / r_s, 1e-30)
        factor = hernquist_factor(u) / (r_s * r_s)
    else:
        factor = 1.0 / (distance2 + r_s * r_s)
    scale = -2.0 * gm * factor / math.sqrt(speed2)
    return px, py, pz, scale


@njit(cache=True, error_model="numpy")
def _along_stream(v, x, offset, w, x0, gm, r_s, hernquist):
    out = np.empty_like(v)
    for i in range(len(v)):
        px = offset[0] + x[i, 0] - x0[0]
        py = offset[1] + x[i, 1] - x0[1]
        pz = offset[2] + x[i, 2] - x0[2]
        bx, by, bz, scale = impulse(
            px, py, pz, v[i, 0], v[i, 1], v[i, 2], w[0], w[1], w[2], gm, r_s, hernquist
        )
        out[i, 0], out[i, 1], out[i, 2] = scale * bx, scale * by, scale * bz
    return out


def velocity_kick(v, x, b, w, x0, v0, gm, r_s, profile="hernquist") -> np.ndarray:
    """Velocity kicks along a curved stream, in any consistent units.

    The same quantity as ``galpy.df.streamgapdf.impulse_deltav_{hernquist,plummer}_curvedstream``,
    and finite also where galpy's Hernquist formula divides zero by zero (B = r_s).

    Parameters
    ----------
    v, x : (n, 3) arrays
        Velocities and positions along the stream.
    b : float
        Impact parameter; its sign chooses the side.
    w : (3,) array
        Velocity of the subhalo.
    x0, v0 : (3,) arrays
        Position and velocity of the stream at closest approach.
    gm, r_s : float
        G times mass, and scale radius.
    profile : {"hernquist", "plummer"}

    Returns
    -------
    (n, 3) array
    """
    normal = np.cross(w, v0)
    offset = b * normal / np.linalg.norm(normal)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (np.atleast_2d(v), np.atleast_2d(x), w, x0)]
    return _along_stream(arrays[0], arrays[1], offset, arrays[2], arrays[3], gm, r_s, profile == "hernquist")
