"""Names and colours of classes for people: once, for every page, file and link."""

from __future__ import annotations

from streamdash.config import mass_label

CLASS_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""Okabe & Ito's colour-blind-safe blue, vermilion, green and purple: models M0, M1, M2, M3."""

MASS_UNIT = "M☉"
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
