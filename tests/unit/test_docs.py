"""The documentation: it builds strictly and without network, links lead somewhere, examples are true."""

from __future__ import annotations

import doctest
import importlib
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from streamdash.cli.main import app
from tests.browser.screenshots import LARGEST, VIEWS
from tests.unit.sources import shipped

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
WITH_EXAMPLES = [path for path in shipped() if ">>> " in path.read_text(encoding="utf-8")]
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site; building fails where a link is broken."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", "http_proxy": "http://127.0.0.1:9", "https_proxy": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_the_site_asks_no_other_host(site):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        resources = re.findall(r"<(?:script|img|iframe|source)\b[^>]*\bsrc=\"([^\"]*)\"", text)
        resources += re.findall(r"<link\b[^>]*\bhref=\"([^\"]*)\"", text)
        assert [url for url in resources if re.match(r"(https?:)?//", url)] == [], page


@pytest.mark.slow
def test_equations_are_drawn_without_a_script(site):
    pages = {page.name: page.read_text(encoding="utf-8") for page in (site / "science").glob("*.html")}
    assert all("<math" in pages[page] for page in ("stream.html", "evidence.html", "classifier.html"))
    assert [page for page, text in pages.items() if "arithmatex" in text or "$$" in text] == []


@pytest.mark.slow
def test_picture_and_reference_come_from_the_code(site):
    architecture = (site / "architecture.html").read_text(encoding="utf-8")
    reference = "".join(page.read_text(encoding="utf-8") for page in (site / "reference").rglob("*.html"))
    for part in (path.name for path in (ROOT / "streamdash").iterdir() if (path / "__init__.py").exists()):
        assert f">{part}</text>" in architecture
        assert f"streamdash.{part}." in reference
    for command in app.registered_commands:
        assert f"streamdash {command.name}" in reference


def test_pictures_are_small_shown_and_taken_by_one_command():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {
        (page.parent / link).resolve()
        for page in pages
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+\.png)\)", page.read_text(encoding="utf-8"))
    }
    taken = {(ROOT / "docs" / name).resolve() for name in VIEWS}
    assert shown == taken
    assert all(picture.stat().st_size < LARGEST for picture in taken)


@pytest.fixture(scope="module")
def architecture():
    """The module that draws the parts; it stands outside the packages."""
    place = importlib.util.spec_from_file_location("building", ROOT / "docs" / "building" / "architecture.py")
    module = sys.modules["building"] = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


def test_each_part_stands_below_all_that_it_imports(architecture):
    parts = architecture.read_parts()
    row = architecture.rows(parts)
    middle = architecture.places(parts)
    for part, imported in parts.imports.items():
        assert all(row[other] < row[part] and middle[other][1] < middle[part][1] for other in imported)
    assert "app" in parts.imports and all("app" not in imported for imported in parts.imports.values())


def test_an_arrow_that_others_imply_is_left_out_and_a_circle_is_named(architecture):
    def parts(**imports: str):
        return architecture.Parts(dict.fromkeys(imports, 1), {k: frozenset(v) for k, v in imports.items()})

    assert architecture.direct(parts(a="", b="a", c="ab")) == [("a", "b"), ("b", "c")]
    assert ["a", "a>d@1", "d"] in architecture.chains(parts(a="", b="", c="b", d="ac"))
    with pytest.raises(ValueError, match="a → b → a is a circle"):
        architecture.rows(parts(a="b", b="a"))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_in_the_repository_lead_somewhere(page):
    """As on a page of the repository; those between generated pages are the build's to check."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    generated = ("reference/", "contributing.md", "changelog.md")
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" in target or target.removeprefix("../").startswith(generated):
            continue
        assert (page.parent / target).exists(), f"{name(page)}: {target}"


@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=name)
def test_examples_in_docstrings_are_true(path):
    module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    result = doctest.testmod(module, optionflags=OPTIONS)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("page", [p for p in PAGES if ">>> " in p.read_text(encoding="utf-8")], ids=name)
def test_examples_in_pages_are_true(page):
    assert doctest.testfile(str(page), module_relative=False, optionflags=OPTIONS).failed == 0
