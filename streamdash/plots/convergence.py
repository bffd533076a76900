"""Spectra of a knob's settings over one another (paper, appendix A), and their shifts as numbers."""

from __future__ import annotations

from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.convergence.knobs import ConvergenceTest, knob
from streamdash.convergence.spectra import stored_spectra
from streamdash.convergence.text import Measured
from streamdash.convergence.theta_spectra import ThetaSpectra
from streamdash.convergence.verdicts import AGREES, DECADE_WORDS, SCATTER, Outcome, judge, reference_bands
from streamdash.naming import mass_text
from streamdash.plots.elements import (
    GREY,
    error_bars,
    framed,
    hover_spans,
    level_lines,
    line,
    nice_top,
    points,
)
from streamdash.plots.live import Backend, use
from streamdash.plots.spectrum import SCALES, area, scale_spans
from streamdash.statistics.spectrum import KINDS, SpectrumBand
from streamdash.store.cache import Cache, StoreError

SEQUENCE = ("#4f6bd8", "#8a54d6", "#b94bb4", "#dc5186", "#ea7152", "#e8952a", "#c9ab00")
"""Colours of settings in their order, of middling lightness: right on light and dark, and from blue to
yellow, which no common colour blindness confuses."""
X_LABEL = "1/k of θ∥ (deg)"
Y_LABELS = {
    "density": "√P of Qρ (rad¹ᐟ²)",
    "track": "√P of ⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩ (rad¹ᐟ²)",
    "cross": "√|P| of both (rad¹ᐟ²)",
}
X_RANGE = (1.0, 100.0)
DECADES = 4
"""Height of a figure."""
RATIO_RANGE = (0.2, 5.0)


def convergence_figure(
    cache: Cache, key: str, n_streams: int = 1000, seed: int = 0, backend: Backend = "matplotlib"
) -> hv.Layout:
    """Density, track and cross spectra of one test of convergence (paper, appendix A).

    Parameters
    ----------
    cache
        Where the spectra are; `streamdash.convergence.spectra.compute_missing` puts them there.
    key
        Of `streamdash.convergence.knobs.KNOBS`.
    n_streams, seed
        Of the ensembles; the shipped ones by default.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.

    Raises
    ------
    StoreError
        When the spectra are not in the cache.
    """
    # Collect
    chosen = knob(key, n_streams, seed)
    spectra = collect(cache, chosen)
    # Plot
    panels = [draw(chosen, spectra, kind, backend, legend=kind == "density") for kind in KINDS]
    panels.append(draw_ratios(chosen, spectra, backend))
    return hv.Layout(panels).cols(2).opts(sublabel_format="", tight=True, backend="matplotlib")


def collect(cache: Cache, chosen: ConvergenceTest) -> list[ThetaSpectra]:
    """Spectra of all settings of a knob from the cache.

    Raises
    ------
    StoreError
        When some are not there; names the command that computes them.
    """
    found = [stored_spectra(setting.config, cache) for setting in chosen.settings]
    spectra = [one for one in found if one is not None]
    if len(spectra) < len(found):
        raise StoreError(
            f"The cache lacks the spectra of {len(found) - len(spectra)} of the {len(found)} settings of "
            f"“{chosen.title}”; run `streamdash convergence --compute {chosen.key}` first."
        )
    return spectra


def draw(
    chosen: ConvergenceTest,
    spectra: Sequence[ThetaSpectra],
    kind: str,
    backend: Backend,
    legend: bool = False,
) -> hv.Overlay:
    """Medians of one kind of spectrum at all settings, and the bands of those compared with."""
    use(backend)
    references = sorted({setting.reference for setting in chosen.settings})
    parts: list[hv.Element] = [area("", spectra[i].bands[kind], GREY, backend) for i in references]
    for i, (setting, found) in enumerate(zip(chosen.settings, spectra, strict=True)):
        band = found.bands[kind]
        parts.append(line(setting.label, band.scale, band.median, colour(chosen, i), backend))
    if backend == "bokeh":
        spans = scale_spans(spectra[0].scale)
        tips = [("1/k", "@at{0.0}°")]
        for i, setting in enumerate(chosen.settings):
            spans[f"median{i}"] = spectra[i].bands[kind].median
            tips.append((setting.label, f"@median{i}{{0.00000}}"))
        parts.append(hover_spans(SCALES, spans, tips))
    overlay = framed(
        parts, X_LABEL, Y_LABELS[kind], X_RANGE, y_range(spectra, kind), backend, log=True,
    )  # fmt: skip
    if legend and backend == "matplotlib":
        look = {"legend_position": "bottom_right", "legend_opts": {"fontsize": 6}}
        return overlay.opts(hv.opts.Overlay(show_legend=True, backend=backend, **look))
    return overlay


