"""Observe page: a measured density of a stream, read, checked and put to the simulated classes."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.observe.parts import (
    STYLE,
    AssumptionControls,
    answer_html,
    list_html,
    numbers_html,
    preview_html,
    robustness_html,
)
from app.pages.observe.reading import (
    Outcome,
    Reading,
    changes_of,
    example_words,
    file_of,
    question,
    read_for,
    show_example,
    trials,
)
from app.pages.observe.state import AUTO, LINKED, Upload
from app.services.services import Unavailable
from app.session.listing import ensembles_code
from app.ui.browser import LiveText
from app.ui.study import TaskControls
from app.ui.upload import FileDrop
from app.work.later import Later
from app.work.tasks import Task, Watch
from streamdash.config import StreamModel
from streamdash.observe.provenance import provenance_words, signed
from streamdash.observe.wording import name, tried, truth_words
from streamdash.plots import observe
from streamdash.plots.live import LiveFigure, export
from streamdash.plots.report_html import report_html
from streamdash.streams import stream_of, stream_text
from streamdash.survey.mock import EXAMPLE_TRUTH

LEGEND = (
    ("ink", "measured, with errors"),
    ("band", "where 68 % of a class's streams lie, observed alike"),
    ("line", "its median"),
)
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
        self.expected: Any = None
        self.later = Later(self.services, self._show_reading, self._refuse)
        self.watch = Watch(self._show_task)
        self.trying = Watch(self._show_trials)
        self.status = LiveText(margin=(4, 10), css_classes=["sd-observe-status"])
        self.problem = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.assumptions = AssumptionControls(self.session)
        self.preview = _html("sd-preview")
        self.stated = _html("sd-stated")
        self.measured = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.controls = TaskControls(
            "Classify", self.classify, self.watch.cancel, "classify", color="primary", size="large"
        )
        self.read_part = _column(
            self.assumptions.view,
            ui.figure_grid(
                [pn.Column(self.stated, self.preview, sizing_mode=ui.WIDE, margin=0), self.measured],
                narrowest=420,
            ),
        )
        self.answer, self.numbers, self.caveats = _html("sd-answer"), _html("sd-numbers"), _html("sd-caveats")
        self.truth = ui.plain_text("", css_classes=["sd-truth"], styles={"font-size": "17px"})
        self.reveal = ui.button("Reveal the truth", self._reveal, css_classes=["sd-reveal"])
        self.holds = _html("sd-robustness")
        self.holds_status = LiveText(margin=(4, 10), css_classes=["sd-robustness-status"])
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.card = self._card()
        self.result_part = _column(
            self.answer,
            ui.controls(
                ui.download("streamdash-report.html", "report", self._html_report),
                ui.download("streamdash-report.json", "json", self._json_report),
                self.reveal,
                self.truth,
            ),
            self.numbers,
            self.holds_status,
            self.holds,
            self.card.view,
            self.caveats,
        )
        self.drop = FileDrop(
            self._receive,
            self._refuse,
            limit=int(1e6 * self.services.uploads.max_upload_mb),
            announce=self._await,
            sizing_mode=ui.WIDE,
            margin=(10, 10),
            css_classes=["sd-drop"],
        )
        self._read()
        return ui.page_layout(
            self.drop,
            ui.controls(
                ui.button(example_words(self.model), self._example, css_classes=["sd-example"]), self.status
            ),
            self.problem,
            self.controls.view,
            self.result_part,  # above what was read: the answer is where the button was pressed
            self.read_part,
            ui.plain_text(introduction(self.model), margin=(14, 10), max_width=1000),
            opening=ui.Opening(self.question),
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
        self.watch.leave()
        self.trying.leave()
        self._forget()
        super().close()

    def classify(self) -> None:
        """Have the observation that is shown classified, or join those who wait for the same."""
        if self.reading.observation is None:
            return
        self._forget()
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
        self.read_part.visible = False

    def _clear(self, words: str) -> None:
        """Forget what was read and said; nothing can be classified until something is read."""
        self.later.cancel()
        self.watch.leave()
        self.trying.leave()
        self.result_part.visible = False
        self.outcome = self.expected = None
        self.reading = Reading()
        self.controls.start.disabled = True
        self.status.text = words

    def _read(self) -> None:
        """Read the session's file off the event loop, then show it."""
        file = file_of(self.session)
        self._clear("" if file is None else "Reading …")
        if file is None:
            self.read_part.visible = self.controls.view.visible = False
            return
        changes = changes_of(self.session)
        self.later.ask(partial(read_for, self.services, self.model, file, changes))

    def _show_reading(self, reading: Reading) -> None:
        self.reading = reading
        table, observation = reading.table, reading.observation
        self.problem[:] = [ui.error_state(reading.problem)] if reading.problem else []
        self.read_part.visible = table is not None
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
        self._draw()

    # ------------------------------------------------------------ result

    def _show_task(self, task: Task) -> None:
        self.controls.show(task, "Done.")
        source = self.reading.source
        if task.state != "done" or task.key != self.expected or source is None:
            return
        outcome: Outcome = replace(task.result, result=signed(task.result.result, source))
        self.outcome = outcome
        result = outcome.result
        self.answer.write(answer_html(result))
        self.numbers.write(numbers_html(result))
        self.caveats.write(
            list_html("Mind", result["caveats"])
            + list_html("Where this comes from", provenance_words(result))
        )
        self.reveal.visible = self.session.example == "yes"
        self.truth.write("")
        self.card.say(observe.sentence(outcome.observation, outcome.bands, self._names()))
        self.result_part.visible = True
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
        dark = self.session.theme == "dark"
        observation = self.reading.observation
        self.measured[:] = (
            [] if observation is None else [_pane(observe.draw(observation, None, "bokeh", dark))]
        )
        if self.outcome is not None:
            overlay = observe.draw(self.outcome.observation, self.outcome.bands, "bokeh", dark)
            self.slot[:] = [_pane(overlay)]

    def _card(self) -> ui.FigureCard:
        return ui.FigureCard(
            "The profile over the classes, observed alike",
            self.slot,
            name="observe",
            image=lambda kind: export(
                observe.draw(self._ready().observation, self._ready().bands, "matplotlib"), kind
            ),
            table=lambda: observe.table(self._ready().observation, self._ready().bands, self._labels()),
            code=self._code,
            legend=ui.legend(LEGEND, len(self.session.ensembles)),
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

    def _labels(self) -> list[str]:
        return [c["mass_range"] for c in self._ready().result["classes"]]

    def _names(self) -> list[str]:
        return [name(c) for c in self._ready().result["classes"]]

    def _html_report(self) -> bytes:
        outcome = self._ready()
        return report_html(outcome.result, outcome.observation, outcome.bands).encode()

    def _json_report(self) -> bytes:
        return json.dumps(self._ready().result, indent=1).encode()

    def _code(self) -> str:
        example = self.session.example == "yes"
        file = "EXAMPLE" if example else 'Path("profile.csv")  # your table'
        lines = [
            "from pathlib import Path\n",
            "from streamdash.simulation.geometry import load_geometry",
            "from streamdash.observe.observation import interpret",
            "from streamdash.observe.guess import Assumptions",
            "from streamdash.observe.table import read_table",
            "from streamdash.plots.live import export",
            "from streamdash.plots.observe import draw",
            "from streamdash.observe.report import report, text",
            "from streamdash.store.cache import Cache",
            *(["from streamdash.survey.mock import EXAMPLE"] if example else []),
            "from streamdash.observe.verdict import judge, prepare\n",
            f"cache = Cache.default()\n{ensembles_code(self.session.ensembles).rstrip()}",
            f"file = {file}",
            f"assumptions = Assumptions.parse({self._ready().observation.assumptions.model_dump_json()!r})",
            "geometry = load_geometry(cache.find(ensembles[0]).config.stream, cache)",
            "observation = interpret(read_table(file.read_bytes()), assumptions, geometry)",
            "prepared = prepare(cache, ensembles, observation.design)",
            "print(text(report(judge(prepared, observation), observation, prepared)))",
            'figure = draw(observation, prepared.bands(), "matplotlib")',
            'Path("observe.png").write_bytes(export(figure, "png"))',
        ]
        return "\n".join(lines) + "\n"


def introduction(model: StreamModel) -> str:
    """What to upload, and what becomes of it."""
    longitude = stream_of(model).frame.longitude_symbol
    return (
        f"Upload the density of {stream_text(model)}, along the stream as you measured it: a text table with "
        f"a position ({longitude} or Galactic longitude), a value and, best, an error for each bin. "
        "Simulated streams are then observed with your bins, errors and gaps, and the answer comes with how "
        "often it is right at that quality. The file stays in this session’s memory and is gone when you "
        "close the page."
    )


def _html(css_class: str) -> ui.Html:
    return ui.Html(stylesheets=[STYLE], css_classes=[css_class], margin=(0, 10))


def _column(*parts: Viewable) -> pn.Column:
    return pn.Column(*parts, sizing_mode=ui.WIDE, margin=0, visible=False)


def _pane(overlay: Any) -> Viewable:
    return ui.figure_pane(LiveFigure(overlay).figure)
