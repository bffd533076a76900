"""HTML: made by templates, in which every value is escaped, and shown by `Html`; by nothing else in the app.

A template of more than a line is a file beside the code that fills it, named by its path below ``app/``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, ClassVar

import panel as pn
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markdown_it import MarkdownIt
from markupsafe import Markup, escape

from streamdash.words import SUBSCRIPT

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).resolve().parents[1]),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)
MARKDOWN = MarkdownIt("commonmark", {"html": False}).enable("table")
TAGS = re.compile(r"(<[^<>]*>)")
SCROLLS = """
.wide { overflow-x: auto; --sd-ground: var(--mui-palette-background-paper, Canvas);
  background:
    linear-gradient(to right, var(--sd-ground) 12px, transparent) left / 44px 100% no-repeat local,
    linear-gradient(to left, var(--sd-ground) 12px, transparent) right / 44px 100% no-repeat local,
    linear-gradient(to right, #808080d0, transparent) left / 18px 100% no-repeat scroll,
    linear-gradient(to left, #808080d0, transparent) right / 18px 100% no-repeat scroll; }
"""
"""What is wider than its place scrolls, and a shadow lies on the side on which there is more of it."""
TABLE_STYLE = f"""
{SCROLLS}
sub {{ font-size: 0.75em; line-height: 0; }}
table {{ border-collapse: collapse; font: 14px/1.4 Roboto, sans-serif; width: 100%; }}
caption {{ text-align: left; padding: 4px 8px; font-weight: 500; }}
th, td {{ padding: 4px 8px; text-align: right; vertical-align: top; white-space: nowrap; }}
th[scope=row] {{ text-align: left; font-weight: 400; }}
thead th {{ border-bottom: 1px solid #808080; }}
small {{ display: block; opacity: 0.8; font-size: 12px; }}
"""
"""What tables have in common; a table's own style follows it."""


def render(name: str, /, **values: Any) -> Markup:
    """HTML of the template of a file, such as ``pages/evidence/cumulative.html``."""
    return Markup(TEMPLATES.get_template(name).render(values))  # noqa: S704 - escaped by the template


def fill(source: str, /, **values: Any) -> Markup:
    """HTML of a template that is a line of code."""
    return Markup(TEMPLATES.from_string(source).render(values))  # noqa: S704 - escaped by the template


def literally(text: str) -> str:
    """Text that Markdown shows as it is: a name somebody gave is no link, image or emphasis."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)  # all of ASCII's punctuation


def subscripted(html: str) -> str:
    """HTML in which ``σ_ε`` and the like have real subscripts; tags and listings stay as they are."""
    listing, parts = False, TAGS.split(html)
    for i, part in enumerate(parts):
        if i % 2:
            listing = not part.startswith("</") if part.lstrip("</").startswith("pre") else listing
        elif not listing:
            parts[i] = SUBSCRIPT.sub(_with_subscript, part)
    return "".join(parts)


def _with_subscript(found: re.Match[str]) -> str:
    symbol, low = found[0].split("_")
    return f"{symbol}<sub>{low}</sub>"


def from_markdown(text: str) -> Markup:
    """HTML of a text of ours in Markdown; HTML in it is shown as text."""
    html = MARKDOWN.render(text)
    # A table scrolls where it is wider than its place; so a keyboard has to reach it.
    return Markup(html.replace("<table>", '<table tabindex="0">'))  # noqa: S704 - escaped by the renderer


class Html(pn.pane.HTML):
    """Shows HTML from a template as such and any other text as text, whoever wrote it.

    What is written ``σ_ε`` is shown with a real subscript.

    Parameters
    ----------
    content
        As for `write`.
    """

    priority: ClassVar[float | bool | None] = False  # not Panel's choice for what stands in a layout

    def __init__(self, content: str = "", **params: Any) -> None:
        super().__init__(subscripted(str(escape(content))), **{"sizing_mode": "stretch_width", **params})

    def write(self, content: str) -> None:
        """Show something else: what `render` and `fill` return, or text."""
        self.object = subscripted(str(escape(content)))
