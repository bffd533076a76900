"""Power, cross and bispectra of each class against the shot noise (paper, appendix B)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig
from streamdash.naming import class_colours, class_names, model_labels
from streamdash.plots.elements import GREY, framed, hover_spans, line
from streamdash.plots.live import Backend, Columns, area_columns, use
from streamdash.plots.style import INK
from streamdash.statistics.bispectrum import Bispectrum
from streamdash.statistics.spectra_in_noise import (
    PAPER_APART_DEG,
    PAPER_DETECTED_DEG,
    Shown,
    Statement,
    show,
)
from streamdash.statistics.spectrum import KINDS, SpectrumBand, observed_spectra, shot_noise_level
from streamdash.store.cache import Cache
from streamdash.survey.design import default_design
from streamdash.survey.observed import ObservedStreams, open_ensembles
from streamdash.words import is_or_are, number_of

X_LABEL = "1/k (deg)"
Y_LABELS = {
    "density": "√P of Qρ (deg¹ᐟ²)",
    "track": "√P of ⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩ (deg¹ᐟ²)",
    "cross": "√|P| of Qρ with ⟨ΔΩ∥⟩/⟨ΔΩ∥⁰⟩ (deg¹ᐟ²)",
}
B_LABELS = {"real": "|Re B| of Qρ", "imaginary": "|Im B| of Qρ"}
X_RANGE = (1.0, 100.0)
Y_RANGES = {"density": (1e-3, 10.0), "track": (1e-4, 10.0), "cross": (1e-4, 10.0)}
B_RANGE = (1e-9, 1e-3)
NOISE, LIMITS, SCALES = "noise", "limits", "scales"
Part = Literal["real", "imaginary"]


def spectrum_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    kind: str = "density",
    noise: float = 0.1,
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """√P against 1/k of each class, with the level of shot noise (paper, figure of appendix B).

    Parameters
    ----------
    cache
        Where the ensembles and the stream's geometry are.
    ensembles
        Keys or configurations, lowest masses first.
    kind
        ``density``, ``track`` or ``cross``.
    noise
        Shot noise σ_ε per bin.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.
    """
    # Collect and compute
    configs, shown = collect(cache, ensembles, noise)
    # Plot
    return draw(shown, configs, kind, backend)


def collect(
    cache: Cache, ensembles: Sequence[str | EnsembleConfig], noise: float
) -> tuple[tuple[EnsembleConfig, ...], Shown]:
    """Read ensembles of one stream and take their spectra along longitude, with shot noise.

    Raises
    ------
    StoreError
        When an ensemble is missing or damaged.
    """
    opened = open_ensembles(cache, ensembles)
    spectra = []
    for config, dataset in zip(opened.configs, opened.datasets, strict=True):
        streams = ObservedStreams.of(opened.geometry, dataset, config)
        spectra.append(observed_spectra(opened.geometry, dataset, streams))
    design = default_design(opened.geometry)
    return opened.configs, show(spectra, shot_noise_level(design.n_bin, design.step), noise)


# ---------------------------------------------------------------- plot: spectra


def draw(
    shown: Shown, configs: Sequence[EnsembleConfig], kind: str, backend: Backend, title: str = ""
) -> hv.Overlay:
    """Declare the figure of one kind of spectrum; in the browser its data are replaced by `columns`."""
    use(backend)
    data = columns(shown, kind)
    parts: list[hv.Element] = []
    if kind == "density":
        parts.append(area("noise band", shown.noise, GREY, backend))
        parts.append(_limits(backend))
    for m, band in enumerate(shown.bands[kind]):
        parts.append(area(f"band {m}", band, class_colours(configs)[m], backend))
    for m, band in enumerate(shown.bands[kind]):
        colour = class_colours(configs)[m]
        parts.append(line(f"median {m}", band.scale, band.median, colour, backend))
        if kind == "density":
            clean = shown.clean[m]
            parts.append(line(f"clean {m}", clean.scale, clean.median, colour, backend, dashed=True))
    if kind == "density":
        level = shown.noise
        parts.append(line(NOISE, level.scale, _drawable(level.median), INK["light"], backend))
    if backend == "bokeh":
        names = [(label, f"@text{m}") for m, label in enumerate(model_labels(configs))]
        tips = [("1/k", "@at{0.0}°"), *names]
        if kind == "density":
            tips.append(("shot noise alone", "@noise"))
        parts.append(hover_spans(SCALES, data[SCALES], tips))
    return framed(parts, X_LABEL, Y_LABELS[kind], X_RANGE, Y_RANGES[kind], backend, title, log=True)


def columns(shown: Shown, kind: str) -> Columns:
    """Arrays of a figure by element label and column name, for `LiveFigure.patch`."""
    scale = shown.noise.scale
    spans = scale_spans(scale)
    result: dict[str, dict[str, np.ndarray]] = {SCALES: spans}
    for m, band in enumerate(shown.bands[kind]):
        result[f"band {m}"] = area_columns(band.scale, _drawable(band.low), _drawable(band.high))
        result[f"median {m}"] = {"x": band.scale, "y": _drawable(band.median)}
        spans[f"text{m}"] = _texts(band)
        if kind == "density":
            clean = shown.clean[m]
            result[f"clean {m}"] = {"x": clean.scale, "y": _drawable(clean.median)}
    if kind == "density":
        level = shown.noise
        result["noise band"] = area_columns(scale, _drawable(level.low), _drawable(level.high))
        result[NOISE] = {"x": scale, "y": _drawable(level.median)}
        spans["noise"] = _texts(level)
    return result


def area(label: str, band: SpectrumBand, colour: str, backend: Backend) -> hv.Area:
    """The band of a spectrum; in the browser its columns are ``x, y``."""
    values = (band.scale, _drawable(band.low), _drawable(band.high))
    element = hv.Area(values, "x", ["low", "high"], label=label)
    if backend == "matplotlib":
        return element.opts(facecolor=colour, edgecolor=colour, alpha=0.3, linewidth=0, backend=backend)
    return element.opts(fill_color=colour, fill_alpha=0.28, line_alpha=0, backend=backend)


def _limits(backend: Backend) -> hv.Curve:
    """Grey lines at the scales of the paper's statements."""
    x = np.repeat([PAPER_DETECTED_DEG, PAPER_APART_DEG], 3)
    y = np.tile([*Y_RANGES["density"], np.nan], 2)
    return line(LIMITS, x, y, GREY, backend, dashed=True)


