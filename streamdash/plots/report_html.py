"""The report on an observation as one HTML file: no scripts, nothing fetched, every text escaped.

The templates ``report.html`` and ``report_tables.html`` stand beside this module.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from streamdash.naming import class_colours, label_text
from streamdash.observe.observation import Observation
from streamdash.observe.provenance import provenance_words
from streamdash.observe.report import abundance_words
from streamdash.observe.wording import (
    evidence_words,
    interval,
    name,
    percent,
    resemblance_words,
    right_share,
)
from streamdash.plots import observe
from streamdash.plots.live import export

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).resolve().parent),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)
TEMPLATES.globals |= {
    word.__name__: word
    for word in (
        abundance_words,
        class_colours,
        evidence_words,
        interval,
        label_text,
        name,
        percent,
        provenance_words,
        resemblance_words,
        right_share,
    )
}


def report_html(result: dict[str, Any], observation: Observation, bands: np.ndarray) -> str:
    """The whole report, figure and numbers included.

    Parameters
    ----------
    result : from `streamdash.observe.report.report`
    observation : what it is about
    bands : from `streamdash.observe.verdict.Prepared.bands`
    """
    classes = [c["mass_range"] for c in result["classes"]]
    return TEMPLATES.get_template("report.html").render(
        result=result,
        figure=inline_svg(observe.draw(observation, bands, classes, "matplotlib")),
        data=json.dumps(result, indent=1, ensure_ascii=False),
    )


def inline_svg(figure: Any) -> Markup:
    """A figure of Matplotlib's as an SVG element of a page."""
    svg = export(figure, "svg").decode()
    return Markup(svg[svg.index("<svg") :])  # noqa: S704 - Matplotlib escapes what it writes


def result_tables(result: dict[str, Any]) -> Markup:
    """Resemblance, probabilities, evidence and the held-out matrix as HTML."""
    return Markup(TEMPLATES.get_template("report_tables.html").render(result=result))  # noqa: S704 - escaped


def robustness_table(result: dict[str, Any]) -> Markup:
    """The table of robustness as HTML; nothing where it was not made."""
    return Markup(TEMPLATES.get_template("report_robustness.html").render(result=result))  # noqa: S704 - escaped