def draw_ratios(
    chosen: ConvergenceTest, spectra: Sequence[ThetaSpectra], backend: Backend, kind: str = "density"
) -> hv.Overlay:
    """Medians of one kind of spectrum in units of that of the setting each is compared with.

    Four decades of √P hide a change by a third; here it is seen. Grey: the band of 68 % of the streams
    of the first setting that others are compared with.
    """
    use(backend)
    compared = [i for i, setting in enumerate(chosen.settings) if setting.reference != i]
    first = spectra[chosen.settings[compared[0]].reference].bands[kind]
    band = SpectrumBand(
        first.scale,
        first.low / first.median,
        np.ones_like(first.median),
        first.high / first.median,
        first.n_streams,
    )
    parts: list[hv.Element] = [area("", band, GREY, backend), level_lines("even", [1.0], backend)]
    spans, tips = scale_spans(first.scale), [("1/k", "@at{0.0}°")]
    for i in compared:
        own = spectra[i].bands[kind]
        ratio = own.median / reference_bands(chosen, spectra, i, kind).median
        parts.append(line(chosen.settings[i].label, own.scale, ratio, colour(chosen, i), backend))
        spans[f"ratio{i}"] = ratio
        tips.append((chosen.settings[i].label, f"@ratio{i}{{0.00}}"))
    if backend == "bokeh":
        parts.append(hover_spans(SCALES, spans, tips))
    return framed(parts, X_LABEL, "√P against its reference", X_RANGE, RATIO_RANGE, backend, log=True)


def y_range(spectra: Sequence[ThetaSpectra], kind: str) -> tuple[float, float]:
    """Whole decades, the highest of which holds all bands."""
    highest = max(float(found.bands[kind].high.max()) for found in spectra)
    top = np.ceil(np.log10(highest))
    return float(10.0 ** (top - DECADES)), float(10.0**top)


def colour(chosen: ConvergenceTest, index: int) -> str:
    """Colour of a setting."""
    last = max(len(chosen.settings) - 1, 1)
    return SEQUENCE[round(index * (len(SEQUENCE) - 1) / last)]


def draw_verdicts(found: Sequence[Measured], backend: Backend) -> hv.Overlay:
    """Largest mean shift of each test, as observed, among what the paper calls converged."""
    use(backend)
    worst = [one.verdict.worst for one in found]
    x = np.arange(len(worst), dtype=float)
    y, error = np.array([abs(shift.mean) for shift in worst]), np.array([shift.error for shift in worst])
    parts: list[hv.Element] = [
        level_lines("levels", [AGREES, SCATTER], backend),
        error_bars("errors", x, y - error, y + error, GREY, backend),
        points("shifts", x, y, SEQUENCE[0], backend),
    ]
    top = nice_top(max(float((y + error).max()), SCATTER))
    overlay = framed(
        parts, "test", "shift as observed (half bands)", (-0.5, len(x) - 0.5), (0.0, top), backend
    )
    ticks = [(i, one.knob.key) for i, one in enumerate(found)]
    return overlay.opts(hv.opts.Overlay(xticks=ticks, xrotation=45, backend=backend))


# ---------------------------------------------------------------- words and numbers


def table(chosen: ConvergenceTest, spectra: Sequence[ThetaSpectra]) -> pd.DataFrame:
    """The numbers of the figures: per setting, spectrum and scale the median, its error and the band."""
    parts = [
        pd.DataFrame(
            {
                "knob": chosen.key,
                "setting": setting.label,
                "config_key": setting.config.key,
                "spectrum": kind,
                "n_streams": band.n_streams,
                "scale_deg": band.scale,
                "quantile_16_sqrt_power_rad": band.low,
                "median_sqrt_power_rad": band.median,
                "median_error_sqrt_power_rad": found.errors[kind],
                "quantile_84_sqrt_power_rad": band.high,
            }
        )
        for setting, found in zip(chosen.settings, spectra, strict=True)
        for kind, band in found.bands.items()
    ]
    return pd.concat(parts, ignore_index=True)


def shift_table(chosen: ConvergenceTest, verdict: Outcome) -> pd.DataFrame:
    """Shift of each setting and spectrum per decade, in half bands of the setting compared with."""
    labels = [setting.label for setting in chosen.settings]
    return pd.DataFrame(
        [
            {
                "knob": chosen.key,
                "setting": labels[shift.setting],
                "compared_with": labels[shift.reference],
                "spectrum": shift.kind,
                "scales": DECADE_WORDS[shift.decade],
                "with_noise": shift.observed,
                "mean_shift_half_bands": shift.mean,
                "error_half_bands": shift.error,
                "largest_shift_half_bands": shift.largest,
                "at_scale_deg": shift.scale,
                "verdict": shift.word,
            }
            for shift in verdict.shifts
        ]
    )


def all_shifts(found: Sequence[Measured]) -> pd.DataFrame:
    """`shift_table` of several tests."""
    return pd.concat([shift_table(one.knob, one.verdict) for one in found], ignore_index=True)


def sentence(chosen: ConvergenceTest, spectra: Sequence[ThetaSpectra]) -> str:
    """What the figures show now, in words."""
    impacts = [found.mean_impacts for found in spectra]
    streams = {setting.config.n_streams for setting in chosen.settings}
    cost = sum(found.cost_s for found in spectra)
    return (
        f"Medians over {_span(streams)} streams per setting, perturbers of {mass_text(chosen.mass_range)}, "
        f"{min(impacts):.0f} to {max(impacts):.0f} impacts per stream; grey: the band of 68 % of the streams "
        f"of the setting that the others are compared with. All of it took {cost / 60:.1f} core minutes."
    )


def measured(cache: Cache, chosen: ConvergenceTest) -> tuple[list[ThetaSpectra], Outcome]:
    """Spectra of a knob from the cache, and the verdict on them; raises as `collect` does."""
    spectra = collect(cache, chosen)
    return spectra, judge(chosen, spectra)


def _span(values: set[int]) -> str:
    return f"{min(values)}" if len(values) == 1 else f"{min(values)} to {max(values)}"
