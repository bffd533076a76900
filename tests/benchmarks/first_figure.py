"""How long it takes from starting the server, and from opening a link, until the figures are painted.

    python tests/benchmarks/first_figure.py

Cold: server process started, browser waiting. Warm: further tabs of the same browser on the same server.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from playwright.sync_api import BrowserContext, Page, sync_playwright

from tests.browser.driving import ROOT, launch, served

PAINTED = """
() => {
  const models = [...(window.Bokeh?.documents?.[0]?._all_models.values() ?? [])]
  const figures = models.filter(m => m.type === "Figure")
  return figures.length > 0 && figures.every(f => (Bokeh.index.find_one(f)?._render_count ?? 0) > 0)
}
"""
SETTLED_MS = 1500
"""A new tab costs the browser itself most of a second of processor time."""


def new_tab(context: BrowserContext) -> Page:
    """An empty tab that has settled."""
    page = context.new_page()
    page.wait_for_timeout(SETTLED_MS)
    return page


def seconds_to_figure(page: Page, address: str, query: str) -> float:
    """Seconds from asking for the page until every figure has been painted; closes the tab."""
    start = time.perf_counter()
    page.goto(f"{address}/main{query}", wait_until="commit")
    page.wait_for_function(PAINTED)
    elapsed = time.perf_counter() - start
    page.close()
    return elapsed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--page", default="profiles", help="key of the page")
    parser.add_argument("--tabs", type=int, default=8, help="warm tabs to open, one after another")
    arguments = parser.parse_args()
    query = f"?page={arguments.page}"
    with sync_playwright() as playwright:
        browser = launch(playwright)
        context = browser.new_context(viewport={"width": 1440, "height": 900})
        tab = new_tab(context)
        start = time.perf_counter()
        with served(ROOT / "cache") as address:
            seconds_to_figure(tab, address, query)
            cold = time.perf_counter() - start
            warm = [seconds_to_figure(new_tab(context), address, query) for _ in range(arguments.tabs)]
        browser.close()
    p50, p95 = np.percentile(warm, [50, 95])
    print(
        f"{arguments.page}: cold {cold:.1f} s from starting the server; warm p50 {p50:.2f} s, p95 {p95:.2f} s"
    )


if __name__ == "__main__":
    main()
