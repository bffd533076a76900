"""Names that strangers gave are text on every page: never markup, whatever stands in them."""

from __future__ import annotations

import dataclasses
import io
from html.parser import HTMLParser

import panel as pn
import pytest
from markdown_it import MarkdownIt
from pandas import DataFrame, read_csv

from app import ui
from app.pages.registry import PAGES
from app.session.session import Session
from app.shell import Shell
from app.ui.cards import csv_of
from app.ui.templates import TEMPLATES, fill, literally
from streamdash.plots import report_html

HOSTILE = """<img src=x onerror=boom()>"'&amp;{{ 1111 * 7 }}![x](http://e/x.png)[y](http://e/)"""
OURS = {"a", "br", "caption", "code", "div", "h1", "h2", "p", "pre", "small", "span", "sub"} | {
    *("svg", "circle", "path", "rect", "strong", "em"),  # marks of legends, and prose
    *("details", "summary", "li", "ul", "table", "tbody", "td", "th", "thead", "tr"),
}
LINKS = [
    *(f"?page={page.key}" for page in PAGES),
    *(f"?page=learn&step={step}" for step in range(2, 11)),
    "?page=learn&lesson=flyby",
    "?page=learn&lesson=quiz",
    "?page=learn&lesson=teach",
]


class Read(HTMLParser):
    """What a browser makes of HTML: elements, and the text that is seen."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.handlers: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]

    def handle_data(self, data):
        self.text += data


@pytest.fixture
def hostile_catalog(services):
    """The shipped ensembles under names that are an attack."""
    catalog = services.catalog()
    streams = tuple(
        dataclasses.replace(
            stream,
            ensembles=tuple(dataclasses.replace(c, label=f"{HOSTILE} {c.label}") for c in stream.ensembles),
        )
        for stream in catalog.streams
    )
    return dataclasses.replace(catalog, streams=streams, problems=(HOSTILE,))


def html_of(part) -> str:
    """What the browser is given: Markdown (Typography is a kind of it) is turned into HTML on the way."""
    if isinstance(part, pn.pane.Markdown):
        allowed = {"html": False} if type(part) is pn.pane.Markdown else {}
        assert part.renderer_options == allowed
        return MarkdownIt("gfm-like", {"html": not allowed}).render(part.object)
    return part.object


@pytest.mark.parametrize("link", LINKS)
def test_names_are_text_on_every_page(services, hostile_catalog, link):
    session = Session(tuple(page.key for page in PAGES), hostile_catalog)
    session.load(f"{link}&colour={HOSTILE.replace('&', '')}")
    shell = Shell(session, services, PAGES)
    try:
        parts = [*shell.view.select(pn.pane.HTML), *shell.view.select(pn.pane.Markdown)]
        read = [Read(html_of(part)) for part in parts]
        for one in read:
            assert one.handlers == []
            assert "7777" not in one.text
        plain = [one for one, part in zip(read, parts, strict=True) if not isinstance(part, pn.pane.Markdown)]
        assert set().union(*(one.tags for one in plain)) <= OURS
        prose = [one for one, part in zip(read, parts, strict=True) if isinstance(part, pn.pane.Markdown)]
        assert not {"img", "a", "script"} & set().union(*(one.tags for one in prose))
        assert any(HOSTILE in one.text for one in read)
    finally:
        shell.close()


def test_html_shows_templates_as_they_are_and_anything_else_as_text():
    pane = ui.Html(HOSTILE)
    assert Read(pane.object).text == HOSTILE
    pane.write(fill("<b>{{ name }}</b>", name=HOSTILE))
    assert Read(pane.object).tags == {"b"}
    assert Read(pane.object).text == HOSTILE
    pane.write(HOSTILE)
    assert Read(pane.object).tags == set()
    assert not isinstance(pn.panel("text"), ui.Html)


def test_markdown_shows_a_name_as_it_is():
    html = MarkdownIt("gfm-like", {"html": False}).render(f"before **{literally(HOSTILE)}** after")
    assert Read(html).tags == {"p", "strong"}
    assert HOSTILE in Read(html).text


@pytest.mark.parametrize("templates", [TEMPLATES, report_html.TEMPLATES])
def test_every_template_compiles_and_escapes(templates):
    names = templates.list_templates(extensions=["html"])
    assert names
    for name in names:
        templates.get_template(name)
        source = templates.loader.get_source(templates, name)[0]
        assert "|safe" not in source.replace(" ", "") and "autoescape" not in source
    assert templates.from_string("{{ x }}").render(x="<b>") == "&lt;b&gt;"


@pytest.mark.parametrize(
    "evil",
    [
        '=HYPERLINK("http://e/";"x")',
        "@SUM(A1)",
        "+1+cmd|' /C calc'!A0",
        "-2+3",
        "\t=1",
        "\r=1",
        "\n=1",
        "a\r=1",
        "a\n=1,=2",
    ],
)
def test_names_in_downloaded_tables_are_no_formulas(evil):
    table = DataFrame({evil: [-1.5, 2.0], "name": [evil, "-"], "mixed": [evil, -3], "count": [-1, 2]})
    data = csv_of(table)
    read = read_csv(io.BytesIO(data), keep_default_na=False)
    cells = [*read.columns, *read.name, read.mixed[0]]
    assert [cell for cell in cells if cell[:1] in "=+@-\t\r\n" and cell != "-"] == []
    assert list(read.iloc[:, 0]) == [-1.5, 2.0] and list(read["count"]) == [-1, 2]
    assert read.mixed[1] == "-3" and read.name[1] == "-"
    assert list(table.name) == [evil, "-"], "the page's own table stays"
