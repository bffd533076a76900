"""galpy's actions, frequencies and angles by the isochrone approximation, compiled.

`galpy.actionAngle.actionAngleIsochroneApprox` (Bovy 2014) integrates an orbit, computes the actions and
angles that an isochrone potential would give along it, and fits them. Nearly all the time that galpy
spends on a stream is spent there: each node of a track takes seven, one for itself and one for the
derivative in each direction of phase space. `CompiledIsochroneApprox` is used by galpy in its place.
It differs in three ways:

- the same formulas are evaluated and fitted in one compiled pass over an orbit, which is taken as it was
  integrated, where galpy interpolates it first;
- orbits are integrated by a method of higher order, all that a derivative needs in one call;
- derivatives are central differences over 10⁻⁵. galpy's are one-sided over 10⁻⁸, which magnifies the
  rounding and the steps of the integrator to 10⁻⁶ and more of a frequency's derivative; by so much do its
  results differ between processors, and these from them, while these repeat to some 10⁻⁷.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from galpy.actionAngle import actionAngleIsochroneApprox
from galpy.orbit import Orbit

from streamdash.compiled import njit

INTEGRATOR = "dop853_c"
"""A quarter of the time of galpy's default here."""
STEP = 1e-5
"""Half the interval of the central differences (natural units and rad)."""
NEAR = 1e-7
"""Points as near as this to the last one that was evaluated are answered to first order; galpy takes its
differences over a tenth of that."""
MAX_N = 3
"""Orders of the Fourier terms that are fitted: galpy's default."""
N_TERMS = 14
TWO_PI = 2 * math.pi


