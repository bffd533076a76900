"""The Infer page's cards: figures that follow an answer, with their files and their code."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.pages.infer.answers import Answer, Calibration
from app.pages.infer.code import Asked, answer_code, bands_code, calibration_code, moves_code
from app.pages.infer.parts import (
    STYLE,
    Corner,
    calibration_html,
    calibration_sentence,
    corner_sentence,
    methods_html,
    strange_sentence,
)
from app.services.services import Unavailable
from streamdash.config import StreamModel
from streamdash.inference.methods import shipped_methods
from streamdash.inference.posterior import Posterior
from streamdash.plots import corner, infer
from streamdash.plots.corner import BLUE
from streamdash.plots.live import LiveFigure
from streamdash.streams import stream_of

CORNER_LEGEND = (
    (f"band-{BLUE}", "posterior; dark: its most probable 68 %"),
    ("dashes-grey", "prior"),
    ("line-grey", "cold dark matter"),
    ("line-hand", "truth, where it is known"),
)
BAND_LEGEND = (
    ("bars-ink", "data"),
    (f"band-{BLUE}", "68 % and 95 % of the posterior’s streams, observed alike"),
    (f"line-{BLUE}", "their median"),
)
ROWS_WORDS = (
    "Median, 68 % and 95 % interval of the abundance. An age can be fixed, and errors made smaller, where an "
    "estimator that was told them is shipped; the usual age and errors have a sharper one of their own. "
    "Errors with LSST are rough: they count the stream’s stars down to a depth, and no background."
)


class Cards:
    """Posterior, predictive bands, what moves the answer, and its calibration.

    Parameters
    ----------
    asked
        Gives what the listings must say.
    cutting
        What asks for the answers from parts of the stretch.

    Attributes
    ----------
    found : Answer or None
        What is shown.
    """

    def __init__(self, asked: Callable[[], Asked], cutting: Viewable) -> None:
        self._asked = asked
        self.found: Answer | None = None
        self.rows: Sequence[tuple[str, Posterior]] = ()
        self.calibrated: Calibration | None = None
        self.corner: Corner | None = None
        self.live: LiveFigure | None = None
        self._live_for = ("", False)
        self.corner_slot, self.band_slot, self.moves_slot, self.rank_slot = (
            pn.Column(sizing_mode=ui.WIDE, margin=0) for _ in range(4)
        )
        self.scores = html("sd-scores")
        self.corner_card = ui.FigureCard(
            "What the data say",
            self.corner_slot,
            name="posterior",
            drawn=lambda: self._corner(),
            table=lambda: corner.corner_table(self.ready().posterior),
            code=lambda: answer_code(asked()),
            legend=ui.legend(CORNER_LEGEND),
        )
        self.band_card = ui.FigureCard(
            "Streams of the posterior over the data",
            self.band_slot,
            name="predictive",
            drawn=lambda: self._bands("matplotlib"),
            table=lambda: infer.predictive_table(*self._measured()),
            code=lambda: bands_code(asked()),
            legend=ui.legend(BAND_LEGEND),
        )
        self.moves_card = ui.FigureCard(
            "What each assumption does",
            [pn.Column(ui.plain_text(ROWS_WORDS), self.moves_slot, cutting, sizing_mode=ui.WIDE, margin=0)],
            name="assumptions",
            drawn=lambda: self._moves("matplotlib"),
            table=lambda: infer.interval_table(self.rows, self._first()),
            code=lambda: moves_code(asked()),
        )
        self.rank_card = ui.FigureCard(
            "Is it calibrated? Ranks of the truth in held-out streams",
            self.rank_slot,
            name="calibration",
            drawn=lambda: infer.rank_histogram(self._ranks().ranks, "matplotlib"),
            table=lambda: infer.rank_table(self._ranks().ranks),
            code=lambda: calibration_code(asked()),
        )

    def show(self, found: Answer, dark: bool) -> None:
        """Show an answer; of a strange profile the posterior is withheld."""
        self.found = found
        if found.strange:
            self.corner = None
            self.corner_slot[:] = [ui.plain_text("No posterior is shown for it.")]
            self.corner_card.say(strange_sentence(found), ready=False)
            self.moves_slot.clear()
            self.moves_card.say("")
        else:
            if self.corner is not None and self.corner.fits(found.posterior):
                self.corner.patch(found.posterior, found.truth)
            else:
                prior = found.oracle.estimator.prior
                self.corner = Corner(found.posterior, prior, found.truth)
                self.corner_slot[:] = [self.corner.view]
            self.corner_card.say(corner_sentence(found))
        self.draw_bands(dark)

    def withdraw(self) -> None:
        """Show nothing: there is no answer to what is asked now."""
        self.found, self.corner, self.live, self.rows, self.calibrated = None, None, None, (), None
        for slot in (self.corner_slot, self.band_slot, self.moves_slot, self.rank_slot):
            slot.clear()
        for card in (self.corner_card, self.band_card, self.moves_card, self.rank_card):
            card.say("")

    def draw_bands(self, dark: bool) -> None:
        """The data over the predictive bands, in the page's ink."""
        if self.found is None:
            return
        design, q, sigma, bands = self._measured()
        shown = (design.key, dark)
        if self.live is not None and self._live_for == shown:
            self.live.patch(infer.predictive_columns(design, q, sigma, bands))
            self.live.move(y=(0.0, infer.predictive_top(q, bands)))
        else:
            self.live, self._live_for = LiveFigure(self._bands("bokeh", dark)), shown
            self.band_slot[:] = [pane(self.live)]
        self.band_card.say(infer.predictive_sentence(q, bands))

    def show_rows(self, rows: Sequence[tuple[str, Posterior]]) -> None:
        """Show the answer under other assumptions."""
        if self.found is None:
            return
        self.rows = rows
        self.moves_slot[:] = [pane(LiveFigure(self._moves("bokeh")))]
        self.moves_card.say(infer.intervals_sentence(rows, self._first()))

    def fail_rows(self, sentence: str) -> None:
        """Say why there is none."""
        self.moves_slot[:] = [ui.error_state(sentence)]
        self.moves_card.say("")

    def show_ranks(self, calibrated: Calibration) -> None:
        """Show the calibration."""
        if self.found is None:
            return
        self.calibrated = calibrated
        self.scores.write(calibration_html(calibrated, self.found.oracle.estimator.prior))
        self.rank_slot[:] = [pane(LiveFigure(infer.rank_histogram(calibrated.ranks, "bokeh"))), self.scores]
        self.rank_card.say(calibration_sentence(calibrated))

    def fail_ranks(self, sentence: str) -> None:
        """Say why there is none."""
        self.rank_slot[:] = [ui.error_state(sentence)]
        self.rank_card.say("")

    def ready(self) -> Answer:
        """The answer that is shown.

        Raises
        ------
        Unavailable
            When there is none.
        """
        if self.found is None:
            raise Unavailable("There is no answer yet; train an estimator for these bins first.")
        return self.found

    def _ranks(self) -> Calibration:
        if self.calibrated is None:
            raise Unavailable("The calibration has not been computed yet.")
        return self.calibrated

    def _first(self) -> str:
        return self.rows[0][1].names[0]

    def _measured(self) -> tuple[Any, Any, Any, Any]:
        found = self.ready()
        return found.oracle.estimator.design, found.data.q, found.sigma, found.bands

    def _corner(self) -> Any:
        found = self.ready()
        return corner.layout(found.posterior, found.oracle.estimator.prior, "matplotlib", found.truth)

    def _bands(self, backend: Any, dark: bool = False) -> Any:
        return infer.predictive(*self._measured(), backend, dark)

    def _moves(self, backend: Any) -> Any:
        found = self.ready()
        return infer.intervals(
            self.rows, self._first(), found.oracle.estimator.prior, backend, found.data.truth
        )


def html(css_class: str) -> ui.Html:
    """Text of this page."""
    return ui.Html(stylesheets=[STYLE], css_classes=[css_class], margin=0)


def pane(live: LiveFigure) -> Viewable:
    """A figure as wide as there is room."""
    return ui.figure_pane(live.figure)


def methods_part(model: StreamModel) -> list[Viewable]:
    """What each method is worth for a stream, where that was measured."""
    methods = shipped_methods(stream_of(model).name)
    if not methods:
        return []
    table = html("sd-methods")
    table.write(methods_html(methods))
    words = ui.plain_text(
        "All rows answer for the same streams, which none of them has learnt from: the abundance alone, "
        "in the stream’s usual bins.",
        margin=(0, 8),
    )
    return [ui.folded("What each method is worth", [words, table], "methods-part")]
