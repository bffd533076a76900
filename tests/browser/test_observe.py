"""The Observe page in a real browser: a file in, an answer out, and files that are no good."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from streamdash.observe.table import MAX_BYTES
from streamdash.survey.mock import EXAMPLE

pytestmark = pytest.mark.browser
LONG_MS = 120_000
ANSWER_MS = 900_000
"""A committee is trained: half a minute on an idle machine, many on a busy one."""


def choose(page: Page, name: str, data: bytes) -> None:
    page.locator(".sd-drop input").set_input_files({"name": name, "mimeType": "text/csv", "buffer": data})


def status(page: Page):
    return page.locator(".sd-observe-status .sd-live")


@pytest.mark.slow
def test_the_example_is_classified_and_its_truth_revealed(tab):
    watched = tab("?page=observe")
    page = watched.page
    page.locator(".sd-example button").click()
    expect(status(page)).to_contain_text("35 bins are compared", timeout=LONG_MS)
    expect(page.locator(".sd-stated")).to_contain_text("polynomial of order 3")
    page.locator(".sd-classify-start button").click()
    expect(page.locator(".sd-answer .answer")).to_contain_text("10⁵–10⁹ M☉", timeout=ANSWER_MS)
    expect(page.locator(".sd-card-observe canvas").first).to_be_visible(timeout=LONG_MS)
    with page.expect_download(timeout=LONG_MS) as download:
        page.locator(".sd-download-json a, .sd-download-json button").first.click()
    result = json.loads(Path(download.value.path()).read_text())
    expect(page.locator(".sd-answer .answer")).to_have_text(result["answer"])
    expect(page.locator(".sd-robustness table")).to_contain_text("errors × 2", timeout=ANSWER_MS)
    expect(page.locator(".sd-answer .answer")).to_have_text(result["answer"])
    page.locator(".sd-reveal button").click()
    expect(page.locator(".sd-truth")).to_contain_text("The truth", timeout=LONG_MS)
    assert not watched.complaints
    assert all(
        url.startswith(("http://localhost", "ws://localhost", "data:", "blob:")) for url in watched.requests
    )


@pytest.mark.slow
def test_bad_files_get_a_sentence_and_the_connection_stays(tab):
    page = tab("?page=observe").page
    choose(page, "huge.csv", b"1" * (MAX_BYTES + 1))
    expect(page.locator(".sd-drop [role=alert]")).to_contain_text("larger than 1 MB", timeout=LONG_MS)
    choose(page, "picture.csv", b"\x89PNG\x00\x00")
    expect(page.locator(".sd-error-state")).to_contain_text("not text", timeout=LONG_MS)
    choose(
        page, "evil.csv", EXAMPLE.read_bytes().replace(b"density_error", b"<img/src=x/onerror=boom()/err>")
    )
    expect(page.locator(".sd-preview")).to_contain_text("<img/src=x/onerror=boom()/err>", timeout=LONG_MS)
    expect(page.locator(".sd-error-state")).to_have_count(0)
    menu = page.get_by_label("The value is")
    menu.focus()
    page.keyboard.press("Home")
    expect(page.locator(".sd-stated")).to_contain_text("is Qρ", timeout=LONG_MS)
    page.wait_for_function("() => new URLSearchParams(location.search).get('profile_kind') === 'q_rho'")


SLOW = """
() => {
  const read = FileReader.prototype.readAsDataURL
  window.waiting = []
  FileReader.prototype.readAsDataURL = function (file) { window.waiting.push(() => read.call(this, file)) }
  window.go = () => { window.waiting.splice(0).forEach((start) => start()) }
}
"""
"""A browser whose disk answers only when it is told to."""


@pytest.mark.slow
def test_the_answer_is_of_the_file_that_is_shown(tab):
    """A second file is chosen, and the button pressed while the browser still reads it."""
    page = tab("?page=observe").page
    first, second = EXAMPLE.read_bytes(), b"\n".join(EXAMPLE.read_bytes().splitlines()[:-6])
    start = page.locator(".sd-classify-start button")
    choose(page, "first.csv", first)
    expect(status(page)).to_contain_text("“first.csv” was read: 35 bins", timeout=LONG_MS)
    start.click()
    expect(page.locator(".sd-answer .answer")).to_be_visible(timeout=ANSWER_MS)
    page.evaluate(SLOW)
    choose(page, "second.csv", second)
    expect(status(page)).to_contain_text("Reading “second.csv”", timeout=LONG_MS)
    expect(page.locator(".sd-answer .answer")).to_be_hidden(timeout=LONG_MS)
    expect(start).to_be_disabled()
    start.click(force=True)
    start.dispatch_event("click")
    page.evaluate("() => window.go()")
    expect(status(page)).to_contain_text("“second.csv” was read: 29 bins", timeout=LONG_MS)
    expect(page.locator(".sd-answer .answer")).to_be_hidden(timeout=LONG_MS)
    expect(start).to_be_enabled(timeout=LONG_MS)
    start.click()
    expect(page.locator(".sd-answer .answer")).to_be_visible(timeout=ANSWER_MS)
    with page.expect_download(timeout=LONG_MS) as download:
        page.locator(".sd-download-json a, .sd-download-json button").first.click()
    result = json.loads(Path(download.value.path()).read_text())
    assert result["provenance"]["file"]["name"] == "second.csv"
    assert result["provenance"]["file"]["sha256"] == hashlib.sha256(second).hexdigest()
    assert len(result["profile"]["value"]) == 29
