"""Choosing a file: the browser's part, and the server's own check of what arrives."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from typing import Any

import param
from panel.custom import JSComponent

from streamdash.observe.table import MAX_BYTES, too_large

NOT_READ = "The file did not arrive whole; choose it again."


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
    """

    limit = param.Integer(MAX_BYTES, doc="largest file in bytes, for the browser alone: a client can set it")
    too_large = param.String(doc="what the browser says about a larger one")

    def __init__(
        self,
        receive: Callable[[bytes], Any],
        refuse: Callable[[str], Any],
        *,
        limit: int = MAX_BYTES,
        **params: Any,
    ) -> None:
        super().__init__(limit=limit, too_large=too_large(limit), **params)
        self._bytes = limit
        self._receive, self._refuse = receive, refuse

    def _handle_msg(self, data: Any) -> None:
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
      input.accept = ".csv,.tsv,.txt,.dat,.ecsv,text/*"
      const problem = document.createElement("p")
      problem.setAttribute("role", "alert")
      label.append(words, input, problem)
      const take = (files) => {
        problem.textContent = ""
        if (!files || !files.length) { return }
        if (files.length > 1) { problem.textContent = "Several files: choose one."; return }
        if (files[0].size > model.limit) { problem.textContent = model.too_large; return }
        const reader = new FileReader()
        reader.onload = () => {
          const text = String(reader.result)
          model.send_msg({data: text.slice(text.indexOf(",") + 1)})
        }
        reader.onerror = () => { problem.textContent = "The browser cannot read this file." }
        reader.readAsDataURL(files[0])
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
                border: 2px dashed #808080; border-radius: 8px; padding: 14px 16px;
                font: 15px/1.4 Roboto, sans-serif; }
        .drop.over { border-color: #e69f00; }
        .drop input { font: inherit; max-width: 100%; }
        .drop p { margin: 0; flex-basis: 100%; color: #d64533; }
        .drop p:empty { display: none; }
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
