"""A handler that raises takes nothing from the visitors who come after, whatever kind of handler it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.driving import open_app, served

pytestmark = pytest.mark.browser
FAULTY = Path(__file__).parent / "faulty" / "main.py"
UNUSED = ("--unused-session-lifetime", "300", "--check-unused-sessions", "100")
WAIT_MS = 60_000


@pytest.fixture(scope="module")
def faulty(small_cache) -> Iterator[str]:
    """Address of a server whose sessions can be asked to fail, and end soon after they are left."""
    with served(small_cache, *UNUSED, script=FAULTY) as url:
        yield url


def provoke(page: Page, fault: str) -> None:
    """Do what makes the handler of a kind raise."""
    if fault == "download":
        page.locator(".sd-download-fault button").click()
    elif fault == "slider":
        page.locator(".sd-fault .MuiSlider-thumb input").focus()
        page.keyboard.press("ArrowRight")
    elif fault == "upload":
        file = {"name": "a.csv", "mimeType": "text/csv", "buffer": b"1,2\n"}
        page.locator(".sd-fault input[type=file]").set_input_files(file)
    elif fault not in ("document event", "load"):
        page.locator(".sd-fault button").click()


def sees_everything(page: Page) -> None:
    """All figures of the Evidence page, which come late, and Simulate's after it."""
    for card in ("evidence", "cumulative", "growth"):
        expect(page.locator(f".sd-card-{card} .sd-sentence p")).not_to_be_empty(timeout=WAIT_MS)
        expect(page.locator(f".sd-card-{card} canvas").first).to_be_visible(timeout=WAIT_MS)
    page.get_by_role("tab", name="Simulate").click()
    expect(page.locator(".sd-card-simulate canvas").first).to_be_visible(timeout=WAIT_MS)


FAULTS = (
    "button",
    "download",
    "slider",
    "upload",
    "periodic",
    "next tick",
    "timeout",
    "unlocked",
    "document event",
    "load",
    "session destroyed",
)


def test_handlers_that_raise_take_nothing_from_the_next_visitor(chrome: Browser, faulty: str):
    for fault in FAULTS:
        context = chrome.new_context()
        page = open_app(context.new_page(), faulty, f"?fault={fault}")
        provoke(page, fault)
        if fault in ("button", "download", "slider", "upload", "unlocked"):  # what a person has done
            notice = page.get_by_text("That failed unexpectedly")
            expect(notice.first, fault).to_be_visible(timeout=WAIT_MS)
        else:
            page.wait_for_timeout(300)  # nothing says when a silent handler has run
        context.close()
    page = chrome.new_page()
    page.wait_for_timeout(1000)  # the server forgets the sessions, and their documents die
    sees_everything(open_app(page, faulty, "?page=evidence"))
    page.close()


def test_a_download_waits_until_there_is_something_to_download(tab):
    page = tab("?page=classifier").page
    buttons = page.locator(".sd-card-importance .sd-download-csv button")
    expect(buttons).to_be_disabled()
    page = tab("?page=profiles").page
    expect(page.locator(".sd-download-csv button").first).to_be_enabled()