class CompiledIsochroneApprox(actionAngleIsochroneApprox):  # type: ignore[misc]
    """`galpy.actionAngle.actionAngleIsochroneApprox` for axisymmetric potentials, several times as fast.

    What it is called with by galpy's streams is computed here; anything else is left to galpy.
    """

    tolerance: float | None = None
    """Relative and absolute error of the integration; galpy's 10⁻¹² when None."""
    one_sided: bool = False
    """Whether derivatives are taken on one side only: half the orbits, and off by some 10⁻⁴."""
    _last: tuple[np.ndarray, np.ndarray] | None = None
    _slopes: np.ndarray | None = None

    def _actionsFreqsAngles(self, *args: Any, **kwargs: Any) -> tuple[np.ndarray, ...]:
        asked = set(kwargs) - {"_firstFlip", "use_physical"}
        point = _point(args)
        if point is None or asked - {"maxn"} or kwargs.get("maxn", MAX_N) != MAX_N or self._maxn != MAX_N:
            return super()._actionsFreqsAngles(*args, **kwargs)
        if "_firstFlip" in kwargs:  # galpy counts on the orbit being integrated afterwards
            self._integrate(args[0], kwargs["_firstFlip"])
        return tuple(self._values(point)[:, None])

    def _integrate(self, orbit: Orbit, backwards: bool) -> None:
        """Integrate as galpy does: forwards, or backwards with the velocities as they are."""
        if backwards:
            orbit.vxvv[..., [1, 2, 4]] *= -1
        orbit.integrate(self._tsJ, pot=self._pot, method=self._integrate_method, dt=self._integrate_dt)
        if backwards:
            orbit.vxvv[..., [1, 2, 4]] *= -1
            orbit.orbit[..., [1, 2, 4]] *= -1

    def _values(self, point: np.ndarray) -> np.ndarray:
        """Three actions, three frequencies and three angles (9,) of a point."""
        if self._last is None or np.abs(point - self._last[0]).max() > NEAR:
            self._last, self._slopes = (point, self.evaluate(point[None])[0]), None
        away = point - self._last[0]
        if not away.any():
            return self._last[1]
        if self._slopes is None:
            self._slopes = self.derivatives(*self._last)
        return self._last[1] + self._slopes @ away

    def derivatives(self, point: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """Derivatives (9, 6) of actions, frequencies and angles with respect to R, vR, vT, z, vz, φ.

        `values` are those of the point (9,), which save an orbit where they are `one_sided`.
        """
        steps = STEP * np.eye(6)[:5]
        if self.one_sided:
            before = self.evaluate(point[None])[0] if values is None else values
            rise, interval = self.evaluate(point + steps) - before, STEP
        else:
            both = self.evaluate(np.concatenate([point + steps, point - steps]))
            rise, interval = both[:5] - both[5:], 2 * STEP
        rise[:, 6:] = (rise[:, 6:] + math.pi) % TWO_PI - math.pi
        slopes = np.zeros((9, 6))
        slopes[:, :5] = rise.T / interval
        slopes[7, 5] = 1.0  # around the axis everything turns together
        return slopes

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Three actions, three frequencies and three angles of each point.

        Parameters
        ----------
        points : (n, 6) array
            R, vR, vT, z, vz, φ in natural units.

        Returns
        -------
        (n, 9) array
        """
        orbits = Orbit(np.concatenate([points, points * (1, -1, -1, 1, -1, 1)]))
        orbits.integrate(
            self._tsJ,
            self._pot,
            method=INTEGRATOR,
            progressbar=False,
            rtol=self.tolerance,
            atol=self.tolerance,
        )
        isochrone, n = self._aAI, len(points)
        found = np.empty((n, 9))
        for i, point in enumerate(points):
            radial, terms, along, phi_falls = _along(
                orbits.orbit[i], orbits.orbit[n + i], self._tsJ, isochrone.amp, isochrone.b
            )
            angles, frequencies = np.linalg.solve(terms.T @ terms, terms.T @ along)[:2]
            if phi_falls:
                angles[1], frequencies[1] = -angles[1], -frequencies[1]
            found[i] = (radial[0], point[0] * point[2], radial[1], *frequencies, *(angles % TWO_PI))
        return found


def _point(args: tuple[Any, ...]) -> np.ndarray | None:
    """The one phase-space point that is asked for, or None."""
    if len(args) == 6 and all(np.ndim(value) == 0 for value in args):
        return np.array(args, dtype=float)
    if len(args) == 1 and isinstance(args[0], Orbit) and not hasattr(args[0], "orbit"):
        point = np.asarray(args[0].vxvv, dtype=float)
        return point[0].copy() if point.shape == (1, 6) else None
    return None


@njit(cache=True)
def _isochrone(state: np.ndarray, amp: float, b: float) -> tuple[float, float, float, float, float]:
    """Radial and vertical action and the angles r, φ, z of a point in an isochrone potential.

    Same formulas as ``galpy.actionAngle.actionAngleIsochrone`` (Binney & Tremaine 2008, §3.5.2).
    """
    R, vR, vT, z, vz, phi = state[0], state[1], state[2], state[3], state[4], state[5]
    r2 = R * R + z * z
    r = math.sqrt(r2)
    root = math.sqrt(b * b + r2)
    energy = -amp / (b + root) + 0.5 * (vR * vR + vT * vT + vz * vz)
    lz = R * vT
    lx, ly = -z * vT, z * vR - R * vz
    l2 = lx * lx + ly * ly + lz * lz
    length = math.sqrt(l2)
    spread = math.sqrt(l2 + 4 * amp * b)
    jr = amp / math.sqrt(-2 * energy) - 0.5 * (length + spread)
    jz = length - abs(lz)
    ratio = 0.5 * (1 + length / spread)  # of the vertical to the radial frequency
    c = -amp / (2 * energy) - b
    e = math.sqrt(max(1 - l2 / amp / c * (1 + b / c), 0.0))
    cos_eta = (1 - b / c * (root / b - 1)) / e if e > 0 else 1.0
    eta = math.acos(min(max(cos_eta, -1.0), 1.0))
    cos_theta, sin_theta = z / r, R / r
    if vR * sin_theta + vz * cos_theta < 0:
        eta = TWO_PI - eta
    angle_r = eta - e * c / (c + b) * math.sin(eta)
    half = math.tan(0.5 * eta)
    tan11 = math.atan(math.sqrt((1 + e) / (1 - e)) * half)
    tan12 = math.atan(math.sqrt((1 + e + 2 * b / c) / (1 - e + 2 * b / c)) * half)
    if tan11 < 0:
        tan11 += math.pi
    if tan12 < 0:
        tan12 += math.pi
    falling = vR * cos_theta - vz * sin_theta > 0
    across = math.sqrt(max(l2 - lz * lz, 0.0))
    if across > 0:
        psi = math.asin(min(max(cos_theta * length / across, -1.0), 1.0))
        u = math.asin(min(max(z / R * lz / across, -1.0), 1.0))
        if falling:
            psi, u = math.pi - psi, math.pi - u
    else:  # an orbit in the plane has no node: galpy's convention
        psi, u = phi, phi
    angle_z = psi % TWO_PI + ratio * angle_r - tan11 - length / spread * tan12
    angle_phi = phi - u + (angle_z if lz >= 0 else -angle_z)
    return jr, jz, angle_r % TWO_PI, angle_phi % TWO_PI, angle_z % TWO_PI


@njit(cache=True)
def _along(
    forth: np.ndarray, back: np.ndarray, times: np.ndarray, amp: float, b: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Mean actions along an orbit, its angles, and the terms that are fitted to them.

    Parameters
    ----------
    forth, back : (n, 6) arrays
        R, vR, vT, z, vz, φ from now on, and with time and velocities reversed.
    times : (n,) array

    Returns
    -------
    (2,) mean radial and vertical action, (2n - 1, N_TERMS) terms of the fit, (2n - 1, 3) angles r, φ, z
    that it is made to, and whether φ falls with time.
    """
    n = len(times)
    size = 2 * n - 1
    angles = np.empty((size, 3))
    actions = np.empty((size, 2))
    state = np.empty(6)
    for i in range(size):
        for k in range(6):  # loops: whole rows take numba a second to compile
            state[k] = back[n - 1 - i, k] if i < n - 1 else forth[i - n + 1, k]
        if i < n - 1:
            state[1], state[2], state[4] = -state[1], -state[2], -state[4]
        actions[i, 0], actions[i, 1], angles[i, 0], angles[i, 1], angles[i, 2] = _isochrone(state, amp, b)
    falls = 0
    mean, weight = np.zeros(2), np.zeros(2)
    for i in range(1, size):
        falls += 1 if angles[i, 1] < angles[i - 1, 1] else -1
        for k in range(2):
            step = (angles[i, 2 * k] - angles[i - 1, 2 * k]) % TWO_PI
            mean[k] += actions[i - 1, k] * step
            weight[k] += step
    terms = np.empty((size, N_TERMS))
    turns = np.zeros(3)
    for i in range(size):
        if falls > 0:
            angles[i, 1] = TWO_PI - angles[i, 1]
        for k in range(3):
            if i > 0 and angles[i, k] + turns[k] - angles[i - 1, k] < -6.0:
                turns[k] += TWO_PI
            angles[i, k] += turns[k]
        terms[i, 0] = 1.0
        terms[i, 1] = times[i - n + 1] if i >= n - 1 else -times[n - 1 - i]
        s1, c1 = math.sin(angles[i, 0]), math.cos(angles[i, 0])
        t1, d1 = math.sin(angles[i, 2]), math.cos(angles[i, 2])
        s2, c2, t2, d2 = 2 * s1 * c1, 1 - 2 * s1 * s1, 2 * t1 * d1, 1 - 2 * t1 * t1
        terms[i, 2], terms[i, 3], terms[i, 4], terms[i, 5] = t1, t2, s1, s2
        terms[i, 6], terms[i, 7] = s1 * d1 + c1 * t1, s1 * d1 - c1 * t1
        terms[i, 8], terms[i, 9] = s1 * d2 + c1 * t2, s1 * d2 - c1 * t2
        terms[i, 10], terms[i, 11] = s2 * d1 + c2 * t1, s2 * d1 - c2 * t1
        terms[i, 12], terms[i, 13] = s2 * d2 + c2 * t2, s2 * d2 - c2 * t2
    for k in range(2):
        mean[k] /= weight[k]
    return mean, terms, angles, falls > 0
