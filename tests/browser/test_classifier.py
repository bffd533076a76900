"""The Classifier page in a real browser."""

from __future__ import annotations

import io

import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import darken, open_export

pytestmark = pytest.mark.browser
TWO = "?page=classifier&mass=1e3-1e5,1e5-1e9&preset=paper&n_pca=8&features=pca"
# Where the cell of the second row and column is on the screen.
CELL = """
() => {
  const figure = sd.figures().find(f => sd.renderers(f).some(r => r.glyph.type === "Text"))
  const view = sd.view(figure), box = view.el.getBoundingClientRect(), frame = view.frame
  return [box.x + frame.x_scale.compute(1), box.y + frame.y_scale.compute(-1)]
}
"""
# How many cards and controls stick out to the right.
WIDE = """
() => [...document.querySelectorAll(".sd-card, .sd-controls")]
  .filter(e => e.getBoundingClientRect().right > window.innerWidth + 1).length
"""


def trained(page: Page) -> Page:
    """Wait until the classifier is there and its matrix painted."""
    expect(page.locator(".sd-train-status .sd-live")).to_contain_text("trees per class")
    expect(page.locator(".sd-card-confusion canvas").first).to_be_visible()
    return page


def sentence(page: Page, card: str):
    return page.locator(f".sd-card-{card} .sd-sentence .sd-live")


@pytest.fixture(scope="module")
def shown(shared_tab):
    """A tab with the trained classifier of the paper's classes."""
    watched = shared_tab(TWO)
    trained(watched.page)
    return watched


def test_the_page_trains_and_says_how_good_it_is(shown):
    page = shown.page
    expect(sentence(page, "confusion")).to_contain_text("streams that were never trained on")
    expect(page.locator(".sd-scores table")).to_contain_text("paper 0.99")
    expect(sentence(page, "calibration")).to_contain_text("Expected calibration error")
    assert not shown.complaints
    assert all(
        url.startswith(("http://localhost", "ws://localhost", "data:", "blob:")) for url in shown.requests
    )


def test_the_scores_are_seen_whole_on_a_wide_screen(shown):
    """With their intervals and the paper's: nothing to scroll for."""
    table = shown.page.locator(".sd-scores table")
    expect(table).to_contain_text("AUC")
    hidden = table.evaluate("table => table.parentElement.scrollWidth - table.parentElement.clientWidth")
    assert hidden <= 1


def test_a_click_on_a_cell_shows_its_streams_and_the_menu_does_the_same(shown):
    page = shown.page
    menu = page.locator(".sd-cell select")
    menu.focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowDown")
    expect(sentence(page, "cell")).to_contain_text("of 10³–10⁵ M☉ are put right")
    for _ in range(100):  # a figure that is still being laid out does not see a click
        page.mouse.click(*page.evaluate(CELL))
        page.wait_for_timeout(250)
        if "10⁵–10⁹" in sentence(page, "cell").inner_text():
            break
    expect(sentence(page, "cell")).to_contain_text("of 10⁵–10⁹ M☉ are put right")
    page.wait_for_function("() => new URLSearchParams(location.search).get('cell') === '4'")


def test_nothing_sticks_out_on_a_phone(shown):
    page = shown.page
    page.set_viewport_size({"width": 390, "height": 844})
    for theme in ("default", "dark"):
        if theme == "dark":
            darken(page)
        page.wait_for_function("() => document.documentElement.scrollWidth <= 390")
        page.wait_for_function(f"() => ({WIDE})() === 0")


@pytest.mark.slow
def test_training_at_another_noise_and_a_study_by_keyboard(tab):
    """One after the other, in one tab: what is trained is studied."""
    page = trained(tab(TWO).page)
    page.locator(".sd-noise .MuiSlider-thumb input").first.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    status = page.locator(".sd-train-status .sd-live")
    expect(status).to_contain_text("Press Train")
    page.locator(".sd-train-start button").focus()
    page.keyboard.press("Enter")
    expect(status).to_contain_text("σε = 0.13")
    # Of the paper's settings nothing is shipped: what is said at once says of what it is.
    expect(page.locator(".sd-studies")).to_contain_text("As shipped, for the best settings")
    expect(page.locator(".sd-importance-status .sd-live")).to_contain_text("Takes")
    # The longest study of all is the one that is cancelled: others may end before the click.
    start, cancel = (page.locator(f".sd-tuning-{name} button") for name in ("start", "cancel"))
    start.click()
    expect(cancel).to_be_visible()
    cancel.click()
    expect(page.locator(".sd-tuning-status .sd-live")).to_contain_text("Cancelled")
    expect(start).to_be_enabled()
    page.locator(".sd-importance-start button").click()
    expect(sentence(page, "importance")).not_to_contain_text("As shipped")
    expect(sentence(page, "importance")).to_contain_text("Most is lost without")
    open_export(page, ".sd-card-importance")
    with page.expect_download() as download:
        page.locator(
            ".sd-card-importance .sd-download-csv a, .sd-card-importance .sd-download-csv button"
        ).first.click()
    table = pd.read_csv(io.BytesIO(download.value.path().read_bytes()), comment="#")
    assert len(table) > 10 and table["log_loss_rise"].max() > 0
