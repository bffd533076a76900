"""ln B per bin of PDF(Qρ) with its method error (paper fig. 5), and its growth with the streams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.config import EnsembleConfig
from streamdash.naming import class_colour, class_names, model_labels
from streamdash.plots.elements import (
    error_bars,
    framed,
    grey_spans,
    hover_spans,
    level_lines,
    line,
    nice_top,
    points,
    runs,
)
from streamdash.plots.live import Backend, Columns, use
from streamdash.plots.pdf import BINS, EXCLUDED, Q_LABEL, frame
from streamdash.plots.style import INK
from streamdash.statistics.evidence import RULES, Comparison, compare, jeffreys
from streamdash.statistics.evidence_growth import Growth
from streamdash.statistics.evidence_noise import AgainstNoise
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams
from streamdash.words import is_or_are, number_of

NOW = "now"
"""Label of the line at the noise chosen."""
STRONG = 5.0
"""Jeffreys' limit of strong evidence."""
LEVELS = (-5.0, -2.5, -1.0, 1.0, 2.5, 5.0)
"""Jeffreys' limits of weak, moderate and strong evidence, drawn dashed."""
APART = 0.16
"""Distance between the dots of neighbouring models, in widths of a bin."""


def evidence_figure(
    cache: Cache,
    ensembles: Sequence[str | EnsembleConfig],
    fiducial: int = 0,
    noise: float = 0.1,
    n_bin: int = 20,
    rules: str = "central",
    backend: Backend = "matplotlib",
) -> hv.Overlay:
    """ln B^{fid i}_ij of every bin α against each other model j (paper fig. 5).

    Parameters
    ----------
    cache
        Where the ensembles and the stream's geometry are.
    ensembles
        Keys or configurations, lowest masses first.
    fiducial
        Number of the model the data are assumed to come from, 0 for the lowest masses.
    noise
        Shot noise σ_ε per bin.
    n_bin
        Number of bins in Qρ.
    rules
        Which bins count: a name of `streamdash.statistics.evidence.RULES`.
    backend
        ``matplotlib`` for files, ``bokeh`` for the browser.
    """
    # Collect
    streams = ObservedStreams.read(cache, ensembles)
    # Compute
    comparison = compare(streams.noisy(noise), noise, n_bin, RULES[rules])
    # Plot
    return draw(comparison, fiducial, streams.configs, backend)


# ---------------------------------------------------------------- plot: ln B per bin


def others(comparison: Comparison, fiducial: int) -> list[int]:
    """The models that the fiducial one is compared with."""
    return [j for j in range(comparison.n_models) if j != fiducial]


def excluded_bins(comparison: Comparison, fiducial: int) -> np.ndarray:
    """Bins α left out of the sum against every other model, (n_bin,) of bool."""
    kept = [comparison.evidence.kept(fiducial, fiducial, j) for j in others(comparison, fiducial)]
    return ~np.any(kept, axis=0)


def draw(
    comparison: Comparison,
    fiducial: int,
    configs: Sequence[EnsembleConfig],
    backend: Backend,
    title: str = "",
) -> hv.Overlay:
    """Declare the figure of ln B per bin; in the browser its data are then replaced by `columns`."""
    use(backend)
    data = columns(comparison, fiducial)
    left, right = data[EXCLUDED]["x0"], data[EXCLUDED]["x1"]
    parts: list[hv.Element] = [
        grey_spans(EXCLUDED, left, right, backend),
        level_lines("levels", LEVELS, backend),
        level_lines("zero", [0.0], backend, dashed=False),
    ]
    for j in others(comparison, fiducial):
        colour, dots, bars = class_colour(j, configs), data[f"ln_b {j}"], data[f"error {j}"]
        parts.append(error_bars(f"error {j}", bars["base"], bars["lower"], bars["upper"], colour, backend))
        parts.append(points(f"ln_b {j}", dots["x"], dots["y"], colour, backend))
    if backend == "bokeh":
        labels = model_labels(configs)
        names = [(f"against {labels[j]}", f"@text{j}") for j in others(comparison, fiducial)]
        where = [("bin α", "@number"), ("Qρ", "@x0{0.000} to @x1{0.000}")]
        parts.append(hover_spans(BINS, data[BINS], [*where, *names]))
    ranges = y_frame(comparison, fiducial)
    ylabel = f"ln B for M{fiducial}"
    return framed(parts, Q_LABEL, ylabel, frame(comparison)["x"], ranges, backend, title)


