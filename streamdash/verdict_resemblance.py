"""Is a profile like anything that was simulated? A p-value from streams nobody was trained on.

Two checks, each blind to what the other sees:

`distance`
    How far the profile lies from the middle of each class, in the space of the principal
    components and in units of the class's own scatter (Mahalanobis). Too near is as strange as too
    far: a profile without any structure lies at the centre of everything.

`pattern`
    Whether it has the pattern of a perturbed stream. Trees learn to tell simulated streams from
    profiles made of the same numbers that no perturber makes: streams back to front, streams with
    the phases of their Fourier components scrambled, white noise, sine waves, and the smooth stream,
    all observed with the same bins and errors. Their score estimates the ratio of the density of
    streams to that of these alternatives (Hastie, Tibshirani & Friedman 2009, §14.2.4).

Each statistic is ranked among those of held-out streams, so that a fraction p of true streams is as
strange or stranger, whatever the statistic is. The two are joined as p = 2 min(p₁, p₂) (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xgboost
from sklearn.decomposition import PCA

from streamdash.classifier import boost
from streamdash.classifier_data import LabelledStreams
from streamdash.classifier_model import Boosting, ClassifierConfig, class_margins
from streamdash.features import summarise
from streamdash.survey_observed import measured

UNLIKE = 0.01
"""Below this p-value a profile is said to resemble no class."""
DOUBTFUL = 0.05
"""Below this one it is said to be an unusual member."""
N_COMPONENTS = 40
TREES = ClassifierConfig(
    boosting=Boosting(
        max_depth=4, n_estimators=200, colsample_bytree=0.4, reg_lambda=1.0, early_stopping_rounds=None
    )
)
SHARES = 5
"""Kinds of alternative profiles, equally many of each."""
WAVES = (2.0, 40.0)
"""Shortest and longest sine wave among the alternatives, in bins; at most twice the profile."""


@dataclass(frozen=True)
class Resemblance:
    """How far a profile is from all classes.

    Attributes
    ----------
    p : float
        Share of true streams that are as strange or stranger, both checks joined.
    p_distance, p_pattern : float
        Of each check alone.
    n_streams : int
        Held-out streams behind them; no p can be smaller than 1/(n_streams + 1).
    """

    p: float
    p_distance: float
    p_pattern: float
    n_streams: int

    @property
    def unlike(self) -> bool:
        """Whether the profile resembles no class."""
        return self.p < UNLIKE

    @property
    def doubtful(self) -> bool:
        """Whether it would be an unusual member of any class."""
        return self.p < DOUBTFUL


@dataclass(frozen=True, eq=False)
class Likeness:
    """The two checks, ready for profiles of one design; made by `learn_likeness`."""

    scale: np.ndarray
    pca: PCA
    middles: tuple[np.ndarray, ...]
    inverses: tuple[np.ndarray, ...]
    booster: xgboost.Booster
    distances: tuple[np.ndarray, ...]
    patterns: np.ndarray

    def __call__(self, q: np.ndarray) -> list[Resemblance]:
        """Resemblance of each profile (n_profiles, n_bin) to the classes."""
        distance = self.distance(q)
        ranks = [_two_sided(d, known) for d, known in zip(distance.T, self.distances, strict=True)]
        far = np.max(ranks, axis=0)
        odd = _rank(self.pattern(q), self.patterns)
        joint = np.minimum(1.0, 2 * np.minimum(far, odd))
        n = len(self.patterns)
        return [Resemblance(float(p), float(a), float(b), n) for p, a, b in zip(joint, far, odd, strict=True)]

    def distance(self, q: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distance of each profile from each class (n_profiles, n_classes)."""
        x = self.pca.transform(_straightened(q, self.scale))
        columns = []
        for middle, inverse in zip(self.middles, self.inverses, strict=True):
            off = x - middle
            columns.append(np.einsum("ni,ij,nj->n", off, inverse, off))
        return np.stack(columns, axis=1)

    def pattern(self, q: np.ndarray) -> np.ndarray:
        """Log density ratio of streams to alternatives (n_profiles,)."""
        return class_margins(self.booster, self._features(q))[:, 1]

    def _features(self, q: np.ndarray) -> np.ndarray:
        return np.concatenate([np.log(self.distance(q)), q, summarise(q, TREES.features)], axis=1)


