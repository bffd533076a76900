"""One real server and one real Chromium for all browser tests."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, expect, sync_playwright

from tests.browser.driving import PATIENCE_MS, launch, open_app, served


@pytest.fixture(scope="session")
def address(shipped_cache) -> Iterator[str]:
    """Address of a server on the shipped cache, ended when the tests are over."""
    with served(shipped_cache) as url:
        yield url


@pytest.fixture(scope="session")
def chrome() -> Iterator[Browser]:
    """Debian's Chromium; fails with the command that installs it where it is missing."""
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


class Watched:
    """A tab, what it asked the network for and what it complained about."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.on("request", self._asked)
        page.on("console", self._said)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def _asked(self, request: Request) -> None:
        self.requests.append(request.url)

    def _said(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            self.complaints.append(message.text)


@contextlib.contextmanager
def tabs(chrome: Browser, address: str) -> Iterator[Callable[..., Watched]]:
    """Open the app in new tabs, each in a window of its own, at a link and a size."""
    contexts = []

    def open_tab(query: str = "", width: int = 1440, height: int = 900) -> Watched:
        context = chrome.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        contexts.append(context)
        watched = Watched(context.new_page())
        open_app(watched.page, address, query)
        return watched

    yield open_tab
    for context in contexts:
        context.close()


@pytest.fixture
def tab(chrome, address) -> Iterator[Callable[..., Watched]]:
    """Open the app in a tab of the test's own."""
    with tabs(chrome, address) as open_tab:
        yield open_tab


@pytest.fixture(scope="module")
def shared_tab(chrome, address) -> Iterator[Callable[..., Watched]]:
    """The same for tabs that several tests of a module look at, which therefore leave them as they were."""
    with tabs(chrome, address) as open_tab:
        yield open_tab
