"""What every figure shares: class colours, palettes, labels. No drawing here."""

from __future__ import annotations

from streamdash.config import mass_label

CLASS_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Okabe & Ito's colour-blind-safe blue, vermilion, green and purple: models M0, M1, M2, M3."""

INK = {"light": "#1f2328", "dark": "#e6e8eb"}
"""Colour of medians and reference lines on a light and on a dark page."""

MASS_UNIT = "M☉"
COORDINATE_LABELS = {"theta": "θ∥ (rad)", "ell": "ℓ (deg)", "phi1": "φ₁ (deg)"}
"""Axis labels of the three coordinates along the stream."""

SUPERSCRIPT = str.maketrans("0123456789.", "⁰¹²³⁴⁵⁶⁷⁸⁹·")


def class_colour(index: int) -> str:
    """Colour of model ``index`` (0 for the lowest masses) on every page and in every figure."""
    return CLASS_COLOURS[index % len(CLASS_COLOURS)]


def mass_text(mass_range: tuple[float, float]) -> str:
    """A mass range for people, for example ``10³–10⁵ M☉``."""

    def one(text: str) -> str:
        mantissa, exponent = text.split("e")
        power = "10" + exponent.translate(SUPERSCRIPT)
        return power if mantissa == "1" else f"{mantissa}·{power}"

    low, high = mass_label(mass_range).split("-")
    return f"{one(low)}–{one(high)} {MASS_UNIT}"


def model_text(index: int, mass_range: tuple[float, float]) -> str:
    """Name of a class in titles, legends and tables, for example ``M0 · 10³–10⁵ M☉``."""
    return f"M{index} · {mass_text(mass_range)}"


def rising_alpha(colour: str = "#808080", highest: float = 0.9, steps: int = 64) -> list[str]:
    """Palette of one colour from transparent to nearly opaque, right on light and dark alike."""
    return [f"{colour}{round(255 * highest * i / (steps - 1)):02x}" for i in range(steps)]
