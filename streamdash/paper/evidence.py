"""The paper's Bayesian model selection from the cache: every number of it, beside the paper's.

`measure` returns one plain dictionary, written as ``results.json`` by ``streamdash reproduce``;
tables and text (`streamdash.paper.tables`) are rendered from it alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from streamdash.config import Perturbers, Population, StreamModel, parse_mass_range
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import expected_impacts
from streamdash.statistics.cumulative import N_RESAMPLES, cumulative_tables, paper_value
from streamdash.statistics.evidence import PAPER_RULES, Rules, measured_evidence, measured_width
from streamdash.statistics.evidence_growth import growth
from streamdash.statistics.overlap import Y_BINS
from streamdash.statistics.pdf import measure_pdfs
from streamdash.store.cache import Cache, Entry, StoreError
from streamdash.survey.observed import ObservedStreams

TWO_CLASSES = ("1e3-1e5", "1e5-1e9")
THREE_CLASSES = ("1e3-1e5", "1e5-1e7", "1e7-1e9")
NOISE = 0.1
"""σ_ε per longitude bin (paper section 2)."""
PAPER = {
    "expected_impacts": {"1e3-1e5": 839, "1e5-1e9": 62},
    "largest_ln_bayes_fiducial_0": [2.5, 4.0],
    "low_mass_pdf": {"mean": 1.0, "width": 0.1},
    "largest_density_ratio": {"1e3-1e5": "about 10 % off", "1e5-1e9": "up to a factor of about 4"},
    "n_longitudes": 300,
}
"""What else the paper states in numbers (sections 2, 3.1.1 and 4.1)."""


def find_entries(cache: Cache, labels: Sequence[str], stream: StreamModel | None = None) -> tuple[Entry, ...]:
    """The largest complete ensemble of each mass range, all else as by default.

    Raises
    ------
    StoreError
        When there is none of a mass range; names the command that makes one.
    """
    stream = stream or StreamModel()
    populations = [Population(components=(Perturbers(mass_range=parse_mass_range(m)),)) for m in labels]
    complete = cache.complete_ensembles(
        lambda c: c.prior is None and c.stream == stream and c.population in populations
    )
    found = []
    for label, population in zip(labels, populations, strict=True):
        fits = [entry for entry in complete if entry.config.population == population]
        if not fits:
            raise StoreError(
                f"The cache has no complete ensemble of {label} M☉; "
                f"run `streamdash simulate --mass {label}` first."
            )
        found.append(max(fits, key=lambda entry: entry.config.n_streams))
    return tuple(found)


def load_sample(cache: Cache, labels: Sequence[str] = (*TWO_CLASSES, *THREE_CLASSES[1:])) -> ObservedStreams:
    """Streams of the shipped ensembles as the paper observes them.

    Raises
    ------
    StoreError
        When an ensemble or the geometry is missing.
    """
    configs = [entry.config for entry in find_entries(cache, labels)]
    if cache.open_geometry(configs[0].stream) is None:
        raise StoreError("The cache has no geometry of this stream; run `streamdash simulate` first.")
    return ObservedStreams.read(cache, configs)


def measure(
    sample: ObservedStreams, geometry: Geometry, noise: float = NOISE, n_resamples: int = N_RESAMPLES
) -> dict[str, Any]:
    """Everything the text and the tables say, as plain numbers.

    Parameters
    ----------
    sample : ObservedStreams
        With the paper's two and three classes.
    geometry : Geometry
        Of their stream.
    noise : float
        σ_ε.
    n_resamples : int
        Resamplings for the sampling errors.
    """
    edges = sample.design.edges
    return {
        "noise": noise,
        "n_longitudes": sample.q[0].shape[1],
        "longitudes_deg": [float(edges[0]), float(edges[-1])],
        "rules": {"n_sigma": PAPER_RULES.n_sigma, "min_streams": PAPER_RULES.min_streams},
        "y_bins": [min(Y_BINS), max(Y_BINS), len(Y_BINS)],
        "ensembles": [_ensemble_facts(sample, geometry, place) for place in range(len(sample.labels))],
        "two_classes": compare(sample.only(TWO_CLASSES), noise, n_resamples),
        "three_classes": compare(sample.only(THREE_CLASSES), noise, n_resamples),
        "paper": PAPER,
    }


def compare(sample: ObservedStreams, noise: float, n_resamples: int) -> dict[str, Any]:
    """Table 1 for these classes: every ordered pair and the paper's numbers of bins.

    ``tables`` follow the paper's rules, ``central`` those that this project uses by default.
    """

    def redraw(number: int) -> list[np.ndarray]:
        return sample.noisy(noise, number)

    tables, ours = (
        cumulative_tables(sample.noisy(noise), noise, n_resamples, rules=rules, redraw=redraw)
        for rules in (PAPER_RULES, Rules())
    )
    if sample.labels == TWO_CLASSES:
        for table in tables:
            for row in table["pairs"]:
                row["paper"] = paper_value(row["i"], row["j"], table["n_bin"])
    return {
        "labels": list(sample.labels),
        "tables": tables,
        "central": ours,
        "growth": _growth_facts(sample, noise),
        "pdf": _pdf_facts(sample, noise),
    }


def _pdf_facts(sample: ObservedStreams, noise: float, n_bin: int = 20) -> list[dict[str, Any]]:
    """Per class, the median PDF(Qρ): where it peaks, how high, and how wide it is."""
    pdfs = measure_pdfs(sample.noisy(noise), n_bin)
    facts = []
    for model, label in enumerate(sample.labels):
        median = pdfs.band(model).median
        peak = int(np.argmax(median))
        high = pdfs.centers[median >= 0.5 * median[peak]]
        facts.append(
            {
                "label": label,
                "peak_q_rho": float(pdfs.centers[peak]),
                "peak": float(median[peak]),
                "half_height_from": float(high.min()),
                "half_height_to": float(high.max()),
            }
        )
    return facts


def _growth_facts(sample: ObservedStreams, noise: float, n_bin: int = 20) -> dict[str, Any]:
    """Σ ln B from ever more streams, for the first pair of models in both directions."""
    pdfs, evidence = measured_evidence(sample.noisy(noise), noise, n_bin, PAPER_RULES)
    curves = []
    for i, j in ((0, 1), (1, 0)):
        curve = growth(pdfs, evidence, i, j)
        curves.append(
            {
                "i": i,
                "j": j,
                "n_streams": curve.n_streams.tolist(),
                "mean": curve.mean.tolist(),
                "bins_in_sum": curve.n_kept.tolist(),
                "scatter": [None if np.isnan(s) else float(s) for s in curve.scatter],
            }
        )
    return {"n_bin": n_bin, "curves": curves}


def _ensemble_facts(sample: ObservedStreams, geometry: Geometry, place: int) -> dict[str, Any]:
    config, q = sample.configs[place], sample.q[place]
    low, middle, high = np.quantile(q, (0.1587, 0.5, 0.8413))
    return {
        "label": sample.labels[place],
        "key": config.key,
        "n_streams": len(q),
        "expected_impacts": float(expected_impacts(geometry, config.population)),
        "q_rho_quantiles": [float(low), float(middle), float(high)],
        "q_rho_extremes": [float(q.min()), float(q.max())],
        "width_without_noise": measured_width(q),
        "width_with_noise": measured_width(sample.only([place]).noisy(NOISE)[0]),
    }
