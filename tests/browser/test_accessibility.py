"""What axe-core finds on every page, in light and dark, and at a phone's width."""

from __future__ import annotations

import pytest
from axe_playwright_python.sync_playwright import Axe

from app.pages.registry import PAGES

GRAVE = {"serious", "critical"}


@pytest.mark.parametrize("theme", ["default", "dark"])
@pytest.mark.parametrize("key", [page.key for page in PAGES])
def test_no_grave_violation_on_any_page(tab, key, theme):
    page = tab(f"?page={key}&theme={theme}", width=1440 if theme == "default" else 390).page
    found = Axe().run(page).response
    assert found["passes"], "axe saw nothing"
    grave = {
        f"{violation['id']}: {violation['help']}": [node["target"][-1] for node in violation["nodes"][:3]]
        for violation in found["violations"]
        if violation["impact"] in GRAVE
    }
    assert grave == {}
