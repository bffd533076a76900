"""The verdicts of the convergence laboratory as tables and text, with what they cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from streamdash.convergence.knobs import KNOBS, ConvergenceTest, knob
from streamdash.convergence.spectra import stored_spectra
from streamdash.convergence.theta_spectra import ThetaSpectra
from streamdash.convergence.verdicts import (
    AGREES,
    DECADE_WORDS,
    DECADES,
    NOISE,
    SCATTER,
    Outcome,
    Shift,
    judge,
    verdict_sentence,
)
from streamdash.statistics.spectrum import KINDS
from streamdash.store.cache import Cache


@dataclass(frozen=True)
class Measured:
    """A knob with the spectra of its settings and the verdict on them."""

    knob: ConvergenceTest
    spectra: tuple[ThetaSpectra, ...]
    verdict: Outcome


@dataclass(frozen=True)
class Cost:
    """What it took: different ensembles, their streams, and core seconds of both kinds of work."""

    n_ensembles: int
    n_streams: int
    streams_s: float
    geometries_s: float

    @property
    def total_s(self) -> float:
        """Core seconds in all."""
        return self.streams_s + self.geometries_s


def measure(
    cache: Cache, keys: Sequence[str] = tuple(KNOBS), n_streams: int = 1000, seed: int = 0
) -> tuple[list[Measured], list[ConvergenceTest]]:
    """Verdicts on all knobs whose spectra are in the cache, and the knobs of which some are not."""
    found, lacking = [], []
    for key in keys:
        chosen = knob(key, n_streams, seed)
        spectra = [stored_spectra(setting.config, cache) for setting in chosen.settings]
        there = tuple(one for one in spectra if one is not None)
        if len(there) == len(spectra):
            found.append(Measured(chosen, there, judge(chosen, there)))
        else:
            lacking.append(chosen)
    return found, lacking


def cost(cache: Cache, found: Sequence[Measured]) -> Cost:
    """What the ensembles behind some verdicts cost, each counted once, with their streams' geometries."""
    largest: dict[str, tuple[int, float]] = {}
    streams = set()
    for one in found:
        for setting, spectra in zip(one.knob.settings, one.spectra, strict=True):
            key, counted = setting.config.ensemble.key, (setting.config.n_streams, spectra.cost_s)
            largest[key] = max(largest.get(key, (0, 0.0)), counted)
            streams.add(setting.config.ensemble.stream.key)
    entries = {e.key: e.cost_s for e in cache.entries(("geometries",))}
    return Cost(
        len(largest),
        sum(n for n, _ in largest.values()),
        sum(seconds for _, seconds in largest.values()),
        sum(entries.get(key, 0.0) for key in streams),
    )


def as_numbers(found: Sequence[Measured], spent: Cost) -> dict[str, Any]:
    """Verdicts and cost as plain numbers, lists and text."""
    return {
        "knobs": [
            {
                "key": one.knob.key,
                "title": one.knob.title,
                "paper": one.knob.paper,
                "verdict": one.verdict.word,
                "sentence": verdict_sentence(one.knob, one.verdict),
                "settings": [setting.label for setting in one.knob.settings],
                "converged_from": one.verdict.converged_from,
                "shifts": [
                    {
                        "setting": shift.setting,
                        "reference": shift.reference,
                        "spectrum": shift.kind,
                        "scales": shift.decade,
                        "observed": shift.observed,
                        "mean": shift.mean,
                        "error": shift.error,
                        "largest": shift.largest,
                        "scale_deg": shift.scale,
                    }
                    for shift in one.verdict.shifts
                ],
            }
            for one in found
        ],
        "cost": {
            "n_ensembles": spent.n_ensembles,
            "n_streams": spent.n_streams,
            "streams_core_s": spent.streams_s,
            "geometries_core_s": spent.geometries_s,
        },
    }


def cost_sentence(spent: Cost) -> str:
    """What all of it cost, in words."""
    return (
        f"{spent.n_ensembles} ensembles, {spent.n_streams} streams: {spent.streams_s / 60:.1f} core minutes "
        f"for the streams and {spent.geometries_s / 60:.1f} for the geometry at their impact times, "
        f"{spent.total_s / 60:.1f} in all (by the clock of each worker: an upper limit where the machine was "
        "busy with other things)."
    )


def convergence_markdown(found: Sequence[Measured], spent: Cost) -> str:
    """Verdicts, shifts and cost as Markdown."""
    lines = [
        "# Convergence of the simulations\n",
        "The tests of the paper's appendix A and some more, on power spectra of the density, of the track in "
        "parallel frequency, and on their cross spectrum along parallel angle, 1/k from 1° to the length of "
        "the stream. A shift is the distance of two settings' medians in half bands, half the range of 68 % "
        "of the streams, averaged from 1° to 10° or over all larger scales. What counts is the density as "
        f"observed: with shot noise σ_ε = {NOISE:g} in the medians and in the band. Up to {AGREES:g} spectra "
        f"agree, up to {SCATTER:g} they differ within the scatter of streams. Written by "
        "`streamdash convergence --text`.\n",
        f"Cost: {cost_sentence(spent)}\n",
        "| test | largest mean shift as observed | verdict | without noise | paper |",
        "|---|---|---|---|---|",
    ]
    for one in found:
        worst, clean = one.verdict.worst, one.verdict.worst_clean
        lines.append(
            f"| {one.knob.title} | {_shift_text(worst)} | {worst.word} | {_shift_text(clean)}, {clean.kind} "
            f"| {one.knob.paper or '–'} |"
        )
    lines.append(
        "\nShifts in this table are the largest among the settings and scales that the paper calls converged."
    )
    for one in found:
        lines += _section(one)
    return "\n".join(lines) + "\n"


def _shift_text(shift: Shift) -> str:
    return f"{shift.mean:+z.2f} ± {shift.error:.2f} at {DECADE_WORDS[shift.decade]}"


def _section(one: Measured) -> list[str]:
    labels = [setting.label for setting in one.knob.settings]
    lines = [f"\n## {one.knob.title}\n", f"{one.knob.question}\n"]
    if one.knob.paper:
        lines.append(f"Paper: {one.knob.paper}\n")
    lines.append(verdict_sentence(one.knob, one.verdict))
    lines += [
        "\nMean shift at 1° to 10° / at larger scales:",
        "\n| setting | impacts | core s | density, observed | density | track | cross |",
        "|---|---|---|---|---|---|---|",
    ]
    for i, found in enumerate(one.spectra):
        columns = (("density", True), *((kind, False) for kind in KINDS))
        pairs = [[one.verdict.of(i, kind, name, seen) for name in DECADES] for kind, seen in columns]
        cells = [" / ".join(f"{s.mean:+z.2f}" if s else "–" for s in pair) for pair in pairs]
        if one.knob.settings[i].reference == i:
            cells = ["compared with"] * len(columns)
        lines.append(f"| {labels[i]} | {found.mean_impacts:.0f} | {found.cost_s:.0f} | {' | '.join(cells)} |")
    return lines
