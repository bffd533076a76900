"""The frame around all pages: title bar, colours, navigation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import panel_material_ui as pmui
from panel.viewable import Viewable

from app.borrowed import component_code, unwatch_busy

BAR = 56
"""Height of the title bar in pixels."""
FOCUS = {"outline": "3px solid #e69f00", "outlineOffset": "2px"}
"""How what has the keyboard's focus is framed."""


def _palette(primary: str, page: str, paper: str, bar: str) -> dict[str, Any]:
    bar_style = {"root": {"backgroundColor": bar, "color": "#ffffff", "backgroundImage": "none"}}
    still = {"transition": "none"}
    return {
        "palette": {"primary": {"main": primary}, "background": {"default": page, "paper": paper}},
        "components": {
            "MuiAppBar": {"styleOverrides": bar_style},
            "MuiToolbar": {"styleOverrides": {"root": {"minHeight": f"{BAR}px !important"}}},
            # Animated thumbs repaint the page for 150 ms after every key, while the figures wait.
            "MuiSlider": {"styleOverrides": {"thumb": still | {"&.Mui-focusVisible": FOCUS}, "track": still}},
            "MuiButtonBase": {"styleOverrides": {"root": {"&.Mui-focusVisible": FOCUS}}},
            "MuiToggleButton": {"styleOverrides": {"root": {"textTransform": "none"}}},
            # What assistive technology is told: the question is the page's heading, a figure's is one
            # below, and the title bar's (unused) progress bar has a name.
            "MuiTypography": {
                "defaultProps": {"variantMapping": {"h3": "div", "h5": "div", "h6": "h2"}},
                "styleOverrides": {
                    "h3": {"fontSize": "20px", "fontWeight": 500},
                    "h6": {"fontSize": "16px", "lineHeight": 1.3},
                },
            },
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


def page_frame(main: Sequence[Viewable], dark: bool, header: Sequence[Viewable] = ()) -> pmui.Page:
    """Title bar with `header` and the light/dark switch around `main`; all comes from this server."""
    page = pmui.Page(
        title="streamdash",
        meta_description="Which dark-matter perturbers made the gaps in a stellar stream?",
        main=list(main),
        header=list(header),
        dark_theme=dark,
        theme_config=THEME,
        raw_css=[STYLE],
        busy_indicator=None,
        site_url=".",
        main_width=2000,
        css_classes=["sd-page"],
        template=TEMPLATE % component_code(),
    )
    unwatch_busy(page)
    return page
