"""The walls of the house: who may import whom, what shipped code must not call, how long a module may be."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

FLOW = [
    ["config"],
    ["store", "workers"],
    ["geometry"],
    ["impacts"],
    ["kicks"],
    ["density"],
    ["flyby"],
    ["ensemble"],
    ["jobs"],
    ["survey"],
    ["observation"],
    ["spectrum"],
    ["pdf", "features", "scores"],
    ["evidence", "classifier"],
    ["verdict"],
    ["reproduce"],
    ["plots"],
    ["report"],
    ["cli"],
]
"""The library from left to right: a module imports from its own stage and from those before it.

A module belongs to the stage whose name it bears, alone or followed by an underscore and more
(``classifier_features`` belongs to ``classifier``). The cache (``store``) knows configurations
only, so that every later stage may keep its results in it.
"""

MAX_LINES = 420

LIBRARY = sorted((ROOT / "streamdash").rglob("*.py"))
APP = sorted((ROOT / "app").rglob("*.py"))
SHIPPED = LIBRARY + APP
EVERYTHING = SHIPPED + sorted((ROOT / "tests").rglob("*.py")) + sorted((ROOT / "scripts").rglob("*.py"))


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), filename=name(path))


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and absolute dotted name of everything a file imports, wherever in the file it does so."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join([*above, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


def importers(paths: list[Path], package: str) -> set[str]:
    """Files among `paths` that import `package` or anything in it."""
    return {
        name(path)
        for path in paths
        for _, module in imports(path)
        if module == package or module.startswith(f"{package}.")
    }


def stage_of(module: str) -> tuple[int, str]:
    """Place in the flow, and stage, of a module of the library given as ``streamdash.x[.y]``."""
    own = module.split(".")[1]
    for position, stages in enumerate(FLOW):
        for stage in stages:
            if own == stage or own.startswith(f"{stage}_"):
                return position, stage
    raise AssertionError(f"{module}: say in FLOW where this module stands in the data flow")


def test_the_library_and_the_app_are_found():
    assert {"streamdash/config.py", "streamdash/density.py", "app/main.py"} <= {name(p) for p in SHIPPED}


@pytest.mark.parametrize("package", ["panel", "panel_material_ui", "bokeh", "app"])
def test_library_does_not_know_the_page(package):
    assert importers(LIBRARY, package) == set()


def test_only_plots_draw_in_the_library():
    assert {p for p in importers(LIBRARY, "holoviews") if not p.startswith("streamdash/plots/")} == set()


def test_one_door_to_panel_material_ui():
    assert importers(SHIPPED, "panel_material_ui") <= {"app/ui.py"}


def is_module(dotted: str) -> bool:
    """Whether ``streamdash.x…`` names a module or a package of the library."""
    path = ROOT.joinpath(*dotted.split(".")[:2])
    return path.is_dir() or path.with_suffix(".py").exists()


@pytest.mark.parametrize("path", [p for p in LIBRARY if p != ROOT / "streamdash" / "__init__.py"], ids=name)
def test_imports_follow_the_data_flow(path):
    position, stage = stage_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
    for line, imported in imports(path):
        if imported.startswith("streamdash.") and is_module(imported):
            theirs, their_stage = stage_of(imported)
            assert theirs < position or their_stage == stage, f"line {line}: {imported} stands to the right"


def test_the_package_itself_imports_no_stage():
    assert [module for _, module in imports(ROOT / "streamdash" / "__init__.py") if is_module(module)] == []


FORBIDDEN_CALLS = {"eval", "exec", "joblib.load", "pd.read_pickle", "pandas.read_pickle"}
FORBIDDEN_MODULES = {"pickle", "cPickle", "cloudpickle", "dill", "shelve", "marshal"}


@pytest.mark.parametrize("path", SHIPPED, ids=name)
def test_nothing_shipped_unpickles_or_evaluates(path):
    for node in ast.walk(tree(path)):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        assert called not in FORBIDDEN_CALLS, f"line {node.lineno}: {called}"
        for keyword in node.keywords:
            trusted = isinstance(keyword.value, ast.Constant) and keyword.value.value is False
            assert keyword.arg not in {"allow_pickle", "to_disk"} or trusted, (
                f"line {node.lineno}: {called}({keyword.arg}=…)"
            )
    for line, module in imports(path):
        assert module.split(".")[0] not in FORBIDDEN_MODULES, f"line {line}: imports {module}"
        assert module != "joblib.load", f"line {line}: imports {module}"


@pytest.mark.parametrize("path", EVERYTHING, ids=name)
def test_no_module_is_too_long(path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= MAX_LINES, f"{lines} lines, more than {MAX_LINES}: split by meaning"
