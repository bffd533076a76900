"""What each choice that the paper leaves open does to table 1, one choice at a time.

`CHOICES` lists them; `measure_choices` evaluates Σ ln B for the paper's two classes with each of
them changed alone, everything else as in `streamdash.paper.evidence`. Nothing is fitted: the settings
of this project are those read off the paper's words, whatever they give.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from streamdash.engine.geometry import Geometry
from streamdash.paper.evidence import NOISE, THREE_CLASSES, TWO_CLASSES
from streamdash.simulation.geometry import load_geometry
from streamdash.statistics.evidence import PAPER_N_BINS, PAPER_RULES, Rules, measure_evidence, measured_width
from streamdash.statistics.pdf import Pdfs, central_range, common_range, measure_pdfs
from streamdash.store.cache import Cache
from streamdash.survey import sky
from streamdash.survey.design import Design
from streamdash.survey.observed import ObservedStreams, open_ensembles

PAIRS = ((0, 1), (1, 0))


@dataclass(frozen=True)
class Setting:
    """One complete way from streams to table 1.

    Attributes
    ----------
    profiles : list of ndarray (n_streams, n_longitudes)
        Qρ with noise, per model.
    value_range : (float, float), optional
        Range of Qρ; the widest where every model has samples when not given.
    inside_only : bool
        Normalise PDF(Qρ) by the values inside the range (True) or by all of them.
    rules : Rules
    width : float, optional
        Width in rule 1; σ_ε when not given.
    average : callable
        How ln B is summarised over the numbers of bins in y.
    min_overlap : int
        Leave out bins α in which fewer than this many streams of either model lie within the other
        model's range of y.
    """

    profiles: list[np.ndarray]
    value_range: tuple[float, float] | None = None
    inside_only: bool = True
    rules: Rules = PAPER_RULES
    width: float | None = None
    average: Callable[..., np.ndarray] = np.median
    min_overlap: int = 0

    def totals(self, n_bin: int) -> list[tuple[float, int]]:
        """Σ ln B^{fid 0}_01 and Σ ln B^{fid 1}_10, each with the number of bins α in it."""
        pdfs = measure_pdfs(self.profiles, n_bin, self.value_range)
        if not self.inside_only:
            pdfs = _over_all_values(pdfs, self.profiles)
        evidence = measure_evidence(pdfs, NOISE, self.rules, width=self.width)
        enough = _overlap(pdfs) >= self.min_overlap
        result = []
        for i, j in PAIRS:
            kept = evidence.kept(i, i, j) & enough
            samples = evidence.ln_bayes_by_y_bins(i, i, j)[:, kept]
            result.append((float(self.average(samples, axis=0).sum()), int(kept.sum())))
        return result


@dataclass(frozen=True)
class Choice:
    """One thing the paper leaves open, done in another way.

    Attributes
    ----------
    topic : str
        What is chosen.
    text : str
        This way of doing it.
    settings : callable
        From `Materials` to one or several settings; several are averaged and their scatter shown.
    """

    topic: str
    text: str
    settings: Callable[[Materials], Setting | list[Setting]]


@dataclass(frozen=True)
class Materials:
    """What settings are made of: the two classes, all classes, their stream and cache, the plain setting."""

    sample: ObservedStreams
    every: ObservedStreams
    geometry: Geometry
    cache: Cache
    plain: Setting

    def observed(self, edges: np.ndarray, coordinate: sky.Coordinate = "ell") -> list[np.ndarray]:
        """Qρ without noise in other bins along the stream."""
        return list(
            ObservedStreams.read(self.cache, self.sample.configs, Design.adjoining(coordinate, edges)).q
        )

    def at_points(self) -> list[np.ndarray]:
        """Qρ without noise at the middles of the bins instead of averaged over them."""
        geometry, edges = self.geometry, self.sample.design.edges
        theta = sky.ell_to_theta(geometry, 0.5 * (edges[1:] + edges[:-1]))
        result = []
        for ensemble in open_ensembles(self.cache, self.sample.configs).datasets:
            q = ensemble["density"].values / ensemble["smooth"].values
            grid = ensemble["theta"].values
            result.append(np.stack([np.interp(theta, grid, row) for row in q]).astype(np.float32))
        return result

    def with_noise(self, profiles: Sequence[np.ndarray], seed: int = 0) -> list[np.ndarray]:
        """Profiles with shot noise from other draws."""
        return [sky.add_noise(q, sky.shot_noise(q.shape, seed), NOISE) for q in profiles]

    def noise_on_density(self) -> list[np.ndarray]:
        """Noise of σ_ε on ρ itself, in units of ρ̄ near the progenitor, then divided by ρ̄."""
        geometry, edges = self.geometry, self.sample.design.edges
        grid = np.linspace(0.0, sky.ell_to_theta(geometry, edges[-1:])[0] * 1.02, 4000)
        smooth = sky.observe(geometry, grid, geometry.smooth_density(grid), edges)
        return [
            (q + NOISE * d / smooth).astype(np.float32)
            for q, d in zip(self.sample.q, self.sample.draws, strict=True)
        ]


def _with_rules(**changes: Any) -> Callable[[Materials], Setting]:
    return lambda m: replace(m.plain, rules=replace(m.plain.rules, **changes))


def _with_overlap(least: int) -> Callable[[Materials], Setting]:
    return lambda m: replace(m.plain, min_overlap=least)


def _with_range(choose: Callable[[Materials], tuple[float, float]]) -> Callable[[Materials], Setting]:
    return lambda m: replace(m.plain, value_range=choose(m))


def _with_profiles(choose: Callable[[Materials], list[np.ndarray]]) -> Callable[[Materials], Setting]:
    return lambda m: replace(m.plain, profiles=choose(m))


def _streams(part: slice) -> Callable[[Materials], Setting]:
    return _with_profiles(lambda m: [q[part] for q in m.plain.profiles])


def _widest(profiles: Sequence[np.ndarray]) -> tuple[float, float]:
    return min(float(q.min()) for q in profiles), max(float(q.max()) for q in profiles)


def _overlap(pdfs: Pdfs) -> np.ndarray:
    """The smaller number of streams, of the two models, within the other's range of y, (n_bin,)."""
    first, second = pdfs.y

    def inside(y: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.count_nonzero((y >= other.min(axis=0)) & (y <= other.max(axis=0)), axis=0)

    return np.minimum(inside(first, second), inside(second, first))


def _over_all_values(pdfs: Pdfs, profiles: Sequence[np.ndarray]) -> Pdfs:
    low, high = pdfs.edges[0], pdfs.edges[-1]
    inside = [((q >= low) & (q <= high)).mean(axis=1, keepdims=True) for q in profiles]
    return Pdfs(pdfs.edges, tuple(y * share for y, share in zip(pdfs.y, inside, strict=True)))


RANGE, NORMALISATION = "Range of Qρ", "Normalisation of PDF(Qρ)"
BINS, INTEGRAL, FAR, FEW = "Bins of y", "Integral", "Distance from the peak", "Samples"
ALONG, SHOT, STREAMS = "Bins along the stream", "Shot noise", "Simulated streams"
MODEL = "Other streams"
"""Not a choice left open but another model, for comparison."""

CHOICES: tuple[Choice, ...] = (
    Choice(
        RANGE,
        "from the smallest to the largest value of any model",
        _with_range(lambda m: _widest(m.plain.profiles)),
    ),
    Choice(
        RANGE, "where both models have values without noise", _with_range(lambda m: common_range(m.sample.q))
    ),
    Choice(RANGE, "central 99.8 % of both models", _with_range(lambda m: central_range(m.plain.profiles))),
    Choice(RANGE, "0 to 2", _with_range(lambda m: (0.0, 2.0))),
    Choice(
        NORMALISATION,
        "by all values of the stream, also those outside the range",
        lambda m: replace(m.plain, inside_only=False),
    ),
    Choice(BINS, "10, 11, …, 500", _with_rules(y_bins=tuple(range(10, 501)))),
    Choice(
        BINS,
        "12 numbers from 10 to 500 in equal ratios",
        _with_rules(y_bins=tuple(np.geomspace(10, 500, 12).round().astype(int).tolist())),
    ),
    Choice(BINS, "only 10", _with_rules(y_bins=(10,))),
    Choice(BINS, "only 50, as in the paper's figure 4", _with_rules(y_bins=(50,))),
    Choice(BINS, "only 500", _with_rules(y_bins=(500,))),
    Choice(BINS, "starting at y = 0 instead of the smallest y", _with_rules(from_zero=True)),
    Choice(BINS, "mean over numbers of bins instead of median", lambda m: replace(m.plain, average=np.mean)),
    Choice(
        INTEGRAL, "sum of heights times widths instead of the trapezoidal rule", _with_rules(trapezoid=False)
    ),
    Choice(INTEGRAL, "no stream paired with itself in E_ii", _with_rules(self_pairs=False)),
    Choice(FAR, "2.5 σ_ε", _with_rules(n_sigma=2.5)),
    Choice(FAR, "3.5 σ_ε", _with_rules(n_sigma=3.5)),
    Choice(FAR, "4 σ_ε", _with_rules(n_sigma=4.0)),
    Choice(FAR, "no limit", _with_rules(n_sigma=np.inf)),
    Choice(FAR, "whole bin within 3 σ_ε", _with_rules(reach="whole")),
    Choice(FAR, "any part of the bin within 3 σ_ε", _with_rules(reach="part")),
    Choice(
        FAR,
        "3 measured widths of the low-mass PDF",
        lambda m: replace(m.plain, width=measured_width(m.plain.profiles[0])),
    ),
    Choice(FEW, "at least 1 stream in the bin", _with_rules(min_streams=1)),
    Choice(FEW, "at least 100 streams in the bin", _with_rules(min_streams=100)),
    Choice(FEW, "at least 1000 streams in the bin", _with_rules(min_streams=1000)),
    Choice(FEW, "at least 10 streams of each within the other’s range of y", _with_overlap(10)),
    Choice(FEW, "at least 100 streams of each within the other’s range of y", _with_overlap(100)),
    Choice(
        ALONG,
        "347 equal bins in θ∥ instead of ℓ",
        _with_profiles(lambda m: m.with_noise(m.observed(_theta_edges(m), "theta"))),
    ),
    Choice(
        ALONG,
        "values at the middles of the bins instead of averages",
        _with_profiles(lambda m: m.with_noise(m.at_points())),
    ),
    Choice(
        ALONG,
        "300 bins over the same longitudes",
        _with_profiles(lambda m: m.with_noise(m.observed(_even_edges(m, 300)))),
    ),
    Choice(
        ALONG,
        "without the last 5° of the tail",
        _with_profiles(lambda m: [q[:, :-25] for q in m.plain.profiles]),
    ),
    Choice(
        SHOT,
        "on ρ (σ_ε of ρ̄ near the progenitor) instead of on Qρ",
        _with_profiles(lambda m: m.noise_on_density()),
    ),
    Choice(
        SHOT,
        "five other realisations",
        lambda m: [replace(m.plain, profiles=m.with_noise(m.sample.q, seed)) for seed in range(1, 6)],
    ),
    Choice(STREAMS, "the first 1000 of each", _streams(slice(0, 1000))),
    Choice(STREAMS, "the other 1000 of each", _streams(slice(1000, 2000))),
    Choice(
        STREAMS,
        "four sets of 500 of each",
        lambda m: [_streams(slice(k, k + 500))(m) for k in range(0, 2000, 500)],
    ),
    Choice(
        MODEL,
        f"{THREE_CLASSES[2]} M☉ in place of {TWO_CLASSES[1]} M☉",
        _with_profiles(lambda m: m.every.only((TWO_CLASSES[0], THREE_CLASSES[2])).noisy(NOISE)),
    ),
)
"""Every choice that is measured."""


def _even_edges(materials: Materials, n_bin: int) -> np.ndarray:
    edges = materials.sample.design.edges
    return np.linspace(edges[0], edges[-1], n_bin + 1)


def _theta_edges(materials: Materials) -> np.ndarray:
    edges = materials.sample.design.edges
    ends = sky.ell_to_theta(materials.geometry, edges[[0, -1]])
    return np.linspace(ends[0], ends[1], len(edges))


def measure_choices(
    cache: Cache, sample: ObservedStreams, choices: Sequence[Choice] = CHOICES
) -> list[dict[str, Any]]:
    """Table 1 with each choice changed alone; the first row is the plain setting.

    Parameters
    ----------
    cache : Cache
        Where the ensembles of the sample are.
    sample : ObservedStreams
        With the paper's two and three classes.
    choices : sequence of Choice

    Returns
    -------
    list of dict
        ``topic``, ``text``, ``fid_0`` and ``fid_1`` (Σ ln B per number of bins of Qρ), ``scatter_0`` and
        ``scatter_1`` (standard deviation over realisations, or None), and ``kept``, the mean number of
        bins α in the sum.
    """
    two = sample.only(TWO_CLASSES)
    geometry = load_geometry(two.configs[0].stream, cache)
    materials = Materials(two, sample, geometry, cache, Setting(two.noisy(NOISE)))
    rows = [_row("As here", "every choice as described", [materials.plain])]
    for choice in choices:
        settings = choice.settings(materials)
        rows.append(_row(choice.topic, choice.text, settings if isinstance(settings, list) else [settings]))
    return rows


def _row(topic: str, text: str, settings: list[Setting]) -> dict[str, Any]:
    totals = np.array([[setting.totals(n_bin) for n_bin in PAPER_N_BINS] for setting in settings])
    mean = totals.mean(axis=0)  # (number of bins, fiducial, value or bins kept)
    scatter = totals[..., 0].std(axis=0, ddof=1) if len(settings) > 1 else None
    return {
        "topic": topic,
        "text": text,
        "fid_0": mean[:, 0, 0].tolist(),
        "fid_1": mean[:, 1, 0].tolist(),
        "kept": mean[:, 0, 1].tolist(),
        "scatter_0": None if scatter is None else scatter[:, 0].tolist(),
        "scatter_1": None if scatter is None else scatter[:, 1].tolist(),
    }
