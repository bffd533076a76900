"""The app without a browser: sessions and pages on the shipped cache."""

from __future__ import annotations

import pytest

from app.pages.registry import PAGES
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from streamdash.store.cache import Cache


@pytest.fixture(scope="session")
def services(shipped_cache) -> Services:
    """Services of one server process on the shipped cache."""
    return Services(Cache.default(shipped_cache))


@pytest.fixture
def open_shell(services):
    """Open the app at a link, as one browser session would."""

    def open_at(search: str = "") -> Shell:
        session = Session(tuple(page.key for page in PAGES), services.catalog())
        session.load(search)
        return Shell(session, services, PAGES)

    return open_at
