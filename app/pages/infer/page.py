"""Infer page: the posterior of what hit a stream, live for shipped estimators, trained for one's own bins."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.infer import answers
from app.pages.infer.answers import Answer, Data, Oracle
from app.pages.infer.cards import Cards, html, methods_part
from app.pages.infer.code import Asked
from app.pages.infer.controls import Controls
from app.pages.infer.joined import Joined, other_arm
from app.pages.infer.parts import answer_html
from app.pages.observe.reading import Reading, changes_of, file_of, read_for, show_example
from app.pages.observe.state import AUTO, LINKED, Upload
from app.services.services import Unavailable
from app.ui.study import TaskControls
from app.work.later import Later
from app.work.tasks import Task, Watch
from streamdash.config import StreamModel
from streamdash.observe.observation import Observation
from streamdash.streams import stream_text
from streamdash.survey.design import Design

BLANK: dict[str, Any] = {"columns": {}, **dict.fromkeys(LINKED.values(), AUTO)}
HALVES = ("first", "second")
CHOICES = ("prior", "data", "number", "class", "errors", "age", "window", "kept")
FILE = frozenset({"example", "upload", "columns", "infer_data", *LINKED.values()})
"""What decides which file is read, and how."""


class InferPage(Page):
    """Choose stream, prior and data; read off what the data say, and what would change it."""

    key, title, group = "infer", "Infer", "Your stream"
    question = "How many subhalos hit a stream, and down to what mass?"
    one_arm = (
        "One population hit both, and each arm has impacts of its own: what both say is the product of what "
        "each says. Choose the arm to begin with; at its answer press “Put aside, to join” and then “Next”, "
        "which asks for the other: “Several streams together” multiplies them."
    )
    uses = FILE | {"theme", *(f"infer_{name}" for name in CHOICES)}

    def view(self) -> Viewable:
        self.reading, self.halves = Reading(), dict[str, Observation]()
        self.model = self._model()
        self.watch = Watch(self._show_task)
        self.cut_watches = [Watch(self._show_cut) for _ in HALVES]
        self.cutting = TaskControls("Halve the stretch", self.cut, self._keep_whole, "infer-cut")
        self.cards = Cards(self._asked, self.cutting.view)
        self.later_file = Later(self.services, self._show_reading, self._refuse)
        here = self.services.here
        self.later_rows = Later(self.services, self.cards.show_rows, self.cards.fail_rows, here)
        self.later_ranks = Later(self.services, self.cards.show_ranks, self.cards.fail_ranks, here)
        self.answer = html("sd-answer")
        self.problem = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.joined = Joined(self.session)
        self.controls = Controls(
            self,
            receive=self._receive,
            refuse=self._refuse,
            announce=self._await,
            example=self._example,
            train=self.train,
            cancel=self.watch.cancel,
            keep=self.put_aside,
            other=self.go_to_other_arm,
        )
        self._arrange()
        self._renew()
        cards = self.cards
        rest = [cards.band_card, cards.moves_card, self.joined.card, cards.rank_card]
        return ui.page_layout(
            cards.corner_card.view,
            *(card.view for card in rest),
            *methods_part(self.model),
            opening=ui.Opening(self.question, self.answer, self.problem),
            panel=self.controls.view,
        )

    def update(self, changed: frozenset[str]) -> None:
        if changed == {"theme"}:
            self.cards.draw_bands(self._dark)
        elif changed == {"infer_kept"}:
            self._show_joined()
        else:
            self._arrange()
            if changed & FILE:
                self._renew()
            else:
                self._answer()

    def close(self) -> None:
        for later in (self.later_file, self.later_rows, self.later_ranks):
            later.cancel()
        self.watch.leave()
        for watch in self.cut_watches:
            watch.leave()
        super().close()

    @property
    def found(self) -> Answer | None:
        """The answer that is shown."""
        return self.cards.found

    @property
    def _dark(self) -> bool:
        return self.session.dark

    def _arrange(self) -> None:
        """Show the controls that mean something now."""
        self.controls.arrange(self.base, self._halvable(), self.window)

    # ------------------------------------------------------------ who answers

    @property
    def base(self) -> Oracle | None:
        """The oracle that comes with the package for the stream and the prior."""
        return answers.shipped(self.services, self.model, self.session.infer_prior)

    def _model(self) -> StreamModel:
        stream = self.session.catalog.stream(self.session.stream)
        if stream is None:
            raise Unavailable("There is no stream in the cache; run “streamdash simulate” for one.")
        return stream.model

    def _whole(self) -> Design | None:
        """The bins of the whole stretch, or None while no file could be read."""
        if self.session.infer_data == "upload":
            observation = self.reading.observation
            return observation.design if observation else None
        return answers.usual_design(self.services, self.model, self.base)

    @property
    def window(self) -> str:
        """The part of the stretch that is used: all of it where its halves are too short."""
        return self.session.infer_window if self._halvable() else "whole"

    def _halvable(self) -> bool:
        if self.session.infer_data == "upload":
            return bool(self.halves)
        whole = self._whole()
        return whole is not None and answers.halvable(whole)

    def _design(self, window: str | None = None) -> Design | None:
        """The bins that are asked about, or None while no file could be read."""
        whole, window = self._whole(), window or self.window
        if self.session.infer_data == "upload" and window != "whole":
            return self.halves[window].design
        return None if whole is None else whole.part(answers.part_of(whole.n_bin, window))

    @property
    def mocks(self) -> Oracle | None:
        """The oracle whose held-out streams are the mocks: no estimator has learnt from them."""
        return answers.sharpest(self.services, self.model, self.session.infer_prior) or self.base

    def _oracle(self) -> Oracle | None:
        """What answers for these bins, if it is known already; else it must be trained."""
        design = self._design()
        if design is None:
            return None
        base = self.base
        if base is None or base.estimator.design.key != design.key:
            return self._trained(design)
        sharp = answers.sharpest(self.services, self.model, self.session.infer_prior)
        return sharp if sharp is not None and self._is_usual(sharp) else base

    def _trained(self, design: Design) -> Oracle | None:
        """What has been trained for a design, if anything has."""
        key, _ = answers.training(self.services, self.model, self.session.infer_prior, design)
        task = self.services.laboratory.find(key)
        return task.result if task is not None and task.state == "done" else None

    def _is_usual(self, sharp: Oracle) -> bool:
        """Whether age and errors are those that the sharpest oracle knows alone."""
        session, usual = self.session, sharp.estimator.stream.age_gyr
        errors = session.infer_data == "upload" or session.infer_errors == 1
        return errors and session.infer_age in ("usual", f"{usual:g}")

    def train(self) -> None:
        """Have an estimator trained for the bins that are asked about, or join those who wait for it."""
        design = self._design()
        if design is not None:
            question = answers.training(self.services, self.model, self.session.infer_prior, design)
            self.watch.follow(self.services.laboratory.ask(*question))

    def _data(self, oracle: Oracle, factor: float, window: str | None = None) -> Data | None:
        session, mocks = self.session, self.mocks
        window = window or self.window
        if session.infer_data == "upload":
            if self.reading.observation is None or factor != 1:
                return None  # it was measured once, with errors of its own
            observation = self.halves.get(window, self.reading.observation)
            return answers.uploaded(observation, session.example == "yes")
        if session.infer_data == "simulated":
            choice = answers.choice_of(session)
            if choice is None:
                return None
            whole = answers.usual_design(self.services, self.model, self.base)
            return answers.simulated(
                self.services, oracle, whole, choice, session.infer_number, window, factor
            )
        if mocks is None and window != "whole":
            return None  # its mocks have the bins that it was trained for
        return answers.mock(oracle, mocks or oracle, session.infer_number, window, factor)

    def _factor(self, oracle: Oracle) -> float:
        if self.session.infer_data == "upload":
            return 1.0
        low, high = oracle.errors
        return min(max(self.session.infer_errors, low), high)

    def _age(self, oracle: Oracle) -> float | None:
        """The age that is taken as known, if it is one that the oracle knows."""
        chosen = self.session.infer_age
        if chosen == "open":
            return None
        usual = oracle.estimator.stream.age_gyr
        age = usual if chosen == "usual" else float(chosen)
        known = [known for known in (age, usual) if known in (oracle.ages or (usual,))]
        return known[0] if known else None

    # ------------------------------------------------------------ answering

    def _answer(self) -> None:
        """Answer now if there is an estimator for these bins; else offer to train one."""
        oracle = self._oracle()
        self._offer(oracle)
        data = self._data(oracle, self._factor(oracle)) if oracle else None
        for later in (self.later_rows, self.later_ranks):
            later.cancel()
        if oracle is None or data is None:
            self.cards.withdraw()
            self.controls.keep.disabled = True
            self.answer.write("")
        else:
            found = answers.answer(oracle, data, self._factor(oracle), self._age(oracle))
            self.answer.write(answer_html(found))
            self.controls.keep.disabled = found.strange
            self.cards.show(found, self._dark)
            self._ask(found)
        self._offer_halves(oracle if data is not None else None)
        self._show_joined()

    def _ask(self, found: Answer) -> None:
        """What moves the answer, and whether it is calibrated, once the controls rest."""
        told = self.base if found.oracle.shipped else None
        halves = self._halves() if self.window == "whole" else {}
        if not found.strange:
            self.later_rows.ask(lambda: answers.moved(found, told, self._data, halves))
        self.later_ranks.ask(
            lambda: answers.calibration(self.services, found.oracle, found.noise_factor, found.age)
        )

    def put_aside(self) -> None:
        """Keep the answer, to be joined with those of other streams."""
        found, source = self.cards.ready(), self.reading.source
        own = self.session.infer_data == "upload" and self.session.example == "no" and source is not None
        name = f"{stream_text(self.model)}, {f'“{source.name}”' if own and source else found.data.name}"
        if self.window != "whole":
            name += f", {self.window} half"
        self.joined.put_aside(name, found.posterior)

    def go_to_other_arm(self) -> None:
        """Ask the same of the stream's other arm; a file is of one arm alone."""
        other = other_arm(self.session, self.model)
        if other is not None:
            self.session.param.update(example="no", upload=None, infer_window="whole", **BLANK)
            self.session.choose_stream(other.key)

    def _show_joined(self) -> None:
        found, other = self.found, other_arm(self.session, self.model)
        self.controls.say_kept(
            [name for name, _ in self.session.infer_kept], other.model.arm if other else ""
        )
        if found is None:
            self.joined.show(None, None)
        else:
            self.joined.show(found.posterior, found.oracle.estimator.prior)

    # ------------------------------------------------------------ files

    def _receive(self, data: bytes) -> None:
        upload, session = Upload(data, self.controls.drop.file_name), self.session
        if (session.infer_data, session.example, session.upload) == ("upload", "no", upload):
            self._renew()  # the same again: nothing changes, but it was awaited
        session.param.update(infer_data="upload", example="no", upload=upload, **BLANK)

    def _example(self) -> None:
        show_example(self.session, infer_data="upload", **BLANK)

    def _refuse(self, sentence: str) -> None:
        self._show_reading(Reading(problem=sentence))

    def _await(self, name: str) -> None:
        """Another file was chosen and is on its way: nothing that is shown of the last one counts."""
        self._take(Reading())
        self._answer()
        self.controls.status.text = f"Reading “{name}” …"

    def _renew(self) -> None:
        """Answer for what is chosen; a file is read off the event loop first."""
        self.later_file.cancel()
        self.problem.clear()
        self._take(Reading())
        file = file_of(self.session) if self.session.infer_data == "upload" else None
        self.controls.status.text = "" if file is None else "Reading …"
        self._answer()
        if file is not None:
            self.later_file.ask(partial(read_for, self.services, self.model, file, changes_of(self.session)))

    def _take(self, reading: Reading) -> None:
        """Look at what was read in a file, and at either half of it where it can be halved."""
        self.reading, self.halves = reading, {}
        if reading.observation is not None:
            self.halves = answers.halved(reading.observation)

    def _show_reading(self, reading: Reading) -> None:
        self._take(reading)
        self.problem[:] = [ui.error_state(reading.problem)] if reading.problem else []
        self.controls.assumptions.show(reading)
        observation = reading.observation
        self.controls.status.text = f"{observation.design.n_bin} bins were read." if observation else ""
        self._arrange()
        self._answer()

    # ------------------------------------------------------------ training

    def _offer(self, oracle: Oracle | None) -> None:
        """The button that trains, where there is nothing that answers for these bins."""
        design = self._design()
        self.controls.training.view.visible = oracle is None and design is not None
        self.controls.training.start.disabled = False
        self.controls.training.cancel.visible = self.controls.training.bar.visible = False
        self.controls.training.text.text = (
            f"No estimator for these {design.n_bin} bins yet: "
            + answers.cost(self.model, self.session.infer_prior)
            if oracle is None and design is not None
            else ""
        )
        if oracle is None and design is not None:
            key, _ = answers.training(self.services, self.model, self.session.infer_prior, design)
            task = self.services.laboratory.find(key)
            if task is not None and task.active:
                self.watch.follow(task)

    def _show_task(self, task: Task) -> None:
        self.controls.training.show(task, "Trained.")
        if task.state == "done":
            self._answer()

    # ------------------------------------------------------------ parts of the stretch

    def _halves(self) -> dict[str, Oracle]:
        """What answers for either half of the stretch, as far as it has been trained."""
        if not self._halvable():
            return {}
        designs = {window: self._design(window) for window in HALVES}
        found = {window: self._trained(design) for window, design in designs.items() if design is not None}
        return {window: oracle for window, oracle in found.items() if oracle is not None}

    def cut(self) -> None:
        """Have estimators trained for both halves of the stretch."""
        for watch, window in zip(self.cut_watches, HALVES, strict=True):
            design = self._design(window)
            if design is None:
                return
            question = answers.training(self.services, self.model, self.session.infer_prior, design)
            watch.follow(self.services.laboratory.ask(*question))

    def _keep_whole(self) -> None:
        for watch in self.cut_watches:
            watch.cancel()

    def _show_cut(self, task: Task) -> None:
        """Show the one that is being trained; what is done is answered with."""
        running = [w.following for w in self.cut_watches if w.following and w.following.active]
        self.cutting.show(running[0] if running else task, "Both halves are shown.")
        if task.state == "done" and self.found is not None:
            self._offer_halves(self.found.oracle)
            self._ask(self.found)

    def _offer_halves(self, oracle: Oracle | None) -> None:
        """The button for both halves, where the answer is from the whole stretch."""
        whole = oracle is not None and self.window == "whole" and self._halvable()
        there = len(self._halves()) if whole else 0
        self.cutting.view.visible = whole and there < len(HALVES)
        if not any(watch.following for watch in self.cut_watches):
            self.cutting.text.text = (
                "What would half of the stretch say? An estimator is trained for either: "
                + answers.cost(self.model, self.session.infer_prior)
                if whole
                else ""
            )

    def _asked(self) -> Asked:
        session, observation, whole = self.session, self.reading.observation, self._whole()
        return Asked(
            self.cards.ready(),
            self.mocks,
            self.base is not None and self.base.told,
            self.model,
            session.infer_prior,
            session.infer_data,
            answers.part_of(whole.n_bin, self.window) if whole else slice(None),
            observation.assumptions.model_dump_json() if observation else "",
            session.example == "yes",
        )