def columns(comparison: Comparison, fiducial: int) -> Columns:
    """Arrays of the figure of ln B by element label and column name, for `LiveFigure.patch`."""
    edges, evidence = comparison.edges, comparison.evidence
    left, right = runs(edges, excluded_bins(comparison, fiducial))
    bins = {"x0": edges[:-1], "x1": edges[1:], "number": np.arange(1, len(edges))}
    result: dict[str, dict[str, np.ndarray]] = {EXCLUDED: {"x0": left, "x1": right}, BINS: bins}
    rivals = others(comparison, fiducial)
    for place, j in enumerate(rivals):
        median, low, high = evidence.ln_bayes(fiducial, fiducial, j)
        shift = APART * (place - 0.5 * (len(rivals) - 1)) * (edges[1] - edges[0])
        x = comparison.centers + shift
        result[f"ln_b {j}"] = {"x": x, "y": median}
        result[f"error {j}"] = {"base": x, "lower": low, "upper": high}
        kept = evidence.kept(fiducial, fiducial, j)
        bins[f"text{j}"] = np.array(
            [_bin_text(*values) for values in zip(median, low, high, kept, strict=True)]
        )
    return result


def y_frame(comparison: Comparison, fiducial: int) -> tuple[float, float]:
    """Range of ln B shown; it moves in steps and always holds 0 and 1."""
    spread = [comparison.evidence.ln_bayes(fiducial, fiducial, j) for j in others(comparison, fiducial)]
    values = np.concatenate([np.ravel(s) for s in spread])
    values = values[np.isfinite(values)]
    low, high = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    return -nice_top(max(-low, 0.4)), nice_top(max(high, 1.0))


def _bin_text(median: float, low: float, high: float, kept: bool) -> str:
    if not np.isfinite(median):
        return "too few samples"
    return f"{median:.2f} ({low:.2f} to {high:.2f}){'' if kept else ', excluded'}"


# ---------------------------------------------------------------- plot: growth with the streams


def draw_growth(
    curves: Mapping[int, Growth], configs: Sequence[EnsembleConfig], backend: Backend, title: str = ""
) -> hv.Overlay:
    """Σ ln B from ever more simulated streams, one line for each model compared with."""
    use(backend)
    data = growth_columns(curves)
    parts: list[hv.Element] = []
    for j in curves:
        colour, bars, dots = class_colour(j, configs), data[f"error {j}"], data[f"growth {j}"]
        parts.append(error_bars(f"error {j}", bars["base"], bars["lower"], bars["upper"], colour, backend))
        parts.append(line(f"growth {j}", dots["x"], dots["y"], colour, backend))
        parts.append(points(f"dots {j}", dots["x"], dots["y"], colour, backend))
    x, y = growth_frame(curves)
    return framed(parts, "simulated streams per class", "Σ ln B over bins", x, y, backend, title)


def growth_columns(curves: Mapping[int, Growth]) -> Columns:
    """Arrays of the figure of growth by element label and column name."""
    result: dict[str, dict[str, np.ndarray]] = {}
    for j, curve in curves.items():
        x = curve.n_streams.astype(float)
        scatter = np.nan_to_num(curve.scatter)
        result[f"growth {j}"] = {"x": x, "y": curve.mean}
        result[f"dots {j}"] = {"x": x, "y": curve.mean}
        result[f"error {j}"] = {"base": x, "lower": curve.mean - scatter, "upper": curve.mean + scatter}
    return result


