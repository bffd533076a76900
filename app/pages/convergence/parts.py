"""Verdicts and shifts of the convergence tests as HTML tables."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from app import ui
from streamdash.convergence.knobs import ConvergenceTest
from streamdash.convergence.text import Measured
from streamdash.convergence.verdicts import DECADE_WORDS, DECADES, Shift
from streamdash.plots.convergence import colour
from streamdash.statistics.spectrum import KINDS

STYLE = (
    ui.TABLE_STYLE
    + """
th, td { text-align: left; border-top: 1px solid #80808060; white-space: normal; }
thead th { border-top: 0; font-weight: 500; }
small { white-space: normal; }
td.number { white-space: nowrap; }
a { color: inherit; }
.mark { display: inline-block; width: 22px; height: 4px; vertical-align: middle; margin-right: 6px; }
"""
)
SIGNS = {"agrees": "✓", "within the scatter of streams": "≈", "differs": "✗"}
HEADS = {"density": "Density", "track": "Track", "cross": "Cross"}


def verdicts_html(found: Sequence[Measured], lacking: Sequence[ConvergenceTest]) -> Markup:
    """One row per test: the largest mean shift among what the paper calls converged, and the verdict."""
    return ui.render(
        "pages/convergence/verdicts.html",
        found=found,
        lacking=lacking,
        signs=SIGNS,
        decade_words=DECADE_WORDS,
    )


def shifts_html(one: Measured) -> Markup:
    """One row per setting of a test: its impacts and the mean shifts of each spectrum."""
    columns = (("density", True), *((kind, False) for kind in KINDS))

    def shifts(i: int, kind: str, seen: bool) -> list[Shift]:
        found = (one.verdict.of(i, kind, name, seen) for name in DECADES)
        return [shift for shift in found if shift is not None]

    return ui.render(
        "pages/convergence/shifts.html",
        columns=[(HEADS[kind], seen) for kind, seen in columns],
        rows=[
            (
                setting.label,
                colour(one.knob, i),
                spectra.mean_impacts,
                [shifts(i, kind, seen) for kind, seen in columns],
            )
            for i, (setting, spectra) in enumerate(zip(one.knob.settings, one.spectra, strict=True))
        ],
        signs=SIGNS,
    )
