"""How the lessons are laid out."""

from __future__ import annotations

FIGURE_FIRST = {"flex_wrap": "wrap-reverse", "align_items": "flex-end"}
"""Options of a box with words and a figure: side by side from the top, on a phone the figure above the words.

Where lines wrap in reverse, the end of the cross axis is the top.
"""