def growth_frame(curves: Mapping[int, Growth]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ranges of the axes of the figure of growth."""
    most = max(float(curve.n_streams[-1]) for curve in curves.values())
    ends = [
        (curve.mean - np.nan_to_num(curve.scatter), curve.mean + np.nan_to_num(curve.scatter))
        for curve in curves.values()
    ]
    low = min(float(a.min()) for a, _ in ends)
    high = max(float(b.max()) for _, b in ends)
    bottom = -nice_top(-low) if low < 0 else 0.0
    return (0.0, most * 1.04), (bottom, nice_top(max(high, 1.0)))


# ---------------------------------------------------------------- plot: against the noise


def draw_noise(
    curves: Mapping[int, AgainstNoise], configs: Sequence[EnsembleConfig], noise: float, backend: Backend
) -> hv.Overlay:
    """Σ ln B against the shot noise, one line for each model compared with; the noise chosen is dashed."""
    use(backend)
    parts: list[hv.Element] = [level_lines("zero", [0.0], backend, dashed=False)]
    tops, bottoms = [1.0], [0.0]
    for j, curve in curves.items():
        colour = class_colour(j, configs)
        low, high = curve.low, curve.high
        parts.append(error_bars(f"error {j}", curve.noise, low, high, colour, backend))
        parts.append(line(f"against {j}", curve.noise, curve.value, colour, backend))
        parts.append(points(f"dots {j}", curve.noise, curve.value, colour, backend))
        tops.append(float(np.nanmax(high)))
        bottoms.append(float(np.nanmin(low)))
    top, low_end = nice_top(max(tops)), min(bottoms)
    bottom = -nice_top(-low_end) if low_end < 0 else 0.0
    now = noise_columns(noise, (bottom, top))[NOW]
    parts.append(line(NOW, now["x"], now["y"], INK["light"], backend, dashed=True))
    return framed(
        parts,
        "shot noise σ_ε per bin" if backend == "matplotlib" else "shot noise σ per bin",
        "Σ ln B over bins",
        (0.0, 1.02),
        (bottom, top),
        backend,
    )


def noise_columns(noise: float, ends: tuple[float, float]) -> dict[str, dict[str, np.ndarray]]:
    """Arrays of the line at the noise chosen, from one end of the axis to the other."""
    return {NOW: {"x": np.full(2, noise), "y": np.array(ends)}}


def noise_table(curves: Mapping[int, AgainstNoise], fiducial: int) -> pd.DataFrame:
    """The numbers of the figure against noise, one line per model compared with and noise."""
    parts = [
        pd.DataFrame(
            {
                "fiducial": f"M{fiducial}",
                "against": f"M{j}",
                "noise": curve.noise,
                "sum_ln_bayes": curve.value,
                "method_error_16": curve.low,
                "method_error_84": curve.high,
                "bins_in_sum": curve.n_kept,
            }
        )
        for j, curve in curves.items()
    ]
    return pd.concat(parts, ignore_index=True)


def noise_sentence(curves: Mapping[int, AgainstNoise], fiducial: int) -> str:
    """Up to which noise the evidence is strong, in words."""
    parts = []
    for j, curve in curves.items():
        strong = curve.value >= STRONG
        if strong.all():
            parts.append(f"against M{j} the evidence is strong at every noise shown")
        elif not strong[0]:
            parts.append(f"against M{j} it is not strong even at σ_ε = {curve.noise[0]:g}")
        else:
            last = int(np.argmin(strong))
            parts.append(
                f"against M{j} it is strong (Σ ln B of {STRONG:g} or more) up to σ_ε = "
                f"{curve.noise[last - 1]:g} and no more at {curve.noise[last]:g}"
            )
    return (
        f"Fiducial M{fiducial}: {'; '.join(parts)}. The sum ignores correlations between bins; "
        "how accurate a classifier is at each noise is on the Classifier page."
    )


# ---------------------------------------------------------------- words and numbers


def table(comparison: Comparison, fiducial: int, configs: Sequence[EnsembleConfig]) -> pd.DataFrame:
    """The numbers of the figure of ln B: per bin and model compared with, value, error and exclusion."""
    evidence, masses = comparison.evidence, class_names(configs)
    parts = []
    for j in others(comparison, fiducial):
        median, low, high = evidence.ln_bayes(fiducial, fiducial, j)
        parts.append(
            pd.DataFrame(
                {
                    "fiducial": f"M{fiducial}",
                    "against": f"M{j}",
                    "fiducial_mass_range_msun": masses[fiducial],
                    "against_mass_range_msun": masses[j],
                    "bin": np.arange(1, len(median) + 1),
                    "q_rho_from": comparison.edges[:-1],
                    "q_rho_to": comparison.edges[1:],
                    "ln_bayes": median,
                    "method_error_16": low,
                    "method_error_84": high,
                    "kept": evidence.kept(fiducial, fiducial, j),
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def sentence(comparison: Comparison, fiducial: int, configs: Sequence[EnsembleConfig]) -> str:
    """What the figure of ln B shows now, in words."""
    evidence, labels = comparison.evidence, model_labels(configs)
    parts = []
    for j in others(comparison, fiducial):
        total = evidence.cumulative(fiducial, fiducial, j)
        name = labels[j]
        if not total.n_kept:
            parts.append(f"against {name} no bin can be compared")
            continue
        give = "counts gives" if total.n_kept == 1 else "count give"
        parts.append(
            f"against {name} the {number_of(total.n_kept, 'bin')} that {give} Σ ln B = {total.value:z.1f}, "
            f"{words(total.value)}, at most {total.largest:.2f} in one bin"
        )
    grey = int(excluded_bins(comparison, fiducial).sum())
    return (
        f"If the perturbers are {labels[fiducial]}: "
        f"{'; '.join(parts)}. {grey} of {len(comparison.centers)} bins {is_or_are(grey)} excluded (grey). "
        "The sum ignores correlations between bins; bars are the spread over 10 to 500 bins of y."
    )


def growth_table(curves: Mapping[int, Growth], fiducial: int) -> pd.DataFrame:
    """The numbers of the figure of growth, one line per model compared with and number of streams."""
    parts = [
        pd.DataFrame(
            {
                "fiducial": f"M{fiducial}",
                "against": f"M{j}",
                "n_streams": curve.n_streams,
                "sum_ln_bayes": curve.mean,
                "scatter": curve.scatter,
                "bins_in_sum": curve.n_kept,
            }
        )
        for j, curve in curves.items()
    ]
    return pd.concat(parts, ignore_index=True)


def growth_sentence(curves: Mapping[int, Growth], fiducial: int, n_bin: int) -> str:
    """What the figure of growth shows now, in words."""
    parts = []
    for j, curve in curves.items():
        if len(curve.mean) < 2:
            parts.append(f"against M{j} there are too few streams to tell")
            continue
        half = max(int(np.searchsorted(curve.n_streams, curve.n_streams[-1] / 2, side="right")) - 1, 0)
        change = curve.mean[-1] - curve.mean[half]
        parts.append(
            f"against M{j} Σ ln B is {curve.mean[-1]:z.1f} from {curve.n_streams[-1]} streams, "
            f"{change:+z.1f} since {curve.n_streams[half]}"
        )
    return (
        f"Fiducial M{fiducial}, {number_of(n_bin, 'bin')} of Qρ: {'; '.join(parts)}. Bars: scatter between "
        "separate sets of as many streams. The last point is the sum in the table."
    )


def words(ln_bayes: float) -> str:
    """Jeffreys' word with its direction, for example ``strong evidence`` or ``weak, the wrong way``."""
    word = jeffreys(ln_bayes)
    if word == "inconclusive":
        return word
    return f"{word} evidence" if ln_bayes > 0 else f"{word} evidence the wrong way"
