"""The comparison of statistics on the Spectrum page: what it computes, shows and says."""

from __future__ import annotations

from collections.abc import Hashable

import panel as pn

from app import ui
from app.pages.spectrum.comparison import STYLE, statistics_html
from app.services.services import Services
from app.session.session import Session
from app.ui.study import Study
from app.work.tasks import Compute
from app.work.training import streams_of
from streamdash.paper.statistics import compare_statistics
from streamdash.plots import statistics


def statistics_study(services: Services, session: Session) -> Study:
    """One classifier and one evidence on each statistic of the chosen classes, on one split."""
    streams = streams_of(services, session)

    def question() -> tuple[Hashable, Compute]:
        noise = session.noise
        keys = tuple(choice.key for choice in session.ensembles)
        return ("statistics", *keys, noise), lambda progress, should_stop: compare_statistics(
            streams, noise, progress=progress, should_stop=should_stop
        )

    def code() -> str:
        ensembles = "\n".join(f'    "{choice.key}",  # {choice.label}' for choice in session.ensembles)
        return (
            "from pathlib import Path\n\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.plots.statistics import draw_statistics\n"
            "from streamdash.paper.statistics import compare_statistics\n"
            "from streamdash.store.cache import Cache\n"
            "from streamdash.survey.observed import ObservedStreams\n\n"
            f"ensembles = [\n{ensembles}\n]\n"
            "streams = ObservedStreams.read(Cache.default(), ensembles)\n"
            f"rows = compare_statistics(streams, {session.noise:g})\n"
            'Path("statistics.png").write_bytes(export(draw_statistics(rows, "matplotlib"), "png"))\n'
        )

    return Study(
        "statistics",
        "How much of the information does each statistic keep?",
        "One and the same classifier, and the paper’s evidence, are given the PDF of Qρ, its power spectrum "
        "or the profile itself, and judged on the same held-out streams.",
        question,
        statistics.draw_statistics,
        lambda rows: statistics.statistics_table(rows, streams.labels),
        statistics.statistics_sentence,
        code,
        (("none", "information on the class with its standard error; upright line: certainty"),),
        lambda rows: pn.pane.HTML(statistics_html(rows), stylesheets=[STYLE], sizing_mode=ui.WIDE),
    )
