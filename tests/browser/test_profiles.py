"""The Profiles page in a real browser."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import READY, darken, open_controls, open_export

pytestmark = pytest.mark.browser
TWO = "?page=profiles&mass=1e3-1e5,1e5-1e9"
COLOUR = "() => getComputedStyle(document.body).backgroundColor"

# Share of a figure's pixels that differ from its corner, and the mean of its three channels.
PAINTED = """
(figure) => {
  const canvas = sd.view(figure).canvas_view.primary.canvas
  const context = canvas.getContext("2d")
  const data = context.getImageData(0, 0, canvas.width, canvas.height).data
  let different = 0, sum = 0
  for (let i = 0; i < data.length; i += 4) {
    if (data[i] !== data[0] || data[i + 3] !== data[3]) { different += 1 }
    sum += data[i] + data[i + 1] + data[i + 2]
  }
  return [different / (data.length / 4), sum / (0.75 * data.length)]
}
"""


def painted(page: Page) -> list[list[float]]:
    """For every figure: share of pixels that are not background, mean brightness."""
    return page.evaluate(f"() => sd.figures().map({PAINTED})")


def band(page: Page, panel: int = 0) -> np.ndarray:
    """Upper edge of a panel's 68 % band, as the browser has it."""
    columns = page.evaluate(
        """(panel) => {
          const sources = sd.renderers(sd.figures()[panel]).map(r => r.data_source)
          return Array.from(sources.find(s => s.data.has ? s.data.has("high") : "high" in s.data).get("high"))
        }""",
        panel,
    )
    return np.array(columns)


def noise_thumb(page: Page):
    return page.locator(".sd-noise .MuiSlider-thumb input").first


def address_bar(page: Page) -> str:
    return page.evaluate("() => window.location.search")


def background(page: Page) -> list[int]:
    """Red, green and blue of the page's background."""
    colour = page.evaluate(COLOUR)
    return [int(channel) for channel in re.findall(r"\d+", colour)[:3]]


@pytest.fixture(scope="module")
def shown(shared_tab):
    """A tab with the paper's two classes, which is looked at and at most made smaller or dark."""
    return shared_tab(TWO).page


def test_every_panel_is_painted(shown):
    page = shown
    assert len(painted(page)) == 2
    for share, _ in painted(page):
        assert share > 0.1


def test_moving_the_noise_slider_changes_the_data_and_the_url(tab):
    page = tab(TWO + "&noise=0.1").page
    before = band(page)
    noise_thumb(page).focus()
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    page.wait_for_function("() => new URLSearchParams(location.search).get('noise') === '0.2'")
    after = band(page)
    assert (after - 1).mean() > 1.3 * (before - 1).mean()
    expect(page.locator(".sd-sentence .sd-live").first).to_contain_text("σε = 0.2")


def test_a_link_reproduces_the_view(tab):
    first = tab(TWO + "&noise=0.35&y=rho&x=theta&highlight=5&seed=12").page
    second = tab(address_bar(first)).page
    np.testing.assert_array_equal(band(first, 1), band(second, 1))
    for page in (first, second):
        expect(page.locator(".sd-sentence .sd-live").first).to_contain_text(
            "density ρ along parallel angle θ∥"
        )
        expect(page.locator(".sd-sentence .sd-live").first).to_contain_text("σε = 0.35")


def test_a_bad_link_is_explained_and_the_rest_is_kept(tab):
    watched = tab(TWO + "&noise=2&colour=red&x=theta&page2=%3Cimg%20src%3Dx%20onerror%3Dalert(1)%3E")
    message = watched.page.locator(".sd-message")
    expect(message).to_contain_text("noise must be a number between 0 and 1")
    expect(message).to_contain_text("colour")
    expect(watched.page.locator(".sd-sentence .sd-live").first).to_contain_text("parallel angle")
    assert watched.page.locator("img[src=x]").count() == 0
    assert all(share > 0.1 for share, _ in painted(watched.page))


@pytest.mark.slow
def test_reload_and_back_keep_what_was_chosen(tab):
    page = tab(TWO).page
    page.get_by_role("button", name="ρ", exact=True).click()
    page.wait_for_function("() => location.search.includes('y=rho')")
    page.reload()
    page.wait_for_function(READY)
    expect(page.locator(".sd-sentence .sd-live").first).to_contain_text("density ρ")
    page.goto("about:blank")
    page.go_back()
    page.wait_for_function(READY)
    expect(page.locator(".sd-sentence .sd-live").first).to_contain_text("density ρ")


