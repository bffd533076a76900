"""Learn page, guess the mass: ten streams, the student's guess and the classifier's."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import panel as pn
from markupsafe import Markup
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.state import DIFFICULTIES, QUIZ_NOISE, ROUNDS
from app.services.services import Unavailable
from app.session.listing import ensembles_code
from app.session.session import link_to
from app.ui.browser import CopyLink, LiveText
from app.work.tasks import Task, Watch
from app.work.training import streams_of, train_task
from streamdash.classifier.model import BEST
from streamdash.classifier.quiz import Clue, draw_rounds, find_clue, learn, quiz_split
from streamdash.classifier.train import Judged
from streamdash.plots import quiz as plot
from streamdash.plots.live import LiveFigure, export
from streamdash.streams import bin_text
from streamdash.survey.observed import ObservedStreams

USES = frozenset({"difficulty", "game", "round", "answers", "average", "theme"})
LEGEND = (("ink", "averaged over bins"), ("line", "without noise (once revealed)"))
CLUE_LEGEND = (("line", "streams that were not asked about, by class"), ("dashes", "this stream"))
SCORE_STYLE = """
.wide { overflow-x: auto; }
table { border-collapse: collapse; font: 14px/1.5 Roboto, sans-serif; }
th, td { padding: 2px 8px; text-align: center; border-bottom: 1px solid #80808060; }
th[scope=row] { text-align: left; font-weight: 500; }
.now { outline: 2px solid currentColor; outline-offset: -2px; }
.total, .right { font-weight: 700; }
.wrong { opacity: 0.75; }
"""


class QuizLesson:
    """Ten rounds against the classifier; neither it nor the explanation has seen the streams asked about."""

    def __init__(self, page: Page) -> None:
        self.page, self.session, self.services = page, page.session, page.services
        try:
            self.streams: ObservedStreams = streams_of(self.services, self.session)
        except ValueError as error:
            raise Unavailable(str(error)) from None
        self.judged: Judged | None = None
        self.clue: Clue | None = None
        self.watch = Watch(self._trained)
        self.live: LiveFigure | None = None
        self._build()
        self._begin()

    # ------------------------------------------------------------ the game

    @property
    def noise(self) -> float:
        """Shot noise of the chosen difficulty."""
        return QUIZ_NOISE[self.session.difficulty]

    @property
    def guesses(self) -> list[int]:
        """The student's answers in this game; those of another game count for nothing."""
        tag, _, digits = self.session.answers.partition("-")
        if tag != self.tag:
            return []
        return [int(digit) for digit in digits if int(digit) < len(self.streams.q)]

    @property
    def tag(self) -> str:
        """Four digits that tell this game from others."""
        session = self.session
        text = repr((self.streams.keys, session.difficulty, session.game))
        return hashlib.sha256(text.encode()).hexdigest()[:4]

    @property
    def number(self) -> int:
        """Round shown, from 1; nobody can look ahead."""
        return min(self.session.round, len(self.guesses) + 1, ROUNDS)

    @property
    def revealed(self) -> bool:
        """Whether this round has been answered."""
        return self.number <= len(self.guesses)

    def guess(self, answer: int) -> None:
        """Answer the round that is shown."""
        if not self.revealed:
            digits = "".join(str(g) for g in (*self.guesses, answer))
            self.session.param.update(answers=f"{self.tag}-{digits}", round=self.number)

    def go_on(self) -> None:
        """On to the next round."""
        self.session.round = min(self.number + 1, ROUNDS)

    def new_game(self) -> None:
        """Ten other streams."""
        self.session.advance("game", round=1, answers="")

    def taken_for(self, number: int) -> int | None:
        """What the classifier says to a round; None while it is being trained."""
        if self.judged is None:
            return None
        return int(self._probability(number).argmax())

    # ------------------------------------------------------------ page

    def view(self) -> Viewable:
        """Controls, scores, the stream, what gave it away."""
        return self.body

    def update(self, changed: frozenset[str]) -> None:
        """Patch what changed."""
        if changed & {"difficulty", "game"}:
            self._begin()
        elif changed & {"round", "answers"}:
            self._show()
        elif "average" in changed and self.live is not None:
            self.live.patch(plot.round_columns(self.round, self.session.average, self.revealed))
        if "theme" in changed:
            self._ink()

    def close(self) -> None:
        """Wait for the classifier no more."""
        self.watch.leave()

    def _begin(self) -> None:
        """Another game: the classifier for its noise, and the round that the link asks for."""
        self.judged = None
        self.rows = draw_rounds(self.streams, quiz_split(self.streams, BEST.seed), self.session.game)
        noise = self.noise
        key = ("observed", *self.streams.keys, noise)
        self.observed = self.services.shared(key, lambda: self.streams.observed(noise))
        self._show()
        self.watch.follow(self.services.work.ask(*train_task(self.services, self.session, noise, BEST)))

    def _trained(self, task: Task) -> None:
        if task.state == "done":
            self.judged = task.result
            self._say()
        elif task.active:
            percent = 20 * int(5 * task.fraction)
            self.summary.text = f"The classifier is still learning from other streams: {percent} %."
        else:
            self.summary.text = task.error or "The classifier was stopped; choose another difficulty."

    def _show(self) -> None:
        """The stream of this round, and its truth once it is answered."""
        session = self.session
        row = int(self.rows[self.number - 1])
        self.round = plot.make_round(self.streams, self.observed, row, self.noise)
        if self.live is None:
            drawn = plot.draw_round(self.round, session.average, self.revealed, "bokeh")
            self.live = LiveFigure(drawn, ink=(plot.AVERAGED,))
            self.figure[:] = [ui.figure_pane(self.live.figure)]
        else:
            self.live.patch(plot.round_columns(self.round, session.average, self.revealed))
        self.clue = self._find_clue() if self.revealed else None
        self.clue_card.view.visible = self.revealed
        if self.clue is not None:
            drawn = plot.draw_clue(self.clue, self.streams.design.step, "bokeh")
            self.clue_live = LiveFigure(drawn, ink=("this",))
            self.clue_figure[:] = [ui.figure_pane(self.clue_live.figure)]
            self.clue_card.say(plot.clue_sentence(self.clue, self.round))
        words = plot.truth_sentence if self.revealed else plot.round_sentence
        self.card.say(words(self.round, self.number, ROUNDS))
        for button in self.buttons:
            button.disabled = self.revealed
        self.next_button.visible = self.revealed and self.number < ROUNDS
        # Where everybody starts, and without this person's guesses.
        self.link.query = link_to(session, round=1, answers="", average=1, theme="default")
        self._ink()
        self._say()

    def _find_clue(self) -> Clue:
        number, noise, row = self.number, self.noise, int(self.rows[self.number - 1])
        streams, keys = self.streams, self.streams.keys
        known = self.services.shared(
            ("quiz measures", *keys, noise), lambda: learn(streams, quiz_split(streams, BEST.seed), noise)
        )
        key = ("quiz clue", *keys, noise, self.session.game, number)
        return self.services.shared(key, lambda: find_clue(known, self.observed[row], int(streams.y[row])))

    def _probability(self, number: int) -> np.ndarray:
        assert self.judged is not None
        return self.judged.probability[np.searchsorted(self.judged.rows, self.rows[number - 1])]

    def _say(self) -> None:
        """The verdict of this round and the scores."""
        answered = len(self.guesses)
        truths = [int(self.streams.y[row]) for row in self.rows[:answered]]
        machine = [self.taken_for(i + 1) for i in range(answered)]
        self.scores.write(score_table(truths, self.guesses, machine, self.number))
        self.status.text = self._verdict()
        if self.judged is not None:
            self.summary.text = self._summary(self.judged, truths, machine)

    def _verdict(self) -> str:
        if not self.revealed:
            count = len(self.streams.q)
            return f"Round {self.number} of {ROUNDS}: which of the {count} mass ranges made these gaps?"
        names, truth, mine = self.round.names, self.round.truth, self.guesses[self.number - 1]
        verdict = "Right" if mine == truth else "Wrong"
        said = f"{verdict}: it was {names[truth]}" + ("." if mine == truth else f", not {names[mine]}.")
        if self.judged is None:
            return f"{said} The classifier is still learning; its guess will follow."
        probability = self._probability(self.number)
        choice = int(probability.argmax())
        also = "right too" if choice == truth == mine else "right" if choice == truth else "wrong"
        return f"{said} The classifier said {names[choice]} ({100 * probability[choice]:.0f} % sure): {also}."

    def _summary(self, judged: Judged, truths: list[int], machine: list[int | None]) -> str:
        if len(truths) < ROUNDS:
            learnt = len(self.streams.y) - len(judged.y)
            return f"The classifier has learnt from {learnt} other streams, and has not seen these ten."
        mine = sum(a == b for a, b in zip(truths, self.guesses, strict=True))
        its = sum(a == b for a, b in zip(truths, machine, strict=True))
        accuracy = float(np.mean(judged.probability.argmax(axis=1) == judged.y))
        return (
            f"You: {mine} of {ROUNDS}. The classifier: {its} of {ROUNDS}. Blind guessing would give "
            f"{ROUNDS / len(self.streams.q):.1f} on average. On all {len(judged.y)} streams it was not "
            f"trained on, the classifier is right {100 * accuracy:.1f} % of the time at this noise."
        )

    def _ink(self) -> None:
        dark = self.session.theme == "dark"
        if self.live is not None:
            self.live.set_ink(dark)
        if self.clue is not None:
            self.clue_live.set_ink(dark)

    def _build(self) -> None:
        names = [choice.label for choice in self.session.ensembles]
        self.buttons = [
            ui.class_button(i, name, lambda i=i: self.guess(i), css_classes=[f"sd-guess-{i}"])  # type: ignore[misc]
            for i, name in enumerate(names)
        ]
        self.next_button = ui.button("Next stream", self.go_on, css_classes=["sd-next"], margin=(4, 10))
        self.status = LiveText(sizing_mode=ui.WIDE, margin=(6, 10), css_classes=["sd-verdict"])
        self.summary = LiveText(sizing_mode=ui.WIDE, margin=(6, 10), css_classes=["sd-summary"])
        self.scores = ui.Html(stylesheets=[SCORE_STYLE], margin=(4, 10), css_classes=["sd-quiz-scores"])
        self.link = CopyLink(margin=(4, 10), css_classes=["sd-class-link"], sizing_mode=ui.WIDE)
        self.figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.clue_figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self._make_cards()
        self.body = pn.Column(
            ui.controls(
                ui.ensemble_picker(self.page),
                ui.toggle(self.page, "difficulty", "Difficulty: shot noise", _difficulties()),
                ui.int_slider(self.page, "average", "Average over bins"),
                ui.button("Ten others", self.new_game, css_classes=["sd-new-game"], margin=(4, 10)),
            ),
            ui.controls(*self.buttons, self.next_button),
            self.status,
            self.scores,
            self.summary,
            self.card.view,
            self.clue_card.view,
            self.link,
            sizing_mode=ui.WIDE,
            margin=0,
        )

    def _make_cards(self) -> None:
        count = len(self.streams.q)
        dots = ("dots-grey", f"observed, one dot per {bin_text(self.streams.configs[0].stream)}")
        self.card = ui.FigureCard(
            "What made these gaps?",
            self.figure,
            name="quiz",
            image=lambda kind: export(self._drawn(), kind),
            table=lambda: plot.round_table(self.round, self.revealed),
            code=lambda: self._code(
                "quiz_figure", f", average={self.session.average}, reveal={self.revealed}", "quiz"
            ),
            legend=ui.legend((dots, *LEGEND), count),
        )
        self.clue_card = ui.FigureCard(
            "What gave it away",
            self.clue_figure,
            name="clue",
            image=lambda kind: export(self._drawn_clue(), kind),
            table=lambda: plot.clue_table(self._known_clue(), self.round.names),
            code=lambda: self._code("clue_figure", "", "clue"),
            legend=ui.legend(CLUE_LEGEND, count),
        )

    def _drawn(self) -> Any:
        return plot.draw_round(self.round, self.session.average, self.revealed, "matplotlib")

    def _drawn_clue(self) -> Any:
        return plot.draw_clue(self._known_clue(), self.streams.design.step, "matplotlib")

    def _known_clue(self) -> Clue:
        if self.clue is None:
            raise ValueError("The truth is not out yet; guess first.")
        return self.clue

    def _code(self, function: str, more: str, name: str) -> str:
        return (
            "from pathlib import Path\n\n"
            "from streamdash.plots.live import export\n"
            f"from streamdash.plots.quiz import {function}\n"
            "from streamdash.store.cache import Cache\n\n"
            f"{ensembles_code(self.session.ensembles)}"
            f"figure = {function}(\n"
            f"    Cache.default(), ensembles, noise={self.noise:g}, game={self.session.game}, "
            f"number={self.number}{more}\n"
            ")\n"
            f'Path("{name}.png").write_bytes(export(figure, "png"))\n'
        )


def _difficulties() -> dict[str, str]:
    return {f"{words} {QUIZ_NOISE[key]:g}": key for key, words in DIFFICULTIES.items()}


def score_table(
    truths: Sequence[int], mine: Sequence[int], machine: Sequence[int | None], number: int
) -> Markup:
    """Who was right in which round.

    Parameters
    ----------
    truths, mine, machine
        Classes of the rounds answered so far; None where the classifier is not ready.
    number
        Round shown now, from 1.
    """
    rows = []
    for name, said in (("You", mine), ("Classifier", machine)):
        right = [None if a is None else a == truth for truth, a in zip(truths, said, strict=True)]
        rows.append((name, right, right.count(True)))
    return ui.render("pages/learn/scores.html", rows=rows, number=number, rounds=ROUNDS)
