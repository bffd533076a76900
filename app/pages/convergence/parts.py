"""Verdicts and shifts of the convergence tests as HTML tables."""

from __future__ import annotations

import html
from collections.abc import Sequence

from app.pages.spectrum.statements import STYLE as TABLE_STYLE
from app.ui.layout import reachable
from streamdash.convergence.knobs import ConvergenceTest
from streamdash.convergence.text import Measured
from streamdash.convergence.verdicts import DECADE_WORDS, DECADES, Shift
from streamdash.plots.convergence import colour
from streamdash.statistics.spectrum import KINDS

STYLE = (
    TABLE_STYLE
    + """
td { white-space: normal; }
td.number { white-space: nowrap; }
a { color: inherit; }
.mark { display: inline-block; width: 22px; height: 4px; vertical-align: middle; margin-right: 6px; }
"""
)
SIGNS = {"agrees": "✓", "within the scatter of streams": "≈", "differs": "✗"}
HEADS = {"density": "Density", "track": "Track", "cross": "Cross"}


def verdicts_html(found: Sequence[Measured], lacking: Sequence[ConvergenceTest]) -> str:
    """One row per test: the largest mean shift among what the paper calls converged, and the verdict."""
    rows = []
    for one in found:
        worst = one.verdict.worst
        rows.append(
            f"<tr><th scope='row'><a href='?page=convergence&amp;knob={html.escape(one.knob.key)}'>"
            f"{html.escape(one.knob.title)}</a></th>"
            f"<td class='number'>{_number(worst)}</td>"
            f"<td>{SIGNS[worst.word]} {worst.word}</td>"
            f"<td class='number'>{_number(one.verdict.worst_clean)}</td>"
            f"<td>{html.escape(one.knob.paper) or 'no such test'}</td></tr>"
        )
    rows += [
        f"<tr><th scope='row'>{html.escape(one.title)}</th><td colspan='4'>not simulated yet</td></tr>"
        for one in lacking
    ]
    return reachable(
        "Verdicts on all tests",
        "<table><thead><tr><th scope='col'>Test</th>"
        "<th scope='col'>Shift as observed<small>in half bands of signal and noise</small></th>"
        "<th scope='col'>Outcome</th><th scope='col'>Without noise</th>"
        "<th scope='col'>Paper</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>",
    )


def shifts_html(one: Measured) -> str:
    """One row per setting of a test: its impacts and the mean shifts of each spectrum."""
    columns = (("density", True), *((kind, False) for kind in KINDS))
    heads = "".join(
        f"<th scope='col'>{HEADS[kind]}<small>{'as observed' if seen else 'without noise'}</small></th>"
        for kind, seen in columns
    )
    rows = []
    for i, (setting, spectra) in enumerate(zip(one.knob.settings, one.spectra, strict=True)):
        pairs = ([one.verdict.of(i, kind, name, seen) for name in DECADES] for kind, seen in columns)
        cells = "".join(_cell(pair) for pair in pairs)
        rows.append(
            f"<tr><th scope='row'><span class='mark' style='background:{colour(one.knob, i)}' "
            f"aria-hidden='true'></span>{html.escape(setting.label)}</th>"
            f"<td class='number'>{spectra.mean_impacts:.0f}</td>{cells}</tr>"
        )
    return reachable(
        "Shifts of this test",
        "<table><caption>Mean shift of the median, in half bands of the setting compared with: at 1° to 10°, "
        "and at larger scales</caption>"
        f"<thead><tr><th scope='col'>Setting</th><th scope='col'>Impacts</th>{heads}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>",
    )


def _number(shift: Shift) -> str:
    return f"{shift.mean:+.2f} ± {shift.error:.2f}<small>at {DECADE_WORDS[shift.decade]}</small>"


def _cell(pair: Sequence[Shift | None]) -> str:
    found = [shift for shift in pair if shift is not None]
    if not found:
        return "<td class='number'>–<small>compared with</small></td>"
    lines = "<br>".join(f"{SIGNS[shift.word]} {shift.mean:+.2f} ± {shift.error:.2f}" for shift in found)
    return f"<td class='number'>{lines}</td>"
