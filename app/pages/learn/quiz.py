"""Learn page, guess the mass: ten streams, the guesses of student and classifier, and how sure both are."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.layout import row
from app.pages.learn.levels import asked_about, game_of
from app.pages.learn.scoring import SCORE_STYLE, Said, calibration, score_table
from app.pages.learn.state import DIFFICULTIES, QUIZ_NOISE, ROUNDS, SURE
from app.services.classrooms import Result
from app.services.services import Unavailable
from app.session.listing import ensembles_code
from app.session.session import Session, link_to
from app.ui.browser import LiveText
from app.ui.links import CopyLink
from app.work.tasks import Task, Watch
from app.work.training import streams_of, train_task
from streamdash.classifier.model import BEST
from streamdash.classifier.quiz import Clue, draw_rounds, find_clue, learn, points, quiz_split
from streamdash.classifier.train import Judged
from streamdash.observe.wording import percent
from streamdash.plots import quiz as plot
from streamdash.plots.live import LiveFigure
from streamdash.streams import bin_text
from streamdash.survey.observed import ObservedStreams

USES = frozenset({"difficulty", "game", "round", "answers", "average", "theme"})
LEGEND = (("line-ink", "averaged over bins"), ("line", "without noise (once revealed)"))
CLUE_LEGEND = (("line", "streams that were not asked about, by class"), ("dashes-ink", "this stream"))
WILL_BE_SENT = "When all ten are answered, your result goes to your teacher’s screen, without your name."
SENT = "Your result has gone to your teacher’s screen, without your name."
NOT_SENT = "Your class is closed, or plays another game: your result stays here."
RIGHT, WRONG, OPEN = "#009E73", "#D55E00", "transparent"
"""Edge of the verdict."""


class QuizLesson:
    """Ten rounds against the classifier; neither it nor the explanation has seen the streams asked about."""

    def __init__(self, page: Page) -> None:
        self.page, self.session, self.services = page, page.session, page.services
        self.judged: Judged | None = None
        self.clue: Clue | None = None
        self.watch = Watch(self._trained)
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.inner: Page | None = None
        self._begin()

    # ------------------------------------------------------------ the game

    @property
    def noise(self) -> float:
        """Shot noise of the chosen difficulty."""
        return QUIZ_NOISE[self.session.difficulty]

    @property
    def said(self) -> list[Said]:
        """What the student has said in this game; answers of another game count for nothing."""
        tag, _, digits = self.session.answers.partition("-")
        n = len(self.streams.q)
        if tag != self.tag or any(int(choice) >= n for choice in digits[::2]):
            return []
        return [
            Said(int(choice), self.levels[int(sure)], n)
            for choice, sure in zip(digits[::2], digits[1::2], strict=True)
        ]

    @property
    def guesses(self) -> list[int]:
        """The classes the student has chosen so far."""
        return [said.choice for said in self.said]

    @property
    def levels(self) -> tuple[float, ...]:
        """Probabilities that can be stated, the first of them that of a blind guess."""
        return (1 / len(self.streams.q), *SURE)

    @property
    def tag(self) -> str:
        """Four digits that tell this game from others."""
        session = self.session
        text = repr((self.streams.keys, session.difficulty, session.game))
        return hashlib.sha256(text.encode()).hexdigest()[:4]

    @property
    def number(self) -> int:
        """Round shown, from 1; nobody can look ahead."""
        return min(self.session.round, len(self.said) + 1, ROUNDS)

    @property
    def revealed(self) -> bool:
        """Whether this round has been answered."""
        return self.number <= len(self.said)

    def guess(self, answer: int) -> None:
        """Answer the round that is shown, as sure as the session says."""
        if not self.revealed:
            before = self.session.answers.partition("-")[2] if self.said else ""
            digits = f"{before}{answer}{self.session.sure}"
            self.session.param.update(answers=f"{self.tag}-{digits}", round=self.number)
            if self.session.room and len(self.said) == ROUNDS:
                truths = [int(self.streams.y[row]) for row in self.rows]
                pairs = list(zip(self.said, truths, strict=True))
                right = tuple(said.choice == truth for said, truth in pairs)
                result = Result(right, sum(said.points(truth) for said, truth in pairs))
                rooms = self.services.classrooms
                counts = rooms.add(self.session.room, game_of(self.session), self.session.visitor, result)
                self.sent.text = SENT if counts else NOT_SENT

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
        """Controls, the stream, the answers, what gave it away, scores."""
        return pn.Column(self._controls(), self.slot, sizing_mode=ui.WIDE, margin=0)

    def update(self, changed: frozenset[str]) -> None:
        """Patch what changed."""
        if "difficulty" in changed:
            self._begin()
        elif "game" in changed:
            self._deal()
        elif changed & {"round", "answers"}:
            self._show()
        elif "average" in changed and self.live is not None:
            self.live.patch(plot.round_columns(self.round, self.session.average, self.revealed))
        if "theme" in changed:
            self._ink()

    def close(self) -> None:
        """Wait for the classifier no more."""
        self.watch.leave()
        if self.inner is not None:
            self.inner.close()

    def _begin(self) -> None:
        """Another level: its ranges, its classifier, and the round that the link asks for."""
        self.choices = asked_about(self.session)
        session, keys = self.session, [choice.key for choice in self.choices]
        self.asked = Session(session.pages, session.catalog, stream=session.stream, mass=keys)
        try:
            self.streams: ObservedStreams = streams_of(self.services, self.asked)
        except ValueError as error:
            raise Unavailable(str(error)) from None
        self.judged, self.clue = None, None
        self.live: LiveFigure | None = None
        self._build()
        noise = self.noise
        key = ("observed", *self.streams.keys, noise)
        self.observed = self.services.shared(key, lambda: self.streams.observed(noise))
        self._deal()
        self.watch.follow(self.services.work.ask(*train_task(self.services, self.asked, noise, BEST)))

    def _deal(self) -> None:
        """The ten streams of the game, for the classifier that there is or will be."""
        self.rows = draw_rounds(self.streams, quiz_split(self.streams, BEST.seed), self.session.game)
        self._show()

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
            drawn = plot.draw_clue(self.clue, self.streams.design.step, "bokeh", self.round.names)
            self.clue_live = LiveFigure(drawn, ink=("this",))
            self.clue_figure[:] = [ui.figure_pane(self.clue_live.figure)]
            self.clue_card.say(plot.clue_sentence(self.clue, self.round))
        words = plot.truth_sentence if self.revealed else plot.round_sentence
        self.card.say(words(self.round, self.number, ROUNDS))
        for i, (button, name) in enumerate(zip(self.buttons, self.names, strict=True)):
            mark = ""
            if self.revealed and i == self.round.truth:
                mark = "✓ "
            elif self.revealed and i == self.guesses[self.number - 1]:
                mark = "✗ "
            button.param.update(disabled=self.revealed, label=f"{mark}M{i} · {name}")
        self.sure_row.visible = not self.revealed
        self.next_button.visible = self.revealed and self.number < ROUNDS
        # Where everybody starts, and without this person's guesses.
        self.link.query = link_to(session, round=1, answers="", average=1, sure=1, room="", theme="default")
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
        said = self.said
        truths = [int(self.streams.y[row]) for row in self.rows[: len(said)]]
        machine = self._machine(len(said))
        self.scores.write(score_table(truths, said, machine, self.number, ROUNDS))
        self.status.text = self._verdict()
        edge = OPEN
        if self.revealed:
            edge = RIGHT if said[self.number - 1].choice == self.round.truth else WRONG
        self.verdict.styles = {"border-left": f"6px solid {edge}", "padding-left": "8px"}
        self.calibration.text = calibration(truths, said) if len(said) == ROUNDS else ""
        if self.judged is not None:
            self.summary.text = self._summary(self.judged, truths, machine)

    def _machine(self, answered: int) -> list[Said | None]:
        """What the classifier said to the rounds answered so far."""
        if self.judged is None:
            return [None] * answered
        return [Said.of(self._probability(i + 1)) for i in range(answered)]

    def _verdict(self) -> str:
        if not self.revealed:
            count = len(self.streams.q)
            return f"Round {self.number} of {ROUNDS}: which of the {count} mass ranges made these gaps?"
        names, truth, mine = self.round.names, self.round.truth, self.said[self.number - 1]
        verdict = "Right" if mine.choice == truth else "Wrong"
        right = "" if mine.choice == truth else f", not {names[mine.choice]}"
        said = f"{verdict}: it was {names[truth]}{right}. {mine.points(truth):+.0f} points."
        if self.judged is None:
            return f"{said} The classifier is still learning; its guess will follow."
        its = Said.of(self._probability(self.number))
        also = (
            "right too" if its.choice == truth == mine.choice else "right" if its.choice == truth else "wrong"
        )
        return (
            f"{said} The classifier said {names[its.choice]} ({percent(its.sure)} sure): {also}, "
            f"{its.points(truth):+.0f} points."
        )

    def _summary(self, judged: Judged, truths: list[int], machine: list[Said | None]) -> str:
        accuracy = float(np.mean(judged.probability.argmax(axis=1) == judged.y))
        learnt = len(self.streams.y) - len(judged.y)
        if len(truths) < ROUNDS:
            return (
                f"The classifier has learnt from {learnt} other streams, and has not seen these ten. At this "
                f"noise it puts {100 * accuracy:.0f} % of new streams right."
            )
        mine = sum(truth == said.choice for truth, said in zip(truths, self.said, strict=True))
        its = sum(
            said is not None and truth == said.choice for truth, said in zip(truths, machine, strict=True)
        )
        return (
            f"You: {mine} of {ROUNDS}. The classifier: {its} of {ROUNDS}. Blind guessing would give "
            f"{ROUNDS / len(self.streams.q):.1f} on average. Of all {len(judged.y)} streams it was not "
            f"trained on, the classifier puts {100 * accuracy:.1f} % right at this noise."
        )

    def _ink(self) -> None:
        dark = self.session.dark
        if self.live is not None:
            self.live.set_ink(dark)
        if self.clue is not None:
            self.clue_live.set_ink(dark)

    def _controls(self) -> Viewable:
        return ui.controls(
            row(self.page, "difficulty", "Difficulty", {words: key for key, words in DIFFICULTIES.items()}),
        )

    def _build(self) -> None:
        """What the stream is shown and answered with; other classes need others."""
        self.names = [choice.label for choice in self.choices]
        self.buttons = [
            ui.class_button(i, self.choices, lambda i=i: self.guess(i), css_classes=[f"sd-guess-{i}"])  # type: ignore[misc]
            for i in range(len(self.names))
        ]
        count = len(self.names)
        if self.inner is not None:
            self.inner.close()
        self.inner = Page(self.session, self.services)
        words = {f"a guess ({100 / count:.0f} %)": 0}
        words |= {f"{100 * sure:.0f} %": i for i, sure in enumerate(SURE, 1)}
        self.sure_row = row(self.inner, "sure", "How sure are you?", words)
        at_most, at_least = points(np.eye(count)[0], 0), points(np.eye(count)[0], 1)
        rule = ui.caption(
            f"Points: 0 for a guess, {at_most:.0f} for sure and right, {at_least:.0f} for sure and wrong. On "
            "average you get most by saying how sure you really are."
        )
        self.next_button = ui.button("Next stream", self.go_on, css_classes=["sd-next"], margin=(4, 10))
        self.status = LiveText(sizing_mode=ui.WIDE, margin=(6, 10), css_classes=["sd-verdict"])
        self.summary = LiveText(sizing_mode=ui.WIDE, margin=(6, 10), css_classes=["sd-summary"])
        self.scores = ui.Html(stylesheets=[SCORE_STYLE], margin=(4, 10), css_classes=["sd-quiz-scores"])
        self.link = CopyLink(margin=(4, 10), css_classes=["sd-class-link"], sizing_mode=ui.WIDE)
        self.figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.clue_figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self._make_cards()
        in_class = self.session.room and self.services.classrooms.knows(self.session.room)
        self.sent = LiveText(
            text=WILL_BE_SENT if in_class else "",
            sizing_mode=ui.WIDE,
            margin=(6, 10),
            css_classes=["sd-sent"],
        )
        self.calibration = LiveText(sizing_mode=ui.WIDE, margin=(6, 10), css_classes=["sd-calibration"])
        self.verdict = pn.Column(self.status, sizing_mode=ui.WIDE, margin=(2, 4))
        self.slot[:] = [
            self.card.view,
            ui.controls(self.sure_row, *self.buttons, self.next_button),
            self.verdict,
            # Below what is asked: on a phone the stream and the answers come first.
            ui.controls(
                ui.int_slider(self.inner, "average", "Average over bins"),
                ui.button("Ten others", self.new_game, css_classes=["sd-new-game"], margin=(4, 10)),
            ),
            self.clue_card.view,
            self.scores,
            pn.Column(rule, margin=(0, 10), sizing_mode=ui.WIDE),
            self.calibration,
            self.sent,
            self.summary,
            self.link,
        ]

    def _make_cards(self) -> None:
        configs = self.streams.configs
        dots = ("dots-grey", f"observed, one dot per {bin_text(self.streams.configs[0].stream)}")
        self.card = ui.FigureCard(
            "What made these gaps?",
            self.figure,
            name="quiz",
            page=self.page,
            drawn=lambda: self._drawn(),
            table=lambda: plot.round_table(self.round, self.revealed),
            code=lambda: self._code(
                "quiz_figure", f", average={self.session.average}, reveal={self.revealed}", "quiz"
            ),
            legend=ui.legend((dots, *LEGEND), configs),
        )
        self.clue_card = ui.FigureCard(
            "What gave it away",
            self.clue_figure,
            name="clue",
            page=self.page,
            drawn=lambda: self._drawn_clue(),
            table=lambda: plot.clue_table(self._known_clue(), self.round.names),
            code=lambda: self._code("clue_figure", "", "clue"),
            legend=ui.legend(CLUE_LEGEND, configs),
        )

    def _drawn(self) -> Any:
        return plot.draw_round(self.round, self.session.average, self.revealed, "matplotlib")

    def _drawn_clue(self) -> Any:
        return plot.draw_clue(self._known_clue(), self.streams.design.step, "matplotlib", self.round.names)

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
            f"{ensembles_code(self.choices)}"
            f"figure = {function}(\n"
            f"    Cache.default(), ensembles, noise={self.noise:g}, game={self.session.game}, "
            f"number={self.number}{more}\n"
            ")\n"
            f'Path("{name}.png").write_bytes(export(figure, "png"))\n'
        )
