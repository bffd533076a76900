"""Observe page: a measured density of a stream, read, checked and put to the simulated classes."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.observe.code import listing
from app.pages.observe.parts import (
    AssumptionControls,
    answer_html,
    html,
    introduction,
    list_html,
    numbers_html,
    preview_html,
    robustness_html,
    step_words,
)
from app.pages.observe.reading import (
    Look,
    Outcome,
    Reading,
    changes_of,
    example_words,
    file_of,
    kept_name,
    look_at,
    look_at_example,
    question,
    read_for,
    show_example,
    trials,
)
from app.pages.observe.state import AUTO, LINKED, Upload
from app.services.services import Unavailable
from app.ui.browser import LiveText
from app.ui.study import TaskControls
from app.ui.upload import FileDrop
from app.work.later import Later
from app.work.tasks import Task, Watch
from streamdash.config import StreamModel
from streamdash.naming import class_labels, class_names
from streamdash.observe.provenance import provenance_words, signed
from streamdash.observe.wording import tried, truth_words
from streamdash.plots import observe
from streamdash.plots.live import LiveFigure
from streamdash.plots.report_html import report_html
from streamdash.survey.mock import EXAMPLE_TRUTH

LEGEND = (
    ("bars-ink", "measured, with errors"),
    ("band", "where 68 % of a class's streams lie, observed alike"),
    ("line", "its median"),
)
LONG = 60
"""Letters of a verdict that can stand above the figure."""
INVITATION = "Choose a table of its density, or look at the example."
BLANK: dict[str, Any] = {"columns": {}, **dict.fromkeys(LINKED.values(), AUTO)}


class ObservePage(Page):
    """Choose a file, see what it was taken for, change that, and have it classified."""

    key, title, group = "observe", "Observe", "Your stream"
    question = "Which perturbers made the gaps in your stream?"
    one_arm = (
        "A file here is of one arm and is classified with streams of that arm alone: choose the arm that was "
        "measured, and where both were, ask for one after the other. What two arms say together is on the "
        "Infer page; how well simulated ones are told apart by both, on PDF, Evidence and Classifier."
    )
    uses = frozenset({"example", "upload", "columns", "theme", *LINKED.values()})

    def view(self) -> Viewable:
        self.reading = Reading()
        self.outcome: Outcome | None = None
        self.asked: Any = None
        self.began: float | None = None
        self.expected: Any = None
        self.look: Look | None = None
        self.later = Later(self.services, self._show_reading, self._refuse)
        self.looking = Later(self.services, self._show_look, self._no_look)
        self.watch = Watch(self._show_task)
        self.trying = Watch(self._show_trials)
        self.status = LiveText(margin=(4, 10), css_classes=["sd-observe-status"])
        self.problem = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.assumptions = AssumptionControls(self.session)
        self.preview = html("sd-preview")
        self.stated = html("sd-stated")
        self.controls = TaskControls(
            "Classify", self.classify, self.watch.cancel, "classify", color="primary", size="large"
        )
        # What was read as sentences, then a chip for each of them that changes it.
        self.read_part = _column(self.stated, self.assumptions.view)
        self.rows_part = _column(self.preview)
        self.opening = ui.Opening(self.question)
        self.answer, self.numbers, self.caveats = html("sd-answer"), html("sd-numbers"), html("sd-caveats")
        self.truth = ui.plain_text("", css_classes=["sd-truth"], styles={"font-size": "17px"})
        self.reveal = ui.button("Reveal the truth", self._reveal, css_classes=["sd-reveal"])
        self.holds = html("sd-robustness")
        self.holds_status = LiveText(margin=(4, 10), css_classes=["sd-robustness-status"])
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.card = self._card()
        self.result_part = _column(
            ui.heading("The answer"),
            self.answer,
            ui.controls(self.reveal, self.truth),
            self.numbers,
            ui.heading("What it depends on"),
            self.holds_status,
            self.holds,
            self.caveats,
            ui.heading("Report"),
            ui.controls(
                ui.download("streamdash-report.html", "report", self._html_report),
                ui.download("streamdash-report.json", "json", self._json_report),
            ),
        )
        self.drop = FileDrop(
            self._receive,
            self._refuse,
            limit=int(1e6 * self.services.uploads.max_upload_mb),
            announce=self._await,
            kept=kept_name(self.session),
            margin=(4, 10),
            styles={"flex": "1 1 200px", "min-width": "0"},
            css_classes=["sd-drop"],
        )
        example = ui.button(
            example_words(self.model), self._example, css_classes=["sd-example"], margin=(4, 10)
        )
        self._read()
        return ui.page_layout(
            ui.controls(self.drop, example),
            self.problem,
            self.card.view,
            self.status,
            self.read_part,
            self.controls.view,
            self.result_part,
            self.rows_part,
            ui.plain_text(introduction(self.model), margin=(14, 10), max_width=1000),
            opening=self.opening,
            panel=ui.side_panel([ui.stream_picker(self)], [ui.ensemble_picker(self)]),
        )

    @property
    def model(self) -> StreamModel:
        """The stream that was measured."""
        return self.session.ensembles[0].config.stream

    def update(self, changed: frozenset[str]) -> None:
        if changed == {"theme"}:
            self._draw()
        else:
            self._read()

    def close(self) -> None:
        self.later.cancel()
        self.looking.cancel()
        self.watch.leave()
        self.trying.leave()
        self._forget()
        super().close()

    def classify(self) -> None:
        """Have the observation that is shown classified, or join those who wait for the same."""
        if self.reading.observation is None:
            return
        self._forget()
        self.began = None
        key, compute = question(self.services, self.session.ensembles, self.reading.observation)
        self.expected = key
        self.asked = None if self.session.example == "yes" else key
        self.watch.follow(self.services.work.ask(key, compute))

    # ------------------------------------------------------------ choosing

    def _receive(self, data: bytes) -> None:
        upload = Upload(data, self.drop.file_name)
        if self.session.example == "no" and self.session.upload == upload:
            self._read()  # the same again: nothing changes, but it was awaited
        self.session.param.update(example="no", upload=upload, **BLANK)

    def _example(self) -> None:
        show_example(self.session, **BLANK)

    def _refuse(self, sentence: str) -> None:
        self._clear("")
        self._show_reading(Reading(problem=sentence))

    # ------------------------------------------------------------ reading

    def _await(self, name: str) -> None:
        """Another file was chosen and is on its way: nothing that is shown of the last one counts."""
        self._clear(f"Reading “{name}” …")
        self.read_part.visible = self.rows_part.visible = self.card.view.visible = False

    def _clear(self, words: str) -> None:
        """Forget what was read and said; nothing can be classified until something is read."""
        self.later.cancel()
        self.looking.cancel()
        self.watch.leave()
        self.trying.leave()
        self.result_part.visible = False
        self.outcome = self.expected = self.look = None
        self.reading = Reading()
        self.controls.start.disabled = True
        self.status.text = words

    def _read(self) -> None:
        """Read the session's file off the event loop, then show it."""
        file = file_of(self.session)
        self._clear("" if file is None else "Reading …")
        if file is None:
            self.read_part.visible = self.rows_part.visible = self.controls.view.visible = False
            self._invite()
            return
        changes = changes_of(self.session)
        self.later.ask(partial(read_for, self.services, self.model, file, changes))

    def _show_reading(self, reading: Reading) -> None:
        self.reading = reading
        table, observation = reading.table, reading.observation
        self.problem[:] = [ui.error_state(reading.problem)] if reading.problem else []
        self.read_part.visible = self.rows_part.visible = table is not None
        self.card.view.visible = observation is not None
        self.assumptions.show(reading)
        self.preview.write(preview_html(table) if table is not None else "")
        self.controls.view.visible = observation is not None
        self.controls.start.disabled = observation is None
        self.controls.cancel.visible = self.controls.bar.visible = False
        self.controls.text.text = ""
        self.stated.write(list_html("What is assumed", observation.stated) if observation else "")
        what = "The example"
        if self.session.example != "yes":
            what = f"“{reading.source.name}”" if reading.source else "Your table"
        if observation is not None:
            self.status.text = f"{what} was read: {observation.design.n_bin} bins are compared."
        else:
            self.status.text = "" if table is None else f"{what} was read; its columns need to be set."
        self.look = None
        self._draw()
        self._say_next()
        if observation is not None:
            self.card.say(observe.sentence(observation, None, []))
            keys = [choice.key for choice in self.session.ensembles]
            self.looking.ask(partial(look_at, self.services, keys, observation), rest_s=0.0, keep=False)

    # ------------------------------------------------------------ looking

    def _invite(self) -> None:
        """Before there is a file: the example in the place where it will be seen."""
        self.opening.say(INVITATION)
        home = self.model == StreamModel()
        self._draw()
        self.card.view.visible = home  # the example is of this stream, and says nothing of another
        if home:
            keys = [choice.key for choice in self.session.ensembles]
            self.looking.ask(
                partial(look_at_example, self.services, self.model, keys), key=("observe example", *keys)
            )

    def _show_look(self, look: Look | None) -> None:
        """The bands are there, of the file that is shown or of the example before there is one."""
        self.look = look
        if look is None:
            self.card.view.visible = False
            return
        self._draw()
        words = observe.sentence(look.observation, look.bands, self._names())
        none = self.reading.source is None
        self.card.say(f"This is the example, as your table would be shown. {words}" if none else words)

    def _no_look(self, sentence: str) -> None:
        """Without bands the measurement is seen alone; classifying says what is wrong."""
        self.card.view.visible = self.reading.observation is not None

    def _say_next(self) -> None:
        """What comes next, above the figure."""
        if self.outcome is not None:
            verdict = self.outcome.result["answer"].partition(". ")[0].rstrip(".")
            # The whole of it is a paragraph, which would push the figure out of a phone's sight.
            self.opening.say(f"{verdict if len(verdict) < LONG else 'Answered'}: see below the figure.")
        elif self.reading.observation is not None:
            self.opening.say("Look at it over the classes, check what is assumed, then press Classify.")
        elif self.reading.table is not None:
            self.opening.say("One thing has to be said about the table before it can be shown: see below.")
        else:
            self.opening.say(INVITATION)

    # ------------------------------------------------------------ result

    def _show_task(self, task: Task) -> None:
        self.controls.show(task, "Done.")
        if task.state == "running":
            self.began = self.began or time.monotonic()
            words = step_words(task.fraction, time.monotonic() - self.began)
            known = f" Known already: {self._known()}" if self.look is not None else ""
            self.controls.text.text = words + known
        source = self.reading.source
        if task.state != "done" or task.key != self.expected or source is None:
            return
        outcome: Outcome = replace(task.result, result=signed(task.result.result, source))
        self.outcome, result = outcome, outcome.result
        self.answer.write(answer_html(result))
        self.numbers.write(numbers_html(result))
        self.caveats.write(
            list_html("Mind", result["caveats"])
            + list_html("Where this comes from", provenance_words(result))
        )
        self.reveal.visible = self.session.example == "yes"
        self.truth.write("")
        self.look = Look(outcome.observation, outcome.bands)
        self.card.say(observe.sentence(outcome.observation, outcome.bands, self._names()))
        self.result_part.visible = True
        self._say_next()
        self._draw()
        self._try_others()

    def _try_others(self) -> None:
        """Ask what would change the answer, in the background: the answer does not wait for it."""
        self.holds.write("")
        asked = trials(self.services, self.session.ensembles, self.reading, self.expected)
        self.trying.follow(self.services.work.ask(*asked))

    def _show_trials(self, task: Task) -> None:
        if self.outcome is None or task.key != ("robustness", self.expected):
            return
        if task.state != "done":
            percent = 5 * math.floor(20 * task.fraction)
            words = f"Trying what would change the answer: {percent} % done"
            self.holds_status.text = words if task.active else task.error or "Nothing else was tried."
            return
        self.holds_status.text = ""
        self.outcome = replace(self.outcome, result=tried(self.outcome.result, task.result))
        self.answer.write(answer_html(self.outcome.result))
        self.holds.write(robustness_html(self.outcome.result))

    def _reveal(self) -> None:
        known = json.loads(EXAMPLE_TRUTH.read_text(encoding="utf-8"))
        self.truth.write(truth_words(known))

    def _draw(self) -> None:
        """Draw the measurement, alone and over the classes, in the page's ink."""
        dark, configs = self.session.dark, self.session.configs
        observation = self.look.observation if self.look is not None else self.reading.observation
        bands = self.look.bands if self.look is not None else None
        drawn = None if observation is None else observe.draw(observation, bands, configs, "bokeh", dark)
        self.slot[:] = [ui.plain_text("Observing the simulated streams …") if drawn is None else _pane(drawn)]

    def _card(self) -> ui.FigureCard:
        return ui.FigureCard(
            "The profile over the classes",
            self.slot,
            name="observe",
            page=self,
            drawn=lambda: observe.draw(
                self._seen().observation, self._seen().bands, self.session.configs, "matplotlib"
            ),
            table=lambda: observe.table(self._seen().observation, self._seen().bands, self._labels()),
            code=self._code,
            legend=ui.legend(LEGEND, self.session.configs),
        )

    def _forget(self) -> None:
        """Nothing of a file outlives the session; what is said of the example may."""
        if self.asked is not None:
            self.services.work.forget(self.asked)
            self.services.work.forget(("robustness", self.asked))
        self.asked = None

    def _ready(self) -> Outcome:
        if self.outcome is None:
            raise Unavailable("No profile has been classified yet; press Classify.")
        return self.outcome

    def _seen(self) -> Look:
        if self.look is None:
            raise Unavailable("No profile has been read yet; choose a table, or the example.")
        return self.look

    def _known(self) -> str:
        """How many of the bins lie in the band of each class."""
        seen = self._seen()
        return observe.sentence(seen.observation, seen.bands, self._names()).partition(". ")[2]

    def _labels(self) -> list[str]:
        return class_names(self.session.configs)

    def _names(self) -> list[str]:
        return class_labels(self.session.configs)

    def _html_report(self) -> bytes:
        outcome = self._ready()
        return report_html(outcome.result, outcome.observation, outcome.bands).encode()

    def _json_report(self) -> bytes:
        return json.dumps(self._ready().result, indent=1).encode()

    def _code(self) -> str:
        example = self.session.example == "yes" or self.reading.source is None
        return listing(self.session.ensembles, self._seen().observation.assumptions, example)


def _column(*parts: Viewable) -> pn.Column:
    return pn.Column(*parts, sizing_mode=ui.WIDE, margin=0, visible=False)


def _pane(overlay: Any) -> Viewable:
    return ui.figure_pane(LiveFigure(overlay).figure)
