"""What every figure shares: ink, palettes, labels of axes. No drawing here."""

from __future__ import annotations

from streamdash.config import StreamModel
from streamdash.streams import bin_text, longitude_symbol

INK = {"light": "#1f2328", "dark": "#e6e8eb"}
"""Colour of medians and reference lines on a light and on a dark page."""

HAND = "#C77C00"
"""Colour of a fly-by chosen by hand, of a truth that is known, and of what was chosen."""

COORDINATE_LABELS = {"theta": "θ∥ (rad)", "ell": "ℓ (deg)", "phi1": "φ₁ (deg)"}
"""Axis labels of the three coordinates along the default stream."""


def coordinate_label(coordinate: str) -> str:
    """Axis label of a coordinate along any stream."""
    return COORDINATE_LABELS.get(coordinate) or f"{longitude_symbol(coordinate)} (deg)"


def coordinate_symbol(coordinate: str) -> str:
    """Symbol of a coordinate along any stream, for sentences."""
    return {"theta": "θ∥", "ell": "ℓ"}.get(coordinate) or longitude_symbol(coordinate)


def noise_label(stream: StreamModel) -> str:
    """Name of the shot noise in the bins in which a stream is shown."""
    return f"Shot noise σ per {bin_text(stream)}"


def rising_alpha(colour: str = "#808080", highest: float = 0.9, steps: int = 64) -> list[str]:
    """Palette of one colour from transparent to nearly opaque, right on light and dark alike."""
    return [f"{colour}{round(255 * highest * i / (steps - 1)):02x}" for i in range(steps)]
