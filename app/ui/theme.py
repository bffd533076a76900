"""Colours and styles of the frame around all pages, light and dark."""

from __future__ import annotations

from typing import Any

FOCUS = {"outline": "3px solid #e69f00", "outlineOffset": "2px"}
"""How what has the keyboard's focus is framed."""


def _palette(primary: str, page: str, paper: str, bar: str) -> dict[str, Any]:
    bar_style = {"root": {"backgroundColor": bar, "color": "#ffffff", "backgroundImage": "none"}}
    still = {"transition": "none"}
    return {
        "palette": {"primary": {"main": primary}, "background": {"default": page, "paper": paper}},
        "components": {
            "MuiAppBar": {"styleOverrides": bar_style},
            "MuiTab": {"styleOverrides": {"root": {"textTransform": "none", "fontSize": "15px"}}},
            # Animated thumbs repaint the page for 150 ms after every key, while the figures wait.
            "MuiSlider": {"styleOverrides": {"thumb": still | {"&.Mui-focusVisible": FOCUS}, "track": still}},
            "MuiButtonBase": {"styleOverrides": {"root": {"&.Mui-focusVisible": FOCUS}}},
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
STYLE = f":focus-visible {{ outline: {FOCUS['outline']} !important; outline-offset: 2px; }}"
"""Where the keyboard is must be seen on any ground."""
TEMPLATE = """{%% extends "base.html" %%}
{%% block postamble %%}{{ super() }}<script>window.importShim?.("%s").catch(() => {})</script>{%% endblock %%}
{%% block loader %%}<div id="loader" style="display: none">
<div class="spinner" style="animation: none; border: 0; width: auto; height: auto; color: #fff;
font: 500 20px sans-serif">Loading …</div><div id="loader-error"></div></div>{%% endblock %%}
"""
"""The page before there are components. It loads their code while the server still builds the page, not
when the first of them has arrived; and it waits without a spinner, which needs as much of a processor as
drawing the figures. Together they are painted 0.3 s sooner."""
CARD = {"padding": "12px 16px", "border": "1px solid var(--mui-palette-divider)", "border-radius": "4px"}
"""Frame of a figure and what belongs to it. A component's Paper looks the same, but the figures in it
are painted 0.3 s later."""
_ARROW = "%3Cpath d='M2 4l4 5 4-5z' fill='%23808080'/%3E"
MENU_STYLE = f"""
select.bk-input {{ background-image: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' \
width='12' height='12'%3E{_ARROW}%3C/svg%3E") !important; }}
"""
"""The browser's own menu, with an arrow that is seen on any ground; Panel's is black."""
