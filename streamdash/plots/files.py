"""Figures as files that explain themselves: legend, classes, settings, and where they come from."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.legend_handler import HandlerTuple
from matplotlib.text import Text

import streamdash
from streamdash.config import EnsembleConfig
from streamdash.naming import class_colours, class_names, differences, model_labels
from streamdash.plots.legend import Mark, handles
from streamdash.plots.live import DOTS_PER_INCH, use
from streamdash.words import SUBSCRIPT

CAPTION_SIZE, CHARACTERS_AN_INCH = 7.5, 15.5
"""Size of the caption in points, and how many of its characters are as wide as an inch."""
GAP = 0.1
"""Inches between figure, legend and caption."""
LONGEST_STEM = 120


@dataclass(frozen=True)
class About:
    """What a file of a figure says besides the figure.

    Attributes
    ----------
    title : str
        What the figure shows.
    configs : sequence of EnsembleConfig
        The classes, M0 first; none where the figure has none.
    keys : sequence of str
        Their names in the cache.
    settings : mapping of str to object
        What else was chosen, by its symbol, such as ``{"σ_ε": 0.1}``.
    link : str
        Address that shows the figure again.
    """

    title: str
    configs: Sequence[EnsembleConfig] = ()
    keys: Sequence[str] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    link: str = ""

    @property
    def caption(self) -> list[str]:
        """Lines under a figure."""
        told = zip(model_labels(self.configs), self.configs, self.keys, strict=True)
        classes = [f"{label} ({config.n_streams} streams, {_short(key)})" for label, config, key in told]
        settings = [f"{symbol} = {_plain(value)}" for symbol, value in self.settings.items()]
        made = f"streamdash {streamdash.__version__}"
        return [
            part
            for part in (
                f"{self.title}. {', '.join(settings)}".rstrip(" ."),
                "; ".join(classes),
                f"{made}: {self.link}" if self.link else made,
            )
            if part
        ]

    @property
    def comments(self) -> str:
        """Lines that begin with ``#``, for the head of a CSV file."""
        lines = [f"streamdash: {streamdash.__version__}", f"figure: {self.title}"]
        told = zip(class_names(self.configs), self.configs, self.keys, strict=True)
        for i, (name, config, key) in enumerate(told):
            lines.append(f"M{i}: {name}; {config.n_streams} streams; ensemble {key}")
            lines.append(f"M{i} knobs: {config.model_dump_json()}")
        lines += [f"{symbol}: {_plain(value)}" for symbol, value in self.settings.items()]
        if self.link:
            lines.append(f"link: {self.link}")
        return "".join(f"# {_line(line)}\n" for line in lines)

    def stem(self, name: str) -> str:
        """Name of a file without its ending: what it shows, of which classes, at which settings."""
        parts = ["streamdash", name, *class_names(self.configs)]
        parts += [f"{symbol}{_plain(value)}" for symbol, value in self.settings.items()]
        words = "_".join(parts).replace("σ_ε", "noise").replace("N_bin", "bins").replace("α", "alpha")
        return re.sub(r"[^A-Za-z0-9._+-]+", "-", words)[:LONGEST_STEM].strip("-_.")

    @property
    def metadata(self) -> dict[str, str]:
        """What is written into the file's own fields."""
        return {"Title": self.title, "Description": " · ".join(self.caption)}

    @property
    def knobs(self) -> list[str]:
        """What sets each class apart from the default ones, for people."""
        return [", ".join(differences(config)) for config in self.configs]


def publish(figure: Any, kind: str, about: About, marks: Sequence[Mark] = ()) -> bytes:
    """A figure declared for Matplotlib as a file with legend, caption and metadata.

    Parameters
    ----------
    figure : holoviews object
    kind : {"png", "svg", "pdf"}
    about
        What the file says.
    marks
        Entries of the figure's legend.
    """
    drawn = use("matplotlib").get_plot(figure).state
    labels = model_labels(about.configs)
    classes = tuple(
        Mark("band", (colour,), label)
        for colour, label in zip(class_colours(about.configs), labels, strict=True)
    )
    # What is looked into is framed on the page alone.
    shown = [mark for mark in (*classes, *marks) if mark.kind != "frame"]
    width, height = drawn.get_size_inches()
    for text in drawn.findobj(Text):
        if SUBSCRIPT.search(text.get_text()) and "$" not in text.get_text():
            text.set_text(_math(text.get_text()))
    drawn.canvas.draw()
    box = drawn.get_tightbbox()
    left, low = box.x0 / width, (box.y0 - GAP) / height
    if shown:
        legend = drawn.legend(
            handles(shown),
            [_math(mark.words) for mark in shown],
            handler_map={tuple: HandlerTuple(ndivide=None, pad=0)},
            loc="upper left",
            bbox_to_anchor=(left, low),
            ncols=2 if width > 7 else 1,
            fontsize=8,
            frameon=False,
            borderaxespad=0.0,
        )
        drawn.canvas.draw()
        low = legend.get_window_extent().transformed(drawn.transFigure.inverted()).y0 - GAP / height
    lines = [
        part
        for line in about.caption
        for part in textwrap.wrap(line, int(width * CHARACTERS_AN_INCH)) or [""]
    ]
    text = "\n".join(_math(line) for line in lines)
    drawn.text(left, low, text, fontsize=CAPTION_SIZE, color="#444444", va="top", wrap=False)
    buffer = io.BytesIO()
    drawn.savefig(
        buffer,
        format=kind,
        dpi=DOTS_PER_INCH,
        bbox_inches="tight",
        pad_inches=0.1,
        metadata=_fields(kind, about),
    )
    return buffer.getvalue()


def _fields(kind: str, about: About) -> dict[str, Any]:
    """Metadata as each format takes it."""
    told = about.metadata
    if kind == "pdf":
        return {"Title": told["Title"], "Subject": told["Description"], "Creator": "streamdash"}
    if kind == "svg":
        return {**told, "Source": about.link or None, "Creator": "streamdash", "Date": None}
    return {**told, "Source": about.link, "Software": f"streamdash {streamdash.__version__}"}


def _math(text: str) -> str:
    """Text for Matplotlib: names with subscripts as such, and nothing that people typed as a formula."""
    safe = text.replace("\\", "").replace("$", r"\$")
    return SUBSCRIPT.sub(_with_subscript, safe)


def _with_subscript(found: re.Match[str]) -> str:
    symbol, low = found[0].split("_")
    return f"${symbol}_{{\\mathrm{{{low}}}}}$"


def _short(key: str) -> str:
    return "+".join(part[:8] for part in key.split("+"))


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _line(text: str) -> str:
    return re.sub(r"[\x00-\x1f\x7f]+", " ", text)