def learn_likeness(
    streams: LabelledStreams,
    sigma: np.ndarray,
    smooth: np.ndarray,
    known: np.ndarray,
    held_out: np.ndarray,
    seed: int = 0,
) -> Likeness:
    """Learn what streams of all classes look like in one design.

    Parameters
    ----------
    streams : LabelledStreams
        Streams in the design's bins.
    sigma : ndarray (n_bin,)
        Error of each bin relative to the smooth curve.
    smooth : ndarray (n_bin,)
        The unperturbed stream, like `LabelledStreams.clean`.
    known, held_out : ndarray of int
        Rows to learn from, and rows to rank profiles among.
    """
    rng = np.random.default_rng([seed, 5])
    scale = 2 * np.maximum(np.asarray(sigma, np.float32), 0.02)
    observed = streams.observed(sigma)
    straight = _straightened(observed[known], scale)
    pca = PCA(min(N_COMPONENTS, *straight.shape), svd_solver="covariance_eigh").fit(straight)
    x, y = pca.transform(straight), streams.y[known]
    middles, inverses = [], []
    for c in range(len(streams.labels)):
        middles.append(x[y == c].mean(axis=0))
        spread = np.atleast_2d(np.cov(x[y == c], rowvar=False))
        inverses.append(np.linalg.inv(spread + 1e-6 * np.trace(spread) / len(spread) * np.eye(len(spread))))

    nothing = np.zeros(0)
    draft = Likeness(scale, pca, tuple(middles), tuple(inverses), None, (), nothing)  # type: ignore[arg-type]
    fresh = rng.standard_normal((len(known), streams.n_bins), dtype=np.float32)
    real = np.concatenate([observed[known], measured(streams.clean[known], fresh, sigma, streams.fit)])
    clean = alternatives(streams.clean[known], smooth.astype(np.float32), len(real), rng)
    unreal = measured(clean, rng.standard_normal(clean.shape, dtype=np.float32), sigma, streams.fit)
    features = np.concatenate([draft._features(unreal), draft._features(real)])
    truth = np.repeat([0, 1], [len(unreal), len(real)])
    booster = boost(features, truth, TREES, TREES.boosting.n_estimators)

    ready = Likeness(scale, pca, tuple(middles), tuple(inverses), booster, (), nothing)
    tests, owner = observed[held_out], streams.y[held_out]
    distance = ready.distance(tests)
    distances = tuple(distance[owner == c, c] for c in range(len(streams.labels)))
    return Likeness(scale, pca, tuple(middles), tuple(inverses), booster, distances, ready.pattern(tests))


def alternatives(clean: np.ndarray, smooth: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Profiles no perturber makes, of the same amplitudes as streams (about n, n_bin), no noise.

    Parameters
    ----------
    clean : ndarray (n_streams, n_bin)
        Streams, not divided.
    smooth : ndarray (n_bin,)
        The unperturbed stream.
    """
    each, n_bin = -(-n // SHARES), clean.shape[1]

    def some() -> np.ndarray:
        return rng.integers(len(clean), size=each)

    def amplitude() -> np.ndarray:
        return (clean[some()] / smooth).std(axis=1, keepdims=True)

    noise = 1 + amplitude() * rng.standard_normal((each, n_bin))
    longest = max(min(WAVES[1], 2.0 * n_bin), 2 * WAVES[0])
    period = np.exp(rng.uniform(np.log(WAVES[0]), np.log(longest), (each, 1)))
    phase = 2 * np.pi * (np.arange(n_bin) / period + rng.random((each, 1)))
    waves = 1 + np.minimum(np.sqrt(2) * amplitude(), 0.95) * np.sin(phase)
    waves_of_q = np.fft.rfft(clean[some()] / smooth, axis=1)
    turned = np.exp(2j * np.pi * rng.random(waves_of_q.shape))
    turned[:, 0] = 1
    scrambled = np.fft.irfft(waves_of_q * turned, n_bin, axis=1)
    kinds = [
        clean[some(), ::-1],
        smooth * noise,
        smooth * waves,
        smooth * np.clip(scrambled, 0, None),
        np.repeat(smooth[None], each, axis=0),
    ]
    return np.concatenate(kinds).astype(np.float32)


def _straightened(q: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Logarithm of Qρ where well above the errors, linear below: its scatter is then nearly normal."""
    return np.arcsinh(q / scale)


def _rank(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Share of known values that are as low or lower, the value itself included."""
    return (1 + np.searchsorted(np.sort(known), values, side="right")) / (1 + len(known))


def _two_sided(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    low, high = _rank(values, known), _rank(-values, -known)
    return np.minimum(1.0, 2 * np.minimum(low, high))
