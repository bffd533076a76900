"""Small pieces that live in the browser: address bar, navigation, drawer, live sentences."""

from __future__ import annotations

import json

import param
from panel.custom import JSComponent

from streamdash.words import SUBSCRIPT


class AddressBar(JSComponent):
    """Keeps the URL's query equal to `search`, both ways.

    Panel's own `Location` adds a history entry for every change and does not notice the back
    button. Here controls replace the current entry, a change of page (`push`) adds one, and going
    back or forward sets `search`.
    """

    search = param.String("", doc="query with its question mark, or empty")
    dark = param.Boolean(False, doc="whether the visitor's system prefers dark pages")
    visitor = param.String("", doc="who this tab is: the same after a reload")
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
      const system = window.matchMedia("(prefers-color-scheme: dark)")
      const tell = () => { if (model.dark !== system.matches) { model.dark = system.matches } }
      system.addEventListener("change", tell)
      // What is set while the document is still being built is not sent.
      const begin = setInterval(() => {
        if (!window.Bokeh.documents.some((one) => one.is_idle)) { return }
        clearInterval(begin)
        tell()
        try {  // some browsers keep nothing
          const own = window.sessionStorage.getItem("sd-visitor")
          if (own) { model.visitor = own } else { window.sessionStorage.setItem("sd-visitor", model.visitor) }
        } catch {}
      }, 50)
      model.on("remove", () => {
        window.removeEventListener("popstate", back)
        system.removeEventListener("change", tell)
        clearInterval(begin)
      })
      const nothing = document.createElement("span")
      nothing.hidden = true
      return nothing
    }
    """


SUBSCRIPTS = """
    const SUBSCRIPT = new RegExp(PATTERN, "g")
    // Text as nodes: what is written σ_ε has a real subscript.
    const typeset = (text) => {
      const nodes = []
      let from = 0
      for (const found of text.matchAll(SUBSCRIPT)) {
        const [symbol, low] = found[0].split("_")
        const sub = document.createElement("sub")
        sub.style.lineHeight = 0
        sub.textContent = low
        nodes.push(text.slice(from, found.index) + symbol, sub)
        from = found.index + found[0].length
      }
      return [...nodes, text.slice(from)]
    }
""".replace("PATTERN", json.dumps(SUBSCRIPT.pattern.replace("\\w", "A-Za-z0-9_")))
"""A function of the browser's that turns text into nodes; see `streamdash.words.SUBSCRIPT`."""

ANNOUNCED = (
    SUBSCRIPTS
    + """
    export function render({model}) {
      const p = document.createElement("p")
      p.className = "sd-live"
      p.setAttribute("role", "status")
      p.setAttribute("aria-live", "polite")
      const write = () => { p.replaceChildren(...typeset(model.text)) }
      model.on("text", write)
      write()
      return p
    }
    """
)
"""A text in a paragraph that screen readers announce when it changes."""


class LiveText(JSComponent):
    """A sentence that screen readers announce when it changes (``aria-live="polite"``)."""

    text = param.String("", doc="plain text")

    _esm = ANNOUNCED
    _stylesheets = [
        """
        .sd-live { margin: 0; font: var(--sd-type, 14px)/1.5 Roboto, sans-serif; max-width: 110ch;
                   color: var(--mui-palette-text-secondary, inherit); }
        """
    ]


class Answer(LiveText):
    """A page's answer in one sentence, above its figure; read out when it changes."""

    _esm = ANNOUNCED.replace("sd-live", "sd-now")
    _stylesheets = [
        """
        .sd-now { margin: 0; font: 16px/1.45 Roboto, sans-serif; max-width: 120ch; }
        @media (max-width: 700px) { .sd-now { font-size: 15px; line-height: 1.4; } }
        """
    ]


