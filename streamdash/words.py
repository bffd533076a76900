"""Numbers in sentences: counts with their noun, and shares with an interval that can hold."""

from __future__ import annotations

import re

SUBSCRIPT = re.compile(r"(?<![\w$])(?:σ_[εh]|y_α|N_bin|n_PCA|n_l|r_s|m_WDM|M_hm|E_ii|μ_[αδlb])(?![\wα-ω])")
"""Symbols of this field, as sentences write them; readers see what follows the line as a subscript."""

NEAR_PROGENITOR = 0.15
"""Angle θ∥ from the progenitor (rad) within which simulated densities are least to be trusted."""
PROGENITOR_WORDS = (
    "The model's progenitor is not kicked itself, and stars that cross θ∥ = 0 are lost: simulated densities "
    "there are least to be trusted."
)


def number_of(n: int, noun: str, plural: str = "") -> str:
    """A count with its noun.

    Examples
    --------
    >>> number_of(1, "bin"), number_of(3, "bin"), number_of(2, "class", "classes")
    ('1 bin', '3 bins', '2 classes')
    """
    return f"{n} {noun if n == 1 else plural or noun + 's'}"


def is_or_are(n: int) -> str:
    """The verb after a count: ``1 of 20 bins is``, ``3 of 20 bins are``."""
    return "is" if n == 1 else "are"


def between(value: float, low: float, high: float, digits: int = 3) -> str:
    """A value and its interval, ``0.982 (0.978–0.985)``."""
    return f"{value:z.{digits}f} ({low:z.{digits}f}–{high:z.{digits}f})"


def percent_between(value: float, low: float, high: float, digits: int = 1) -> str:
    """A share and its interval in percent, ``98.2 % (97.8–98.5 %)``."""
    return f"{100 * value:.{digits}f} % ({100 * low:.{digits}f}–{100 * high:.{digits}f} %)"