def _drawable(values: np.ndarray) -> np.ndarray:
    """Values that a logarithmic axis can show: no noise at all is drawn far below the frame."""
    return np.maximum(values, 1e-12)


def scale_spans(scale: np.ndarray) -> dict[str, np.ndarray]:
    """Ranges around the scales, for pointing at."""
    edges = np.sqrt(scale[1:] * scale[:-1])
    return {
        "x0": np.concatenate([edges, [scale[-1] ** 2 / edges[-1]]]),
        "x1": np.concatenate([[scale[0] ** 2 / edges[0]], edges]),
        "at": scale,
    }


def _texts(band: SpectrumBand) -> np.ndarray:
    rows = zip(band.low, band.median, band.high, strict=True)
    return np.array([f"{b:.3g} (68 %: {a:.3g}–{c:.3g})" for a, b, c in rows])


# ---------------------------------------------------------------- plot: bispectra


def draw_bispectrum(
    bispectra: Sequence[Bispectrum], configs: Sequence[EnsembleConfig], part: Part, backend: Backend
) -> hv.Overlay:
    """|Re B| or |Im B| of Qρ of each class against 1/k₂ (BES17); data replaced by `bispectrum_columns`."""
    use(backend)
    bands = [getattr(b, part) for b in bispectra]
    colours = class_colours(configs)
    parts: list[hv.Element] = [area(f"band {m}", band, colours[m], backend) for m, band in enumerate(bands)]
    parts += [
        line(f"median {m}", band.scale, band.median, colours[m], backend) for m, band in enumerate(bands)
    ]
    if backend == "bokeh":
        names = [(label, f"@text{m}") for m, label in enumerate(model_labels(configs))]
        spans = bispectrum_columns(bispectra, part)[SCALES]
        parts.append(hover_spans(SCALES, spans, [("1/k₂", "@at{0.0}°"), *names]))
    return framed(parts, "1/k₂ (deg)", B_LABELS[part], X_RANGE, B_RANGE, backend, log=True)


def bispectrum_columns(bispectra: Sequence[Bispectrum], part: Part) -> Columns:
    """Arrays of the figure of a bispectrum by element label and column name."""
    bands = [getattr(b, part) for b in bispectra]
    spans = scale_spans(bands[0].scale)
    result: dict[str, dict[str, np.ndarray]] = {SCALES: spans}
    for m, band in enumerate(bands):
        result[f"band {m}"] = area_columns(band.scale, _drawable(band.low), _drawable(band.high))
        result[f"median {m}"] = {"x": band.scale, "y": _drawable(band.median)}
        spans[f"text{m}"] = _texts(band)
    return result


# ---------------------------------------------------------------- words and numbers


