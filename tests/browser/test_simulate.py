"""The Simulate page in a real browser: watched while it computes, found on other pages, safe from kill -9."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from streamdash.config import EnsembleConfig, Perturbers
from streamdash.simulation.ensemble import simulate
from streamdash.store.cache import Cache
from tests.browser.driving import open_app, started

pytestmark = [pytest.mark.browser, pytest.mark.slow]
OFFERED = """() => [...Bokeh.documents[0]._all_models.values()].some(m =>
    (m.css_classes ?? []).includes("sd-mass") && JSON.stringify(m.data.options).includes("mine"))"""
SMALL = EnsembleConfig(perturbers=Perturbers(mass_range="1e8-1e9"), n_streams=20)


@pytest.fixture
def root(shipped_cache, tmp_path) -> Path:
    """A cache with the default geometry and one small ensemble."""
    shutil.copytree(shipped_cache / "geometries", tmp_path / "cache" / "geometries")
    simulate(SMALL, "inline", cache=Cache.default(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def new_page(chrome):
    """Open the app in a window of its own."""
    contexts = []

    def make(address: str, query: str) -> Page:
        contexts.append(chrome.new_context(viewport={"width": 1440, "height": 1000}))
        return open_app(contexts[-1].new_page(), address, query)

    yield make
    for context in contexts:
        context.close()


def status(page: Page):
    return page.locator(".sd-sim-status p")


def press(page: Page, words: str) -> None:
    page.get_by_role("button", name=words, exact=True).click()


def test_a_simulation_is_watched_found_everywhere_and_outlives_its_server(root, new_page):
    cache = Cache.default(root)
    many = EnsembleConfig(perturbers=Perturbers(mass_range="1e5-1e7"), n_streams=1500)
    with started(root) as (address, server):
        other = new_page(address, "?page=profiles")
        page = new_page(address, "?page=simulate&sim_mass=1e7-1e8&sim_n=120&sim_title=%3Ci%3Emine")
        expect(status(page)).to_contain_text("impacts are expected per stream")
        sentence = page.locator(".sd-card-simulate .sd-sentence p")
        expect(sentence).to_contain_text("of the first 5 streams")
        press(page, "Simulate")
        expect(status(page)).to_contain_text("Done: 120 streams")
        expect(sentence).to_contain_text("120 finished streams of 120")
        other.wait_for_function(OFFERED)
        press(page, "See its profiles")
        page.wait_for_url(re.compile("mass="))
        expect(page.locator(".sd-class").first).to_contain_text("<i>mine")

        busy = new_page(address, "?page=simulate&sim_mass=1e5-1e7&sim_n=1500")
        expect(status(busy)).to_contain_text("1500 streams take about")
        press(busy, "Simulate")
        expect(busy.locator(".sd-card-simulate .sd-sentence p")).to_contain_text(
            re.compile(r"^\d+ finished streams of 1500")
        )
        server.kill()
        server.wait()
    entry = cache.find(many.key)
    assert 0 < entry.n_done < 1500
    assert cache.verify(entry) == []
    with started(root) as (address, _):
        page = new_page(address, "?page=simulate")
        page.locator(".sd-sim-list").get_by_text("Simulations on this server").click()
        press(page, "Show")
        expect(status(page)).to_contain_text(f"{entry.n_done} of 1500 are finished already")
        press(page, "Resume")
        expect(status(page)).to_contain_text("Computing the streams.")
        press(page, "Cancel")
        expect(status(page)).to_contain_text(re.compile(r"Cancelled; \d+ of 1500 streams are kept"))
    assert cache.verify(cache.find(many.key)) == []
    assert cache.find(many.key).n_done >= entry.n_done
