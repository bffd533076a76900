"""Paragraphs of the story, some of whose bold numbers can be dragged."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import param
from panel.custom import JSComponent

from app.ui.browser import SUBSCRIPTS

HANDLE = re.compile(r"\*\*(\w+)~([^*]+)\*\*")


class Prose(JSComponent):
    """Paragraphs with ``*stressed*`` and ``**bold**`` words, and numbers to drag, ``**name~0.1**``.

    Text is never read as HTML. A number that is dragged sideways, or moved with the arrow keys, reports
    steps up or down; what they mean is for the listener to say.
    """

    text = param.String("", doc="paragraphs, divided by empty lines")
    moved = param.Parameter(None, doc="[name, steps, count] of the last move of a number")

    _esm = (
        SUBSCRIPTS
        + r"""
    export function render({model}) {
      const box = document.createElement("div")
      box.className = "sd-prose"
      const STEP = 12
      let count = 0
      const handles = new Map()
      const tell = (name, steps) => { count += 1; model.moved = [name, steps, count] }
      const handle = (name) => {
        if (handles.has(name)) { return handles.get(name) }
        const b = document.createElement("b")
        b.className = "drag"
        b.tabIndex = 0
        b.setAttribute("role", "spinbutton")
        b.setAttribute("aria-label", "number to change")
        b.title = "Drag sideways, or use the arrow keys"
        let from = null
        b.addEventListener("pointerdown", (event) => {
          from = event.clientX
          b.setPointerCapture(event.pointerId)
          event.preventDefault()
          b.focus()
        })
        b.addEventListener("pointermove", (event) => {
          if (from === null) { return }
          const steps = Math.trunc((event.clientX - from) / STEP)
          if (steps !== 0) { from += steps * STEP; tell(name, steps) }
        })
        for (const end of ["pointerup", "pointercancel"]) { b.addEventListener(end, () => { from = null }) }
        b.addEventListener("keydown", (event) => {
          const steps = {ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1}[event.key]
          if (steps) { event.preventDefault(); tell(name, steps) }
        })
        handles.set(name, b)
        return b
      }
      const plain = (text) => text.replace(/\\(.)/g, "$1")
      const write = () => {
        const focused = box.getRootNode().activeElement
        const paragraphs = model.text.trim().split(/\n\s*\n/).map((paragraph) => {
          const p = document.createElement("p")
          for (const part of paragraph.replace(/\s+/g, " ").split(/(\*\*[^*]+\*\*|\*[^*]+\*)/)) {
            const moved = part.match(/^\*\*(\w+)~([^*]+)\*\*$/)
            if (moved) {
              const b = handle(moved[1])
              b.replaceChildren(...typeset(plain(moved[2])))
              b.setAttribute("aria-valuetext", b.textContent)
              b.setAttribute("aria-valuenow", parseFloat(b.textContent) || 0)
              p.append(b)
            } else if (part.startsWith("**")) {
              const b = document.createElement("b")
              b.replaceChildren(...typeset(plain(part.slice(2, -2))))
              p.append(b)
            } else if (part.startsWith("*") && part.length > 2) {
              const i = document.createElement("em")
              i.textContent = plain(part.slice(1, -1))
              p.append(i)
            } else { p.append(...typeset(plain(part))) }
          }
          return p
        })
        box.replaceChildren(...paragraphs)
        if (focused && box.contains(focused)) { focused.focus() }
      }
      model.on("text", write)
      write()
      return box
    }
    """
    )
    _stylesheets = [
        """
        .sd-prose { font: 16px/1.5 Roboto, sans-serif; font-size: var(--sd-prose-size, 16px); }
        .sd-prose p { margin: 0 0 12px; }
        .drag { color: var(--mui-palette-primary-main, inherit); cursor: ew-resize; touch-action: none;
                border-bottom: 2px dotted currentColor; padding: 2px 0; user-select: none; }
        .drag:focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]

    def on_move(self, action: Callable[[str, int], Any]) -> None:
        """Call ``action(name, steps)`` whenever a number is moved."""

        def heard(event: Any) -> None:
            try:
                name, steps, _ = event.new
                name, steps = str(name), max(-100, min(100, int(steps)))
            except (TypeError, ValueError):
                return  # a message made by hand
            action(name, steps)

        self.param.watch(heard, "moved")
