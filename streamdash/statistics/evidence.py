"""Which mass range do the data prefer? Bayes factors from PDF(Qρ), as in the paper.

Section 3.1.2, "Model selection", equations (2)–(6), for each bin α of PDF(Qρ):

    E^{fid f}_i = ∫ Π(y_α|M_f) Π(y_α|M_i) dy_α          (equation 5, likelihood of equation 4)
    ln B^{fid f}_ij = ln E^{fid f}_i − ln E^{fid f}_j    (equation 6; the paper shows f = i)

Both factors are histograms over streams on the same bins of y_α, and the integral is the
trapezoidal rule through their heights. It is repeated for many numbers of bins in y; the
median is the value and the interquantile range its method error.

What the paper leaves open is a documented argument here (`Rules`), and
`streamdash.paper.choices` measures what each choice does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from streamdash.statistics.overlap import Y_BINS, overlap_integrals
from streamdash.statistics.pdf import QUANTILES, Band, Pdfs, central_range, common_range, measure_pdfs

PAPER_N_BINS = (10, 20, 50, 100)
"""Numbers of bins of Qρ in the paper's table 1."""
PAPER_TABLE_1 = {(0, 1): (9.0, 18.0, 33.1, 53.5), (1, 0): (4.0, 5.4, 3.1, 1.3)}
"""Paper, table 1: Σ ln B^{fid i}_ij by (i, j), for 10³–10⁵ (0) and 10⁵–10⁹ M☉ (1), per `PAPER_N_BINS`."""
JEFFREYS = ((1.0, "inconclusive"), (2.5, "weak"), (5.0, "moderate"), (np.inf, "strong"))
"""Upper ends of |ln B| and their words (Trotta 2017, as the paper quotes it)."""


@dataclass(frozen=True)
class Rules:
    """Which bins α count, and how the integrals over y are taken; the paper leaves some of it open.

    Attributes
    ----------
    span : {"central", "extremes"}
        Range of Qρ that is cut into bins: the central 99.8 % of the values of both models, or, as in
        the paper, all between the most extreme values that both have, which hangs on the draw of the
        noise.
    n_sigma : float, optional
        Rule 1: bins α whose centre is farther than this many widths from the peak of the
        lowest-mass model's median PDF are left out (paper: 3). None: no bin is too far.
    width : {"noise", "measured"}
        The width in rule 1: σ_ε, as in the paper, or the measured width of the lowest-mass PDF.
    min_streams : int
        Rule 2: bins α that fewer than this many streams of a model reach (y_α > 0) are left
        out of every comparison with that model: Π(y_α|M) would be little but one bin at 0.
    y_bins : tuple of int
        Numbers of bins in y marginalised over.
    self_pairs : bool
        True, as in the paper: E_ii multiplies a histogram by itself. False leaves out the
        pairing of every stream with itself, which raises E_ii by about one part in the number
        of streams per occupied bin of y.
    trapezoid : bool
        True, as in the paper: the trapezoidal rule through the heights, in which the first and
        the last bin of y count half. False: the sum of heights times widths.
    from_zero : bool
        False: bins of y start at the smallest y_α of any model. True: at 0.
    reach : {"centre", "whole", "part"}
        Rule 1 asks that the centre of a bin α, the whole bin or any part of it lie within reach.
    """

    span: Literal["central", "extremes"] = "central"
    n_sigma: float | None = None
    width: Literal["noise", "measured"] = "noise"
    min_streams: int = 10
    y_bins: tuple[int, ...] = Y_BINS
    self_pairs: bool = True
    trapezoid: bool = True
    from_zero: bool = False
    reach: Literal["centre", "whole", "part"] = "centre"

    def value_range(self, profiles: Sequence[np.ndarray]) -> tuple[float, float]:
        """Range of Qρ to cut into bins.

        Raises
        ------
        ValueError
            If the models have no range in common.
        """
        if self.span == "central":
            low, high = central_range(profiles)
            if low < high:
                return low, high
        return common_range(profiles)


PAPER_RULES = Rules(span="extremes", n_sigma=3.0)
"""The paper's rules: all of the range that both models have, bins within 3 σ_ε of the low-mass peak."""
RULES = {"central": Rules(), "noise": PAPER_RULES, "measured": replace(PAPER_RULES, width="measured")}
"""Rules by name: the default, the paper's, and the paper's with the PDF's own width."""


