"""Sentences that stand by themselves: messages, errors, and what an empty cache shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import panel_material_ui as pmui

from app.ui.layout import WIDE, plain_text


def message(sentences: Sequence[str], kind: str = "info") -> pmui.Alert:
    """Sentences in a coloured bar that can be closed; ``kind`` is info, warning or error."""
    return _alert(sentences, kind, "sd-message", closeable=True)


def error_state(sentence: str) -> pmui.Alert:
    """What takes the place of a page or panel that cannot be shown."""
    return _alert([sentence], "error", "sd-error-state")


def no_ensembles() -> pmui.Alert:
    """What a page shows when the cache holds nothing to show."""
    return _alert(
        [
            "There are no simulated streams in the cache yet.",
            "Run “streamdash simulate --mass 1e3-1e5 --streams 1000”, the same for 1e5-1e9, and reload.",
        ],
        "info",
        "sd-empty-state",
    )


def _alert(sentences: Sequence[str], kind: str, css_class: str, **params: Any) -> pmui.Alert:
    return pmui.Alert(
        # Not the alert's own text: that is read as Markdown.
        *(plain_text(sentence, margin=0) for sentence in sentences),
        severity=kind,
        sizing_mode=WIDE,
        margin=(8, 16),
        css_classes=[css_class, f"sd-{kind}"],
        **params,
    )
