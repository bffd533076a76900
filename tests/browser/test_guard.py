"""A handler that raises takes nothing from the visitors who come after, whatever kind of handler it is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.driving import PATIENCE_MS, open_app, served

pytestmark = pytest.mark.browser
FAULTY = Path(__file__).parent / "faulty" / "main.py"
UNUSED = ("--unused-session-lifetime", "300", "--check-unused-sessions", "100")


@pytest.fixture(scope="module")
def faults(tmp_path_factory) -> Path:
    """The file in which the server notes what has happened."""
    path = tmp_path_factory.mktemp("faults") / "faults"
    path.touch()
    return path


@pytest.fixture(scope="module")
def faulty(small_cache, faults) -> Iterator[str]:
    """Address of a server whose sessions can be asked to fail, and end soon after they are left."""
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("FAULTS", str(faults))
        with served(small_cache, *UNUSED, script=FAULTY) as url:
            yield url


def wait_for_line(faults: Path, line: str) -> None:
    deadline = time.monotonic() + PATIENCE_MS / 1000
    while line not in faults.read_text(encoding="utf-8").splitlines():
        assert time.monotonic() < deadline, line
        time.sleep(0.05)


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
        expect(page.locator(f".sd-card-{card} .sd-sentence p")).not_to_be_empty()
        expect(page.locator(f".sd-card-{card} canvas").first).to_be_visible()
    page.get_by_role("tab", name="Simulate").click()
    expect(page.locator(".sd-card-simulate canvas").first).to_be_visible()


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


def test_handlers_that_raise_take_nothing_from_the_next_visitor(chrome: Browser, faulty: str, faults: Path):
    for fault in FAULTS:
        context = chrome.new_context()
        page = open_app(context.new_page(), faulty, f"?fault={fault}")
        provoke(page, fault)
        if fault in ("button", "download", "slider", "upload", "unlocked"):  # what a person has done
            notice = page.get_by_text("That failed unexpectedly")
            expect(notice.first, fault).to_be_visible()
        else:
            wait_for_line(faults, f"{fault}: {'asked' if fault == 'session destroyed' else 'raised'}")
        context.close()
    for fault in FAULTS:  # the server forgets the sessions, and their documents die
        for event in ("raised", "gone"):
            wait_for_line(faults, f"{fault}: {event}")
    page = chrome.new_page()
    sees_everything(open_app(page, faulty, "?page=evidence"))
    page.close()


def test_a_download_waits_until_there_is_something_to_download(tab):
    page = tab("?page=classifier").page
    buttons = page.locator(".sd-card-importance .sd-download-csv button")
    expect(buttons).to_be_disabled()
    page = tab("?page=profiles").page
    expect(page.locator(".sd-download-csv button").first).to_be_enabled()
