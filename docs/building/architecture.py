"""The picture of the parts and the table beside it, from the imports in the code.

`python docs/building/architecture.py > parts.svg` writes the picture alone.
"""

from __future__ import annotations

import ast
import html
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parents[2]
WIDTH, HEIGHT = 128, 40
"""Of a box, in pixels."""
GAP_X, GAP_Y = 30, 36
MARGIN = 8


@dataclass(frozen=True)
class Parts:
    """Packages of the code and who imports whom.

    Attributes
    ----------
    modules : number of modules of each part, by its dotted name.
    imports : the parts that each part imports from.
    """

    modules: dict[str, int]
    imports: dict[str, frozenset[str]]


def read_parts() -> Parts:
    """The packages directly below ``streamdash``, and ``app``; modules named with ``_`` are left out."""
    graph = grimp.build_graph("streamdash", "app", cache_dir=None, exclude_type_checking_imports=True)
    modules: dict[str, int] = defaultdict(int)
    imports: dict[str, set[str]] = defaultdict(set)
    for module in graph.modules:
        if (part := part_of(module)) is None:
            continue
        modules[part] += 1
        theirs = {part_of(other) for other in graph.find_modules_directly_imported_by(module)}
        imports[part] |= {other for other in theirs if other not in (None, part)}
    return Parts(dict(modules), {part: frozenset(imports[part]) for part in modules})


def part_of(module: str) -> str | None:
    """The part that a module belongs to, by their dotted names."""
    names = module.split(".")
    if names[0] == "app":
        return "app"
    return None if len(names) == 1 or names[1].startswith("_") else ".".join(names[:2])


def rows(parts: Parts) -> dict[str, int]:
    """Row of each part: one below the lowest part that it imports.

    Raises
    ------
    ValueError
        When parts import one another in a circle, which has no above and below.
    """
    found: dict[str, int] = {}

    def place(part: str, path: tuple[str, ...]) -> int:
        if part in path:
            raise ValueError(f"{' → '.join([*path, part])} is a circle of imports")
        if part not in found:
            found[part] = 1 + max((place(other, (*path, part)) for other in parts.imports[part]), default=-1)
        return found[part]

    for part in sorted(parts.modules):
        place(part, ())
    return found


def direct(parts: Parts) -> list[tuple[str, str]]:
    """Pairs (imported, importer) that no chain over other parts explains already."""

    def reach(part: str) -> frozenset[str]:
        return frozenset().union(*(parts.imports[other] | reach(other) for other in parts.imports[part]))

    return sorted((other, part) for part, theirs in parts.imports.items() for other in theirs - reach(part))


def chains(parts: Parts) -> list[list[str]]:
    """Every arrow as what it passes: a part, a free place in each row on its way, a part."""
    row = rows(parts)
    return [
        [above, *(f"{above}>{below}@{between}" for between in range(row[above] + 1, row[below])), below]
        for above, below in direct(parts)
    ]


def places(parts: Parts) -> dict[str, tuple[float, float]]:
    """Middle of every box and free place; in its row each stands below what it is joined to."""
    row = rows(parts)
    joined: dict[str, set[str]] = defaultdict(set)
    for chain in chains(parts):
        for above, below in pairwise(chain):
            joined[above].add(below)
            joined[below].add(above)
            row.setdefault(below, row[above] + 1)
    by_row: dict[int, list[str]] = defaultdict(list)
    for name in sorted(row):
        by_row[row[name]].append(name)
    x: dict[str, float] = dict.fromkeys(row, 0.0)
    for _ in range(16):
        for members in by_row.values():
            members.sort(key=lambda name: sum(x[other] for other in joined[name]) / max(len(joined[name]), 1))
            sizes = [(WIDTH if name in parts.modules else 0) + GAP_X for name in members]
            starts = [sum(sizes[:n]) - sum(sizes) / 2 for n in range(len(sizes))]
            x |= {name: start + size / 2 for name, start, size in zip(members, starts, sizes, strict=True)}
    left = min(x[part] for part in parts.modules) - WIDTH / 2 - MARGIN
    return {name: (x[name] - left, MARGIN + HEIGHT / 2 + row[name] * (HEIGHT + GAP_Y)) for name in x}


def picture(parts: Parts) -> str:
    """The parts as an SVG that takes its colours from the page it stands in."""
    middle = places(parts)
    boxes = {part: middle[part] for part in sorted(parts.modules)}
    width = max(x for x, _ in boxes.values()) + WIDTH / 2 + MARGIN
    height = max(y for _, y in boxes.values()) + HEIGHT / 2 + MARGIN
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
        'aria-label="Parts of the code; each imports from those above it" font-family="sans-serif" '
        f'style="width:100%;max-width:{width:g}px">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="currentColor"/></marker></defs>',
    ]
    for chain in chains(parts):
        points = [middle[name] for name in chain]
        drawn = [f"M{points[0][0]:g} {points[0][1] + HEIGHT / 2:g}"]
        for (x0, y0), (x1, y1) in pairwise(points):
            y0, y1 = y0 + HEIGHT / 2, y1 - HEIGHT / 2
            drawn.append(f"C{x0:g} {y0 + GAP_Y * 0.8:g} {x1:g} {y1 - GAP_Y * 0.8:g} {x1:g} {y1 - 2:g}")
            drawn.append(f"V{y1 + HEIGHT:g}")
        drawn.pop()
        lines.append(
            f'<path d="{" ".join(drawn)}" fill="none" stroke="currentColor" stroke-opacity="0.5" '
            'marker-end="url(#tip)"/>'
        )
    for part, (x, y) in boxes.items():
        count = f"{parts.modules[part]} module{'s' if parts.modules[part] != 1 else ''}"
        text = f'x="{x:g}" text-anchor="middle" fill="#fff"'
        lines += [
            f"<g><title>{html.escape(summary(part))}</title>",
            f'<rect x="{x - WIDTH / 2:g}" y="{y - HEIGHT / 2:g}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
            'fill="#3f51b5"/>',
            f'<text y="{y - 2:g}" font-size="14" {text}>{short(part)}</text>',
            f'<text y="{y + 13:g}" font-size="10" {text}>{count}</text></g>',
        ]
    return "\n".join([*lines, "</svg>"])


def table(parts: Parts) -> str:
    """The parts from top to bottom, with what each says of itself, as Markdown."""
    row = rows(parts)
    lines = ["| part | modules | what it is |", "|---|---:|---|"]
    for part in sorted(parts.modules, key=lambda p: (row[p], p)):
        lines.append(f"| `{short(part)}` | {parts.modules[part]} | {summary(part).replace('|', '∣')} |")
    return "\n".join(lines)


def short(part: str) -> str:
    """A part's name without that of the package."""
    return part.removeprefix("streamdash.")


def summary(part: str) -> str:
    """First paragraph of a part's docstring, in one line."""
    path = ROOT / part.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("``", "").replace("`", "")


if __name__ == "__main__":
    print(picture(read_parts()))
