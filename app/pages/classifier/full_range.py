"""The paper's extension on the Classifier page: the full range of masses with an excess of clusters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from streamdash.paper.full_range import sentence
from streamdash.plots.full_range import draw_full_range, full_range_table
from streamdash.plots.live import LiveFigure

CODE = """from pathlib import Path

from streamdash.paper.full_range import full_range_results, sentence
from streamdash.plots.full_range import draw_full_range
from streamdash.plots.live import export
from streamdash.store.cache import Cache

results = full_range_results(Cache.default())  # trains 18 classifiers: some minutes
print(sentence(results))
Path("full-range.png").write_bytes(export(draw_full_range(results, "matplotlib"), "png"))
"""
PURPOSE = (
    "The paper compares ranges of masses at their own abundance. Here both classes hold all subhalos of "
    "cold dark matter, 10³–10⁹ M☉, and one of them more clusters of 10³–10⁵ M☉. Each point is a classifier "
    "of the GD-1-like stream, judged on streams it never saw; the table has the answers of the power "
    "spectrum and of the evidence too."
)


class FullRange:
    """Card with the study that is shipped (`streamdash.paper.full_range`)."""

    def __init__(self, results: Mapping[str, Any]) -> None:
        figure = LiveFigure(draw_full_range(results, "bokeh")).figure
        self.card = ui.FigureCard(
            "Full range: how many more clusters would be seen?",
            pn.Column(
                ui.plain_text(PURPOSE, margin=(4, 0)),
                ui.figure_pane(figure),
                sizing_mode=ui.WIDE,
                margin=0,
            ),
            name="full-range",
            drawn=lambda: draw_full_range(results, "matplotlib"),
            table=lambda: full_range_table(results),
            code=lambda: CODE,
        )
        self.card.say(sentence(results))

    @property
    def view(self) -> Viewable:
        """The card."""
        return self.card.view
