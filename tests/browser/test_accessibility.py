"""What axe-core finds on every page, in light and dark, and at a phone's width."""

from __future__ import annotations

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from app.pages.registry import PAGES
from tests.browser.driving import darken

pytestmark = [pytest.mark.browser, pytest.mark.slow]
PROFILE = "observe&example=yes"
"""Observe once it has a profile: with a chip for each assumption."""
GRAVE = {"serious", "critical"}


def grave(page: Page) -> dict[str, list[str]]:
    """Grave violations of what a page shows now: what is violated, and the first places."""
    found = Axe().run(page).response
    assert found["passes"], "axe saw nothing"
    return {
        f"{violation['id']}: {violation['help']}": [node["target"][-1] for node in violation["nodes"][:3]]
        for violation in found["violations"]
        if violation["impact"] in GRAVE
    }


@pytest.mark.parametrize("key", [*(page.key for page in PAGES), PROFILE])
def test_no_grave_violation_on_any_page(tab, key):
    page = tab(f"?page={key}").page
    if key == PROFILE:
        expect(page.locator(".sd-chip").first).to_be_visible()
    assert grave(page) == {}
    page.set_viewport_size({"width": 390, "height": 900})
    darken(page)
    for _ in range(3):  # colours take a moment to change, and have changed when nothing is found
        if not (found := grave(page)):
            break
        page.wait_for_timeout(1000)
    assert found == {}
