"""Parts of the Spectrum page: the paper's statements, tested, and the comparison of statistics."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from functools import partial

from markupsafe import Markup

from app import ui
from app.pages.classifier.parts import STYLE as STATISTICS_STYLE
from app.services.services import Services
from app.session.listing import ensembles_code
from app.session.session import Session
from app.ui.study import Study
from app.work.pieces import on_streams
from app.work.pool import Compute
from app.work.training import streams_of
from streamdash.config import EnsembleConfig
from streamdash.paper.statistics import Kept, compare_statistics, ln_b_text
from streamdash.plots import statistics
from streamdash.plots.evidence import words
from streamdash.plots.spectrum import statement_text
from streamdash.statistics.spectra_in_noise import Shown

STYLE = (
    ui.TABLE_STYLE
    + """
th, td { text-align: left; border-top: 1px solid #80808060; }
thead th { border-top: 0; font-weight: 500; }
th, small { white-space: normal; }
"""
)


def statements_html(shown: Shown, configs: Sequence[EnsembleConfig]) -> Markup:
    """One row per statement: what the paper says, without noise as in its figure, and as observed."""

    def found(scale: float, true: bool) -> tuple[str, str]:
        since = "at no scale" if math.isnan(scale) else f"from {scale:.1f}° up"
        return "✓ true" if true else "✗ not true", since

    return ui.render(
        "pages/spectrum/statements.html",
        sigma=shown.sigma,
        rows=[
            (
                statement_text(s, configs),
                s.limit,
                found(s.clean_from, s.clean_true),
                found(s.observed_from, s.observed_true),
            )
            for s in shown.statements
        ],
    )


def statistics_html(rows: Sequence[Kept]) -> Markup:
    """One row per statistic: accuracy and information of its classifier, and its evidence."""
    pairs = sorted(rows[0].evidence)

    def ln_b(row: Kept, pair: tuple[int, int]) -> tuple[str, ...]:
        found = row.evidence.get(pair)
        return ("–",) if found is None else (ln_b_text(found.value, found.n_unresolved), words(found.value))

    def cells(row: Kept) -> list[tuple[str, ...]]:
        return [
            (f"{len(row.judged.classifier.features.names)}",),
            (row.judged.scores.percent_text("overall_accuracy"),),
            (f"{row.bits:.3f} ± {row.bits_error:.3f}",),
            *(ln_b(row, pair) for pair in pairs),
        ]

    return ui.render(
        "pages/spectrum/statistics.html",
        n_held_out=len(rows[0].judged.y),
        pairs=pairs,
        rows=[(row.name, cells(row)) for row in rows],
    )


def statistics_study(services: Services, session: Session) -> Study:
    """One classifier and one evidence on each statistic of the chosen classes, on one split."""
    streams = streams_of(services, session)

    def question() -> tuple[Hashable, Compute]:
        noise = session.noise
        keys = tuple(choice.key for choice in session.ensembles)
        compute = partial(on_streams, compare_statistics, services, session.ensembles, (noise,))
        return ("statistics", *keys, noise), compute

    def code() -> str:
        return (
            "from pathlib import Path\n\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.plots.statistics import draw_statistics\n"
            "from streamdash.paper.statistics import compare_statistics\n"
            "from streamdash.store.cache import Cache\n"
            "from streamdash.survey.observed import ObservedStreams\n\n"
            f"{ensembles_code(session.ensembles)}"
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
        lambda rows: ui.Html(statistics_html(rows), stylesheets=[STATISTICS_STYLE]),
    )
