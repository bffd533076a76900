"""Colours and styles of the frame around all pages, light and dark."""

from __future__ import annotations

from typing import Any


def _palette(primary: str, page: str, paper: str, bar: str) -> dict[str, Any]:
    bar_style = {"root": {"backgroundColor": bar, "color": "#ffffff", "backgroundImage": "none"}}
    still = {"transition": "none"}
    return {
        "palette": {"primary": {"main": primary}, "background": {"default": page, "paper": paper}},
        "components": {
            "MuiAppBar": {"styleOverrides": bar_style},
            "MuiTab": {"styleOverrides": {"root": {"textTransform": "none", "fontSize": "15px"}}},
            # Animated thumbs repaint the page for 150 ms after every key, while the figures wait.
            "MuiSlider": {"styleOverrides": {"thumb": still, "track": still}},
            "MuiToggleButton": {"styleOverrides": {"root": {"textTransform": "none"}}},
            # What assistive technology is told: the title is the page's heading, a figure's is one
            # below, and the title bar's (unused) progress bar has a name.
            "MuiTypography": {"defaultProps": {"variantMapping": {"h3": "h1", "h5": "div", "h6": "h2"}}},
            "MuiLinearProgress": {"defaultProps": {"aria-label": "progress"}},
        },
    }


THEME = {
    "light": _palette("#17456b", "#ffffff", "#ffffff", "#17456b"),
    "dark": _palette("#8cc4f0", "#12181e", "#12181e", "#1b2a38"),
}
STYLE = ":focus-visible { outline: 3px solid #e69f00 !important; outline-offset: 2px; }"
"""Where the keyboard is must be seen on any ground."""
