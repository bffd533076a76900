"""A real server and a real browser, for the browser tests, the latency benchmark and the screenshots."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, Page, Playwright

ROOT = Path(__file__).resolve().parents[2]
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
PATIENCE_MS = 240_000
"""Milliseconds that anything is waited for; a wait ends with what is awaited, so only failures take long."""
READY = """() => window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle
             && Bokeh.documents[0].roots().length"""
"""Without the number of roots an app that failed to build looks idle."""

# Every figure's data source by the name of the HoloViews element it draws.
MODELS = """
window.sd = {
  figures: () => [...Bokeh.documents[0]._all_models.values()].filter(m => m.type === "Figure"),
  renderers: (figure) => figure.renderers.filter(r => r.type === "GlyphRenderer"),
  glyphs: (type) => sd.figures().map(f => sd.renderers(f).find(r => r.glyph.type === type)),
  view: (model) => Bokeh.index.find_one(model),
  // Top edges of the figures that are drawn, in pixels from the top of the page.
  tops: () => sd.figures().map(sd.view).filter(Boolean).map(view => view.el.getBoundingClientRect())
    .filter(box => box.width > 40 && box.height > 40).map(box => box.top).sort((a, b) => a - b),
  // Elements of a class, those in shadow trees too.
  all: (name, node = document.body) => [...node.children].flatMap(child => [
    ...(child.classList.contains(name) ? [child] : []), ...sd.all(name, child),
    ...(child.shadowRoot ? sd.all(name, child.shadowRoot) : [])]),
  // Cards, and controls in sight, that lie on one another.
  lying: () => {
    const boxes = ["sd-card", "sd-key"].flatMap(name => sd.all(name))
      .filter(e => e.checkVisibility()).map(e => [e.className, e.getBoundingClientRect()])
    const meet = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 2
    return boxes.flatMap(([a, one], i) => boxes.slice(i + 1).filter(([_, other]) => meet(one, other))
      .map(([b]) => `${a} and ${b}`))
  },
  // Boxes that reach beyond the right edge and do not scroll within another; Bokeh's glyphs have empty ones.
  beyond: () => {
    const found = []
    const look = (node, inside) => {
      for (const child of node.children ?? []) {
        const box = child.getBoundingClientRect()
        const style = getComputedStyle(child)
        const scrolls = inside || ["auto", "scroll"].includes(style.overflowX)
        if (!scrolls && box.width > 0 && box.right > innerWidth + 1 && style.position !== "fixed"
            && !child.className.includes?.("bk-GlyphRenderer")) {
          found.push(`${child.tagName}.${child.className} ${Math.round(box.right)}`)
        }
        look(child, scrolls)
        if (child.shadowRoot) { look(child.shadowRoot, scrolls) }
      }
    }
    look(document.body, false)
    return [...new Set(found)]
  },
}
"""


def chromium() -> str:
    """Path of Debian's Chromium: where it is installed, the one without windows, which needs less.

    Raises
    ------
    RuntimeError
        When it is missing, with the command that installs it.
    """
    found = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if found is None:
        raise RuntimeError("Chromium is missing; install it with: apt-get install -y chromium-headless-shell")
    return found


def launch(playwright: Playwright) -> Browser:
    """Start Chromium without a window."""
    return playwright.chromium.launch(executable_path=chromium(), args=FLAGS)


@contextlib.contextmanager
def started(cache: Path, *options: str, script: Path | None = None) -> Iterator[tuple[str, subprocess.Popen]]:
    """Serve the app from `cache` as a subprocess; gives its address and process, and ends it.

    As `streamdash serve` does, with its headers; or another script, as ``panel serve`` does.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"http://localhost:{port}"
    panel = ["-m", "panel", "serve", str(script)]
    command = [sys.executable, *(panel if script else [str(ROOT / "app" / "launch.py")])]
    process = subprocess.Popen(
        [*command, "--port", str(port), "--liveness", *options],
        env={**os.environ, "STREAMDASH_CACHE": str(cache)},
        cwd=ROOT,
    )
    try:
        _wait_until_live(process, f"{address}/liveness")
        yield address, process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextlib.contextmanager
def served(cache: Path, *options: str, **choices: Path) -> Iterator[str]:
    """The address alone of `started`."""
    with started(cache, *options, **choices) as (address, _):
        yield address


def _wait_until_live(process: subprocess.Popen, url: str, seconds: float = PATIENCE_MS / 1000) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RuntimeError(f"the server ended with code {process.returncode} before it was up")
        with contextlib.suppress(urllib.error.URLError, ConnectionError):
            if urllib.request.urlopen(url, timeout=30).status == 200:
                return
        time.sleep(0.1)
    raise RuntimeError(f"the server did not answer within {seconds:g} s")


def open_app(page: Page, address: str, query: str = "") -> Page:
    """Go to the app and wait until everything is drawn."""
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"{address}/main{query}")
    page.wait_for_function(READY)
    page.evaluate(MODELS)
    return page


def darken(page: Page) -> None:
    """Press the button of the theme, and wait until page and figures are dark."""
    page.get_by_role("button", name="Toggle theme").click()
    page.wait_for_function("() => new URLSearchParams(location.search).get('theme') === 'dark'")
    colour = "getComputedStyle(document.body).backgroundColor"
    page.wait_for_function(f"() => {colour}.match(/[0-9]+/g).slice(0, 3).every(c => c < 60)")
    page.wait_for_function("() => Bokeh.documents[0].is_idle")


def open_export(page: Page, card: str = ".sd-card") -> None:
    """Open the files and the code of a card."""
    page.locator(f"{card} .sd-export button").first.click()
    page.locator(f"{card} .sd-code pre").first.wait_for()


def open_controls(page: Page) -> None:
    """Open the drawer with all controls, on a narrow screen."""
    page.get_by_role("button", name="All controls").click()
