"""Profiles that no perturbed stream has: what an estimator must not answer as if they were one.

Three looks at a profile's features, each blind to what the others see. A network tells streams from two
sorts of alternatives, observed with the same bins and errors:

`distorted`
    streams back to front, and streams with the phases of their Fourier components scrambled;
`made up`
    white noise larger than the errors, and sine waves.

The third needs no example of what is strange:

`distance`
    how far the features lie from the middle of all streams', in units of their scatter (Mahalanobis).

Each is ranked among streams that were held back, and the smallest share of them that is as strange counts
three times, as three were looked at. They are apart because some true streams are hardly told from their own
mirror image: they must not hide a sine wave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamdash.inference.network import Network, train
from streamdash.inference.prior_ensemble import observed
from streamdash.prior import Prior
from streamdash.survey.design import Design

SHORTEST = 4.0
"""Shortest sine wave in bins; the longest is as long as the profile."""
LONG = 1 / 8
"""Half of the sine waves are at least so long, as a share of the profile: those are most like streams."""
AMPLITUDES = (0.05, 1.0)
EXCESS_NOISE = (1.3, 5.0)
"""White noise in units of the stated errors."""
EPOCHS = 25
RIDGE = 0.02
"""Added to the variance of every combination of features, so that none that hardly varies decides alone."""


@dataclass(frozen=True, eq=False)
class Critic:
    """Says how unlike streams a profile is.

    Attributes
    ----------
    network : Network
        Tells features of streams (0) from those of distorted ones (1) and of what is made up (2).
    odds : ndarray (n_held, 2), each column increasing
        Its log odds of each alternative, for streams that were held back.
    middle : ndarray (n_input,)
    whitening : ndarray (n_input, n_input)
        Takes features off the middle to numbers of unit scatter.
    distances : ndarray, increasing
        Squared distances of the streams that were held back.
    """

    network: Network
    odds: np.ndarray
    middle: np.ndarray
    whitening: np.ndarray
    distances: np.ndarray

    @classmethod
    def learn(
        cls,
        streams: list[np.ndarray],
        wrong: list[np.ndarray],
        held: np.ndarray,
        wrong_held: np.ndarray,
        seed: int,
        alpha: float,
    ) -> Critic:
        """From scaled features (n, n_input).

        Parameters
        ----------
        streams, wrong : of streams and of alternatives, with noise of its own in each copy.
        held, wrong_held : the same of streams that are held back.
        """
        network, _ = train(
            lambda number: _stacked(streams[number % len(streams)], wrong[number % len(wrong)]),
            _stacked(held, wrong_held),
            n_cells=3,
            seed=seed,
            max_epochs=EPOCHS,
            alpha=alpha,
        )
        middle = streams[0].mean(axis=0)
        values, vectors = np.linalg.eigh(np.atleast_2d(np.cov(streams[0].astype(float), rowvar=False)))
        whitening = (vectors / np.sqrt(np.maximum(values, 0) + RIDGE)).astype(np.float32)
        empty = np.zeros(0, np.float32)
        first = cls(network, empty, middle, whitening, empty)
        odds = np.sort(first.log_odds(held), axis=0)
        return cls(network, odds, middle, whitening, np.sort(first.distance(held)))

    def log_odds(self, x: np.ndarray) -> np.ndarray:
        """Log odds of each alternative (n, 2)."""
        logs = self.network.log_probabilities(x)
        return np.asarray(logs[:, 1:] - logs[:, :1], np.float32)

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Squared distance from the middle of all streams (n,)."""
        return np.asarray((((x - self.middle) @ self.whitening) ** 2).sum(axis=1), np.float32)

    def strangeness(self, x: np.ndarray) -> np.ndarray:
        """Share of streams (n,) that are less strange than each profile, all looks joined."""
        looks = [_beyond(k, v) for k, v in zip(self.odds.T, self.log_odds(x).T, strict=True)]
        looks.append(_beyond(self.distances, self.distance(x)))
        return np.maximum(1 - len(looks) * np.min(looks, axis=0), 0)


def alternatives(
    clean: np.ndarray,
    design: Design,
    prior: Prior,
    rng: np.random.Generator,
    factors: np.ndarray | None = None,
) -> np.ndarray:
    """One alternative for each clean stream (n, n_bin), observed: the four kinds in turn.

    `factors` as in `streamdash.inference.prior_ensemble.observed`.
    """
    kind = np.arange(len(clean)) % 4
    made = np.ones_like(clean)
    made[kind == 0] = clean[kind == 0][:, ::-1]
    made[kind == 1] = scrambled(clean[kind == 1], rng)
    made[kind == 2] = sines(int((kind == 2).sum()), clean.shape[1], rng)
    noisy = kind == 3
    low, high = np.log(EXCESS_NOISE)
    factor = np.exp(rng.uniform(low, high, (int(noisy.sum()), 1)))
    # On top of the errors that come with being observed.
    sigma = design.sigma if factors is None else factors[noisy][:, None] * design.sigma
    made[noisy] += np.sqrt(factor**2 - 1) * sigma * rng.standard_normal((len(factor), clean.shape[1]))
    return observed(made, design, prior, rng, factors)


def scrambled(clean: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same power at every scale, at random places."""
    mean = clean.mean(axis=1, keepdims=True)
    waves = np.fft.rfft(clean - mean, axis=1)
    phases = np.exp(2j * np.pi * rng.random(waves.shape))
    return (mean + np.fft.irfft(np.abs(waves) * phases, clean.shape[1], axis=1)).astype(clean.dtype)


def sines(n: int, n_bin: int, rng: np.random.Generator) -> np.ndarray:
    """Sine waves of any length, amplitude and phase around 1, (n, n_bin)."""
    shortest = np.where(rng.random((n, 1)) < 0.5, SHORTEST, max(SHORTEST, LONG * n_bin))
    length = np.exp(rng.uniform(np.log(shortest), np.log(max(n_bin, SHORTEST)), (n, 1)))
    amplitude = np.exp(rng.uniform(np.log(AMPLITUDES[0]), np.log(AMPLITUDES[1]), (n, 1)))
    phase = rng.uniform(0, 2 * np.pi, (n, 1))
    return 1 + amplitude * np.sin(2 * np.pi * np.arange(n_bin) / length + phase)


def _beyond(known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Share of known values that are as high or higher."""
    return (len(known) - np.searchsorted(known, values) + 1) / (len(known) + 1)


def _stacked(streams: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and which are streams, distorted and made up; alternatives come in the order of their kinds."""
    sort = 1 + (np.arange(len(others)) % 4) // 2
    return np.vstack([streams, others]), np.concatenate([np.zeros(len(streams), int), sort])
