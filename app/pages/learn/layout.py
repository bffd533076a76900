"""How the lessons are laid out."""

from __future__ import annotations

from typing import Any

from panel.viewable import Viewable

from app import ui
from app.page import Page

FIGURES = "sd-figures"
FIGURE_FIRST = {"stylesheets": [f"@media (max-width: 900px) {{ .{FIGURES} {{ order: -1; }} }}"]}
"""Options of a box of words and figures: side by side, on a phone what has the class `FIGURES` above."""


def row(
    page: Page, name: str, label: str, options: dict[str, Any] | None = None, space: int = 13
) -> Viewable:
    """A toggle with buttons large enough for a finger in one row, or in more where there is no room."""
    column: Any = ui.toggle(page, name, label, options)
    column.margin = (1, 10)
    column[1].sx = {
        "flexWrap": "wrap",
        "width": "max-content",
        "maxWidth": "calc(100vw - 36px)",
        "& button": {
            "whiteSpace": "nowrap",
            "width": "auto",
            "flex": "0 0 auto",
            "padding": f"7px {space}px",
            "@media (max-width: 700px)": {"padding": f"7px {min(space, 6)}px", "fontSize": "12px"},
        },
    }
    return column
