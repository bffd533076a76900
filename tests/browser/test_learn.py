"""The Learn page in a real browser."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser
FLYBY = "?page=learn&lesson=flyby"
SHOWN = """(label) => {
  const data = sd.figures().find(f => f.left[0].axis_label.startsWith(label))
    .renderers.filter(r => r.glyph.type === "Line").map(r => Array.from(r.data_source.data.y))
  return data[data.length - 1]
}"""


def film(page: Page):
    return page.locator(".sd-player .sd-film")


def frame(page: Page) -> int:
    return int(film(page).get_attribute("data-frame") or -1)


def drawn(page: Page) -> None:
    """Wait until every figure that is in sight has been painted."""
    page.wait_for_function(
        """() => {
          const views = sd.figures().map(sd.view).filter(view => view != null)
          return views.length > 0 && views.every(view => view._render_count > 0)
        }"""
    )


def sideways(page: Page) -> list[str]:
    """Cards and controls that stick out to the right."""
    return page.evaluate(
        """() => [...document.querySelectorAll(".sd-card, .sd-controls")]
             .filter(e => e.getBoundingClientRect().right > window.innerWidth + 1).map(e => e.className)"""
    )


def test_the_film_plays_pauses_and_scrubs_in_the_browser(tab):
    watched = tab(f"{FLYBY}&frame=0")
    page = watched.page
    expect(page.locator(".sd-player .sd-film-play")).to_be_enabled()
    before = page.evaluate(SHOWN, "ρ (1")
    page.locator(".sd-player .sd-film-play").click()
    expect(film(page)).to_have_attribute("data-playing", "true")
    page.wait_for_function("(f) => Number(f.dataset.frame) >= 15", arg=film(page).element_handle())
    page.keyboard.press("Space")  # the button still has the focus
    expect(film(page)).to_have_attribute("data-playing", "false")
    paused = frame(page)
    assert paused >= 15
    page.wait_for_function(f"() => new URLSearchParams(location.search).get('frame') === '{paused}'")
    after = page.evaluate(SHOWN, "ρ (1")
    assert max(abs(a - b) for a, b in zip(after, before, strict=True)) > 0.05
    page.locator(".sd-player .sd-film-slider").focus()
    page.keyboard.press("End")
    expect(page.locator(".sd-player .sd-film-caption")).to_contain_text("today")
    expect(page.locator(".sd-card-film .sd-sentence .sd-live")).to_contain_text("Today")
    page.wait_for_function("() => !new URLSearchParams(location.search).has('frame')")
    assert watched.complaints == []


@pytest.mark.slow
def test_another_mass_makes_another_film(tab):
    page = tab(FLYBY).page
    expect(page.locator(".sd-player .sd-film-play")).to_be_enabled()
    sentence = page.locator(".sd-card-film .sd-sentence .sd-live")
    expect(sentence).to_contain_text("Today")
    before, deepest = page.evaluate(SHOWN, "ρ (1"), sentence.inner_text()
    page.locator(".sd-mass10 .MuiSlider-thumb input").first.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(page.locator(".sd-hand .sd-live")).to_contain_text("1.8·10⁸ M☉")
    page.wait_for_function(
        "(before) => JSON.stringify((" + SHOWN + ")('ρ (1')) !== JSON.stringify(before)", arg=before
    )
    expect(sentence).not_to_have_text(deepest)


@pytest.mark.slow
def test_a_film_with_another_flyby_is_right_at_once(tab):
    page = tab(FLYBY).page
    expect(film(page)).to_have_attribute("data-starts", "1")  # it opens playing
    expect(film(page)).to_have_attribute("data-playing", "false")
    for button in (".sd-add-flyby button", ".sd-remove-flyby button"):
        before = page.evaluate(SHOWN, "Qρ")
        page.locator(button).click()
        page.wait_for_function(
            "(before) => JSON.stringify((" + SHOWN + ")('Qρ')) !== JSON.stringify(before)", arg=before
        )
        drawn = page.evaluate(SHOWN, "Qρ")
        page.locator(".sd-player .sd-film-slider").focus()
        page.keyboard.press("Home")
        page.keyboard.press("End")
        again = page.evaluate(SHOWN, "Qρ")
        assert again == pytest.approx(drawn, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("query", [f"{FLYBY}&theme=dark", "?page=learn&lesson=quiz", "?page=learn&step=9"])
def test_nothing_sticks_out_on_a_phone(tab, query):
    page = tab(query, width=390, height=844).page
    expect(page.locator(".sd-card").first).to_be_visible()
    assert sideways(page) == []
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 390


def test_a_round_of_the_quiz_by_keyboard(tab):
    watched = tab("?page=learn&lesson=quiz&game=4")
    page = watched.page
    verdict = page.locator(".sd-verdict .sd-live")
    expect(verdict).to_contain_text("Round 1 of 10")
    expect(page.locator(".sd-card-clue")).to_be_hidden()
    link = page.locator(".sd-class-link input")
    stream, answers = (page.locator(name).bounding_box() for name in (".sd-card-quiz", ".sd-guess-0"))
    assert stream["y"] < answers["y"]
    assert link.input_value().endswith("?page=learn&lesson=quiz&game=4")
    page.locator(".sd-guess-0 button").focus()
    page.keyboard.press("Enter")
    expect(verdict).to_contain_text("it was")
    expect(page.locator(".sd-card-clue .sd-sentence .sd-live")).to_contain_text("68 %")
    expect(verdict).to_contain_text("The classifier said")
    page.wait_for_function("() => new URLSearchParams(location.search).has('answers')")
    assert link.input_value().endswith("?page=learn&lesson=quiz&game=4")
    page.locator(".sd-next button").click()
    expect(verdict).to_contain_text("Round 2 of 10")
    assert watched.complaints == []


def test_the_story_goes_on_by_keyboard_and_its_links_come_back(tab):
    watched = tab("?page=learn&step=6")
    page = watched.page
    story = page.locator(".sd-story")
    expect(story).to_contain_text("A telescope counts stars")
    drawn(page)
    page.locator(".sd-story .drag").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function("() => new URLSearchParams(location.search).get('noise') === '0.12'")
    expect(page.locator(".sd-story .drag")).to_have_text("σε = 0.12")
    box = page.locator(".sd-story .drag").bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    page.mouse.move(box["x"] + 45, box["y"] + 5)
    page.mouse.up()
    expect(page.locator(".sd-story .drag")).to_have_text("σε = 0.18")
    page.locator(".sd-predict-1 button").click()
    expect(page.locator(".sd-outcome .sd-live")).to_contain_text("As you said. From σε = 0.18")
    expect(page.locator(".sd-story .drag")).to_have_text("σε = 0.09")
    page.locator(".sd-on button").focus()
    page.keyboard.press("Enter")
    expect(story).to_contain_text("odds")
    drawn(page)
    page.locator(".sd-on button").click()
    expect(story).to_contain_text("Bayes factor")
    drawn(page)
    page.wait_for_function("() => new URLSearchParams(location.search).get('step') === '8'")
    page.evaluate("() => { window.sd_same_page = true }")
    page.get_by_role("link", name="The PDF page").click()
    expect(page.locator(".sd-card-pdf")).to_be_visible()
    drawn(page)
    assert "page=pdf" in page.url
    page.go_back()
    expect(story).to_contain_text("Bayes factor")
    assert page.evaluate("() => window.sd_same_page") is True
    page.get_by_text("Glossary").click()
    expect(page.get_by_role("row", name="Qρ density of the stream")).to_be_visible()
    assert watched.complaints == []
