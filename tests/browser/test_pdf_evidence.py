"""The PDF and Evidence pages in a real browser."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from tests.browser.driving import darken, open_export

pytestmark = pytest.mark.browser
TWO = "mass=1e3-1e5,1e5-1e9"
PDF, EVIDENCE = f"?page=pdf&{TWO}", f"?page=evidence&{TWO}"
THREE = "mass=1e3-1e5,1e5-1e7,1e7-1e9"

# All sources with these columns in the figure whose vertical axis is named so, as arrays.
COLUMNS = """
([axis, names]) => {
  const get = (source, name) => source.data.get ? source.data.get(name) : source.data[name]
  return sd.figures()
    .filter(f => f.left.some(a => (a.axis_label ?? "").startsWith(axis)))
    .flatMap(f => sd.renderers(f).map(r => r.data_source))
    .filter(s => names.every(n => get(s, n) !== undefined))
    .map(s => names.map(n => Array.from(get(s, n))))
}
"""
# Where a point of a figure is on the screen.
PLACE = """
([axis, x, y]) => {
  const figure = sd.figures().find(f => f.left.some(a => (a.axis_label ?? "").startsWith(axis)))
  const view = sd.view(figure)
  view.el.scrollIntoView({block: 'center', behavior: 'instant'})
  const box = view.el.getBoundingClientRect()
  const frame = view.frame
  return [box.left + frame.x_scale.compute(x), box.top + frame.y_scale.compute(y)]
}
"""


def columns(page: Page, axis: str, *names: str) -> list[list[np.ndarray]]:
    """Columns ``names`` of every source that has them, in the figure with this vertical axis."""
    return [[np.array(c) for c in source] for source in page.evaluate(COLUMNS, [axis, list(names)])]


def lines(page: Page, axis: str) -> list[np.ndarray]:
    """Heights of every line, outline and dot of a figure."""
    return [y for _, y in columns(page, axis, "x", "y")]


def press(page: Page, slider: str, key: str, times: int = 1) -> None:
    page.locator(f".sd-{slider} .MuiSlider-thumb input").first.focus()
    for _ in range(times):
        page.keyboard.press(key)


def wait_for_query(page: Page, name: str, value: str) -> None:
    page.wait_for_function(
        "([name, value]) => new URLSearchParams(location.search).get(name) === value", arg=[name, value]
    )


def sentence(page: Page, card: str):
    return page.locator(f".sd-card-{card} .sd-live")


def same(first: list[np.ndarray], second: list[np.ndarray]) -> bool:
    return len(first) == len(second) and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(first, second, strict=True)
    )


@pytest.fixture(scope="module")
def pdf_tab(shared_tab):
    """A tab with the PDF page of the paper's two classes, in which bins are chosen."""
    return shared_tab(PDF)


@pytest.fixture(scope="module")
def evidence_tab(shared_tab):
    """A tab with their Evidence page, which is only read."""
    return shared_tab(EVIDENCE)


def test_moving_the_sliders_changes_both_figures_of_the_pdf_page(tab):
    watched = tab(PDF)
    page = watched.page
    for slider, query, value in (("noise", "noise", "0.11"), ("n_bin", "n_bin", "21")):
        bands, bin_ = lines(page, "PDF(Qρ)"), lines(page, "Π(y|M)")
        press(page, slider, "ArrowRight")
        wait_for_query(page, query, value)
        assert not same(bands, lines(page, "PDF(Qρ)"))
        assert not same(bin_, lines(page, "Π(y|M)"))
    expect(sentence(page, "pdf")).to_contain_text("in 21 bins at σε = 0.11")
    assert watched.complaints == []


def test_a_click_on_a_bin_shows_its_distribution_for_every_class(pdf_tab):
    watched = pdf_tab
    page = watched.page
    before = lines(page, "Π(y|M)")
    left, right = next((x0, x1) for x0, x1, _ in columns(page, "PDF(Qρ)", "x0", "x1", "number"))
    x, y = page.evaluate(PLACE, ["PDF(Qρ)", float(left[13] + right[13]) / 2, 1.0])
    page.mouse.click(x, y)
    wait_for_query(page, "alpha", "14")
    after = lines(page, "Π(y|M)")
    assert len(after) == 2
    assert not same(before, after)
    expect(sentence(page, "pdf-bin")).to_contain_text("Bin α = 14")
    expect(sentence(page, "pdf-bin")).to_contain_text("M1 · 10⁵–10⁹ M☉: median")
    assert watched.complaints == []


def test_pointing_at_a_bin_shows_its_numbers(pdf_tab):
    page = pdf_tab.page
    left, right = next((x0, x1) for x0, x1, _ in columns(page, "PDF(Qρ)", "x0", "x1", "number"))
    tooltip = page.locator(".bk-Tooltip")
    x, y = page.evaluate(PLACE, ["PDF(Qρ)", float(left[10] + right[10]) / 2, 0.5])
    for step in range(40):  # a pointer that moved before the figure took events is not seen there
        page.mouse.move(x, y + step % 2)
        if tooltip.count():
            break
        page.wait_for_timeout(250)
    expect(tooltip).to_contain_text("bin α")
    expect(tooltip).to_contain_text("11")
    expect(tooltip).to_contain_text("M0 · 10³–10⁵ M☉")
    expect(tooltip).to_contain_text("68 %")


def test_the_keyboard_chooses_a_bin_too(pdf_tab):
    page = pdf_tab.page
    press(page, "alpha", "Home")
    expect(sentence(page, "pdf-bin")).to_contain_text("Bin α = 1,")
    press(page, "alpha", "ArrowRight")
    wait_for_query(page, "alpha", "2")
    expect(sentence(page, "pdf-bin")).to_contain_text("Bin α = 2,")


