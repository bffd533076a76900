"""Where things stand: a figure is in sight on every page, on a wide screen and on a phone."""

from __future__ import annotations

import pytest
from playwright.sync_api import expect

from tests.benchmarks.first_edges import PHONE, VIEWS, WIDE, first_edge
from tests.browser.driving import open_controls

pytestmark = pytest.mark.browser
QUICK = {"home", "evidence"}
FIGURED = [
    pytest.param(query, id=name, marks=[] if name in QUICK else [pytest.mark.slow])
    for name, query in VIEWS.items()
]


@pytest.mark.parametrize("query", FIGURED)
def test_the_first_figure_is_in_sight(tab, query):
    page = tab(f"?page={query}", **WIDE).page
    for size in (WIDE, PHONE):
        first_edge(page, size)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= size["width"]
        page.wait_for_function("() => sd.lying().length === 0")
    # Nothing of a closed drawer is in sight, whatever Panel calls visible in it.
    assert page.evaluate("() => sd.all('sd-more').every(e => e.getBoundingClientRect().top >= innerHeight)")


def test_controls_stand_beside_the_figure_or_in_a_drawer(tab):
    page = tab("?page=profiles", **WIDE).page
    masses, drawer = page.locator(".sd-mass"), page.get_by_role("button", name="All controls")
    expect(masses).to_be_visible()
    expect(drawer).to_be_hidden()
    page.set_viewport_size(PHONE)
    expect(masses).to_be_hidden()
    expect(page.locator(".sd-noise")).to_be_visible()
    open_controls(page)
    expect(masses).to_be_visible()
    page.keyboard.press("Escape")
    expect(masses).to_be_hidden()
    expect(drawer).to_be_focused()


@pytest.mark.slow
def test_pages_are_reached_from_the_title_bar(tab):
    watched = tab("?page=profiles&noise=0.3", **WIDE)
    page = watched.page
    page.get_by_role("link", name="PDF", exact=True).click()
    expect(page.locator(".sd-card-pdf")).to_be_visible()
    page.wait_for_url("**page=pdf&noise=0.3")
    expect(page.get_by_role("link", name="PDF", exact=True)).to_have_attribute("aria-current", "page")
    page.go_back()
    expect(page.locator(".sd-card-profiles")).to_be_visible()
    page.set_viewport_size(PHONE)
    page.get_by_role("button", name="All pages").click()
    page.get_by_role("link", name="Evidence", exact=True).click()
    expect(page.locator(".sd-card-evidence")).to_be_visible()
    assert watched.complaints == []


def test_no_figure_takes_the_scroll(tab):
    """Neither a wheel nor a swipe moves an axis before a tool has been chosen."""
    page = tab("?page=evidence", **WIDE).page
    ranges = "() => sd.figures().map(f => [f.x_range.start, f.x_range.end, f.y_range.start, f.y_range.end])"
    before = page.evaluate(ranges)
    x, y = page.evaluate("() => [400, sd.tops()[0] + 120]")
    page.mouse.move(x, y)
    page.mouse.wheel(0, 200)
    page.mouse.down()
    page.mouse.move(x + 80, y + 20, steps=4)
    page.mouse.up()
    tools = page.evaluate("() => sd.figures().map(f => [f.toolbar.active_scroll, f.toolbar.active_drag])")
    assert all(tool is None for pair in tools for tool in pair)
    assert page.evaluate(ranges)[0] == before[0]


def test_the_front_page_answers_and_its_doors_open(tab):
    watched = tab("", **WIDE)
    page = watched.page
    answer = page.locator(".sd-answer-now .sd-now")
    expect(answer).to_contain_text("noise alone by ±0.1")
    page.locator(".sd-noise .MuiSlider-thumb input").first.focus()
    page.keyboard.press("ArrowRight")
    expect(answer).to_contain_text("noise alone by ±0.11")
    expect(page.locator(".sd-facts")).to_contain_text("Σ ln B")
    page.locator(".sd-doors").get_by_role("link", name="Explore").click()
    expect(page.locator(".sd-card-profiles")).to_be_visible()
    assert "page=profiles" in page.url and "noise=0.11" in page.url
    assert watched.complaints == []


LETTERS = """() => {
  const small = []
  const look = (node, card) => {
    for (const child of node.childNodes) {
      if (child.nodeType === Node.TEXT_NODE) {
        const parent = child.parentElement ?? child.parentNode.host
        const size = parseFloat(getComputedStyle(parent).fontSize)
        // Subscripts are smaller than their line.
        if (child.textContent.trim() && parent.checkVisibility() && size < 24 && !parent.closest("sub")
            && !["STYLE", "SCRIPT"].includes(parent.tagName)) {
          small.push(child.textContent.trim())
        }
      } else { look(child) }
      if (child.shadowRoot) { look(child.shadowRoot) }
    }
  }
  for (const part of ["sd-story", "sd-predict", "sd-links", "sd-foot", "sd-card"]) {
    sd.all(part).forEach(box => { look(box); if (box.shadowRoot) { look(box.shadowRoot) } })
  }
  return small
}"""


def test_a_projector_shows_large_letters_and_a_figure_that_fills_the_screen(tab):
    watched = tab("?page=learn&step=6&projector=yes", width=1920, height=1080)
    page = watched.page
    page.wait_for_function("() => sd.tops().length === 1 && sd.view(sd.figures()[0])._render_count > 0")
    box = page.evaluate("() => sd.view(sd.figures()[0]).el.getBoundingClientRect().toJSON()")
    assert box["height"] > 0.7 * 1080 and box["width"] > 0.5 * 1920
    page.wait_for_function("""() => sd.figures()[0].left.concat(sd.figures()[0].below).every(axis =>
        parseFloat(axis.axis_label_text_font_size) >= 24 && axis.major_label_text_font_size === "24px")""")
    assert page.evaluate(LETTERS) == []
    assert watched.complaints == []


def test_what_is_wider_than_a_phone_shows_that_it_scrolls(tab):
    """Beside the shadow, which lies on the side on which there is more, a keyboard reaches it."""
    page = tab("?page=evidence", **PHONE).page
    page.wait_for_function("() => sd.all('wide').some(box => box.scrollWidth > box.clientWidth + 1)")
    shadows = page.evaluate("""() => sd.all('wide').map(box => {
      const style = getComputedStyle(box)
      return [style.backgroundImage.match(/gradient/g)?.length, style.backgroundAttachment, box.tabIndex]
    })""")
    assert shadows and all(found == [4, "local, local, scroll, scroll", 0] for found in shadows)
