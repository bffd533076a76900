"""A question of the story: predict first, then see what happens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.ui.browser import LiveText

TYPE = {"fontSize": "var(--sd-type, 14px)"}
"""Buttons whose words grow with the others on a wall."""


@dataclass(frozen=True)
class Outcome:
    """What came out.

    Attributes
    ----------
    right : int
        Number of the answer that is right.
    sentence : str
        Why, with computed numbers.
    changes : dict
        What to change in the session, so that it is seen.
    """

    right: int
    sentence: str
    changes: dict[str, Any] = field(default_factory=dict)


class Prediction:
    """A question with a few answers; whichever is pressed, the outcome follows.

    Parameters
    ----------
    question, answers
        In words.
    outcome
        Computes what comes out.
    act
        Called with the changes that let it be seen.
    """

    def __init__(
        self,
        question: str,
        answers: tuple[str, ...],
        outcome: Callable[[], Outcome],
        act: Callable[[dict[str, Any]], Any],
    ) -> None:
        self.answers, self._outcome, self._act = answers, outcome, act
        self.said: int | None = None
        self.buttons = [
            ui.button(words, partial(self.say, i), css_classes=[f"sd-predict-{i}"], margin=(4, 6), sx=TYPE)
            for i, words in enumerate(answers)
        ]
        self.verdict = LiveText(sizing_mode=ui.WIDE, margin=(4, 8), css_classes=["sd-outcome"])
        self.view: Viewable = pn.Column(
            ui.plain_text(
                f"Predict, then see: {question}",
                margin=(4, 8),
                styles={"font-weight": "500", "font-size": TYPE["fontSize"]},
            ),
            pn.FlexBox(*self.buttons, gap="0", sizing_mode=ui.WIDE, margin=0),
            self.verdict,
            sizing_mode=ui.WIDE,
            margin=(4, 0, 8, 0),
            styles={"border-left": "4px solid #C77C00", "padding-left": "4px"},
            css_classes=["sd-predict"],
        )

    def say(self, number: int) -> None:
        """Give an answer; the first one counts."""
        if self.said is not None:
            return
        self.said = number
        found = self._outcome()
        for i, (button, words) in enumerate(zip(self.buttons, self.answers, strict=True)):
            mark = "✓ " if i == found.right else "✗ " if i == number else ""
            button.param.update(disabled=True, label=f"{mark}{words}")
        opening = "As you said." if number == found.right else f"No: {self.answers[found.right]}."
        self.verdict.text = f"{opening} {found.sentence}"
        self._act(found.changes)
