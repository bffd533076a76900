"""HTML of the Learn page that has no component of its own: the quiz's scores."""

from __future__ import annotations

from collections.abc import Sequence

from app.ui.layout import reachable

SCORE_STYLE = """
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.5 Roboto, sans-serif; }
th, td { padding: 2px 8px; text-align: center; border-bottom: 1px solid #80808060; }
th[scope=row] { text-align: left; font-weight: 500; }
.now { outline: 2px solid currentColor; outline-offset: -2px; }
.total { font-weight: 700; }
.right { font-weight: 700; }
.wrong { opacity: 0.75; }
"""
RIGHT, WRONG, OPEN = "✓", "✗", "·"


def score_table(
    truths: Sequence[int],
    mine: Sequence[int],
    machine: Sequence[int | None],
    number: int,
    rounds: int,
) -> str:
    """Who was right in which round.

    Parameters
    ----------
    truths, mine, machine
        Classes of the rounds answered so far; None where the classifier is not ready.
    number
        Round shown now, from 1.
    """
    heads = "".join(
        f"<th scope='col'{' class=now' if i == number else ''}>{i}</th>" for i in range(1, rounds + 1)
    )
    rows = _row("You", truths, mine, rounds) + _row("Classifier", truths, machine, rounds)
    return reachable(
        "Scores of both",
        f"<table><thead><tr><th scope='col'>Round</th>{heads}"
        f"<th scope='col'>Score</th></tr></thead><tbody>{rows}</tbody></table>",
    )


def _row(name: str, truths: Sequence[int], said: Sequence[int | None], rounds: int) -> str:
    marks = [
        "<td aria-label='not ready'>…</td>"
        if answer is None
        else f"<td class='right' aria-label='right'>{RIGHT}</td>"
        if answer == truth
        else f"<td class='wrong' aria-label='wrong'>{WRONG}</td>"
        for truth, answer in zip(truths, said, strict=True)
    ]
    empty = f"<td aria-label='open'>{OPEN}</td>" * (rounds - len(marks))
    score = sum(answer == truth for truth, answer in zip(truths, said, strict=True))
    total = f"<td class='total'>{score} of {len(truths)}</td>"
    return f"<tr><th scope='row'>{name}</th>{''.join(marks)}{empty}{total}</tr>"
