"""The Infer page in a real browser: an answer, another mock, a file, and a phone."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from streamdash.survey.mock import EXAMPLE
from tests.browser.driving import open_controls

pytestmark = pytest.mark.browser
LONG_MS = 120_000


def test_a_mock_is_answered_and_another_one_follows(tab):
    watched = tab("?page=infer")
    page = watched.page
    answer = page.locator(".sd-answer .answer")
    expect(answer).to_contain_text("10⁶–10⁹ M☉", timeout=LONG_MS)
    expect(page.locator(".sd-card-posterior canvas").first).to_be_visible(timeout=LONG_MS)
    # The first one is the offer to halve the stretch.
    expect(page.locator(".sd-card-assumptions .sd-live").last).to_contain_text("age 7 Gyr", timeout=LONG_MS)
    expect(page.locator(".sd-card-calibration .sd-live")).to_contain_text("95 % one", timeout=LONG_MS)
    sentence = page.locator(".sd-card-posterior .sd-live")
    expect(sentence).to_contain_text("mock 1:", timeout=LONG_MS)
    page.locator(".sd-infer_number .MuiSlider-thumb input").focus()
    page.keyboard.press("ArrowRight")
    expect(sentence).to_contain_text("mock 2:", timeout=LONG_MS)
    page.wait_for_function("() => new URLSearchParams(location.search).get('infer_number') === '2'")
    page.locator(".sd-infer-keep button").click()
    expect(page.locator(".sd-card-joined")).to_be_visible(timeout=LONG_MS)
    assert not watched.complaints
    assert all(
        url.startswith(("http://localhost", "ws://localhost", "data:", "blob:")) for url in watched.requests
    )


@pytest.mark.slow
def test_a_file_of_other_bins_is_read_and_training_offered(tab):
    page = tab("?page=infer&infer_data=upload").page
    page.locator(".sd-drop input").set_input_files(
        {"name": "mine.csv", "mimeType": "text/csv", "buffer": EXAMPLE.read_bytes()}
    )
    expect(page.locator(".sd-infer-status .sd-live").first).to_contain_text("35 bins", timeout=LONG_MS)
    expect(page.locator(".sd-infer-start button")).to_be_enabled(timeout=LONG_MS)


def test_on_a_phone_the_answer_and_its_figure_come_first_and_nothing_is_wider(tab):
    page = tab("?page=infer", 390, 844).page
    expect(page.locator(".sd-answer .answer")).to_be_visible(timeout=LONG_MS)
    expect(page.locator(".sd-card-posterior canvas").first).to_be_visible(timeout=LONG_MS)
    parts = (".sd-answer", ".sd-key", ".sd-card-posterior", ".sd-card-predictive")
    tops = [page.locator(part).first.bounding_box()["y"] for part in parts]
    assert tops == sorted(tops)
    open_controls(page)
    expect(page.locator(".sd-infer_data")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
