"""Verdicts and shifts of the convergence tests as HTML tables."""

from __future__ import annotations

import html
from collections.abc import Sequence

from app.pages.spectrum.statements import STYLE as TABLE_STYLE
from app.ui.layout import reachable
from streamdash.convergence.knobs import ConvergenceTest
from streamdash.convergence.text import Measured
from streamdash.convergence.verdicts import Shift
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
    """One row per test: the largest shift among what the paper calls converged, and the verdict."""
    rows = []
    for one in found:
        worst = one.verdict.worst
        rows.append(
            f"<tr><th scope='row'><a href='?page=convergence&amp;knob={html.escape(one.knob.key)}'>"
            f"{html.escape(one.knob.title)}</a></th>"
            f"<td class='number'>{worst.largest:+.2f} ± {worst.error:.2f}"
            f"<small>at {worst.scale:.1f}°</small></td>"
            f"<td>{SIGNS[worst.word]} {worst.word}</td>"
            f"<td>{html.escape(one.knob.paper) or 'no such test'}</td></tr>"
        )
    rows += [
        f"<tr><th scope='row'>{html.escape(one.title)}</th><td colspan='3'>not simulated yet</td></tr>"
        for one in lacking
    ]
    return reachable(
        "Verdicts on all tests",
        "<table><thead><tr><th scope='col'>Test</th>"
        "<th scope='col'>Largest shift<small>in half bands</small></th>"
        "<th scope='col'>Verdict</th><th scope='col'>Paper</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>",
    )


def shifts_html(one: Measured) -> str:
    """One row per setting of a test: its impacts and the largest shift of each spectrum."""
    heads = "".join(f"<th scope='col'>{HEADS[kind]}</th>" for kind in KINDS)
    rows = []
    for i, (setting, spectra) in enumerate(zip(one.knob.settings, one.spectra, strict=True)):
        shifts = {shift.kind: shift for shift in one.verdict.shifts if shift.setting == i}
        cells = "".join(_cell(shifts.get(kind)) for kind in KINDS)
        rows.append(
            f"<tr><th scope='row'><span class='mark' style='background:{colour(one.knob, i)}' "
            f"aria-hidden='true'></span>{html.escape(setting.label)}</th>"
            f"<td class='number'>{spectra.mean_impacts:.0f}</td>{cells}</tr>"
        )
    return reachable(
        "Shifts of this test",
        "<table><caption>Largest shift of the median, in half bands of the setting compared with</caption>"
        f"<thead><tr><th scope='col'>Setting</th><th scope='col'>Impacts</th>{heads}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>",
    )


def _cell(shift: Shift | None) -> str:
    if shift is None:
        return "<td class='number'>–<small>compared with</small></td>"
    return (
        f"<td class='number'>{SIGNS[shift.word]} {shift.largest:+.2f} ± {shift.error:.2f}"
        f"<small>at {shift.scale:.1f}°</small></td>"
    )
