"""Answers that were put aside, and what they say together."""

from __future__ import annotations

from typing import Any

import panel as pn

from app import ui
from app.pages.infer.code import JOIN_CODE
from app.session.catalog import Stream
from app.session.session import Session
from streamdash.config import StreamModel
from streamdash.inference.cells import AGE
from streamdash.inference.posterior import Posterior
from streamdash.plots import infer
from streamdash.plots.live import LiveFigure
from streamdash.prior import Prior
from streamdash.streams import stream_of, stream_text

WORDS = "Put aside the answer of another stream with the same prior to see what they say together."


class Joined:
    """A card with the answers of several streams, and the product of their likelihoods."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.rows: list[tuple[str, Posterior]] = []
        self.prior: Prior | None = None
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        forget = ui.button("Forget them", self.forget, css_classes=["sd-infer-forget"])
        self.card = ui.FigureCard(
            "Several streams together",
            pn.Column(self.slot, forget, sizing_mode=ui.WIDE, margin=0),
            name="joined",
            drawn=lambda: self._draw("matplotlib"),
            table=lambda: infer.interval_table(self.rows, self._name),
            code=lambda: JOIN_CODE,
        )
        self.card.view.visible = False

    def put_aside(self, name: str, posterior: Posterior) -> None:
        """Keep an answer; one of the same name is replaced. The age is each stream's own."""
        kept = [entry for entry in self.session.infer_kept if entry[0] != name]
        self.session.infer_kept = [*kept, (name, posterior.without(AGE))]

    def forget(self) -> None:
        """Let go of all answers."""
        self.session.infer_kept = []

    def show(self, present: Posterior | None, prior: Prior | None) -> None:
        """Show those that have the grid of the present answer."""
        self.prior = prior
        self.rows = together(self.session.infer_kept, present)
        self.card.view.visible = bool(self.session.infer_kept)
        if len(self.rows) < 2:
            self.slot[:] = [ui.plain_text(WORDS)]
            self.card.say(WORDS, ready=False)
            return
        figure = LiveFigure(self._draw("bokeh")).figure
        self.slot[:] = [ui.figure_pane(figure)]
        self.card.say(infer.intervals_sentence(self.rows, self._name))

    @property
    def _name(self) -> str:
        return self.rows[0][1].names[0]

    def _draw(self, backend: Any) -> Any:
        assert self.prior is not None
        return infer.intervals(self.rows, self._name, self.prior, backend)


def other_arm(session: Session, model: StreamModel) -> Stream | None:
    """The other arm of a stream, where an answer of one arm was put aside and none of that one."""
    name = stream_of(model).name
    arms = [one for one in session.catalog.streams if not one.arms and stream_of(one.model).name == name]

    def answered(arm: Stream) -> bool:
        return any(kept.startswith(stream_text(arm.model)) for kept, _ in session.infer_kept)

    left = [arm for arm in arms if not answered(arm) and arm.model != model]
    return left[0] if left and len(left) < len(arms) and any(map(answered, arms)) else None


def together(kept: list[tuple[str, Posterior]], present: Posterior | None) -> list[tuple[str, Posterior]]:
    """Answers on the grid of the present one, and last the product of their likelihoods."""
    if present is None:
        return []
    shape = present.without(AGE).p.shape
    names = present.without(AGE).names
    rows = [(name, p) for name, p in kept if p.names == names and p.p.shape == shape]
    if len(rows) >= 2:
        rows.append(("together", rows[0][1].joined(*(p for _, p in rows[1:]))))
    return rows
