"""Where the first figure of every page begins, in pixels from the top, on a wide screen and on a phone.

    python -m tests.benchmarks.first_edges
    python -m tests.benchmarks.first_edges --only learn

Prints a table and ends with status 1 where an edge lies below its bound.
"""

from __future__ import annotations

import argparse

from playwright.sync_api import Page, sync_playwright
from playwright.sync_api import TimeoutError as PlaywrightTimeout

from app.pages.registry import PAGES
from tests.browser.driving import ROOT, launch, open_app, served

PHONE, WIDE = {"width": 390, "height": 844}, {"width": 1440, "height": 900}
HIGHEST = {390: 420, 1440: 260}
"""Farthest down, in pixels, that a page's first figure may begin, by the width of the screen."""
MORE = {
    "observe": {"observe, example": "observe&example=yes"},
    "learn": {
        "learn, story": "learn",
        "learn, one fly-by": "learn&lesson=flyby",
        "learn, quiz": "learn&lesson=quiz",
    },
}
"""Views of a page that have a first figure of their own."""
VIEWS = {
    name: query
    for page in PAGES
    for name, query in {
        **({} if page.key == "learn" else {page.key: page.key}),
        **MORE.get(page.key, {}),
    }.items()
}
"""What is measured, and the page of its link; the teachers' plan has no figure."""


def first_edge(page: Page, size: dict[str, int], patience_ms: float | None = None) -> float:
    """Top edge of the first figure once it is where it belongs, or where it stays if it never is."""
    page.set_viewport_size(size)
    limit = HIGHEST[size["width"]]
    try:
        page.wait_for_function(
            "limit => sd.tops().length && sd.tops()[0] <= limit", arg=limit, timeout=patience_ms
        )
    except PlaywrightTimeout:
        if patience_ms is None:
            raise
    return min(page.evaluate("sd.tops()"), default=float("inf"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", default="", help="only views with this word in their name")
    parser.add_argument("--patience", type=float, default=60.0, help="seconds to wait for a figure")
    arguments = parser.parse_args()
    beyond = 0
    with served(ROOT / "cache") as address, sync_playwright() as playwright:
        browser = launch(playwright)
        bounds = (f"1440 × 900 (≤ {HIGHEST[1440]})", f"390 × 844 (≤ {HIGHEST[390]})")
        print(f"| first figure's top edge (px) | {bounds[0]} | {bounds[1]} |")
        print("|---|---|---|")
        for name, query in VIEWS.items():
            if arguments.only not in name:
                continue
            page = browser.new_page(viewport=WIDE)
            open_app(page, address, f"?page={query}")
            edges = [first_edge(page, size, 1e3 * arguments.patience) for size in (WIDE, PHONE)]
            beyond += edges[0] > HIGHEST[1440] or edges[1] > HIGHEST[390]
            print(f"| {name} | {edges[0]:.0f} | {edges[1]:.0f} |", flush=True)
            page.close()
        browser.close()
    raise SystemExit(1 if beyond else 0)


if __name__ == "__main__":
    main()
