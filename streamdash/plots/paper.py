"""The paper's figures 1 to 5 and those of its appendices as files, drawn with Matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import holoviews as hv

from streamdash.naming import class_labels
from streamdash.paper.evidence import NOISE, THREE_CLASSES, TWO_CLASSES
from streamdash.plots import convergence, evidence, pdf, profiles, spectrum
from streamdash.plots.full_range import draw_full_range
from streamdash.plots.live import use
from streamdash.statistics.evidence import PAPER_N_BINS, PAPER_RULES, Comparison, compare
from streamdash.store.cache import Cache, StoreError
from streamdash.survey.observed import ObservedStreams

DPI = 150
FIGURE_4_N_BIN = 20


def save_figures(cache: Cache, sample: ObservedStreams, folder: Path) -> list[Path]:
    """Draw figures 1 to 5 and write each as ``figureN.png`` and ``figureN.svg``.

    Parameters
    ----------
    cache
        Where the sample's ensembles are.
    sample
        With the paper's two and three classes.
    folder
        An existing folder.

    Returns
    -------
    list of Path
        The files written.
    """
    return [
        path
        for number, make in FIGURES.items()
        for path in _save(make(cache, sample), folder / f"figure{number}")
    ]


def save_appendix_figures(
    cache: Cache, sample: ObservedStreams, folder: Path
) -> tuple[list[Path], list[str]]:
    """Draw the figures of appendices A and B, each as ``appendix….png`` and ``.svg``.

    Parameters
    ----------
    cache, sample, folder
        As for `save_figures`; figures of appendix A are drawn from the spectra in the cache.

    Returns
    -------
    list of Path, list of str
        The files written, and a sentence for each figure whose spectra the cache lacks.
    """
    keys = sample.only(TWO_CLASSES).keys
    paths = _save(spectrum.spectrum_figure(cache, keys, noise=NOISE), folder / "appendixB")
    lacking = []
    for number, key in enumerate(APPENDIX_A, start=1):
        try:
            figure = convergence.convergence_figure(cache, key)
        except StoreError as error:
            lacking.append(str(error))
        else:
            paths += _save(figure, folder / f"appendixA{number}")
    return paths, lacking


def save_full_range(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw what `streamdash.paper.full_range.full_range_results` found: ``full_range.png`` and ``.svg``."""
    return _save(draw_full_range(results, "matplotlib"), folder / "full_range")


def figure_1(cache: Cache, sample: ObservedStreams) -> hv.Layout:
    """Density along θ∥ for the two classes, without noise (paper fig. 1)."""
    return _densities(cache, sample, TWO_CLASSES)


def figure_2(cache: Cache, sample: ObservedStreams) -> hv.Layout:
    """The same for the two parts of the large mass range (paper fig. 2)."""
    return _densities(cache, sample, THREE_CLASSES[1:])


def figure_3(cache: Cache, sample: ObservedStreams) -> hv.Layout:
    """PDF(Qρ): medians and bands for N_bin = 10, 20, 50, 100 (paper fig. 3)."""
    two = sample.only(TWO_CLASSES)
    panels = [
        pdf.draw(comparison, two.configs, "matplotlib", title=f"N_bin = {n_bin}")
        for n_bin, comparison in _comparisons(two)
    ]
    return _layout(panels, columns=2)


def figure_4(cache: Cache, sample: ObservedStreams) -> hv.Layout:
    """Π(y_α|M) of all bins for N_bin = 20 (paper fig. 4)."""
    two = sample.only(TWO_CLASSES)
    comparison = compare(two.noisy(NOISE), NOISE, FIGURE_4_N_BIN, PAPER_RULES)
    panels = [
        pdf.draw_y(comparison, alpha, two.configs, "matplotlib", f"α = {alpha + 1}")
        for alpha in range(FIGURE_4_N_BIN)
    ]
    return _layout(panels, columns=4)


def figure_5(cache: Cache, sample: ObservedStreams) -> hv.Layout:
    """ln B per bin for N_bin = 10, 20, 50, 100, both fiducials (paper fig. 5)."""
    two = sample.only(TWO_CLASSES)
    panels = [
        evidence.draw(
            comparison,
            fiducial,
            two.configs,
            "matplotlib",
            f"N_bin = {n_bin}, fiducial {class_labels(two.configs)[fiducial]}",
        )
        for n_bin, comparison in _comparisons(two)
        for fiducial in (0, 1)
    ]
    return _layout(panels, columns=2)


FIGURES: dict[int, Callable[[Cache, ObservedStreams], hv.Layout]] = {
    1: figure_1,
    2: figure_2,
    3: figure_3,
    4: figure_4,
    5: figure_5,
}


APPENDIX_A = ("phase", "times", "x", "length", "profile")
"""Keys of the convergence tests in the order of the figures of appendix A."""


def _save(figure: hv.Layout | hv.Overlay, stem: Path) -> list[Path]:
    """Draw a figure once, and write it as PNG and SVG."""
    drawn = use("matplotlib").get_plot(figure).state
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in ("png", "svg")]
    for path in paths:
        drawn.savefig(path, dpi=DPI, bbox_inches="tight")
    return paths


def _densities(cache: Cache, sample: ObservedStreams, labels: Sequence[str]) -> hv.Layout:
    keys = sample.only(labels).keys
    return profiles.profiles_figure(cache, keys, quantity="rho", coordinate="theta")


def _comparisons(sample: ObservedStreams) -> list[tuple[int, Comparison]]:
    noisy = sample.noisy(NOISE)
    return [(n_bin, compare(noisy, NOISE, n_bin, PAPER_RULES)) for n_bin in PAPER_N_BINS]


def _layout(panels: Sequence[hv.Overlay], columns: int) -> hv.Layout:
    layout = hv.Layout(list(panels)).cols(columns)
    return layout.opts(sublabel_format="", tight=True, backend="matplotlib")
