"""Card of the shipped study of streams that were made otherwise; on Classifier and on Convergence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import panel as pn

from app import ui
from streamdash.classifier.other_streams import group_sentence
from streamdash.plots.live import LiveFigure
from streamdash.plots.other_streams import draw_other_streams, other_streams_table

LEGEND = (
    ("dots-grey", "share of fresh streams put right, with its 68 % interval"),
    ("dashes-grey", "as usual"),
)


def other_streams_card(results: Mapping[str, Any], groups: Sequence[str], title: str) -> ui.FigureCard:
    """What the classifiers say of streams of other rates, ages or settings.

    Parameters
    ----------
    results : as `streamdash.classifier.other_streams.shipped_results` gives them.
    groups : keys of `streamdash.classifier.other_streams.GROUPS`.
    """
    code = (
        "from pathlib import Path\n\n"
        "from streamdash.classifier.other_streams import other_streams_results, simulate_missing\n"
        "from streamdash.plots.live import export\n"
        "from streamdash.plots.other_streams import draw_other_streams\n"
        "from streamdash.store.cache import Cache\n\n"
        'streams = Path("other-streams")\n'
        "cache = Cache((*Cache.default().roots, streams), streams)\n"
        "simulate_missing(cache)  # some ten minutes of one processor\n"
        "results = other_streams_results(cache)\n"
        f'figure = draw_other_streams(results, {list(groups)}, "matplotlib")\n'
        'Path("other-streams.png").write_bytes(export(figure, "png"))\n'
    )
    card = ui.FigureCard(
        title,
        pn.Column(
            ui.plain_text(
                f"Classifiers of the GD-1-like stream that learnt the usual streams only, at σ_ε = "
                f"{results['noise']:g}, are given {results['n_streams']} fresh streams a class in which one "
                "thing is different, and are not told.",
                margin=(4, 0),
            ),
            ui.figure_pane(LiveFigure(draw_other_streams(results, groups, "bokeh")).figure),
            sizing_mode=ui.WIDE,
            margin=0,
        ),
        name="other-streams",
        drawn=lambda: draw_other_streams(results, groups, "matplotlib"),
        table=lambda: other_streams_table(results, groups),
        code=lambda: code,
        legend=ui.legend(LEGEND),
    )
    card.say(" ".join(group_sentence(results, group) for group in groups))
    return card
