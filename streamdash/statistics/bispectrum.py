"""The bispectrum of Qρ, as Bovy, Erkal & Sanders (2017) use it.

B(k₁, k₂) = X(k₁) X(k₂) X*(k₁ + k₂), with X the discrete Fourier transform of a profile without
its mean, divided by the number of points; smoothed over the plane of the two wavenumbers with the
optimal window of Rao & Gabr (1984), 7 points wide. Shown are the absolute values of its real part
(skewness) and imaginary part (asymmetry along the stream) for one k₁, here 1/k₁ nearest 11 deg,
against 1/k₂: medians and bands over streams. The window's weights here sum to one, so that B has the
unit and the size of Qρ³; the code of BES17 does not normalise them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from streamdash.statistics.spectrum import SpectrumBand, scales_kept
from streamdash.survey.bands import BAND

SCALE_1 = 11.0
"""1/k₁ of the slice that is shown (deg)."""
WINDOW_SIZE = 7
"""Width of the smoothing window in wavenumbers."""


@dataclass(frozen=True)
class Bispectrum:
    """|Re B| and |Im B| over streams, at one k₁.

    Attributes
    ----------
    scale_1 : 1/k₁ (deg).
    real, imaginary : bands against 1/k₂.
    """

    scale_1: float
    real: SpectrumBand
    imaginary: SpectrumBand


def rao_gabr_window(size: int = WINDOW_SIZE) -> np.ndarray:
    """Rao & Gabr's optimal window of the bispectrum, (size, size), its weights summing to one.

    1 - (2/size)² (m² + n² + mn) where |m| + |n| + |m + n| < size, and 0 elsewhere: of the hexagonal
    symmetry that the bispectrum has.
    """
    if size < 1 or size % 2 == 0:
        raise ValueError(f"the window's size must be odd and positive (got {size})")
    m, n = np.indices((size, size)) - (size - 1) // 2
    weights = 1 - (2 / size) ** 2 * (m**2 + n**2 + m * n)
    weights[np.abs(m) + np.abs(n) + np.abs(m + n) >= size] = 0
    return weights / weights.sum()


def bispectrum_slice(
    q: np.ndarray, index: int, size: int = WINDOW_SIZE, highest: int | None = None
) -> np.ndarray:
    """B(k₁, k₂) of every stream for one k₁, smoothed.

    Parameters
    ----------
    q : (n_streams, n) array
    index : k₁ in cycles per length of the stream.
    size : width of the smoothing window; 1 for none.
    highest : largest k₂ in cycles per length of the stream; n // 2 by default.

    Returns
    -------
    (n_streams, highest) complex array
        At k₂ = 1 … highest cycles per length; of the precision of `q`.
    """
    q = np.atleast_2d(q)
    n = q.shape[1]
    transform = np.fft.fft(q - q.mean(axis=1, keepdims=True), axis=1) / n
    second = np.arange(1, min(highest or n, n // 2) + 1)
    weights = rao_gabr_window(size)
    half = size // 2
    result = np.zeros((len(q), len(second)), dtype=transform.dtype)
    for a in range(-half, half + 1):
        for b in range(-half, half + 1):
            weight = float(weights[a + half, b + half])
            if weight != 0.0:
                k1, k2 = index + a, second + b
                # Negative and high wavenumbers are where the discrete transform has them: modulo n.
                product = transform[:, k2 % n] * np.conj(transform[:, (k1 + k2) % n])
                result += weight * transform[:, [k1 % n]] * product
    return result


def bispectrum(q: np.ndarray, step: float, scale_1: float = SCALE_1) -> Bispectrum:
    """Medians and bands over streams of |Re B| and |Im B|.

    Parameters
    ----------
    q : (n_streams, n_bin) array
        Qρ, with or without noise.
    step : width of a bin (deg).
    scale_1 : wished 1/k₁ (deg); the nearest there is, is used.
    """
    length = q.shape[1] * step
    index = max(1, round(length / scale_1))
    k = np.arange(1, q.shape[1] // 2 + 1) / length
    k = k[scales_kept(k)]
    values = bispectrum_slice(q, index, highest=len(k))

    def band(part: np.ndarray) -> SpectrumBand:
        low, median, high = np.quantile(np.abs(part), BAND, axis=0)
        return SpectrumBand(1.0 / k, low, median, high, len(part))

    return Bispectrum(length / index, band(values.real), band(values.imag))