def table(shown: Shown, configs: Sequence[EnsembleConfig], kinds: Sequence[str] = KINDS) -> pd.DataFrame:
    """The numbers of the figures: per class, kind and scale the median and the band of √P."""
    parts = [
        _rows(shown.bands[kind][m], model=f"M{m}", mass_range_msun=mass, spectrum=kind)
        for kind in kinds
        for m, mass in enumerate(class_names(configs))
    ]
    if "density" in kinds:
        for m, mass in enumerate(class_names(configs)):
            names = {"model": f"M{m}", "mass_range_msun": mass}
            parts.append(_rows(shown.clean[m], **names, spectrum="density without noise"))
        parts.append(_rows(shown.noise, model="", mass_range_msun="", spectrum="shot noise"))
    return pd.concat(parts, ignore_index=True)


def bispectrum_table(bispectra: Sequence[Bispectrum], configs: Sequence[EnsembleConfig]) -> pd.DataFrame:
    """The numbers of the bispectra: per class, part and scale the median and the band."""
    parts = []
    for m, (found, mass) in enumerate(zip(bispectra, class_names(configs), strict=True)):
        names = {"model": f"M{m}", "mass_range_msun": mass}
        for part, band in (("real", found.real), ("imaginary", found.imaginary)):
            frame = _rows(band, **names, part=part, scale_1_deg=found.scale_1)
            parts.append(frame.rename(columns=lambda name: name.replace("sqrt_power_deg", "abs_b")))
    return pd.concat(parts, ignore_index=True)


def _rows(band: SpectrumBand, **names: str | float) -> pd.DataFrame:
    return pd.DataFrame(
        {
            **names,
            "n_streams": band.n_streams,
            "scale_deg": band.scale,
            "quantile_16_sqrt_power_deg": band.low,
            "median_sqrt_power_deg": band.median,
            "quantile_84_sqrt_power_deg": band.high,
        }
    )


def sentence(shown: Shown, configs: Sequence[EnsembleConfig]) -> str:
    """What the figure of the density spectrum shows now, in words."""
    largest = float(shown.noise.scale[0])
    heights = ", ".join(
        f"{label} {band.median[0]:.2g}"
        for label, band in zip(model_labels(configs), shown.bands["density"], strict=True)
    )
    clean = sum(s.clean_true for s in shown.statements)
    observed = sum(s.observed_true for s in shown.statements)
    return (
        f"Fluctuations of the density by their size, from the whole stream ({largest:.0f}°) down to 1°, at "
        f"σ_ε = {shown.sigma:g}: median over streams and the band of 68 % of them. At {largest:.0f}° "
        f"√P is {heights}, and {shown.noise.median[0]:.2g} of shot noise alone. "
        f"Of the {number_of(len(shown.statements), 'statement')} after the paper, {clean} "
        f"{is_or_are(clean)} true of these streams without noise, and {observed} as observed."
    )


def track_sentence(shown: Shown, configs: Sequence[EnsembleConfig]) -> str:
    """What the figures of track and cross spectra show now, in words."""
    parts, labels = [], model_labels(configs)
    for m, config in enumerate(configs):
        track, cross = shown.bands["track"][m], shown.bands["cross"][m]
        left_out = config.n_streams - track.n_streams
        gone = f" ({left_out} of its streams have no stars somewhere and do not count)" if left_out else ""
        parts.append(f"{labels[m]} {track.median[0]:.2g} and {cross.median[0]:.2g}{gone}")
    scale = shown.bands["track"][0].scale[0]
    return (
        f"The track in parallel frequency, and what it has in common with the density; at {scale:.0f}° √P "
        f"is: {'; '.join(parts)}. Shot noise is in the density only, so that it does not touch the track."
    )


def bispectrum_sentence(bispectra: Sequence[Bispectrum], configs: Sequence[EnsembleConfig]) -> str:
    """What the figures of the bispectrum show now, in words."""
    parts = [
        f"{label} {b.real.median[0]:.1e} and {b.imaginary.median[0]:.1e}"
        for label, b in zip(model_labels(configs), bispectra, strict=True)
    ]
    return (
        f"Three waves at a time, for 1/k₁ = {bispectra[0].scale_1:.1f}°: the real part measures skewness, "
        f"the imaginary part how much more gradual one side of the gaps is. Medians at "
        f"{bispectra[0].real.scale[0]:.0f}°: {'; '.join(parts)}."
    )


def statement_text(statement: Statement, configs: Sequence[EnsembleConfig]) -> str:
    """A tested statement as a person would say it, without its verdict."""
    labels = model_labels(configs)
    names = [labels[m] for m in statement.classes]
    if statement.kind == "detected":
        return f"{names[0]} stands out of the shot noise"
    return f"{names[0]} and {names[1]} are told apart"
