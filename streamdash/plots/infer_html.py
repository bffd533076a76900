"""The report on an inference as one HTML file: no scripts, nothing fetched, every text escaped.

The template ``infer.html`` stands beside this module.
"""

from __future__ import annotations

import json
from typing import Any

import holoviews as hv
import numpy as np

from streamdash.inference.posterior import Posterior
from streamdash.observe.infer import Inference
from streamdash.plots import observe
from streamdash.plots.elements import framed
from streamdash.plots.live import use
from streamdash.plots.report_html import TEMPLATES, inline_svg
from streamdash.plots.style import INK

LABELS = {
    "age_gyr": "age (Gyr)",
    "log10_rate": "log₁₀ abundance / CDM",
    "log10_half_mode_mass": "log₁₀ half-mode mass / M☉",
    "log10_excess": "log₁₀ excess of clusters / CDM",
    "log10_rs_factor": "log₁₀ size / relation",
    "slope": "slope of the mass function",
}
"""What is written along the axis of each parameter."""


def infer_html(found: Inference) -> str:
    """The whole report: the answer, the profile, every parameter's posterior, and what it rests on."""
    result = found.report()
    post = found.posterior
    figures = {name: inline_svg(draw_marginal(post, name)) for name in post.names}
    return TEMPLATES.get_template("infer.html").render(
        result=result,
        labels=LABELS,
        profile=inline_svg(observe.draw(found.observation, None, (), "matplotlib")),
        figures=figures,
        held_out=_held_out(found.estimator.card),
        data=json.dumps(result, indent=1, ensure_ascii=False),
    )


def draw_marginal(post: Posterior, name: str) -> hv.Overlay:
    """Posterior density of one parameter as steps, its 68 % interval filled, the prior dashed."""
    use("matplotlib")
    edges = np.asarray(post.grid[name])
    density = post.marginal(name) / np.diff(edges)
    flat = 1 / np.ptp(edges)
    low, high = post.interval(name)
    x, y = np.repeat(edges, 2)[1:-1], np.repeat(density, 2)
    inside = np.clip(x, low, high)
    ink = INK["light"]
    parts = [
        hv.Area((inside, y)).opts(color="#0072b2", alpha=0.35, linewidth=0),
        hv.Curve((x, y)).opts(color=ink),
        hv.Curve(([edges[0], edges[-1]], [flat, flat])).opts(color=ink, linestyle="dashed"),
    ]
    top = 1.1 * max(float(density.max()), flat)
    x_range = (float(edges[0]), float(edges[-1]))
    return framed(parts, LABELS[name], "probability density", x_range, (0, top), "matplotlib")


def _held_out(card: Any) -> dict[str, dict[str, float]]:
    """How the estimator did on streams that it had not seen, where that was kept."""
    return dict(card.get("held_out", {}))
