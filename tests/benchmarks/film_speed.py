"""How many frames a second the film of a fly-by reaches in Chromium, with the shipped cache.

    python tests/benchmarks/film_speed.py
    python tests/benchmarks/film_speed.py --query "&crowd=60"

Presses Play and counts, over the whole film, the times at which every figure of the film has
painted a new frame. Server and browser share the machine; the server has nothing to do meanwhile.
On a busy machine frames are skipped; the processor time that the page's main thread spends on a
frame says what an idle one would do.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from playwright.sync_api import CDPSession, Page, sync_playwright

from tests.browser.driving import ROOT, launch, open_app, served

WATCH = """
(film) => new Promise((done) => {
  const ids = new Set()
  const targets = [...Bokeh.documents[0]._all_models.values()].find(m => m.data?.targets?.length).data.targets
  for (const [id] of targets) { ids.add(id) }
  const views = sd.figures().filter(f => sd.renderers(f).some(r => ids.has(r.data_source.id))).map(sd.view)
  const frames = [], painted = new Map(views.map(view => [view, -1]))
  for (const view of views) {
    view.repainted.connect(() => {
      const frame = Number(film.dataset.frame)
      painted.set(view, frame)
      const times = frames.length
      if ([...painted.values()].every(f => f === frame) && frames[times - 1]?.[0] !== frame) {
        frames.push([frame, performance.now()])
      }
    })
  }
  new MutationObserver(() => {
    if (film.dataset.playing === "false" && frames.length > 1) { setTimeout(() => done(frames), 300) }
  }).observe(film, {attributes: true})
  film.querySelector("button").click()
})
"""


def measure(page: Page) -> np.ndarray:
    """Play the film once; frame number and milliseconds of each frame that all figures painted."""
    return np.array(page.locator(".sd-player .sd-film").evaluate(WATCH))


def busy(chrome: CDPSession) -> float:
    """Processor time of the page's main thread so far, s."""
    metrics = chrome.send("Performance.getMetrics")["metrics"]
    return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--query", default="", help="more of the link, such as &crowd=60")
    parser.add_argument("--cache", type=Path, default=ROOT / "cache")
    arguments = parser.parse_args()
    with served(arguments.cache) as address, sync_playwright() as playwright:
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        open_app(page, address, f"?page=learn&lesson=flyby&frame=0{arguments.query}")
        page.locator(".sd-player .sd-film-play:enabled").wait_for()
        chrome = page.context.new_cdp_session(page)
        chrome.send("Performance.enable", {"timeDomain": "threadTicks"})
        before = busy(chrome)
        frames = measure(page)
        spent = 1000 * (busy(chrome) - before) / len(frames)
        browser.close()
    between = np.diff(frames[:, 1])
    seconds = (frames[-1, 1] - frames[0, 1]) / 1000
    rate = len(between) / seconds
    print(
        f"film{arguments.query}: {len(frames)} frames painted in {seconds:.1f} s, {rate:.1f} frames/s; "
        f"between frames p50 {np.median(between):.0f} ms, p95 {np.percentile(between, 95):.0f} ms, "
        f"worst {between.max():.0f} ms; main thread {spent:.0f} ms of processor time a frame"
    )


if __name__ == "__main__":
    main()
