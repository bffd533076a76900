"""Take the pictures of the README anew from the shipped cache.

    python tests/browser/screenshots.py

Writes docs/profiles.png: the Profiles page with three classes, light, 1440 × 860.
"""

from __future__ import annotations

import io

from PIL import Image
from playwright.sync_api import sync_playwright

from tests.browser.driving import ROOT, launch, open_app, served

VIEWS = {"profiles.png": "?page=profiles&mass=1e3-1e5,1e5-1e7,1e7-1e9&highlight=2"}
SIZE = {"width": 1440, "height": 860}
COLOURS = 256


def main() -> None:
    folder = ROOT / "docs"
    folder.mkdir(exist_ok=True)
    with served(ROOT / "cache") as address, sync_playwright() as playwright:
        browser = launch(playwright)
        for name, query in VIEWS.items():
            page = browser.new_page(viewport=SIZE)
            open_app(page, address, query)
            page.wait_for_timeout(1000)  # fonts and the tabs' underline settle
            picture = Image.open(io.BytesIO(page.screenshot()))
            small = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
            small.save(folder / name, optimize=True)
            print(f"{folder / name}: {(folder / name).stat().st_size / 1000:.0f} kB")
        browser.close()


if __name__ == "__main__":
    main()
