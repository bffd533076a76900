"""Bokeh's tools for keyboards and screen readers, and the system's dark preference: in a browser alone."""

from __future__ import annotations

from tests.browser.driving import MODELS, PATIENCE_MS, READY

PDF = "?page=pdf&mass=1e3-1e5,1e5-1e9"
TOOLS = """() => {
  const found = []
  const walk = (node) => {
    for (const child of node.children) {
      if (child.dataset?.sd) { found.push(child) }
      walk(child)
      if (child.shadowRoot) { walk(child.shadowRoot) }
    }
  }
  walk(document.body)
  return found
}"""
DEEPEST = """() => {
  let element = document.activeElement
  while (element?.shadowRoot?.activeElement) { element = element.shadowRoot.activeElement }
  return element
}"""


def test_a_figures_tools_are_one_stop_with_names_arrows_and_a_focus_that_is_seen(tab):
    page = tab(PDF).page
    page.keyboard.press("Tab")
    page.wait_for_function(f"() => ({TOOLS})().length > 4")
    told = page.evaluate(
        f"() => ({TOOLS})().map(b => [b.getAttribute('aria-label'), b.getAttribute('role'), b.tabIndex])"
    )
    assert all(name and role == "button" for name, role, _ in told)
    figures = page.evaluate("() => sd.figures().length")
    assert [index for _, _, index in told].count(0) == figures
    for _ in range(60):
        if page.evaluate(f"() => !!({DEEPEST})()?.dataset?.sd"):
            break
        page.keyboard.press("Tab")
    first = page.evaluate(f"() => ({DEEPEST})().getAttribute('aria-label')")
    assert page.evaluate(f"() => getComputedStyle(({DEEPEST})()).outlineWidth") == "3px"
    page.keyboard.press("ArrowRight")
    assert page.evaluate(f"() => ({DEEPEST})().getAttribute('aria-label')") not in ("", first)


def test_the_first_visit_is_dark_where_the_system_is(chrome, address):
    context = chrome.new_context(color_scheme="dark")
    page = context.new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"{address}/main{PDF}")
    page.wait_for_function(READY)
    page.evaluate(MODELS)
    colour = "getComputedStyle(document.body).backgroundColor"
    page.wait_for_function(f"() => {colour}.match(/[0-9]+/g).slice(0, 3).every(c => c < 60)")
    assert "theme" not in page.url
    context.close()
