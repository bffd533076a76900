"""How many subhalos of which mass there are, and how large they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import integrate

from streamdash.config import Perturbers

SCALE_RADIUS_KPC = {"hernquist": 1.05, "plummer": 1.62}
"""Scale radius of a subhalo of 10⁸ M☉; it grows as M^½."""
PIVOT_MASS = 10**6.5
"""Mass in M☉ where mass functions of any slope agree: Via Lactea II counts 0.3 subhalos
per (8 kpc)³ in the decade around it."""
PIVOT_COUNT = 0.3
WDM_SCALE, WDM_POWER = 2.7, -0.99
"""Warm dark matter's mass function, relative to cold dark matter's (Banik et al. 2021)."""


def scale_radius(mass: Any, perturbers: Perturbers) -> Any:
    """Scale radius r_s(M) in kpc: 1.05 kpc (Hernquist) or 1.62 kpc (Plummer) · (M/10⁸)^½.

    Examples
    --------
    >>> float(scale_radius(1e8, Perturbers()))
    1.05
    """
    return SCALE_RADIUS_KPC[perturbers.profile] * perturbers.rs_factor * (mass / 1e8) ** 0.5


def mass_decades(mass_range: tuple[float, float]) -> list[tuple[float, float]]:
    """Cut a mass range into decades from its lower end; the last may be partial.

    Examples
    --------
    >>> mass_decades((1e5, 5e6))
    [(100000.0, 1000000.0), (1000000.0, 5000000.0)]
    """
    low, high = mass_range
    edges = [low]
    while edges[-1] * 10 < high * (1 - 1e-12):
        edges.append(edges[-1] * 10)
    return list(zip(edges, [*edges[1:], high], strict=True))


def subhalo_count(low: float, high: float, slope: float) -> float:
    """Subhalos per (8 kpc)³ with low < M < high (M☉).

    For slope -2 this is 0.3 · 10^6.5 · (1/low - 1/high) / (√10 - 1/√10); other slopes
    agree with it at `PIVOT_MASS`.
    """
    amplitude = PIVOT_COUNT / (10**0.5 - 10**-0.5)  # dn/d(M/pivot) at the pivot
    a, b = low / PIVOT_MASS, high / PIVOT_MASS
    if abs(slope + 1) < 1e-9:
        return amplitude * np.log(b / a)
    return amplitude * (b ** (slope + 1) - a ** (slope + 1)) / (slope + 1)


def suppression(mass: Any, perturbers: Perturbers) -> Any:
    """Share of subhalos of each mass (M☉) that a cutoff mass and warm dark matter leave of the power law.

    exp(-cutoff_mass / M) · (1 + 2.7 half_mode_mass / M)^-0.99 (Banik et al. 2021).
    """
    left = np.ones_like(mass)
    if perturbers.cutoff_mass is not None:
        left = left * np.exp(-perturbers.cutoff_mass / mass)
    if perturbers.half_mode_mass is not None:
        left = left * (1.0 + WDM_SCALE * perturbers.half_mode_mass / mass) ** WDM_POWER
    return left


def _is_suppressed(perturbers: Perturbers) -> bool:
    return perturbers.cutoff_mass is not None or perturbers.half_mode_mass is not None


def suppressed_fraction(perturbers: Perturbers) -> float:
    """Share of impacts that `suppression` leaves."""
    if not _is_suppressed(perturbers):
        return 1.0
    log_mass, weight = _mass_weights(perturbers)
    plain = np.exp((perturbers.slope + 1.5) * (log_mass - log_mass[0]))
    return float(integrate.trapezoid(weight, log_mass) / integrate.trapezoid(plain, log_mass))


def _mass_weights(perturbers: Perturbers) -> tuple[np.ndarray, np.ndarray]:
    """p(ln M) ∝ M · M^slope · r_s(M) · `suppression` on a grid of ln M, unnormalised."""
    low, high = perturbers.mass_range
    log_mass = np.linspace(math.log(low), math.log(high), 4097)
    weight = np.exp((perturbers.slope + 1.5) * (log_mass - log_mass[0]))
    if _is_suppressed(perturbers):
        weight = weight * suppression(np.exp(log_mass), perturbers)
    return log_mass, weight


def sample_masses(perturbers: Perturbers, u: np.ndarray) -> np.ndarray:
    """Masses in M☉ for uniform numbers `u` (n,): p(M) ∝ M^slope · r_s(M) · `suppression`."""
    low, high = perturbers.mass_range
    power = perturbers.slope + 1.5
    if not _is_suppressed(perturbers):
        if abs(power) < 1e-9:
            return low * (high / low) ** u
        return (low**power + (high**power - low**power) * u) ** (1 / power)
    log_mass, weight = _mass_weights(perturbers)
    cumulative = integrate.cumulative_trapezoid(weight, log_mass, initial=0.0)
    return np.exp(np.interp(u * cumulative[-1], cumulative, log_mass))
