"""Do the spectra agree? Shifts between the settings of a knob, in units of the band.

The shift of a setting is the distance of its median √|P| from that of the setting it is compared
with, in units of the latter's half band (half of the range of 68 % of the streams): what a shift of
1 would mean is that the knob matters as much as which stream one happens to look at. The largest
shift over all scales is what counts; among some fifty scales, a thousand streams leave a largest
shift of 0.1 to 0.2 by chance alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from streamdash.convergence.knobs import ConvergenceTest
from streamdash.convergence.theta_spectra import ThetaSpectra
from streamdash.statistics.spectrum import KINDS

AGREES = 0.25
"""Largest shift, in half bands, of spectra that agree; a knob has converged where they do."""
SCATTER = 1.0
"""Largest shift that is within the scatter of streams."""
WORDS = ((AGREES, "agrees"), (SCATTER, "within the scatter of streams"), (np.inf, "differs"))


@dataclass(frozen=True)
class Shift:
    """Largest shift of one spectrum of one setting.

    Attributes
    ----------
    setting, reference : indices of the setting and of the one it is compared with.
    kind : which spectrum (`streamdash.statistics.spectrum.KINDS`).
    largest : in half bands of the reference, with its sign: positive where there is more power.
    error : standard error of that shift from the finite numbers of streams; an upper limit where
        both settings see the same impacts or streams.
    scale : 1/k where it occurs (deg).
    """

    setting: int
    reference: int
    kind: str
    largest: float
    error: float
    scale: float

    @property
    def word(self) -> str:
        """The verdict on this shift."""
        return verdict_word(self.largest)


@dataclass(frozen=True)
class Outcome:
    """The outcome of one test.

    Attributes
    ----------
    shifts : of every setting that is compared, and every kind of spectrum.
    worst : the largest of those that the paper calls converged (all, where there is no order).
    agreeing : smallest and largest 1/k (deg) of the widest range of scales at which all spectra of
        those settings agree; None where there is no such scale.
    converged_from : index of the first setting from which on all are converged; None where there
        is no order, or where only the reference itself is.
    """

    shifts: tuple[Shift, ...]
    worst: Shift
    agreeing: tuple[float, float] | None
    converged_from: int | None

    @property
    def word(self) -> str:
        """The verdict on the settings that the paper calls converged."""
        return self.worst.word

    def of(self, setting: int) -> Shift | None:
        """The largest shift of a setting over the three spectra; None for a reference."""
        own = [shift for shift in self.shifts if shift.setting == setting]
        return max(own, key=lambda shift: abs(shift.largest)) if own else None


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
        shift_of(spectra, i, setting.reference, kind)
        for i, setting in enumerate(knob.settings)
        if setting.reference != i
        for kind in KINDS
    )
    claimed = [shift for shift in shifts if shift.setting >= knob.claim]
    worst = max(claimed, key=lambda shift: abs(shift.largest))
    agree = [np.abs(shift_by_scale(spectra, s.setting, s.reference, s.kind)) <= AGREES for s in claimed]
    agreeing = _widest(spectra[0].scale, np.all(agree, axis=0))
    return Outcome(shifts, worst, agreeing, _converged_from(knob, shifts) if knob.ordered else None)


def shift_by_scale(spectra: Sequence[ThetaSpectra], setting: int, reference: int, kind: str) -> np.ndarray:
    """Distance of two settings' medians in half bands of the second, at each scale."""
    one, other = spectra[setting].bands[kind], spectra[reference].bands[kind]
    return (one.median - other.median) / other.half_width


def shift_of(spectra: Sequence[ThetaSpectra], setting: int, reference: int, kind: str) -> Shift:
    """The largest shift of one setting's spectrum from another's."""
    one, other = spectra[setting], spectra[reference]
    shift = shift_by_scale(spectra, setting, reference, kind)
    error = np.hypot(one.errors[kind], other.errors[kind]) / other.bands[kind].half_width
    at = int(np.argmax(np.abs(shift)))
    return Shift(setting, reference, kind, float(shift[at]), float(error[at]), float(other.scale[at]))


def _widest(scale: np.ndarray, holds: np.ndarray) -> tuple[float, float] | None:
    """Ends of the run of scales, widest by ratio, at which something holds; the smaller first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    runs = [(float(scale[end - 1]), float(scale[start])) for start, end in edges.reshape(-1, 2)]
    return max(runs, key=lambda run: run[1] / run[0], default=None)


def _converged_from(knob: ConvergenceTest, shifts: Sequence[Shift]) -> int | None:
    last = len(knob.settings) - 1
    bad = [shift.setting for shift in shifts if abs(shift.largest) > AGREES]
    first = max(bad, default=-1) + 1
    return first if first < last else None


# ---------------------------------------------------------------- words

SPECTRUM_WORDS: Mapping[str, str] = {
    "density": "the density spectrum",
    "track": "the track spectrum",
    "cross": "the cross spectrum",
}


def verdict_sentence(knob: ConvergenceTest, verdict: Outcome) -> str:
    """The verdict on a knob in words and numbers."""
    worst = verdict.worst
    labels = [setting.label for setting in knob.settings]
    largest = (
        f"{labels[worst.setting]} against {labels[worst.reference]} shifts the median of "
        f"{SPECTRUM_WORDS[worst.kind]} by {worst.largest:+.2f} ± {worst.error:.2f} half bands at "
        f"{worst.scale:.1f}°"
    )
    agreement = agreement_sentence(verdict)
    if not knob.ordered:
        return f"{worst.word.capitalize()}: at most, {largest}.{agreement}"
    if verdict.converged_from is None:
        start = f"No other setting agrees with {labels[-1]} at every scale"
    elif verdict.converged_from == 0:
        start = "Converged at every setting"
    else:
        start = f"Converged from {labels[verdict.converged_from]} on"
    if knob.paper:
        return f"{start}. Of what the paper calls converged, {largest}: {worst.word}.{agreement}"
    return f"{start}. At most, {largest}: {worst.word}.{agreement}"


def agreement_sentence(verdict: Outcome) -> str:
    """At which scales the claimed settings agree, where they do not at all."""
    if verdict.worst.word == "agrees":
        return ""
    if verdict.agreeing is None:
        return " At no scale do all spectra of these settings agree."
    low, high = verdict.agreeing
    return f" All spectra of these settings agree from {low:.1f}° to {high:.1f}°."