def test_the_code_follows_and_everything_comes_from_the_server_and_nothing_complains(tab, address):
    watched = tab(TWO)
    open_export(watched.page)
    code = watched.page.locator(".sd-code pre")
    expect(code).to_contain_text("noise=0.1,")
    noise_thumb(watched.page).focus()
    watched.page.keyboard.press("ArrowRight")
    expect(code).to_contain_text("noise=0.11,")
    outside = [
        url
        for url in watched.requests
        if not url.startswith((address, address.replace("http", "ws"), "data:", "blob:"))
    ]
    assert outside == []
    assert watched.complaints == []
    # What is loaded early is what the components then use.
    assert sum("panel-material-ui.bundle.js" in url for url in watched.requests) == 1


def test_two_tabs_do_not_touch_each_other(tab):
    first, second = tab(TWO + "&noise=0.1").page, tab(TWO + "&noise=0.1").page
    before, link = band(second), address_bar(second)
    noise_thumb(first).focus()
    for _ in range(5):
        first.keyboard.press("ArrowRight")
    first.wait_for_function("() => location.search.includes('noise=0.15')")
    np.testing.assert_array_equal(band(second), before)
    assert address_bar(second) == link
    assert not np.array_equal(band(first), before)


def test_many_quick_moves_end_at_the_last_value(tab):
    watched = tab(TWO + "&noise=0")
    page = watched.page
    noise_thumb(page).focus()
    for _ in range(40):
        page.keyboard.press("ArrowRight")
    page.wait_for_function("() => location.search.includes('noise=0.4')")
    np.testing.assert_allclose(band(page), band(tab(TWO + "&noise=0.4").page))
    assert watched.complaints == []


def test_highlights_can_be_redrawn(tab):
    page = tab(TWO).page
    seed = "() => new URLSearchParams(location.search).get('seed')"
    assert page.evaluate(seed) is None
    page.get_by_role("button", name="Draw others").click()
    page.wait_for_function(f"() => ({seed})() === '1'")


def test_files_are_downloaded(tab, tmp_path):
    page = tab(TWO + "&noise=0.2").page
    open_export(page)
    found = {}
    for kind in ("PNG", "SVG", "CSV"):
        with page.expect_download() as download:
            page.get_by_role("button", name=kind).click()
        found[kind] = tmp_path / download.value.suggested_filename
        download.value.save_as(found[kind])
    assert found["PNG"].read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in found["SVG"].read_bytes()[:2000]
    table = pd.read_csv(found["CSV"], comment="#")
    np.testing.assert_allclose(table[table.model == "M0"].quantile_84, band(page), rtol=1e-5)


def test_the_keyboard_reaches_every_control_and_focus_is_visible(shown):
    page = shown
    reached = []
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate(
                """() => {
                  let element = document.activeElement
                  while (element?.shadowRoot?.activeElement) { element = element.shadowRoot.activeElement }
                  return element?.getAttribute("aria-label") || element?.textContent || element?.type || ""
                }"""
            )
        )
    text = " | ".join(reached)
    for control in ("Toggle theme", "Profiles", "Draw others", "Export"):
        assert control in text, reached
    assert "range" in text or "Shot noise" in text


def test_names_of_all_classes_are_read_whole_on_a_phone(tab):
    page = tab("?page=profiles", width=390, height=844).page
    open_controls(page)
    buttons = page.locator(".sd-mass button")
    expect(buttons.first).to_be_visible()
    longest = max(buttons.all_inner_texts(), key=len)
    assert len(longest) > 60  # one that does not fit into one line
    for k in range(buttons.count()):
        box = buttons.nth(k).bounding_box()
        assert box is not None and box["x"] >= 0 and box["x"] + box["width"] <= 390


def test_light_and_dark_and_a_phone_shows_everything_without_sideways_scrolling(shown, tab):
    page = shown
    assert min(background(page)) > 230
    page.set_viewport_size({"width": 390, "height": 844})
    fits(page)
    darken(page)
    fits(page)
    for dark in (page, tab(TWO + "&theme=dark", width=390, height=844).page):
        dark.wait_for_function(f"() => ({COLOUR})().match(/[0-9]+/g).slice(0, 3).every(c => c < 60)")
        dark.wait_for_function(
            """() => sd.figures()[0].renderers.some(r => r.glyph.line_color?.value === "#e6e8eb")"""
        )
        fits(dark)


def fits(page: Page) -> None:
    """The page scrolls inside Page's own element: every box is looked at."""
    for element in ("document.documentElement", "document.body"):
        page.wait_for_function(f"() => {element}.scrollWidth <= 390")
    page.wait_for_function("() => sd.beyond().length === 0")
