"""What files of a page's figures say of themselves, from what the session has chosen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from app.page import Page
from streamdash.plots.files import About

SAID: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "noise": ("σ_ε", lambda value: value),
    "n_bin": ("N_bin", lambda value: value),
    "fiducial": ("fiducial", lambda value: f"M{value}"),
}
"""Choices that a file names: how they are called there, and how their values are written."""


def about(page: Page | None, title: str) -> About:
    """Classes, settings and link of a figure on a page; of none, the title alone."""
    if page is None:
        return About(title)
    session = page.session
    choices = session.ensembles if page.needs_ensembles else ()
    settings = {
        symbol: write(getattr(session, name)) for name, (symbol, write) in SAID.items() if name in page.uses
    }
    return About(title, [c.config for c in choices], [c.key for c in choices], settings, link(page))


def link(page: Page) -> str:
    """Address that shows a page as it is now."""
    location = pn.state.location if pn.state.curdoc is not None else None
    address = location.href.partition("?")[0].partition("#")[0] if location is not None else ""
    return f"{address}{page.session.search}"
