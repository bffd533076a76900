"""Do the spectra agree? Shifts between the settings of a knob, per decade of scale.

The shift of a setting is the distance of its median √|P| from that of the setting it is compared with,
in units of the latter's half band (half of the range of 68 % of the streams): a shift of 1 means that
the knob matters as much as which stream one happens to look at. It is averaged over a decade of scale;
among the fifty scales of three spectra the largest always looks bad.

What matters for data is the density as observed. Its shifts are also told in half bands of signal plus
shot noise, which is the paper's criterion ("not relevant for our purposes"); those of spectra without
noise, which no telescope sees, are told as such.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.convergence.knobs import ConvergenceTest
from streamdash.convergence.theta_spectra import ThetaSpectra
from streamdash.statistics.spectrum import KINDS, SpectrumBand

AGREES = 0.25
"""Mean shift, in half bands, of spectra that agree; a knob has converged where they do."""
SCATTER = 1.0
"""Mean shift that is within the scatter of streams."""
WORDS = ((AGREES, "agrees"), (SCATTER, "within the scatter of streams"), (np.inf, "differs"))
DECADES: Mapping[str, tuple[float, float]] = {"small": (1.0, 10.0), "large": (10.0, 100.0)}
"""Ranges of 1/k (deg) over which shifts are averaged, by name."""
NOISE = 0.1
"""σ_ε per bin, as observed."""
BIN_DEG = 0.158
"""Mean length along θ∥ (deg) of the 0.2° bins of longitude that σ_ε refers to."""


@dataclass(frozen=True)
class Shift:
    """Mean shift of one spectrum of one setting over a decade of scale.

    Attributes
    ----------
    setting, reference : indices of the setting and of the one it is compared with.
    kind : which spectrum (`streamdash.statistics.spectrum.KINDS`).
    decade : which scales (`DECADES`).
    observed : whether shot noise is in both spectra and in the band.
    mean : in half bands of the reference, with its sign: positive where there is more power.
    error : standard error of that shift from the finite numbers of streams; an upper limit where
        both settings see the same impacts or streams, or scales go together.
    largest, scale : the shift that is farthest from zero, and 1/k where it occurs (deg).
    """

    setting: int
    reference: int
    kind: str
    decade: str
    observed: bool
    mean: float
    error: float
    largest: float
    scale: float

    @property
    def word(self) -> str:
        """The verdict on this shift."""
        return verdict_word(self.mean)


@dataclass(frozen=True)
class Outcome:
    """The outcome of one test.

    Attributes
    ----------
    shifts : of every setting that is compared: every spectrum without noise, and the density with it.
    worst : the largest mean shift of the density as observed among the settings and scales that the
        paper calls converged (all, where there is no order).
    worst_clean : the same of all spectra without noise.
    converged_from : index of the first setting from which on all are converged as observed; None
        where there is no order, or where only the reference itself is.
    """

    shifts: tuple[Shift, ...]
    worst: Shift
    worst_clean: Shift
    converged_from: int | None

    @property
    def word(self) -> str:
        """The verdict on the settings that the paper calls converged, as observed."""
        return self.worst.word

    def of(self, setting: int, kind: str, decade: str, observed: bool = False) -> Shift | None:
        """The shift of a setting; None for a reference."""
        wanted = (setting, kind, decade, observed)
        return next((s for s in self.shifts if (s.setting, s.kind, s.decade, s.observed) == wanted), None)


def verdict_word(shift: float) -> str:
    """Word for a shift in half bands: agrees to 0.25, within the scatter of streams to 1, or differs."""
    return next(word for end, word in WORDS if abs(shift) <= end)


def judge(knob: ConvergenceTest, spectra: Sequence[ThetaSpectra]) -> Outcome:
    """Shifts and verdict of a knob.

    Parameters
    ----------
    knob : ConvergenceTest
    spectra : one per setting, in their order.
    """
    shifts = tuple(
        shift
        for i, setting in enumerate(knob.settings)
        if setting.reference != i
        for kind, observed in (*((kind, False) for kind in KINDS), ("density", True))
        for shift in _shifts(knob, spectra, i, kind, observed)
    )
    claimed = [s for s in shifts if s.setting >= knob.claim and s.decade in knob.scales]
    worst = max((s for s in claimed if s.observed), key=lambda s: abs(s.mean))
    clean = max((s for s in claimed if not s.observed), key=lambda s: abs(s.mean))
    return Outcome(shifts, worst, clean, _converged_from(knob, shifts) if knob.ordered else None)


def reference_bands(
    knob: ConvergenceTest, spectra: Sequence[ThetaSpectra], setting: int, kind: str
) -> SpectrumBand:
    """The band that a setting is compared with.

    Where impacts at one time are compared between two others (`Setting.beyond`) it is interpolated in
    time between those (√P in proportion), so that all have had the same time to grow.
    """
    chosen = knob.settings[setting]
    first = spectra[chosen.reference].bands[kind]
    if chosen.beyond is None:
        return first
    second = spectra[chosen.beyond].bands[kind]
    weight = knob.place_in_time(setting)

    def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.exp((1 - weight) * np.log(a) + weight * np.log(b))

    return SpectrumBand(
        first.scale,
        between(first.low, second.low),
        between(first.median, second.median),
        between(first.high, second.high),
        min(first.n_streams, second.n_streams),
    )


def shift_by_scale(one: SpectrumBand, other: SpectrumBand, observed: bool = False) -> np.ndarray:
    """Distance of two medians in half bands of the second, at each scale.

    With `observed` the mean power of shot noise, 3 σ_ε² per length of a bin for a Hann window, is added
    to both medians, and the scatter of its power (exponential, as of any mode of white noise) to the
    half band.
    """
    if not observed:
        return (one.median - other.median) / other.half_width
    level = np.sqrt(3 * NOISE**2 * np.radians(BIN_DEG))
    half_noise = 0.5 * level * (np.sqrt(-np.log(0.16)) - np.sqrt(-np.log(0.84)))
    medians = [np.sqrt(band.median**2 + level**2) for band in (one, other)]
    # The half band of the root of a sum: that of the signal counts by its part in the root.
    half_signal = other.half_width * other.median / medians[1]
    return (medians[0] - medians[1]) / np.hypot(half_signal, half_noise)


def _shifts(
    knob: ConvergenceTest, spectra: Sequence[ThetaSpectra], setting: int, kind: str, observed: bool
) -> list[Shift]:
    """The shifts of one spectrum of one setting, one per decade that has scales."""
    reference = knob.settings[setting].reference
    one, other = spectra[setting].bands[kind], reference_bands(knob, spectra, setting, kind)
    shift = shift_by_scale(one, other, observed)
    # How far the shift moves when the median does, so that errors are in the same units.
    per_unit = np.abs(shift) / np.maximum(np.abs(one.median - other.median), 1e-300)
    errors = np.hypot(spectra[setting].errors[kind], spectra[reference].errors[kind])
    errors = errors * np.where(np.isfinite(per_unit) & (per_unit > 0), per_unit, 1 / other.half_width)
    result = []
    for decade, (low, high) in DECADES.items():
        inside = np.flatnonzero((other.scale >= low) & (other.scale < high))
        if not len(inside):
            continue
        at = inside[np.argmax(np.abs(shift[inside]))]
        result.append(
            Shift(
                setting,
                reference,
                kind,
                decade,
                observed,
                float(shift[inside].mean()),
                float(errors[inside].mean()),
                float(shift[at]),
                float(other.scale[at]),
            )
        )
    return result


def _converged_from(knob: ConvergenceTest, shifts: Sequence[Shift]) -> int | None:
    last = len(knob.settings) - 1
    bad = [s.setting for s in shifts if s.observed and s.decade in knob.scales and abs(s.mean) > AGREES]
    first = max(bad, default=-1) + 1
    return first if first < last else None


# ---------------------------------------------------------------- words

SPECTRUM_WORDS: Mapping[str, str] = {
    "density": "density",
    "track": "track",
    "cross": "cross",
}
DECADE_WORDS: Mapping[str, str] = {"small": "1° to 10°", "large": "10° and more"}


def verdict_sentence(knob: ConvergenceTest, verdict: Outcome) -> str:
    """The verdict on a knob in words and numbers."""
    labels = [setting.label for setting in knob.settings]
    worst = verdict.worst
    observed = (
        f"as observed (σ_ε = {NOISE:g}), {_pair(labels, worst)} shifts the density spectrum at "
        f"{DECADE_WORDS[worst.decade]} by {worst.mean:+z.2f} ± {worst.error:.2f} half bands of signal "
        "and noise"
    )
    clean = _clean_sentence(labels, verdict.worst_clean)
    if not knob.ordered:
        return f"{worst.word.capitalize()}: at most, {observed}.{clean}"
    if verdict.converged_from is None:
        start = f"No other setting agrees with {labels[-1]}"
    elif verdict.converged_from == 0:
        start = "Converged at every setting"
    else:
        start = f"Converged from {labels[verdict.converged_from]} on"
    if len(knob.scales) < len(DECADES):
        start += f" at scales of {' and '.join(DECADE_WORDS[name] for name in knob.scales)}"
    if knob.paper:
        return f"{start}. Of what the paper calls converged, {observed}: {worst.word}.{clean}"
    return f"{start}. At most, {observed}: {worst.word}.{clean}"


def _clean_sentence(labels: Sequence[str], shift: Shift) -> str:
    return (
        f" Without noise, which no telescope sees, the largest mean shift is {shift.mean:+z.2f} ± "
        f"{shift.error:.2f} half bands of the streams' own scatter ({_pair(labels, shift)}, "
        f"{SPECTRUM_WORDS[shift.kind]} spectrum, {DECADE_WORDS[shift.decade]}): {shift.word}."
    )


def _pair(labels: Sequence[str], shift: Shift) -> str:
    return f"{labels[shift.setting]} against {labels[shift.reference]}"