@dataclass(frozen=True)
class Evidence:
    """ln B of every ordered pair of models, for every fiducial and bin α.

    Axes: ``f`` the fiducial model, ``i`` and ``j`` the models compared, ``alpha`` the bin.

    Attributes
    ----------
    integrals : ndarray (n_y_bins, n_models, n_models, n_bin)
        E^{fid f}_i for each number of bins in y; symmetric in f and i. Units of 1/y, that is of Qρ.
    far : ndarray of bool (n_bin,)
        Rule 1: too far from the peak of the lowest-mass PDF.
    sparse : ndarray of bool (n_models, n_bin)
        Rule 2: too few streams of that model reach the bin.
    quantiles : (float, float)
        Ends of the interquantile range that is the method error.
    """

    integrals: np.ndarray
    far: np.ndarray
    sparse: np.ndarray
    quantiles: tuple[float, float] = QUANTILES[::2]

    @property
    def n_models(self) -> int:
        """Number of models."""
        return self.integrals.shape[1]

    @property
    def n_bin(self) -> int:
        """Number of bins α."""
        return self.integrals.shape[-1]

    def kept(self, f: int, i: int, j: int) -> np.ndarray:
        """Bins α that count in ln B^{fid f}_ij, (n_bin,) of bool.

        Left out: bins too far from the peak (rule 1), bins that too few streams of one of the
        three models reach (rule 2), and bins where two of the distributions compared do not
        overlap for some number of bins in y: their ln B would be infinite for want of samples.
        """
        sampled = ~(self.sparse[f] | self.sparse[i] | self.sparse[j])
        overlap = np.all((self.integrals[:, f, i] > 0) & (self.integrals[:, f, j] > 0), axis=0)
        return sampled & overlap & ~self.far

    def ln_bayes_by_y_bins(self, f: int, i: int, j: int) -> np.ndarray:
        """ln B^{fid f}_ij for each number of bins in y, (n_y_bins, n_bin) (equation 6).

        Nowhere infinite: NaN where one of the two integrals is 0.
        """
        numerator, denominator = self.integrals[:, f, i], self.integrals[:, f, j]
        both = (numerator > 0) & (denominator > 0)
        return np.log(np.where(both, numerator, np.nan)) - np.log(np.where(both, denominator, np.nan))

    def ln_bayes(self, f: int, i: int, j: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Median over the numbers of bins in y of ln B^{fid f}_ij, and its method error.

        Returns
        -------
        median, low, high : ndarray (n_bin,)
            NaN where the distributions overlap for none of the numbers of bins.
        """
        samples = self.ln_bayes_by_y_bins(f, i, j)
        result = np.full((3, self.n_bin), np.nan)
        some = np.any(np.isfinite(samples), axis=0)
        ends = (0.5, *self.quantiles)
        whole = np.all(np.isfinite(samples), axis=0)
        if whole.any():
            result[:, whole] = np.quantile(samples[:, whole], ends, axis=0)
        for a in np.flatnonzero(some & ~whole):
            column = samples[:, a]
            result[:, a] = np.quantile(column[np.isfinite(column)], ends)
        return result[0], result[1], result[2]

    def cumulative(self, f: int, i: int, j: int) -> Cumulative:
        """Σ_α ln B^{fid f}_ij over the bins that are kept (paper table 1).

        Correlations between bins α are ignored; the paper calls the sum an upper limit for that.
        """
        kept = self.kept(f, i, j)
        if not kept.any():
            return Cumulative(0.0, 0.0, 0.0, 0, 0.0)
        samples = self.ln_bayes_by_y_bins(f, i, j)[:, kept]
        medians = np.median(samples, axis=0)
        low, high = np.quantile(samples.sum(axis=1), self.quantiles)
        return Cumulative(
            float(medians.sum()), float(low), float(high), int(kept.sum()), float(medians.max())
        )


@dataclass(frozen=True)
class Cumulative:
    """Sum of ln B over bins α.

    Attributes
    ----------
    value : float
        Sum over bins of the median over numbers of bins in y.
    low, high : float
        Interquantile range of the sum over the numbers of bins in y: the method error.
    n_kept : int
        Number of bins α in the sum; 0 means that nothing could be compared.
    largest : float
        Largest ln B of a single bin.
    """

    value: float
    low: float
    high: float
    n_kept: int
    largest: float

    @property
    def word(self) -> str:
        """Jeffreys' word for the value."""
        return jeffreys(self.value) if self.n_kept else "no bins"


@dataclass(frozen=True)
class Comparison:
    """PDFs and Bayes factors of some models at one noise and number of bins, small enough to keep.

    Attributes
    ----------
    noise : float
        σ_ε.
    edges : ndarray (n_bin + 1,)
        Edges of the bins α in Qρ.
    bands : tuple of Band
        PDF(Qρ) of each model.
    sorted_y : tuple of float32 ndarray (n_bin, n_streams)
        y_α of each model in rising order.
    evidence : Evidence
    """

    noise: float
    edges: np.ndarray
    bands: tuple[Band, ...]
    sorted_y: tuple[np.ndarray, ...]
    evidence: Evidence

    @property
    def centers(self) -> np.ndarray:
        """Middle of every bin α in Qρ, (n_bin,)."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    @property
    def n_models(self) -> int:
        """Number of models."""
        return len(self.bands)

    def bin_at(self, q_rho: float) -> int:
        """Number of the bin α, counted from 0, that holds a Qρ; the first or last beyond the range."""
        return int(np.clip(np.searchsorted(self.edges, q_rho, side="right") - 1, 0, len(self.edges) - 2))


def compare(
    profiles: Sequence[np.ndarray],
    noise: float,
    n_bin: int,
    rules: Rules | None = None,
) -> Comparison:
    """PDFs, bands and Bayes factors of noisy profiles: all that one slider position shows.

    Parameters
    ----------
    profiles : sequence of ndarray (n_streams, n_longitudes)
        Qρ with noise, one array a model, lowest mass first.
    noise : float
        σ_ε that the profiles have.
    n_bin : int
        Number of bins in Qρ.
    rules : Rules, optional
    """
    pdfs, evidence = measured_evidence(profiles, noise, n_bin, rules)
    return Comparison(
        noise,
        pdfs.edges,
        tuple(pdfs.band(m) for m in range(pdfs.n_models)),
        tuple(y.astype(np.float32) for y in pdfs.sorted_y),
        evidence,
    )


def measured_evidence(
    profiles: Sequence[np.ndarray], noise: float, n_bin: int, rules: Rules | None = None
) -> tuple[Pdfs, Evidence]:
    """PDFs and Bayes factors of noisy profiles, bins and exclusions by the same rules.

    Parameters are those of `compare`.
    """
    rules = rules or Rules()
    pdfs = measure_pdfs(profiles, n_bin, rules.value_range(profiles))
    width = measured_width(profiles[0]) if rules.width == "measured" else None
    return pdfs, measure_evidence(pdfs, noise, rules, width=width)


def jeffreys(ln_bayes: float) -> str:
    """Jeffreys' scale: |ln B| < 1 inconclusive, 1–2.5 weak, 2.5–5 moderate, above 5 strong.

    Not a number (nothing to compare) is "no bins".

    Examples
    --------
    >>> jeffreys(0.9), jeffreys(-3.0), jeffreys(9.0)
    ('inconclusive', 'moderate', 'strong')
    """
    if np.isnan(ln_bayes):
        return "no bins"
    return next(word for end, word in JEFFREYS if abs(ln_bayes) < end or end == np.inf)


def measure_evidence(
    pdfs: Pdfs, noise: float, rules: Rules | None = None, low_mass: int = 0, width: float | None = None
) -> Evidence:
    """Bayes factors of every ordered pair of models for every fiducial (paper figure 5).

    Parameters
    ----------
    pdfs : Pdfs
        PDF(Qρ) per stream of two or more models.
    noise : float
        σ_ε, the shot noise of Qρ in a longitude bin.
    rules : Rules, optional
        What is left out and how integrals are taken.
    low_mass : int
        Which model is the lowest mass range, whose PDF's peak rule 1 refers to.
    width : float, optional
        Width of the lowest-mass PDF in rule 1; σ_ε, as in the paper, when not given. At small
        noise σ_ε is no longer that width: see `measured_width`.

    Raises
    ------
    ValueError
        If there are fewer than two models, a model without streams, or a bad number of bins in y.
    """
    rules = rules or Rules()
    if pdfs.n_models < 2:
        raise ValueError("Evidence compares models: choose at least two mass ranges.")
    far = np.zeros(pdfs.n_bin, dtype=bool)
    if rules.n_sigma is not None:
        far = far_from_peak(pdfs, rules.n_sigma * (noise if width is None else width), low_mass, rules.reach)
    return Evidence(
        integrals=overlap_integrals(
            pdfs.sorted_y, rules.y_bins, rules.self_pairs, rules.trapezoid, rules.from_zero
        ),
        far=far,
        sparse=np.array([pdfs.occupied(m) < rules.min_streams for m in range(pdfs.n_models)]),
    )


def far_from_peak(pdfs: Pdfs, distance: float, low_mass: int = 0, reach: str = "centre") -> np.ndarray:
    """Exclusion rule 1: bins α farther than ``distance`` from the peak, (n_bin,) of bool.

    The peak is the centre of the highest bin of the lowest-mass model's median PDF(Qρ); its bin is
    never excluded. `Rules.reach` says which part of a bin must lie within the distance.
    """
    peak = int(np.argmax(pdfs.band(low_mass).median))
    half = 0.5 * (pdfs.edges[1] - pdfs.edges[0])
    margin = {"centre": 0.0, "whole": half, "part": -half}[reach]
    # The small allowance keeps bins that sit on the limit whatever the rounding.
    far = np.abs(pdfs.centers - pdfs.centers[peak]) + margin > distance * (1 + 1e-9) + 1e-12
    far[peak] = False
    return far


def measured_width(profiles: np.ndarray) -> float:
    """Half the central 68.3 % range of all Qρ values of a model: its PDF's width, noise included."""
    values = profiles[np.isfinite(profiles)]
    low, high = np.quantile(values, (0.1587, 0.8413))
    return float(high - low) / 2