class Navigation(JSComponent):
    """The pages in groups, as links: a row in the title bar, on narrow screens behind one button."""

    groups = param.List([], doc="[name, [[key, title], …]] of each group")
    page = param.String("", doc="key of the page shown")

    _esm = """
    export function render({model}) {
      const nav = document.createElement("nav")
      nav.className = "sd-pages"
      nav.setAttribute("aria-label", "Pages")
      const button = document.createElement("button")
      button.type = "button"
      button.className = "menu"
      button.setAttribute("aria-label", "All pages")
      const list = document.createElement("div")
      list.className = "groups"
      const open = (is) => {
        nav.classList.toggle("open", is)
        button.setAttribute("aria-expanded", String(is))
      }
      open(false)
      button.addEventListener("click", () => open(!nav.classList.contains("open")))
      nav.addEventListener("keydown", (event) => {
        if (event.key === "Escape") { open(false); button.focus() }
      })
      const links = []
      const address = (key) => {
        const query = new URLSearchParams(window.location.search)
        query.set("page", key)
        return "?" + query
      }
      for (const [name, pages] of model.groups) {
        const group = document.createElement("div")
        group.className = "group"
        const title = document.createElement("span")
        title.className = "title"
        title.textContent = name
        const row = document.createElement("span")
        row.className = "row"
        for (const [key, words] of pages) {
          const link = document.createElement("a")
          link.textContent = words
          link.dataset.key = key
          link.href = "?page=" + key
          // What else was chosen goes along also where a link is opened in another tab.
          for (const event of ["pointerdown", "focus"]) {
            link.addEventListener(event, () => { link.href = address(key) })
          }
          link.addEventListener("click", (event) => {
            if (event.ctrlKey || event.metaKey || event.shiftKey || event.button !== 0) { return }
            event.preventDefault()
            open(false)
            model.page = key
          })
          links.push(link)
          row.append(link)
        }
        group.append(title, row)
        list.append(group)
      }
      const mark = () => {
        for (const link of links) {
          const here = link.dataset.key === model.page
          if (here) { link.setAttribute("aria-current", "page"); button.textContent = link.textContent }
          else { link.removeAttribute("aria-current") }
        }
        if (!links.some((link) => link.dataset.key === model.page)) { button.textContent = "Pages" }
        window.scrollTo(0, 0)
      }
      model.on("page", mark)
      mark()
      nav.append(button, list)
      return nav
    }
    """
    _stylesheets = [
        """
        :host { flex: 1 1 auto; min-width: 0; }
        .sd-pages { color: #ffffff; font: 14px/1.3 Roboto, sans-serif; }
        .menu { display: none; margin-left: 12px; font: 500 15px/1 Roboto, sans-serif; color: inherit;
                background: none; border: 1px solid #ffffff80; border-radius: 6px; min-height: 44px;
                padding: 0 14px; cursor: pointer; }
        .menu::after { content: " ▾"; }
        .groups { display: flex; gap: 22px; justify-content: flex-start; padding-left: 12px; }
        .title { display: block; font-size: 11px; letter-spacing: 0.04em; padding: 0 8px; opacity: 0.85; }
        .title:empty::after { content: "\\00a0"; }
        .row { display: flex; }
        a { display: block; color: inherit; text-decoration: none; padding: 4px 8px; border-radius: 4px;
            white-space: nowrap; min-height: 18px; }
        a:hover { background: #ffffff22; }
        a[aria-current] { background: #ffffff33; font-weight: 500; }
        a:focus-visible, .menu:focus-visible { outline: 3px solid #e69f00; outline-offset: 1px; }
        @media (max-width: 1179px) {
          .menu { display: inline-block; }
          .groups { display: none; }
          .open .groups { display: flex; flex-wrap: wrap; gap: 12px 28px; position: fixed; left: 0; right: 0;
                          top: 56px; background: var(--sd-bar, #17456b); padding: 12px 16px 20px;
                          max-height: calc(100vh - 80px); overflow-y: auto;
                          box-shadow: 0 6px 12px #00000055; }
          .open .row { flex-wrap: wrap; }
          .open a { padding: 13px 12px; font-size: 16px; }
          .open .title { padding: 0 12px; font-size: 12px; }
          .open .title:empty { display: none; }
        }
        """
    ]


class DrawerButton(JSComponent):
    """Opens and closes the drawer that holds a page's other controls on a narrow screen.

    The drawer's style reads a property of the document, which reaches into every shadow tree; nothing
    goes to the server.
    """

    label = param.String("All controls", doc="what it says")
    opens = param.Boolean(True, doc="whether it opens and closes, or only closes")

    _esm = """
    export function render({model}) {
      const root = document.documentElement
      const button = document.createElement("button")
      button.type = "button"
      button.className = "sd-drawer-button"
      button.textContent = model.label
      const isOpen = () => root.style.getPropertyValue("--sd-drawer") === "visible"
      const set = (open) => {
        root.style.setProperty("--sd-drawer", open ? "visible" : "hidden")
        root.style.setProperty("--sd-drawer-below", open ? "0" : "110%")
        document.dispatchEvent(new CustomEvent("sd-drawer", {detail: open}))
      }
      const tell = () => { if (model.opens) { button.setAttribute("aria-expanded", String(isOpen())) } }
      button.addEventListener("click", () => set(model.opens && !isOpen()))
      const escape = (event) => {
        if (event.key === "Escape" && isOpen()) { set(false); if (model.opens) { button.focus() } }
      }
      document.addEventListener("sd-drawer", tell)
      document.addEventListener("keydown", escape)
      model.on("remove", () => {
        document.removeEventListener("sd-drawer", tell)
        document.removeEventListener("keydown", escape)
        if (model.opens) { set(false) }
      })
      tell()
      return button
    }
    """
    _stylesheets = [
        """
        .sd-drawer-button { font: 500 14px/1 Roboto, sans-serif; min-height: 44px; padding: 0 18px;
                 color: var(--mui-palette-primary-contrastText, #ffffff); border: 0; border-radius: 22px;
                 background: var(--mui-palette-primary-main, #17456b); box-shadow: 0 2px 8px #00000055;
                 cursor: pointer; white-space: nowrap; }
        .sd-drawer-button:focus-visible { outline: 3px solid #e69f00; outline-offset: 2px; }
        """
    ]
