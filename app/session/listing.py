"""Lines that listings of “Export” have in common."""

from __future__ import annotations

from collections.abc import Sequence

from app.session.catalog import Choice


def ensembles_code(choices: Sequence[Choice]) -> str:
    """Lines that name ensembles by their keys, as the variable ``ensembles``."""
    lines = "\n".join(f'    "{choice.key}",  # {choice.label}' for choice in choices)
    return f"ensembles = [\n{lines}\n]\n"


def code_head(choices: Sequence[Choice], module: str, function: str) -> str:
    """First lines of a listing: imports, and the ensembles."""
    return (
        "from pathlib import Path\n\n"
        f"from streamdash.plots.{module} import {function}\n"
        "from streamdash.plots.live import export\n"
        "from streamdash.store.cache import Cache\n\n"
        f"{ensembles_code(choices)}"
    )
