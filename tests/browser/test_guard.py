"""A handler that raises takes nothing from the visitors who come after, whatever kind of handler it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from app.guard import FAILED
from tests.browser.driving import PATIENCE_MS, open_app, served
from tests.waiting import wait_until

pytestmark = pytest.mark.browser
FAULTY = Path(__file__).parent / "faulty" / "main.py"
UNUSED = ("--unused-session-lifetime", "300", "--check-unused-sessions", "100")
WAIT_MS = PATIENCE_MS


@pytest.fixture(scope="module")
def raised(tmp_path_factory) -> Path:
    """File in which the faulty server's handlers say that they were called."""
    return tmp_path_factory.mktemp("faults") / "called.txt"


@pytest.fixture(scope="module")
def faulty(small_cache, raised) -> Iterator[str]:
    """Address of a server whose sessions can be asked to fail, and end soon after they are left."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("STREAMDASH_FAULTS", str(raised))
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
    else:
        page.locator(".sd-fault button").click()


def sees_everything(page: Page) -> None:
    """All figures of the Evidence page, which come late, and Simulate's after it."""
    for card in ("evidence", "cumulative", "growth"):
        expect(page.locator(f".sd-card-{card} .sd-sentence p")).not_to_be_empty(timeout=WAIT_MS)
        expect(page.locator(f".sd-card-{card} canvas").first).to_be_visible(timeout=WAIT_MS)
    page.get_by_role("link", name="Simulate", exact=True).click()
    expect(page.locator(".sd-card-simulate canvas").first).to_be_visible(timeout=WAIT_MS)


TOLD = ("button", "unlocked", "download", "slider", "upload")
"""What a person has done, who is told that it failed."""
SILENT = ("periodic", "next tick", "timeout", "document event", "session destroyed")
LOAD = "load"
"""In a session of its own: where another handler of the loaded document raises, it is not called."""


@pytest.mark.slow
def test_handlers_that_raise_take_nothing_from_the_next_visitor(chrome: Browser, faulty: str, raised: Path):
    def called() -> list[str]:
        return raised.read_text(encoding="utf-8").splitlines() if raised.exists() else []

    for fault in (*TOLD, ",".join(SILENT), LOAD):
        context = chrome.new_context()
        page = open_app(context.new_page(), faulty, f"?page=observe&fault={fault}")
        if fault in TOLD:
            provoke(page, fault)
            expect(page.get_by_text(FAILED).first, fault).to_be_visible(timeout=WAIT_MS)
        else:
            soon = {*fault.split(",")} - {"session destroyed"}
            wait_until(lambda soon=soon: soon <= {*called()}, "a handler was not called")
        context.close()
    # The server forgets the sessions, and their documents die.
    wait_until(lambda: {*TOLD, *SILENT, LOAD} == {*called()}, "a session that was left goes on")
    page = chrome.new_page()
    sees_everything(open_app(page, faulty, "?page=evidence"))
    page.close()
