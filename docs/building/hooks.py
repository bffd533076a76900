"""What MkDocs is told beyond mkdocs.yml: pages made from the code, and equations without a script."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

import streamdash
from streamdash.streams import STREAM_NAMES, named_stream

sys.path.insert(0, str(Path(__file__).parent))
import architecture

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = "reference/python"
SCROLLS = "overflow: auto hidden; padding: 0.3em 0"
"""Style of what may be wider than a phone."""


def on_config(config: Any) -> Any:
    """Put a page for each part of the library where the navigation says ``reference/python.md``."""
    pages = {"Overview": "reference/python.md"}
    pages |= {part: f"{REFERENCE}/{part.removeprefix('streamdash.')}.md" for part in parts()}
    config.nav = replaced(config.nav, "reference/python.md", [{name: path} for name, path in pages.items()])
    return config


def replaced(tree: Any, old: Any, new: Any) -> Any:
    """The same tree of lists and dictionaries with `new` wherever `old` was."""
    if tree == old:
        return new
    if isinstance(tree, list):
        return [replaced(branch, old, new) for branch in tree]
    if isinstance(tree, dict):
        return {name: replaced(branch, old, new) for name, branch in tree.items()}
    return tree


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made from the code, and those that stand at the top of the repository."""
    pages = {
        "reference/python.md": overview(),
        "reference/command-line.md": command_line(),
        **{f"{REFERENCE}/{part.removeprefix('streamdash.')}.md": reference(part) for part in parts()},
        **{f"{name.lower()}.md": top_page(f"{name}.md") for name in ("CONTRIBUTING", "CHANGELOG")},
    }
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def parts() -> list[str]:
    """The packages and modules directly below ``streamdash``."""
    return sorted(part for part in architecture.read_parts().modules if part != "app")


def modules(part: str) -> list[str]:
    """The public modules of a part; the part itself where it is one module."""
    folder = ROOT / part.replace(".", "/")
    inside = sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("_"))
    return [f"{part}.{name}" for name in inside] or [part]


def overview() -> str:
    """The reference's first page: every part, and what each says of itself."""
    lines = ["# Python", "", "What the library offers, from its docstrings. The names most needed", ""]
    lines += ["```python", f"from streamdash import {', '.join(sorted(streamdash.PUBLIC))}", "```"]
    lines += ["", "are imported when they are first used.", "", "| part | what it is |", "|---|---|"]
    for part in parts():
        page = f"python/{part.removeprefix('streamdash.')}.md"
        lines.append(f"| [`{architecture.short(part)}`]({page}) | {architecture.summary(part)} |")
    return "\n".join(lines)


def reference(part: str) -> str:
    """The reference of one part."""
    return "\n".join([f"# {part}", "", architecture.summary(part), *(f"\n::: {m}" for m in modules(part))])


def command_line() -> str:
    """All commands and options, as the command itself describes them."""
    command = [sys.executable, "-m", "typer", "streamdash.cli.main", "utils", "docs"]
    command += ["--name", "streamdash", "--title", "Command line"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout


def top_page(name: str) -> str:
    """A page that stands at the top of the repository, its links as they are from ``docs/``."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put in what a page asks for: the picture of the parts and their table, the named streams."""
    if "<!-- streams -->" in markdown:
        return markdown.replace("<!-- streams -->", named_streams())
    if "<!-- parts -->" not in markdown:
        return markdown
    found = architecture.read_parts()
    picture = architecture.picture(found).replace("\n", "")
    return markdown.replace("<!-- picture -->", picture).replace("<!-- parts -->", architecture.table(found))


def named_streams() -> str:
    """Arms, ages, bins and caveats of every named stream, as Markdown."""
    lines = []
    for stream in map(named_stream, STREAM_NAMES):
        ages = ", ".join(f"{age:g}" for age in stream.ages_gyr)
        lines += [f"### {stream.title}", "", f"Name `{stream.name}`; frame: {stream.frame.name}.", ""]
        lines += ["| arm | ages (Gyr) | bins | analysed | noise | divided by |", "|" + "---|" * 6]
        for arm, bins in stream.bins.items():
            stretch = "all of it" if bins.low is None else f"{bins.low:g}° to {bins.high:g}°"
            order = "nothing" if bins.order is None else f"a polynomial of order {bins.order}"
            cells = [arm, ages, f"{bins.width:g}° of {bins.coordinate}", stretch, f"{bins.noise:g}", order]
            lines.append(f"| {' | '.join(cells)} |")
        lines += ["", *(f"- {caveat}" for caveat in stream.caveats), ""]
    return "\n".join(lines)


def on_page_content(content: str, **_: Any) -> str:
    """Turn the equations that Arithmatex marked into MathML, which browsers draw by themselves."""

    def mathml(match: re.Match[str]) -> str:
        block = match["open"] == r"\["
        equation = convert(html.unescape(match["latex"]).strip(), display="block" if block else "inline")
        return f'<div style="{SCROLLS}" tabindex="0">{equation}</div>' if block else equation

    pattern = r'<(?P<tag>span|div) class="arithmatex">(?P<open>\\[(\[])(?P<latex>.*?)\\[)\]]</(?P=tag)>'
    return re.sub(pattern, mathml, content, flags=re.DOTALL)
