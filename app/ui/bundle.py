"""All that a page shows as one ZIP: figures, numbers, code, configurations, and a notebook that runs."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Sequence
from typing import Any, Protocol

import streamdash
from streamdash.plots.files import About


class Bundled(Protocol):
    """What is bundled of a figure; see `app.ui.cards.FigureCard`."""

    name: str
    files: Any
    code: Any

    @property
    def ready(self) -> bool:
        """Whether there is something to bundle."""

    @property
    def words(self) -> str:
        """The sentence under the figure."""

    def about(self) -> About:
        """What its files say of themselves."""


def bundle(cards: Sequence[Bundled]) -> bytes:
    """A ZIP of all figures that are there, each in a folder of its own.

    What a figure cannot give (its code, where there is none) is left out, and named in ``readme.txt``.
    """
    ready = [card for card in cards if card.ready]
    buffer, left_out = io.BytesIO(), []
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for card in ready:
            stem = card.about().stem(card.name)
            for kind, make in card.files.items():
                try:
                    archive.writestr(f"{card.name}/{stem}.{kind}", make())
                except ValueError as error:
                    left_out.append(f"{card.name}.{kind}: {error}")
            archive.writestr(f"{card.name}/{card.name}.py", card.code())
        for about in [card.about() for card in ready[:1]]:
            for index, (config, key) in enumerate(zip(about.configs, about.keys, strict=True)):
                archive.writestr(f"configs/M{index}-{key}.json", config.model_dump_json(indent=1))
        archive.writestr("notebook.ipynb", json.dumps(notebook(ready), indent=1, ensure_ascii=False))
        archive.writestr("readme.txt", _readme(ready, left_out))
    return buffer.getvalue()


def notebook(cards: Sequence[Bundled]) -> dict[str, Any]:
    """A Jupyter notebook (format 4.5) that makes the figures again: words and code, without results."""
    cells: list[dict[str, Any]] = []
    for card in cards:
        about = card.about()
        text = f"## {about.title}\n\n{card.words}\n\n" + "\n".join(f"- {line}" for line in about.caption)
        cells.append({"cell_type": "markdown", "metadata": {}, "source": text})
        code = card.code()
        show = f'\nfrom IPython.display import Image\n\nImage("{card.name}.png")\n'
        code += show if f'"{card.name}.png"' in code else ""
        cells.append(
            {
                "cell_type": "code",
                "metadata": {},
                "execution_count": None,
                "outputs": [],
                "source": code,
            }
        )
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": cells}


def _readme(cards: Sequence[Bundled], left_out: Sequence[str]) -> str:
    lines = [
        f"Made by streamdash {streamdash.__version__}.",
        "A folder for each figure: PNG, SVG, PDF, its numbers (CSV; lines with # say what they are of), and",
        "the Python that makes it. configs/ has the knobs of each class; notebook.ipynb makes all figures",
        "again where streamdash is installed (pip install streamdash) and has these ensembles in its cache.",
        "",
    ]
    for card in cards:
        lines += [f"{card.name}: {card.about().title}", *(f"    {line}" for line in card.about().caption)]
    return "\n".join([*lines, *(f"Left out: {words}" for words in left_out), ""])