@pytest.mark.slow
def test_links_reproduce_both_pages(tab):
    for query, axis in (
        (f"?page=pdf&{THREE}&noise=0.23&n_bin=33&alpha=12", "Π(y|M)"),
        (f"?page=evidence&{THREE}&noise=0.23&n_bin=33&fiducial=2&exclude=measured", "ln B for M2"),
    ):
        first = tab(query).page
        second = tab(first.evaluate("() => location.search")).page
        assert len(lines(first, axis)) > 0
        assert same(lines(first, axis), lines(second, axis))


@pytest.mark.slow
def test_moving_the_sliders_changes_ln_b_and_then_the_table(tab):
    watched = tab(EVIDENCE)
    page = watched.page
    table = page.locator(".sd-table-1 table.ready")
    expect(table).to_contain_text("Paper, table 1")
    before, words = lines(page, "ln B for M0"), table.inner_text()
    press(page, "noise", "ArrowRight", 5)
    wait_for_query(page, "noise", "0.15")
    assert not same(before, lines(page, "ln B for M0"))
    expect(sentence(page, "evidence")).to_contain_text("Σ ln B")
    expect(table).not_to_have_text(words)
    between = lines(page, "ln B for M0")
    press(page, "n_bin", "ArrowRight")
    wait_for_query(page, "n_bin", "21")
    assert not same(between, lines(page, "ln B for M0"))
    assert watched.complaints == []


def test_the_table_stands_beside_the_papers_with_jeffreys_words(evidence_tab):
    page = evidence_tab.page
    table = page.locator(".sd-table-1 table.ready")
    expect(table).to_contain_text("Paper, table 1")
    cells = [text.split("\n")[0].strip() for text in table.locator("td").all_inner_texts()]
    for value in ("9.0", "18.0", "33.1", "53.5", "4.0", "5.4", "3.1", "1.3"):
        assert value in cells
    assert sum("±" in cell for cell in cells) == 8
    expect(table).to_contain_text("strong evidence")
    expect(table).to_contain_text("correlations included")


@pytest.mark.parametrize("noise", ["0.123", pytest.param("0.124", marks=pytest.mark.slow)])
def test_slow_results_reach_a_page_that_was_just_opened(tab, noise):
    """Nobody asked for this noise before: the results come while or after the browser builds the page."""
    page = tab(f"{EVIDENCE}&noise={noise}").page
    expect(sentence(page, "cumulative")).to_contain_text("the plain sum goes from")
    expect(sentence(page, "growth")).to_contain_text("2000 streams")
    page.wait_for_function("() => sd.figures().some(f => f.left[0].axis_label === 'Σ ln B for M0')")
    page.wait_for_function("() => sd.figures().some(f => f.left[0].axis_label === 'Σ ln B over bins')")


def test_choosing_the_fiducial_redraws(tab):
    watched = tab(EVIDENCE)
    page = watched.page
    page.locator(".sd-fiducial").get_by_role("button", name="M1").click()
    wait_for_query(page, "fiducial", "1")
    page.wait_for_function("() => sd.figures().some(f => f.left[0].axis_label === 'ln B for M1')")
    expect(sentence(page, "evidence")).to_contain_text("If the perturbers are M1")
    assert watched.complaints == []


def test_the_text_on_differences_can_be_read(evidence_tab):
    page = evidence_tab.page
    page.get_by_text("Where and why our numbers differ from the paper’s").click()
    expect(page.locator(".sd-differences")).to_contain_text("What the paper leaves open")


def test_numbers_of_every_card_are_downloaded(evidence_tab, tmp_path):
    page = evidence_tab.page
    expect(page.locator(".sd-table-1 table.ready")).to_contain_text("Paper, table 1")
    expect(sentence(page, "growth")).to_contain_text("streams")
    for card, column in (("evidence", "ln_bayes"), ("cumulative", "paper"), ("growth", "sum_ln_bayes")):
        open_export(page, f".sd-card-{card}")
        with page.expect_download() as download:
            page.locator(f".sd-card-{card}").get_by_role("button", name="CSV").click()
        path = tmp_path / download.value.suggested_filename
        download.value.save_as(path)
        assert np.isfinite(pd.read_csv(path, comment="#")[column]).any()
    with page.expect_download() as download:
        page.locator(".sd-card-cumulative").get_by_role("button", name="SVG").click()
    download.value.save_as(tmp_path / "cumulative.svg")
    assert "<svg" in (tmp_path / "cumulative.svg").read_text(encoding="utf-8")[:2000]


def test_excluded_bins_are_grey_in_the_figure(evidence_tab):
    page = evidence_tab.page
    spans = [pair for pair in columns(page, "ln B for M0", "x0", "x1") if len(pair[0]) < 10]
    assert spans
    grey = sum((x1 - x0).sum() for x0, x1 in spans)
    match = re.search(r"(\d+) of 20 bins are excluded", sentence(page, "evidence").inner_text())
    width = next(x1[0] - x0[0] for x0, x1, _ in columns(page, "ln B for M0", "x0", "x1", "number"))
    assert match is not None
    assert grey == pytest.approx(int(match[1]) * width)


@pytest.mark.parametrize(
    "query", [f"?page=pdf&{THREE}", pytest.param(f"?page=evidence&{THREE}", marks=pytest.mark.slow)]
)
def test_a_phone_shows_everything_without_sideways_scrolling(tab, query):
    page = tab(query, width=390, height=844).page
    for theme in ("default", "dark"):
        if theme == "dark":
            darken(page)
        if "evidence" in query:
            expect(page.locator(".sd-table-1 table.ready")).to_be_attached()
        page.wait_for_function("() => sd.beyond().length === 0")
        page.wait_for_function("() => document.documentElement.scrollWidth <= 390")
