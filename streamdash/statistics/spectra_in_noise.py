"""What spectra of several classes show at one level of shot noise, and the paper's two statements on it.

Appendix B: "detectable above shot noise over 1/k_l > 8 deg scales", and "clearly distinguishable at
the largest scales, over 1/k_l > 20 deg". Both are tested here in two ways: with the spectra as the
paper draws them, of streams without noise beside the level of the noise, and with the spectra that
would be observed, noise included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from streamdash.statistics.spectrum import KINDS, NoisySpectra, SpectrumBand

PAPER_DETECTED_DEG = 8.0
"""Both of the paper's classes are above shot noise on all scales larger than this (appendix B)."""
PAPER_APART_DEG = 20.0
"""The paper's classes are clearly told apart on all scales larger than this (appendix B)."""


@dataclass(frozen=True)
class Statement:
    """One statement, tested.

    Attributes
    ----------
    kind : "detected" (a class stands out of the noise) or "apart" (two classes do not overlap).
    classes : the class, or the two.
    limit : what the paper says: true on all scales larger than this (deg).
    clean_from, observed_from : smallest 1/k (deg) from which on it is true of all larger scales,
        for spectra without noise and for observed ones; NaN if not even of the largest.
    clean_true, observed_true : whether it is true of all scales larger than `limit`.
    """

    kind: Literal["detected", "apart"]
    classes: tuple[int, ...]
    limit: float
    clean_from: float
    clean_true: bool
    observed_from: float
    observed_true: bool


@dataclass(frozen=True)
class Shown:
    """Spectra of several classes at one level of noise.

    Attributes
    ----------
    sigma : shot noise σ_ε per bin.
    noise : √P of shot noise alone.
    clean : spectrum of Qρ of each class, without noise.
    bands : by kind (`KINDS`), the observed spectrum of each class.
    statements : the paper's statements, tested on these.
    """

    sigma: float
    noise: SpectrumBand
    clean: tuple[SpectrumBand, ...]
    bands: dict[str, tuple[SpectrumBand, ...]]
    statements: tuple[Statement, ...]


def show(spectra: Sequence[NoisySpectra], unit_noise: SpectrumBand, sigma: float) -> Shown:
    """Bands of all classes at a level of noise, and the statements tested on them.

    Parameters
    ----------
    spectra : one a class, lowest masses first.
    unit_noise : `streamdash.statistics.spectrum.shot_noise_level` for the same bins at σ_ε = 1.
    sigma : shot noise σ_ε per bin.
    """
    noise = SpectrumBand(
        unit_noise.scale,
        sigma * unit_noise.low,
        sigma * unit_noise.median,
        sigma * unit_noise.high,
        unit_noise.n_streams,
    )
    clean = tuple(s.clean_band for s in spectra)
    bands = {kind: tuple(s.band(kind, sigma) for s in spectra) for kind in KINDS}
    return Shown(sigma, noise, clean, bands, check_statements(clean, bands["density"], noise))


def check_statements(
    clean: Sequence[SpectrumBand], observed: Sequence[SpectrumBand], noise: SpectrumBand
) -> tuple[Statement, ...]:
    """The paper's statements for every class and every two classes.

    Without noise a class is detected where its median is above the noise's median, as in the
    paper's figure; as observed, where its median is above the band of the noise, which a spectrum
    of noise alone exceeds once in six times. Two classes are told apart where their bands do not
    overlap.
    """
    found = []
    for m in range(len(clean)):
        by_eye = clean[m].median > noise.median
        out_of_band = observed[m].median > noise.high
        found.append(_statement("detected", (m,), PAPER_DETECTED_DEG, noise.scale, by_eye, out_of_band))
    for i, j in combinations(range(len(clean)), 2):
        bands = [~overlap(group[i], group[j]) for group in (clean, observed)]
        found.append(_statement("apart", (i, j), PAPER_APART_DEG, noise.scale, *bands))
    return tuple(found)


def overlap(one: SpectrumBand, other: SpectrumBand) -> np.ndarray:
    """At which scales two bands overlap, (n_scale,) of bool."""
    return (one.low <= other.high) & (other.low <= one.high)


def from_scale(scale: np.ndarray, holds: np.ndarray) -> float:
    """Smallest 1/k from which on something holds at all larger scales; NaN if not at the largest.

    Parameters
    ----------
    scale : (n_scale,) decreasing array, 1/k in deg.
    holds : (n_scale,) of bool.
    """
    count = len(holds) if holds.all() else int(np.argmin(holds))
    return float(scale[count - 1]) if count else float("nan")


def _statement(
    kind: Literal["detected", "apart"],
    classes: tuple[int, ...],
    limit: float,
    scale: np.ndarray,
    clean: np.ndarray,
    observed: np.ndarray,
) -> Statement:
    large = scale > limit
    return Statement(
        kind,
        classes,
        limit,
        from_scale(scale, clean),
        bool(clean[large].all()),
        from_scale(scale, observed),
        bool(observed[large].all()),
    )
