"""What Bokeh's tools lack: names for screen readers, one tab stop a figure, a focus that is seen."""

from __future__ import annotations

from panel.custom import JSComponent


class FigureTools(JSComponent):
    """Gives every figure's tools names and arrow keys; stands once on a page.

    Bokeh 3.9 makes each tool a stop of the Tab key without a role. Here a toolbar is one stop, and the
    arrow keys move within it, as in other toolbars.
    """

    _esm = """
    const FOCUS = new CSSStyleSheet()
    FOCUS.replaceSync(`:focus-visible { outline: 3px solid #e69f00 !important; outline-offset: 1px; }`)
    const known = new WeakSet()

    function mend(view) {
      const root = view.shadow_el, bar = view.el
      const buttons = [...root.children].filter((child) => child.hasAttribute("tabindex"))
      if (!buttons.length) { return }
      const first = buttons.find((button) => button.tabIndex === 0 && button.dataset.sd) ?? buttons[0]
      for (const button of buttons) {
        button.dataset.sd = "1"
        button.setAttribute("role", "button")
        button.setAttribute("aria-label", button.title || "More tools")
        if (button.className.includes("OnOff")) {
          button.setAttribute("aria-pressed", String(button.classList.contains("bk-active")))
        }
        const wanted = button === first ? 0 : -1
        if (button.tabIndex !== wanted) { button.tabIndex = wanted }
      }
      if (known.has(root)) { return }
      known.add(root)
      bar.setAttribute("role", "toolbar")
      bar.setAttribute("aria-label", "Tools of the figure")
      root.adoptedStyleSheets = [...root.adoptedStyleSheets, FOCUS]
      root.addEventListener("keydown", (event) => {
        const step = {ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1}[event.key]
        const all = [...root.children].filter((b) => b.dataset.sd && b.checkVisibility())
        const at = all.indexOf(root.activeElement)
        if (!step || at < 0) { return }
        event.preventDefault()
        const next = all[(at + step + all.length) % all.length]
        for (const button of all) { button.tabIndex = button === next ? 0 : -1 }
        next.focus()
      })
      root.addEventListener("click", () => setTimeout(() => mend(view)))
    }

    export function render({model}) {
      const all = () => {
        for (const root of window.Bokeh.documents.flatMap((one) => one.roots())) {
          for (const part of root.references()) {
            const view = part.type === "Toolbar" && window.Bokeh.index.find_one(part)
            if (view && view.shadow_el) { mend(view) }
          }
        }
      }
      // Before the Tab key moves, and now and then for screen readers, which do not need it.
      const key = (event) => { if (event.key === "Tab") { all() } }
      document.addEventListener("keydown", key, true)
      const timer = setInterval(all, 3000)
      model.on("remove", () => {
        document.removeEventListener("keydown", key, true)
        clearInterval(timer)
      })
      const nothing = document.createElement("span")
      nothing.hidden = true
      return nothing
    }
    """
