"""Scores of the quiz: who was right, how sure they were, and how well that went together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from app import ui
from streamdash.classifier.quiz import points, spread

SCORE_STYLE = (
    ui.SCROLLS
    + """
table { border-collapse: collapse; font: 13px/1.4 Roboto, sans-serif; width: 100%; max-width: 560px; }
th, td { padding: 3px 1px; text-align: center; border-bottom: 1px solid #80808060; }
th[scope=row] { text-align: left; font-weight: 500; }
small { display: block; font-size: 11px; }
.now { outline: 2px solid currentColor; outline-offset: -2px; }
.total, .right, .wrong { font-weight: 700; }
.right { background: #009E7333; }
.wrong { background: #D55E0033; }
"""
)


@dataclass(frozen=True, eq=False)
class Said:
    """An answer: a class, and how sure somebody is of it.

    Attributes
    ----------
    choice : int
    sure : float
        Probability of the choice.
    n_classes : int
    probability : ndarray (n_classes,), optional
        Of every class, where more than the choice's was said.
    """

    choice: int
    sure: float
    n_classes: int
    probability: np.ndarray | None = None

    @classmethod
    def of(cls, probability: np.ndarray) -> Said:
        """The answer of somebody who gives every class a probability."""
        choice = int(probability.argmax())
        return cls(choice, float(probability[choice]), len(probability), probability)

    def points(self, truth: int) -> float:
        """Score if that class is the true one, see `streamdash.classifier.quiz.points`."""
        stated = self.probability
        return points(spread(self.n_classes, self.choice, self.sure) if stated is None else stated, truth)


def score_table(
    truths: Sequence[int],
    mine: Sequence[Said],
    machine: Sequence[Said | None],
    number: int,
    rounds: int,
) -> Markup:
    """Who was right in which round, how sure, and the points.

    Parameters
    ----------
    truths, mine, machine
        Classes of the rounds answered so far, and what was said; None where the classifier is not ready.
    number
        Round shown now, from 1.
    rounds
        How many there are.
    """
    rows = []
    for name, said in (("You", mine), ("Classifier", machine)):
        marks = [
            None if one is None else (one.choice == truth, f"{100 * min(one.sure, 0.99):.0f}")
            for truth, one in zip(truths, said, strict=True)
        ]
        got = [one.points(truth) for truth, one in zip(truths, said, strict=True) if one is not None]
        rows.append((name, marks, f"{sum(got):.0f}" if got else "–"))
    return ui.render("pages/learn/scores.html", rows=rows, number=number, rounds=rounds)


def calibration(truths: Sequence[int], said: Sequence[Said]) -> str:
    """Whether somebody was as often right as they were sure, in words."""
    sure = np.array([one.sure for one in said])
    right = sum(truth == one.choice for truth, one in zip(truths, said, strict=True))
    expected, luck = float(sure.sum()), float(np.sqrt((sure * (1 - sure)).sum()))
    off = right - expected
    if abs(off) <= luck:
        words = "that is as close as luck allows: you know how sure to be"
    elif off < 0:
        words = "you were surer than you were right"
    else:
        words = "you know more than you dare to say"
    return (
        f"You said you would be right {expected:.1f} times out of {len(said)} and were {right} times; luck "
        f"alone moves that by about {luck:.1f}. So {words}."
    )
