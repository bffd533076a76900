"""Profiles that no perturbed stream has: what an estimator must not answer as if they were one.

Alternatives to true streams, observed with the same bins and errors: streams back to front, streams with
the phases of their Fourier components scrambled, white noise larger than the errors, and sine waves.
"""

from __future__ import annotations

import numpy as np

from streamdash.inference.prior_ensemble import observed
from streamdash.prior import Prior
from streamdash.survey.design import Design

WAVES = (4.0, 80.0)
"""Shortest and longest sine wave in bins; at most the profile."""
AMPLITUDES = (0.1, 1.0)
EXCESS_NOISE = (1.3, 5.0)
"""White noise in units of the stated errors."""


def alternatives(clean: np.ndarray, design: Design, prior: Prior, rng: np.random.Generator) -> np.ndarray:
    """One alternative for each clean stream (n, n_bin), observed; a quarter of each kind, about."""
    kind = rng.integers(4, size=len(clean))
    made = np.ones_like(clean)
    made[kind == 0] = clean[kind == 0][:, ::-1]
    made[kind == 1] = scrambled(clean[kind == 1], rng)
    made[kind == 2] = sines(int((kind == 2).sum()), clean.shape[1], rng)
    noisy = kind == 3
    low, high = np.log(EXCESS_NOISE)
    factor = np.exp(rng.uniform(low, high, (int(noisy.sum()), 1)))
    # On top of the errors that come with being observed.
    made[noisy] += np.sqrt(factor**2 - 1) * design.sigma * rng.standard_normal((len(factor), clean.shape[1]))
    return observed(made, design, prior, rng)


def scrambled(clean: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The same power at every scale, at random places."""
    mean = clean.mean(axis=1, keepdims=True)
    waves = np.fft.rfft(clean - mean, axis=1)
    phases = np.exp(2j * np.pi * rng.random(waves.shape))
    return (mean + np.fft.irfft(np.abs(waves) * phases, clean.shape[1], axis=1)).astype(clean.dtype)


def sines(n: int, n_bin: int, rng: np.random.Generator) -> np.ndarray:
    """Sine waves of any length, amplitude and phase around 1, (n, n_bin)."""
    length = np.exp(rng.uniform(np.log(WAVES[0]), np.log(min(WAVES[1], n_bin)), (n, 1)))
    amplitude = np.exp(rng.uniform(np.log(AMPLITUDES[0]), np.log(AMPLITUDES[1]), (n, 1)))
    phase = rng.uniform(0, 2 * np.pi, (n, 1))
    return 1 + amplitude * np.sin(2 * np.pi * np.arange(n_bin) / length + phase)
