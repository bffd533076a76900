"""Choosing a file: the browser's part, and the server's own check of what arrives."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from typing import Any

import param
from panel.custom import JSComponent

from streamdash.observe.table import MAX_BYTES, shown, too_large

NOT_READ = "The file did not arrive whole; choose it again."
NAME_CUT = 400
"""Characters of a file's name that are looked at; operating systems allow 255."""


class FileDrop(JSComponent):
    """A field to choose or drop one small file.

    The browser refuses a file that is too large before it sends a byte, so that the connection
    stays; the server checks what arrives once more, since anybody can send anything.

    Parameters
    ----------
    receive
        Called with the bytes of the file.
    refuse
        Called with a sentence when what arrived cannot be used.
    limit
        Largest file, in bytes. The browser is told; the server keeps its own number, which no message
        from a browser changes.
    announce
        Called with a file's name as soon as it was chosen, before the browser reads it: what was shown
        of another file is out of date from then on.

    Attributes
    ----------
    file_name : str
        Name of the file that arrived last.
    """

    limit = param.Integer(MAX_BYTES, doc="largest file in bytes, for the browser alone: a client can set it")
    kept = param.String(doc="name of a file that was chosen before and is the one shown")
    too_large = param.String(doc="what the browser says about a larger one")

    def __init__(
        self,
        receive: Callable[[bytes], Any],
        refuse: Callable[[str], Any],
        *,
        limit: int = MAX_BYTES,
        announce: Callable[[str], Any] | None = None,
        **params: Any,
    ) -> None:
        super().__init__(limit=limit, too_large=too_large(limit), **params)
        self._bytes = limit
        self._receive, self._refuse, self._announce = receive, refuse, announce
        self.file_name = ""

    def _handle_msg(self, data: Any) -> None:
        if isinstance(data, dict) and isinstance(data.get("chosen"), str):
            if self._announce is not None:
                self._announce(shown(data["chosen"][:NAME_CUT]))
            return
        self.file_name = ""
        if isinstance(data, dict) and isinstance(data.get("name"), str):
            self.file_name = shown(data["name"][:NAME_CUT])
        try:
            content = decoded(data, self._bytes)
        except ValueError as error:
            self._refuse(str(error))
        else:
            self._receive(content)

    _esm = """
    export function render({model}) {
      const label = document.createElement("label")
      label.className = "drop"
      const words = document.createElement("span")
      words.textContent = "Choose a table of a measured profile, or drop it here"
      const input = document.createElement("input")
      input.type = "file"
      input.accept = ".csv,.tsv,.txt,.dat,.ecsv,.vot,.xml,.fits,.fit,.mrt,.tbl,text/*"
      const problem = document.createElement("p")
      problem.setAttribute("role", "alert")
      // After the page was built anew the browser's own field is empty, though a file is shown.
      const kept = document.createElement("span")
      kept.className = "kept"
      const keep = () => {
        kept.textContent = model.kept ? `${model.kept} is shown` : ""
        input.classList.toggle("blank", Boolean(model.kept) && !input.files.length)
      }
      model.on("kept", keep)
      keep()
      label.append(words, input, kept, problem)
      let turn = 0
      // The field does not name a file that is not the one shown.
      const refuse = (sentence) => { problem.textContent = sentence; input.value = "" }
      const take = (files) => {
        problem.textContent = ""
        if (!files || !files.length) { return }
        if (files.length > 1) { return refuse("Several files: choose one.") }
        const file = files[0]
        if (file.size > model.limit) { return refuse(model.too_large) }
        model.kept = ""
        keep()
        const mine = ++turn
        model.send_msg({chosen: file.name})
        const reader = new FileReader()
        reader.onload = () => {
          if (mine !== turn) { return }  // another was chosen while this one was read
          const text = String(reader.result)
          model.send_msg({data: text.slice(text.indexOf(",") + 1), name: file.name})
        }
        reader.onerror = () => {
          if (mine !== turn) { return }
          refuse("The browser cannot read this file.")
          model.send_msg({name: file.name})
        }
        reader.readAsDataURL(file)
      }
      // The same file may be chosen again after it was changed.
      input.addEventListener("click", () => { input.value = "" })
      input.addEventListener("change", () => take(input.files))
      for (const name of ["dragenter", "dragover"]) {
        label.addEventListener(name, (e) => { e.preventDefault(); label.classList.add("over") })
      }
      label.addEventListener("dragleave", () => label.classList.remove("over"))
      label.addEventListener("drop", (e) => {
        e.preventDefault()
        label.classList.remove("over")
        take(e.dataTransfer.files)
      })
      return label
    }
    """
    _stylesheets = [
        """
        .drop { display: flex; flex-wrap: wrap; gap: 8px 16px; align-items: center; cursor: pointer;
                border: 2px dashed #808080; border-radius: 8px; padding: 8px 16px;
                font: 15px/1.4 Roboto, sans-serif; }
        @media (max-width: 700px) { .drop { padding: 5px 10px; } .drop span { position: absolute;
          width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); white-space: nowrap; } }
        .drop.over { border-color: #e69f00; }
        .drop input { font: inherit; max-width: 100%; }
        .drop p { margin: 0; flex-basis: 100%; color: #d64533; }
        .drop p:empty, .kept:empty { display: none; }
        .kept { font-weight: 500; }
        /* Its button stays, its "No file chosen" does not. */
        .blank { color: transparent; width: 120px; }
        """
    ]


def decoded(message: Any, limit: int) -> bytes:
    """Bytes of a file, at most `limit`, out of a browser's message.

    Raises
    ------
    ValueError
        In one sentence, when there is no file in it or it is too large.
    """
    text = message.get("data") if isinstance(message, dict) else None
    if not isinstance(text, str):
        raise ValueError(NOT_READ)
    if len(text) > 4 * (limit // 3 + 2):
        raise ValueError(too_large(limit))
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise ValueError(NOT_READ) from None
