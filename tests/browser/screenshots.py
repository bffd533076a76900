"""Take the pictures of README and documentation anew from the shipped cache.

    python tests/browser/screenshots.py
    python tests/browser/screenshots.py observe.png classifier.png

Writes them below ``docs/``: light, each less than 150 kB.
"""

from __future__ import annotations

import io
import sys
from typing import NamedTuple

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from tests.browser.driving import ROOT, launch, open_app, served


class View(NamedTuple):
    """What a picture shows: a link, when it is there, and the size of the screen."""

    query: str
    there: str = "true"
    size: tuple[int, int] = (1280, 800)


VIEWS = {
    "profiles.png": View("?page=profiles&mass=1e3-1e5,1e5-1e7,1e7-1e9&highlight=2", size=(1440, 860)),
    "pictures/front.png": View("", "sd.all('sd-facts').length > 0"),
    "pictures/evidence.png": View("?page=evidence", "sd.figures().length >= 3", (1280, 900)),
    "pictures/classifier.png": View("?page=classifier", "sd.figures().length >= 4"),
    "pictures/observe.png": View(
        "?page=observe&example=yes", "sd.figures().some(f => sd.renderers(f).length > 4)"
    ),
    "pictures/infer.png": View("?page=infer", "sd.figures().length >= 2"),
    "pictures/simulate.png": View("?page=simulate"),
    "pictures/fly-by.png": View("?page=learn&lesson=flyby", "sd.figures().length >= 4"),
    "pictures/quiz.png": View("?page=learn&lesson=quiz&game=4"),
    "pictures/projector.png": View("?page=learn&step=5&projector=yes", size=(1440, 810)),
}
"""By file below ``docs/``. A condition is JavaScript, with the helpers of `tests.browser.driving`."""
PAINTED = "sd.figures().length && sd.figures().map(sd.view).filter(Boolean).every(v => v._render_count > 0)"
COLOURS = (256, 128, 64, 32)
LARGEST = 150_000
"""Bytes of a picture: fewer colours until it fits."""


def small(picture: bytes) -> bytes:
    """The same as PNG with a palette, below `LARGEST` bytes.

    Raises
    ------
    ValueError
        When even the fewest colours do not suffice.
    """
    image = Image.open(io.BytesIO(picture)).convert("RGB")
    for colours in COLOURS:
        data = io.BytesIO()
        image.quantize(colours, dither=Image.Dither.NONE).save(data, "PNG", optimize=True)
        if data.tell() < LARGEST:
            return data.getvalue()
    raise ValueError(f"The picture needs {data.tell()} bytes even with {COLOURS[-1]} colours.")


def take(browser: Browser, address: str, view: View) -> bytes:
    """A picture of a view once all its figures are painted."""
    width, height = view.size
    page = browser.new_page(viewport={"width": width, "height": height})
    open_app(page, address, view.query)
    page.wait_for_function(f"() => ({view.there}) && ({PAINTED}) && Bokeh.documents[0].is_idle")
    page.wait_for_timeout(1500)  # fonts and the sliders' marks settle
    picture = page.screenshot()
    page.close()
    return small(picture)


def main() -> None:
    wanted = [name for name in VIEWS if not sys.argv[1:] or name.split("/")[-1] in sys.argv[1:]]
    with served(ROOT / "cache") as address, sync_playwright() as playwright:
        browser = launch(playwright)
        for name in wanted:
            file = ROOT / "docs" / name
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(take(browser, address, VIEWS[name]))
            print(f"{file.relative_to(ROOT)}: {file.stat().st_size / 1000:.0f} kB", flush=True)
        browser.close()


if __name__ == "__main__":
    main()
