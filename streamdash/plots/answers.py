"""Each page's answer in one sentence: what its figure says now to somebody who has five seconds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streamdash.classifier.train import Judged
from streamdash.config import EnsembleConfig
from streamdash.naming import model_labels
from streamdash.plots.evidence import others, words
from streamdash.plots.profiles import names
from streamdash.statistics.evidence import Comparison
from streamdash.statistics.spectra_in_noise import Shown
from streamdash.survey.bands import Bands

UNITS = {"q_rho": "{:.2g}", "rho": "{:.2g} ρ̄", "omega": "{:.2g} rad/Gyr"}
"""How the half-width of a band is told, by what is shown."""


def profiles_answer(panels: Sequence[Bands]) -> str:
    """By how much the profiles of each class differ from one another, the noise included."""
    if not panels:
        return ""
    quantity, noise, parts = panels[0].quantity, panels[0].noise, []
    for panel, name in zip(panels, names(panels), strict=True):
        half = float(np.mean(panel.high - panel.low)) / 2
        parts.append(f"{name} by ±{UNITS[quantity].format(half)}")
    share = f"; noise alone by ±{noise:.2g}" if quantity == "q_rho" and noise else ""
    what = {"q_rho": "In units of the smooth density, streams", "rho": "Streams", "omega": "Streams"}[
        quantity
    ]
    return f"{what} differ: {', '.join(parts)}{share}."


def pdf_answer(comparison: Comparison, configs: Sequence[EnsembleConfig]) -> str:
    """Where along Qρ the classes are farthest apart, in units of their own scatter."""
    bands, best, where = comparison.bands, 0.0, 0
    for i, one in enumerate(bands):
        for other in bands[i + 1 :]:
            widths = one.high - one.low + other.high - other.low
            apart = 2 * np.abs(one.median - other.median) / np.where(widths > 0, widths, np.inf)
            if apart.max() > best:
                best, where = float(apart.max()), int(apart.argmax())
    if best < 1:
        return "At this noise no single density tells the mass ranges apart: their 68 % bands overlap."
    low, high = comparison.edges[where : where + 2]
    heights = ", ".join(
        f"{label} {band.median[where]:.2f} ({band.low[where]:.2f}–{band.high[where]:.2f})"
        for label, band in zip(model_labels(configs), bands, strict=True)
    )
    return f"They are farthest apart in how often Qρ is {low:.2f} to {high:.2f}: {heights}."


def evidence_answer(comparison: Comparison, fiducial: int, configs: Sequence[EnsembleConfig]) -> str:
    """The sum of ln B against every other class, with Jeffreys' word."""
    labels, parts = model_labels(configs), []
    for j in others(comparison, fiducial):
        total = comparison.evidence.cumulative(fiducial, fiducial, j)
        if total.n_kept:
            parts.append(f"{labels[j]}: Σ ln B = {total.value:z.1f}, {words(total.value)}")
        else:
            parts.append(f"{labels[j]}: no bin can be compared")
    return f"A stream hit by {labels[fiducial]} would speak against {'; '.join(parts)}."


def classifier_answer(judged: Judged) -> str:
    """How many streams that were never trained on are put right."""
    return (
        f"Yes for {judged.scores.percent_text('overall_accuracy')} of {len(judged.y)} streams that it never "
        f"saw, at σ_ε = {judged.classifier.card.noise:g}."
    )


def spectrum_answer(shown: Shown, configs: Sequence[EnsembleConfig]) -> str:
    """On which scales most streams of a class lie above the shot noise."""
    parts, noise = [], shown.noise
    for label, band in zip(model_labels(configs), shown.bands["density"], strict=True):
        top = np.interp(band.scale, noise.scale[::-1], noise.high[::-1])
        above = band.scale[band.low > top]
        where = f"from {above.min():.2g}° to {above.max():.2g}°" if len(above) else "nowhere"
        parts.append(f"{label} {where}")
    return f"Most streams rise above the shot noise of σ_ε = {shown.sigma:g}: {'; '.join(parts)}."
