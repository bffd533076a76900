"""Two small pieces that live in the browser: the address bar and the live sentence under a figure."""

from __future__ import annotations

import param
from panel.custom import JSComponent


class AddressBar(JSComponent):
    """Keeps the URL's query equal to `search`, both ways.

    Panel's own `Location` adds a history entry for every change and does not notice the back
    button. Here controls replace the current entry, a change of page (`push`) adds one, and going
    back or forward sets `search`.
    """

    search = param.String("", doc="query with its question mark, or empty")
    push = param.Integer(0, doc="raised before a change that the back button should undo")

    _esm = """
    export function render({model}) {
      let pending = null
      let pushed = model.push
      const write = () => {
        pending = null
        const url = window.location.pathname + model.search + window.location.hash
        if (url === window.location.pathname + window.location.search + window.location.hash) { return }
        if (pushed !== model.push) { window.history.pushState({}, "", url) }
        else { window.history.replaceState({}, "", url) }
        pushed = model.push
      }
      // Browsers refuse more than ~200 history changes in 30 s: write when a slider rests.
      model.on("search", () => {
        if (pushed !== model.push) { clearTimeout(pending); write(); return }
        clearTimeout(pending)
        pending = setTimeout(write, 250)
      })
      const back = () => { model.search = window.location.search }
      window.addEventListener("popstate", back)
      model.on("remove", () => window.removeEventListener("popstate", back))
      const nothing = document.createElement("span")
      nothing.hidden = true
      return nothing
    }
    """


class LiveText(JSComponent):
    """A sentence that screen readers announce when it changes (``aria-live="polite"``)."""

    text = param.String("", doc="plain text")

    _esm = """
    export function render({model}) {
      const p = document.createElement("p")
      p.className = "sd-live"
      p.setAttribute("role", "status")
      p.setAttribute("aria-live", "polite")
      const write = () => { p.textContent = model.text }
      model.on("text", write)
      write()
      return p
    }
    """
    _stylesheets = [
        """
        .sd-live { margin: 0; font: 14px/1.5 Roboto, sans-serif; max-width: 110ch;
                   color: var(--mui-palette-text-secondary, inherit); }
        """
    ]


class CopyLink(JSComponent):
    """The address of a view as text, with a button that copies it."""

    query = param.String("", doc="query with its question mark")
    label = param.String("Link for a class: everybody gets the same ten streams", doc="what it is")

    _esm = """
    export function render({model}) {
      const box = document.createElement("div")
      box.className = "sd-copy"
      const label = document.createElement("label")
      const field = document.createElement("input")
      field.type = "text"
      field.readOnly = true
      field.addEventListener("focus", () => field.select())
      label.append(model.label, field)
      const button = document.createElement("button")
      button.type = "button"
      const rest = () => { button.textContent = "Copy" }
      button.addEventListener("click", async () => {
        field.select()
        // Browsers give a clipboard to secure pages only; the text is selected for the keyboard.
        try { await navigator.clipboard.writeText(field.value); button.textContent = "Copied" }
        catch { button.textContent = "Selected: press Ctrl+C" }
        setTimeout(rest, 2000)
      })
      const write = () => { field.value = window.location.origin + window.location.pathname + model.query }
      model.on("query", write)
      write()
      rest()
      box.append(label, button)
      return box
    }
    """
    _stylesheets = [
        """
        .sd-copy { display: flex; flex-wrap: wrap; align-items: end; gap: 6px 10px;
                   font: 13px/1.5 Roboto, sans-serif; color: inherit; }
        .sd-copy label { display: flex; flex-direction: column; flex: 1 1 260px; max-width: 640px; }
        .sd-copy input, .sd-copy button { font: inherit; color: inherit; background: none;
                   border: 1px solid #80808090; border-radius: 4px; padding: 6px 10px; min-width: 0; }
        .sd-copy button { cursor: pointer; min-width: 84px; }
        .sd-copy :focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]


class Links(JSComponent):
    """Links to other views of the app: followed without loading the page anew, where that is possible."""

    links = param.List([], doc="[words, query] of each")

    _esm = """
    export function render({model}) {
      const list = document.createElement("ul")
      list.className = "sd-link-list"
      const write = () => {
        list.replaceChildren(...model.links.map(([words, query]) => {
          const item = document.createElement("li"), link = document.createElement("a")
          link.href = query || "?"
          link.textContent = words
          link.addEventListener("click", (event) => {
            if (event.ctrlKey || event.metaKey || event.shiftKey || event.button !== 0) { return }
            event.preventDefault()
            window.history.pushState({}, "", window.location.pathname + query)
            window.dispatchEvent(new PopStateEvent("popstate"))
          })
          item.append(link)
          return item
        }))
      }
      model.on("links", write)
      write()
      return list
    }
    """
    _stylesheets = [
        """
        .sd-link-list { margin: 0; padding: 0; list-style: none; font: 15px/1.9 Roboto, sans-serif; }
        .sd-link-list a { color: var(--mui-palette-primary-main, inherit); }
        .sd-link-list a::after { content: " →"; }
        .sd-link-list a:focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]
