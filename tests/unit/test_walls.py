"""The walls of the house: contracts between the parts, forbidden calls, the length of a module."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import streamdash
from streamdash._moved import MOVED
from streamdash.store.cache import Cache
from streamdash.survey.observed import ObservedStreams

ROOT = Path(__file__).resolve().parents[2]
MAX_LINES = 420

SHIPPED = sorted(path for folder in ("streamdash", "app") for path in (ROOT / folder).rglob("*.py"))
EVERYTHING = SHIPPED + sorted((ROOT / "tests").rglob("*.py"))


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_parts_import_one_another_as_the_contracts_in_pyproject_say():
    run = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as lint; lint()"]
    done = subprocess.run([*run, "--no-cache"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def calls_and_imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and what is called or imported there, for what shipped code must not do."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=name(path))):
        if isinstance(node, ast.Call):
            yield node.lineno, ast.unparse(node.func)
            for keyword in node.keywords:
                trusted = isinstance(keyword.value, ast.Constant) and keyword.value.value is False
                if keyword.arg and not trusted:
                    yield node.lineno, f"{keyword.arg}="
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.lineno, node.module
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


FORBIDDEN = {
    *("eval", "exec", "joblib.load", "pd.read_pickle", "pandas.read_pickle", "allow_pickle=", "to_disk="),
    *("pickle", "cPickle", "cloudpickle", "dill", "shelve", "marshal"),
}


def test_nothing_shipped_unpickles_or_evaluates():
    found = {
        f"{name(p)}:{n}: {what}" for p in SHIPPED for n, what in calls_and_imports(p) if what in FORBIDDEN
    }
    assert found == set()


@pytest.mark.parametrize("line", ["import pickle", "x = eval('1')", "np.load(f, allow_pickle=True)"])
def test_the_forbidden_is_found(tmp_path, monkeypatch, line):
    path = tmp_path / "module.py"
    path.write_text(f"{line}\n")
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    assert FORBIDDEN & {what for _, what in calls_and_imports(path)}


TRUSTED = {"app/ui/templates.py", "streamdash/plots/report_html.py"}
"""The two environments of templates; nobody else says that a text is markup."""


def html_by_hand(path: Path) -> Iterator[str]:
    """Where HTML is put together without a template that escapes what is put in."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=name(path))):
        if isinstance(node, ast.JoinedStr):
            texts = [part.value for part in node.values if isinstance(part, ast.Constant)]
            if any(re.search(r"</?[a-z]", str(text)) for text in texts):
                yield f"{name(path)}:{node.lineno}: a tag in an f-string"
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in (
            "html.escape",
            "pn.pane.HTML",
            "Markup",
        ):
            yield f"{name(path)}:{node.lineno}: {ast.unparse(node.func)}"


def test_html_comes_from_templates():
    found = [where for path in SHIPPED if name(path) not in TRUSTED for where in html_by_hand(path)]
    assert found == []


@pytest.mark.parametrize("line", ['f"<b>{x}</b>"', "html.escape(x)", "pn.pane.HTML(x)", "Markup(x)"])
def test_html_by_hand_is_found(tmp_path, monkeypatch, line):
    path = tmp_path / "module.py"
    path.write_text(f"{line}\n")
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    assert len(list(html_by_hand(path))) == 1


def test_no_module_is_too_long():
    lengths = {name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in EVERYTHING}
    assert {path: n for path, n in lengths.items() if n > MAX_LINES} == {}


@pytest.mark.parametrize("public", streamdash.PUBLIC)
def test_public_names_are_there(public):
    assert callable(getattr(streamdash, public))
    assert public in dir(streamdash)


@pytest.mark.parametrize("old", MOVED)
def test_modules_answer_to_their_old_names(old):
    with pytest.warns(DeprecationWarning, match="is now"):
        sys.modules.pop(f"streamdash.{old}", None)
        module = importlib.import_module(f"streamdash.{old}")
    new = importlib.import_module(f"streamdash.{MOVED[old]}")
    public = {k: v for k, v in vars(new).items() if not k.startswith("_")}
    assert public.items() <= vars(module).items()


LISTED = ("streamdash.plots.pdf", "streamdash.classifier.data", "streamdash.classifier_data")


@pytest.mark.parametrize("module", LISTED)
def test_what_listings_named_still_answers(module, small_cache):
    old = "collect" if module.endswith("pdf") else "read_streams"
    scope: dict = {}
    with pytest.warns(DeprecationWarning, match="ObservedStreams.read"):
        exec(f"from {module} import {old}", scope)
    cache = Cache.default(small_cache)
    keys = [entry.key for entry in cache.entries() if entry.kind == "ensemble"]
    streams = ObservedStreams.read(cache, keys)
    if old == "collect":
        one = scope[old](cache, keys[1])
        assert one.config == streams.configs[1]
        np.testing.assert_array_equal(one.noisy(0.2), streams.noisy(0.2)[1])
    else:
        assert scope[old](cache, keys).digest == streams.digest
    with pytest.raises(ImportError):
        exec(f"from {module} import nothing_of_the_kind", {})


@pytest.mark.slow
def test_every_module_can_be_imported_first():
    """In a process of its own: an import circle shows only where its wrong end comes first."""
    modules = [".".join(p.relative_to(ROOT).with_suffix("").parts) for p in SHIPPED]
    modules = [m.removesuffix(".__init__") for m in modules if m not in ("app.main", "app.launch")]
    script = (
        "import importlib, os, sys\n"
        "import numpy, panel, holoviews, galpy, numba, xarray, sklearn, xgboost, panel_material_ui\n"
        "for module in sys.argv[1:]:\n"
        "    child = os.fork()\n"
        "    if not child:\n"
        "        try:\n"
        "            importlib.import_module(module)\n"
        "        except BaseException as error:\n"
        "            print(module, repr(error), flush=True)\n"
        "            os._exit(1)\n"
        "        os._exit(0)\n"
        "    os.waitpid(child, 0)\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, *modules], cwd=ROOT, capture_output=True, text=True
    )
    assert (done.stdout, done.returncode) == ("", 0), done.stderr
