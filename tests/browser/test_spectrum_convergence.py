"""The Spectrum and Convergence pages in a real browser."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import open_export

pytestmark = pytest.mark.browser
SPECTRUM = "?page=spectrum&mass=1e3-1e5,1e5-1e9"

# Heights of all lines of the figures whose vertical axis is named so.
LINES = """
(axis) => {
  const get = (source, name) => source.data.get ? source.data.get(name) : source.data[name]
  return sd.figures()
    .filter(f => f.left.some(a => (a.axis_label ?? "").startsWith(axis)))
    .flatMap(f => sd.renderers(f).filter(r => r.glyph.type === "Line"))
    .map(r => Array.from(get(r.data_source, "y")))
}
"""


def lines(page: Page, axis: str) -> list[np.ndarray]:
    return [np.array(y) for y in page.evaluate(LINES, axis)]


def sentence(page: Page, card: str):
    return page.locator(f".sd-card-{card} .sd-sentence .sd-live")


def test_the_noise_slider_moves_the_spectra_and_the_statements(tab):
    watched = tab(SPECTRUM)
    page = watched.page
    expect(page.locator(".sd-statements")).to_contain_text("tested at σε = 0.1")
    before = lines(page, "√P of Qρ")
    page.locator(".sd-noise .MuiSlider-thumb input").first.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(page.locator(".sd-statements")).to_contain_text("tested at σε = 0.13")
    after = lines(page, "√P of Qρ")
    changed = [not np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True)]
    assert sum(changed) == 3  # two classes and the noise; not the classes without noise, nor the limits
    expect(page.locator(".sd-statements")).to_contain_text("true")
    expect(sentence(page, "bispectrum")).to_contain_text("Three waves at a time")
    assert watched.complaints == []


@pytest.mark.slow
def test_a_test_of_convergence_is_chosen_shown_and_downloaded(tab, tmp_path):
    watched = tab("?page=convergence&knob=times")
    page = watched.page
    expect(page.locator(".sd-lab-shifts")).to_contain_text("16 times")
    assert len(lines(page, "√P of Qρ")) == 7
    expect(page.locator(".sd-lab-verdicts")).to_contain_text("Orbital phase of the impacts")
    open_export(page, ".sd-card-convergence")
    with page.expect_download() as download:
        page.locator(".sd-card-convergence").get_by_role("button", name="CSV").click()
    download.value.save_as(tmp_path / "times.csv")
    assert pd.read_csv(tmp_path / "times.csv", comment="#").setting.nunique() == 7
    page.get_by_role("link", name="Size and profile of the perturbers").click()
    page.wait_for_url("**knob=profile**")
    expect(page.locator(".sd-lab-shifts")).to_contain_text("Plummer")
    page.locator(".sd-lab_streams").get_by_role("button", name="100", exact=True).click()
    expect(page.get_by_role("button", name="Simulate")).to_be_visible()
    expect(page.locator(".sd-lab-status .sd-live")).to_contain_text("4 of the 4 settings are not simulated")
    expect(sentence(page, "convergence")).to_have_text("")
    assert watched.complaints == []


@pytest.mark.parametrize(
    "query", [SPECTRUM, pytest.param("?page=convergence&theme=dark", marks=pytest.mark.slow)]
)
def test_a_phone_shows_everything_without_sideways_scrolling(tab, query):
    page = tab(query, width=390, height=844).page
    expect(page.locator(".sd-sentence .sd-live").first).to_contain_text("streams")
    assert page.evaluate("sd.beyond()") == []
