"""How long it takes from pressing Simulate until the first curves of the new ensemble are painted.

    python -m tests.benchmarks.first_curves [--mass 1e3-1e5] [--streams 1000] [--rounds 3]

Each round asks for another seed, in a cache with nothing but the geometry; it is cancelled afterwards.
"""

from __future__ import annotations

import argparse
import re
import shutil
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from tests.browser.driving import ROOT, launch, open_app, started

PATIENCE = 120_000


def seconds_to_curves(page: Page) -> float:
    """Seconds from the click until finished streams are drawn and named under the figure."""
    status, sentence = page.locator(".sd-sim-status p"), page.locator(".sd-card-simulate .sd-sentence p")
    expect(status).to_contain_text("streams take about", timeout=PATIENCE)
    expect(sentence).to_contain_text("of the first", timeout=PATIENCE)
    page.wait_for_timeout(1500)
    start = time.perf_counter()
    page.get_by_role("button", name="Simulate", exact=True).click()
    while "finished streams of" not in (sentence.text_content() or ""):  # expect() looks once a second
        page.wait_for_timeout(50)
    elapsed = time.perf_counter() - start
    page.get_by_role("button", name="Cancel", exact=True).click()
    expect(status).to_contain_text(re.compile("Cancelled|Done"), timeout=PATIENCE)
    return elapsed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--mass", default="1e3-1e5")
    parser.add_argument("--streams", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "cache" / "geometries", Path(folder) / "geometries")
        browser = launch(playwright)
        with started(Path(folder)) as (address, _):
            for seed in range(arguments.rounds):
                query = f"?page=simulate&sim_mass={arguments.mass}&sim_n={arguments.streams}&sim_seed={seed}"
                context = browser.new_context(viewport={"width": 1440, "height": 900})
                elapsed = seconds_to_curves(open_app(context.new_page(), address, query))
                context.close()
                print(f"{arguments.mass}, job {seed + 1} of this server: first curves after {elapsed:.1f} s")
        browser.close()


if __name__ == "__main__":
    main()
