"""Is a profile like anything that was simulated? A p-value from streams nobody was trained on.

Three checks, each blind to what the others see:

`distance`
    How far the profile lies from the middle of each class, in the space of the principal
    components and in units of the class's own scatter (Mahalanobis). Too near is as strange as too
    far: a profile without any structure lies at the centre of everything.

`pattern`
    Whether it has the pattern of a perturbed stream. Trees learn to tell simulated streams from
    profiles made of the same numbers that no perturber makes: streams back to front, streams with
    the phases of their Fourier components scrambled, white noise and sine waves, all observed with
    the same bins and errors. Their score estimates the ratio of the density of streams to that of
    these alternatives (Hastie, Tibshirani & Friedman 2009, §14.2.4).

`structure`
    Whether it has any: the same against the smooth stream alone, also with less noise than stated.
    Apart from `pattern`, since some true streams are hardly hit: they must not hide profiles that
    only run the wrong way.

Each statistic is ranked among those of held-out streams, so that a fraction p of true streams is as
strange or stranger, whatever the statistic is. They are joined as p = 3 min(p₁, p₂, p₃) (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xgboost
from sklearn.decomposition import PCA

from streamdash.classifier.model import Boosting, ClassifierConfig, class_margins
from streamdash.classifier.train import boost
from streamdash.statistics.features import summarise
from streamdash.survey.design import measured
from streamdash.survey.observed import ObservedStreams

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
CHECKS = 3
"""Checks that are joined: the smallest p-value counts so many times."""
WAVES = (2.0, 40.0)
"""Shortest and longest sine wave among the alternatives, in bins; at most twice the profile."""


@dataclass(frozen=True)
class Resemblance:
    """How far a profile is from all classes.

    Attributes
    ----------
    p : float
        Share of true streams that are as strange or stranger, all checks joined.
    p_distance, p_pattern, p_structure : float
        Of each check alone.
    n_streams : int
        Held-out streams behind them; no p can be smaller than 3/(n_streams + 1).
    """

    p: float
    p_distance: float
    p_pattern: float
    p_structure: float
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
class Cloud:
    """Where the streams of each class lie in the space of principal components."""

    scale: np.ndarray
    pca: PCA
    middles: tuple[np.ndarray, ...]
    inverses: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, q: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> Cloud:
        """Mean and covariance of each class of observed streams (n_streams, n_bin)."""
        scale = 2 * np.maximum(np.asarray(sigma, np.float32), 0.02)
        straight = _straightened(q, scale)
        pca = PCA(min(N_COMPONENTS, *straight.shape), svd_solver="covariance_eigh").fit(straight)
        x = pca.transform(straight)
        middles, inverses = [], []
        for c in range(int(y.max()) + 1):
            middles.append(x[y == c].mean(axis=0))
            spread = np.atleast_2d(np.cov(x[y == c], rowvar=False))
            ridge = 1e-6 * np.trace(spread) / len(spread)
            inverses.append(np.linalg.inv(spread + ridge * np.eye(len(spread))))
        return cls(scale, pca, tuple(middles), tuple(inverses))

    def distance(self, q: np.ndarray) -> np.ndarray:
        """Squared Mahalanobis distance of each profile from each class (n_profiles, n_classes)."""
        x = self.pca.transform(_straightened(q, self.scale))
        columns = []
        for middle, inverse in zip(self.middles, self.inverses, strict=True):
            off = x - middle
            columns.append(np.einsum("ni,ni->n", off @ inverse, off))
        return np.stack(columns, axis=1)

    def features(self, q: np.ndarray, summaries: np.ndarray | None = None) -> np.ndarray:
        """What the trees are given: distances also if it ran the other way, components, summaries.

        ``summaries`` are those of ``TREES.features``, if they are known already.
        """
        summaries = summarise(q, TREES.features) if summaries is None else summaries
        ways = [np.log(self.distance(way)) for way in (q, q[:, ::-1])]
        components = self.pca.transform(_straightened(q, self.scale))
        parts = [*ways, ways[1] - ways[0], components, q, summaries]
        return np.concatenate(parts, axis=1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Likeness:
    """The three checks, ready for profiles of one design; made by `learn_likeness`.

    Attributes
    ----------
    cloud : Cloud
    pattern, structure : Booster
        Their margin is the log density ratio of streams to alternatives.
    distances : tuple of ndarray
        Of the held-out streams of each class from their own class.
    patterns, structures : ndarray
        Margins of the held-out streams.
    """

    cloud: Cloud
    pattern: xgboost.Booster
    structure: xgboost.Booster
    distances: tuple[np.ndarray, ...]
    patterns: np.ndarray
    structures: np.ndarray

    def __call__(self, q: np.ndarray) -> list[Resemblance]:
        """Resemblance of each profile (n_profiles, n_bin) to the classes."""
        distance, features = self.cloud.distance(q), self.cloud.features(q)
        ranks = [_two_sided(d, known) for d, known in zip(distance.T, self.distances, strict=True)]
        each = np.stack(
            [
                np.max(ranks, axis=0),
                _rank(_score(self.pattern, features), self.patterns),
                _rank(_score(self.structure, features), self.structures),
            ]
        )
        joint = np.minimum(1.0, CHECKS * each.min(axis=0))
        n = len(self.patterns)
        return [
            Resemblance(float(p), float(far), float(odd), float(flat), n)
            for p, (far, odd, flat) in zip(joint, each.T, strict=True)
        ]


def learn_likeness(
    streams: ObservedStreams,
    sigma: np.ndarray,
    smooth: np.ndarray,
    known: np.ndarray,
    held_out: np.ndarray,
    cloud: Cloud,
    seed: int = 0,
) -> Likeness:
    """Learn what streams of all classes look like in one design.

    Parameters
    ----------
    streams : ObservedStreams
        Streams in the design's bins.
    sigma : ndarray (n_bin,)
        Error of each bin relative to the smooth curve.
    smooth : ndarray (n_bin,)
        The unperturbed stream, like `ObservedStreams.clean`.
    known, held_out : ndarray of int
        Rows to learn from, and rows to rank profiles among.
    cloud : Cloud
        Of the streams that are learnt from.
    """
    rng = np.random.default_rng([seed, 5])
    observed = streams.observed(sigma)

    def seen(clean: np.ndarray, noise: np.ndarray | float = 1.0) -> np.ndarray:
        draws = np.asarray(noise, np.float32) * rng.standard_normal(clean.shape, dtype=np.float32)
        return cloud.features(measured(clean, draws, sigma, streams.design.fit))

    real = np.concatenate([cloud.features(observed[known]), seen(streams.clean[known])])
    smooth = smooth.astype(np.float32)
    pattern = _told_apart(real, seen(alternatives(streams.clean[known], smooth, len(real), rng)))
    # Half of them with less noise than the errors say: a curve, not a measurement.
    noise = np.minimum(rng.uniform(0, 2, (len(known), 1)), 1.0)
    structure = _told_apart(real, seen(np.repeat(smooth[None], len(known), axis=0), noise))

    tests, owner = observed[held_out], streams.y[held_out]
    distance, features = cloud.distance(tests), cloud.features(tests)
    return Likeness(
        cloud,
        pattern,
        structure,
        tuple(distance[owner == c, c] for c in range(len(streams.labels))),
        _score(pattern, features),
        _score(structure, features),
    )


def alternatives(clean: np.ndarray, smooth: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Profiles no perturber makes, of the same amplitudes as streams (about n, n_bin), no noise.

    Parameters
    ----------
    clean : ndarray (n_streams, n_bin)
        Streams, not divided.
    smooth : ndarray (n_bin,)
        The unperturbed stream.
    """
    each, n_bin = -(-n // 4), clean.shape[1]

    def some() -> np.ndarray:
        return clean[rng.integers(len(clean), size=each)]

    def amplitude() -> np.ndarray:
        return (some() / smooth).std(axis=1, keepdims=True)

    noise = 1 + amplitude() * rng.standard_normal((each, n_bin))
    longest = max(min(WAVES[1], 2.0 * n_bin), 2 * WAVES[0])
    period = np.exp(rng.uniform(np.log(WAVES[0]), np.log(longest), (each, 1)))
    phase = 2 * np.pi * (np.arange(n_bin) / period + rng.random((each, 1)))
    waves = 1 + np.minimum(np.sqrt(2) * amplitude(), 0.95) * np.sin(phase)
    components = np.fft.rfft(some() / smooth, axis=1)
    turns = np.exp(2j * np.pi * rng.random(components.shape))
    turns[:, 0] = 1
    scrambled = np.clip(np.fft.irfft(components * turns, n_bin, axis=1), 0, None)
    kinds = [some()[:, ::-1], smooth * noise, smooth * waves, smooth * scrambled]
    return np.concatenate(kinds).astype(np.float32)


def _told_apart(real: np.ndarray, unreal: np.ndarray) -> xgboost.Booster:
    """Trees that tell features of streams from features of alternatives."""
    truth = np.repeat([0, 1], [len(unreal), len(real)])
    return boost(np.concatenate([unreal, real]), truth, TREES, TREES.boosting.n_estimators)


def _score(booster: xgboost.Booster, features: np.ndarray) -> np.ndarray:
    return class_margins(booster, features)[:, 1]


def _straightened(q: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Logarithm of Qρ where well above the errors, linear below: its scatter is then nearly normal."""
    return np.arcsinh(q / scale)


def _rank(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Share of known values that are as low or lower, the value itself included."""
    return (1 + np.searchsorted(np.sort(known), values, side="right")) / (1 + len(known))


def _two_sided(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    low, high = _rank(values, known), _rank(-values, -known)
    return np.minimum(1.0, 2 * np.minimum(low, high))
