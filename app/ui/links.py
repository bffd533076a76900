"""Links to views: one that is copied, large ones side by side, a line of them."""

from __future__ import annotations

import param
from panel.custom import JSComponent


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


class Doors(JSComponent):
    """Large links to other views, side by side; followed without loading the page anew."""

    doors = param.List([], doc="[words, what is behind it, query] of each")

    _esm = """
    export function render({model}) {
      const list = document.createElement("nav")
      list.className = "sd-door-list"
      list.setAttribute("aria-label", "Where to go on")
      const write = () => {
        list.replaceChildren(...model.doors.map(([words, about, query]) => {
          const link = document.createElement("a"), text = document.createElement("span")
          link.href = query || "?"
          const name = document.createElement("strong")
          name.textContent = words
          text.textContent = about
          link.append(name, text)
          link.addEventListener("click", (event) => {
            if (event.ctrlKey || event.metaKey || event.shiftKey || event.button !== 0) { return }
            event.preventDefault()
            window.history.pushState({}, "", window.location.pathname + query)
            window.dispatchEvent(new PopStateEvent("popstate"))
          })
          return link
        }))
      }
      model.on("doors", write)
      write()
      return list
    }
    """
    _stylesheets = [
        """
        .sd-door-list { display: grid; grid-template-columns: repeat(auto-fit, minmax(240px, 1fr)); gap: 12px;
                        font: 15px/1.45 Roboto, sans-serif; }
        .sd-door-list a { display: flex; flex-direction: column; gap: 2px; padding: 14px 16px; color: inherit;
                          text-decoration: none; border: 1px solid #80808066; border-radius: 6px; }
        .sd-door-list strong { font-size: 17px; font-weight: 500;
                               color: var(--mui-palette-primary-main, inherit); }
        .sd-door-list strong::after { content: " →"; }
        .sd-door-list a:hover { border-color: currentColor; }
        .sd-door-list a:focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
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
        .sd-link-list { margin: 0; padding: 0; list-style: none;
                        font: var(--sd-type, 15px)/1.9 Roboto, sans-serif; }
        .sd-link-list a { color: var(--mui-palette-primary-main, inherit); }
        .sd-link-list a::after { content: " →"; }
        .sd-link-list a:focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]
