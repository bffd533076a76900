"""What a page says: text, headings, legends, and the sentences that stand by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import panel_material_ui as pmui

from app.session.catalog import Choice
from app.ui.layout import WIDE
from app.ui.templates import Html, fill, literally, render
from streamdash.config import EnsembleConfig, StreamModel
from streamdash.naming import class_colours
from streamdash.plots.legend import Mark, marks
from streamdash.streams import stream_of

LEGEND_STYLE = """
.legend { display: flex; flex-wrap: wrap; gap: 4px 18px; font: var(--sd-type, 13px)/1.5 Roboto, sans-serif; }
.item { display: inline-flex; align-items: center; gap: 6px; }
.swatch { flex: none; }
"""


def plain_text(text: str, **params: Any) -> Html:
    """Text that is never read as HTML, whoever wrote it; `Html.write` replaces it."""
    return Html(str(text), **params)


def caption(text: str) -> pmui.Typography:
    """Small heading of a control that has none of its own."""
    return pmui.Typography(literally(text), variant="caption", margin=0)


def class_heading(index: int, choices: Sequence[Choice], which: str = "") -> Html:
    """Name of a class with its colour: ``■ M0 · 10³–10⁵ M☉ · 2000 streams``; ``which`` arm, if any."""
    choice = choices[index]
    line = fill(
        """<div style="font: 500 15px/1.5 Roboto, sans-serif">\
{% from "ui/macros.html" import mark %}{{ mark(colour) }} M{{ i }} · {{ label }} · {{ n }} streams\
{% if which %} · {{ which }}{% endif %}</div>""",
        i=index,
        colour=class_colours([one.config for one in choices])[index],
        label=choice.label,
        n=choice.config.n_streams,
        which=which,
    )
    return Html(line, sizing_mode=None, margin=(6, 0, 0, 0), css_classes=["sd-class"])


def stream_caveats(model: StreamModel) -> Html:
    """What is to be kept in mind about a stream; open, unless it is the paper's."""
    stream = stream_of(model)
    line = fill(
        """{% if caveats %}<details{% if open %} open{% endif %} style="font: 13px/1.5 Roboto, sans-serif">\
<summary>{{ title }}: what its model leaves out</summary><ul style="margin: 2px 0; padding-left: 22px">\
{% for caveat in caveats %}<li>{{ caveat }}</li>{% endfor %}</ul></details>{% endif %}""",
        title=stream.title,
        caveats=stream.caveats,
        open=model.progenitor != StreamModel().progenitor,
    )
    return Html(line, margin=(8, 18, 0, 18), css_classes=["sd-stream-caveats"])


def heading(text: str) -> Html:
    """Heading of a part of a page."""
    style = "font: 500 var(--sd-heading, 22px)/1.4 Roboto, sans-serif; margin: 0"
    return Html(
        fill('<h2 style="{{ style }}">{{ text }}</h2>', style=style, text=text), sizing_mode=None, margin=4
    )


class Legend(Html):
    """A line of marks and words under a figure; `marks` are what a file of the figure says too."""

    marks: ClassVar[tuple[Mark, ...]] = ()


def legend(entries: Sequence[tuple[str, str]], classes: Sequence[EnsembleConfig | str] = ()) -> Legend:
    """A line of marks and words under a figure.

    Parameters
    ----------
    entries
        Kind and words of each; for the kinds see `streamdash.plots.legend`.
    classes
        The classes shown, for their colours; none where the figure shows none.
    """
    shown = marks(entries, class_colours(classes))
    line = Legend(render("ui/legend.html", marks=shown), stylesheets=[LEGEND_STYLE], margin=(4, 0))
    line.marks = shown  # type: ignore[misc]
    return line


def message(sentences: Sequence[str], kind: str = "info") -> pmui.Alert:
    """Sentences in a coloured bar that can be closed; ``kind`` is info, warning or error."""
    return _alert(sentences, kind, "sd-message", closeable=True)


def error_state(sentence: str) -> pmui.Alert:
    """What takes the place of a page or panel that cannot be shown."""
    return _alert([sentence], "error", "sd-error-state")


def no_ensembles() -> pmui.Alert:
    """What a page shows when the cache holds nothing to show."""
    return _alert(
        [
            "There are no simulated streams in the cache yet.",
            "Run “streamdash simulate --mass 1e3-1e5 --streams 1000”, the same for 1e5-1e9, and reload.",
        ],
        "info",
        "sd-empty-state",
    )


def _alert(sentences: Sequence[str], kind: str, css_class: str, **params: Any) -> pmui.Alert:
    return pmui.Alert(
        # Not the alert's own text: that is read as Markdown.
        *(plain_text(sentence, margin=0) for sentence in sentences),
        severity=kind,
        sizing_mode=WIDE,
        margin=(8, 16),
        css_classes=[css_class, f"sd-{kind}"],
        **params,
    )
