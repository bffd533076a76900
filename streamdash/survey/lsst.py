"""How much smaller errors get with the Rubin Observatory's survey (LSST): more stars of the same stream.

A bin's relative error goes as one over the root of its number of stars, and that number grows with the
depth to which stars of an old, metal-poor main sequence are seen and told from galaxies. Stars of the
background, which deeper pictures have more of too, are not counted: these are the best that can be hoped for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

DEPTH = 27.5
"""Magnitude r of a point source detected at 5 σ after ten years (LSST Science Book, arXiv:0912.0201)."""
TOLD_APART = 1.75
"""Stars are told from galaxies, and have colours, down to so many magnitudes above that (25 σ)."""
TODAY: Mapping[str, float] = {"gd1-like": 21.0, "gd1": 21.0, "pal5": 23.5}
"""Depth in r of the star counts that measured profiles were made from: Gaia and SDSS; CFHT for Palomar 5."""
DISTANCE_KPC: Mapping[str, float] = {"gd1-like": 8.0, "gd1": 8.0, "pal5": 23.2}
MASSES = np.array([0.10, 0.15, 0.20, 0.30, 0.40, 0.50, 0.60, 0.70, 0.75, 0.80])
MAGNITUDES = np.array([12.3, 10.9, 10.2, 9.2, 8.3, 7.2, 6.1, 5.0, 4.3, 3.6])
"""Absolute magnitude r of stars of `MASSES` (M☉) on a main sequence of 12 Gyr, [Fe/H] = -2, to 0.2 mag."""
YEARS = (1, 10)


def noise_factor(stream: str, years: float) -> float:
    """Error of a bin after some years of LSST, relative to that of the star counts there are today.

    Examples
    --------
    >>> noise_factor("gd1-like", 1) > noise_factor("gd1-like", 10) > 0.2
    True
    """
    depth = DEPTH + 2.5 * math.log10(math.sqrt(years / 10)) - TOLD_APART
    modulus = 5 * math.log10(100 * DISTANCE_KPC[stream])
    return math.sqrt(_stars(TODAY[stream] - modulus) / _stars(depth - modulus))


def _stars(magnitude: float) -> float:
    """Number of stars (any unit) up to the turn-off that are brighter, with Kroupa's masses (2001)."""
    faintest = float(np.interp(magnitude, MAGNITUDES[::-1], MASSES[::-1]))
    m = np.linspace(faintest, MASSES[-1], 400)
    # ∝ m^-1.3 below half a solar mass, m^-2.3 above.
    number = m**-1.3 * np.minimum(1.0, 0.5 / m)
    return float(np.trapezoid(number, m))
