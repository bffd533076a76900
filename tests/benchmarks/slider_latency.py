"""How long a slider move takes until the new figure is painted, in Chromium, with the shipped cache.

    python tests/benchmarks/slider_latency.py --page profiles --slider noise
    python tests/benchmarks/slider_latency.py --page pdf --slider n_bin
    python tests/benchmarks/slider_latency.py --page evidence --slider noise --only "ln B for"

Presses an arrow key on the slider and takes the time from the key until the frame after every
figure on the page has painted its new data. Server and browser share the machine.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from tests.browser.driving import ROOT, launch, open_app, served

THREE_CLASSES = "1e3-1e5,1e5-1e7,1e7-1e9"

# One move: from the key being pressed to the frame in which all figures have painted new data.
WATCH = """
(only) => {
  const wanted = f => f.left.some(axis => (axis.axis_label ?? "").startsWith(only))
  const views = sd.figures().filter(wanted).map(sd.view).filter(v => v != null)
  const sources = new Map()
  for (const view of views) {
    for (const r of sd.renderers(view.model)) { sources.set(r.data_source, view) }
  }
  window.sd_move = () => new Promise((done) => {
    let pressed = null
    const waiting = new Set(views)
    const changed = new Set()
    const listeners = []
    for (const [source, view] of sources) {
      const listener = () => { changed.add(view) }
      source.properties.data.change.connect(listener)
      listeners.push([source, listener])
    }
    for (const view of views) {
      const painted = () => {
        if (!changed.has(view)) { return }
        view.repainted.disconnect(painted)
        waiting.delete(view)
        if (waiting.size > 0) { return }
        requestAnimationFrame(() => {
          const shown = performance.now()
          for (const [source, listener] of listeners) { source.properties.data.change.disconnect(listener) }
          done(shown - pressed)
        })
      }
      view.repainted.connect(painted)
    }
    window.addEventListener("keydown", () => { pressed = performance.now() }, {once: true, capture: true})
  })
}
"""


def measure(page: Page, slider: str, moves: int, only: str = "") -> np.ndarray:
    """Milliseconds from key to painted figure, one per move after three that are not counted."""
    thumb = page.locator(f".sd-{slider} .MuiSlider-thumb input").first
    page.evaluate(WATCH, only)
    thumb.focus()
    times = []
    for i in range(moves + 3):
        page.evaluate("() => { window.sd_done = sd_move() }")
        page.keyboard.press("ArrowRight" if i % 2 == 0 else "ArrowLeft")
        times.append(page.evaluate("() => window.sd_done"))
        page.wait_for_timeout(150)
    return np.array(times[3:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--page", default="profiles", help="key of the page")
    parser.add_argument("--slider", default="noise", help="name of the slider: its class is sd-NAME")
    parser.add_argument("--mass", default=THREE_CLASSES, help="mass ranges, as in a link")
    parser.add_argument(
        "--only", default="", help="watch figures whose vertical axis label starts so; default all"
    )
    parser.add_argument("--moves", type=int, default=60)
    parser.add_argument("--cache", type=Path, default=ROOT / "cache")
    arguments = parser.parse_args()
    with served(arguments.cache) as address, sync_playwright() as playwright:
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        query = f"?page={arguments.page}&mass={arguments.mass}"
        open_app(page, address, query)
        times = measure(page, arguments.slider, arguments.moves, arguments.only)
        figures = page.evaluate("() => sd.figures().length")
        browser.close()
    p50, p95 = np.percentile(times, [50, 95])
    print(
        f"{arguments.page}, {arguments.slider}, {arguments.mass}: {figures} figures, "
        f"{len(times)} moves, key to painted p50 {p50:.0f} ms, p95 {p95:.0f} ms, worst {times.max():.0f} ms"
    )


if __name__ == "__main__":
    main()
