"""Pieces of the Infer page: its answer in words, its tables, and the corner plot that is patched."""

from __future__ import annotations

from collections.abc import Mapping

import panel as pn
from markupsafe import Markup
from panel.viewable import Viewable

from app import ui
from app.pages.infer.answers import Answer, Calibration
from app.ui.templates import render
from streamdash.inference.diagnostics import as_record
from streamdash.inference.estimator import STRANGE
from streamdash.inference.posterior import Posterior
from streamdash.inference.words import sentences
from streamdash.plots import corner
from streamdash.plots.live import LiveFigure
from streamdash.prior import Prior

STYLE = (
    ui.SCROLLS
    + """
:host { font: 15px/1.5 Roboto, sans-serif; }
p { margin: 4px 0; max-width: 110ch; }
table { border-collapse: collapse; font-size: 14px; margin: 6px 0; }
th, td { padding: 4px 12px 4px 0; text-align: right; vertical-align: top; }
th:first-child, td:first-child { text-align: left; }
thead th { border-bottom: 1px solid #808080; font-weight: 500; }
tbody th { font-weight: 400; }
.answer { font-size: 22px; line-height: 1.4; margin: 0 0 8px; padding: 10px 16px; max-width: 75ch;
          border-left: 6px solid #0072b2; background: #0072b21a; }
.unlike { border-color: #d64533; background: #d645331f; }
"""
)
PAIR_WORDS = (
    " Of two parameters together, the table gives the share of streams whose truth is within regions of 68 % "
    "and 95 % about random points (TARP)."
)
COLUMNS = ("information (bits)", "68 % width (dex)", "coverage of 68 %", "of 95 %")


def answer_html(found: Answer) -> Markup:
    """The first sentence large, the others below; of a strange profile, that nothing is said."""
    if found.strange:
        words = [strange_sentence(found)]
    else:
        words = sentences(found.posterior, found.oracle.estimator.prior)
    return render("pages/infer/answer.html", words=words, unlike=found.strange)


def strange_sentence(found: Answer) -> str:
    """Why nothing is said of a profile."""
    return (
        f"The answer is withheld: {found.data.name} is not like streams hit by subhalos, whatever their "
        f"number. Fewer than {1 - STRANGE:.0%} of simulated streams look so unlike them."
    )


def corner_sentence(found: Answer) -> str:
    """What the corner plot shows now."""
    bits = found.posterior.information
    return (
        f"Posterior of {found.data.name}: {bits:.2f} bits more than the prior knew. Dark: the most probable "
        "68 %, light: 95 % (or the whole density); dashed: the prior. An arrow says what lies beyond an end "
        "of the prior: no subhalos at all (“none”), or cold dark matter itself (“CDM”)."
    )


def calibration_html(found: Calibration, prior: Prior) -> Markup:
    """Information, width and coverage of every parameter, on held-out streams."""
    rows = [
        (corner.axis_label(name, prior), _numbers(as_record({name: s})[name]))
        for name, s in found.scores.items()
    ]
    for names, pair in found.pairs.items():
        label = " with ".join(corner.axis_label(name, prior) for name in names) + ", by TARP"
        covered = (f"{share:.2f}" for share in pair.coverage)
        rows.append((label, [f"{pair.information:.2f} ± {pair.error:.2f}", "", *covered]))
    return render("pages/infer/scores.html", name="Calibration", columns=["parameter", *COLUMNS], rows=rows)


def calibration_sentence(found: Calibration) -> str:
    """Whether the posteriors are calibrated, in words."""
    score = found.scores[found.name]
    aged = "" if found.age is None else f" of {found.age:g} Gyr, the age known,"
    return (
        f"Of {score.n} streams{aged} that it has not learnt from, {score.coverage[0]:.0%} have their true "
        f"value in the 68 % interval and {score.coverage[1]:.0%} in the 95 % one. The grey band is where "
        "95 % of the bars lie if the posteriors are right."
    ) + (PAIR_WORDS if found.pairs else "")


def methods_html(methods: Mapping[str, Mapping[str, float]]) -> Markup:
    """The table of methods, on the same held-out streams of a stream's usual design."""
    rows = [(name, _numbers(record)) for name, record in methods.items()]
    return render(
        "pages/infer/scores.html", name="What each method is worth", columns=["method", *COLUMNS], rows=rows
    )


def _numbers(record: Mapping[str, float]) -> list[str]:
    return [
        f"{record['bits']:.2f} ± {record['error']:.2f}",
        *(f"{record[name]:.2f}" for name in ("width", "coverage68", "coverage95")),
    ]


class Corner:
    """The corner plot in the browser: a figure for every parameter and every pair, patched when it moves."""

    def __init__(self, posterior: Posterior, prior: Prior, truth: Mapping[str, float] | None) -> None:
        self.names, self.prior = posterior.names, prior
        self._shape = posterior.p.shape
        self.diagonals = {
            name: LiveFigure(corner.diagonal(posterior, name, prior, "bokeh", truth)) for name in self.names
        }
        self.pairs = {
            (x, y): LiveFigure(corner.pair(posterior, x, y, prior, "bokeh", truth))
            for j, y in enumerate(self.names)
            for x in self.names[:j]
        }
        cells = [self._cell(live, i, i) for i, live in enumerate(self.diagonals.values())] + [
            self._cell(live, self.names.index(y), self.names.index(x)) for (x, y), live in self.pairs.items()
        ]
        n = len(self.names)
        rules = "".join(
            f".sd-cell-{row}-{column} {{ grid-row: {row + 1}; grid-column: {column + 1}; }}"
            for row in range(n)
            for column in range(row + 1)
        )
        self.view = pn.Column(
            *cells,
            sizing_mode=ui.WIDE,
            margin=0,
            css_classes=["sd-corner"],
            stylesheets=[
                f":host {{ display: grid !important; grid-template-columns: repeat({n}, minmax(0, 1fr)); "
                f"gap: 8px; }} @media (min-width: 701px) {{ {rules} }} "
                "@media (max-width: 700px) { :host { grid-template-columns: minmax(0, 1fr); } }"
            ],
        )

    def fits(self, posterior: Posterior) -> bool:
        """Whether a posterior has the same cells, so that it can be shown by patching."""
        return posterior.names == self.names and posterior.p.shape == self._shape

    def patch(self, posterior: Posterior, truth: Mapping[str, float] | None) -> None:
        """Show another posterior on the same grid."""
        for name, live in self.diagonals.items():
            live.patch(corner.diagonal_columns(posterior, name, truth))
            live.move(y=(0.0, corner.diagonal_top(posterior, name)))
        for (x, y), live in self.pairs.items():
            live.patch(corner.pair_columns(posterior, x, y, truth))

    def _cell(self, live: LiveFigure, row: int, column: int) -> Viewable:
        height = {1: 330, 2: 300}.get(len(self.names), 230)
        live.figure.height = height
        return pn.Column(
            ui.figure_pane(live.figure),
            sizing_mode=ui.WIDE,
            margin=0,
            styles={"min-width": "0"},
            css_classes=[f"sd-cell-{row}-{column}"],
        )
