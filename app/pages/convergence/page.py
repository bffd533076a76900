"""Convergence page: the tests of the paper's appendix A and more, each simulated anew on request."""

from __future__ import annotations

from functools import partial
from typing import Any

import holoviews as hv
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.convergence.parts import STYLE, shifts_html, verdicts_html
from app.pages.other_streams import other_streams_card
from app.services.services import Services
from app.session.session import Session
from app.ui.study import TaskControls
from app.work.pieces import laboratory
from app.work.tasks import Compute, Task, Watch
from streamdash.classifier import other_streams
from streamdash.convergence.knobs import ConvergenceTest, knob
from streamdash.convergence.spectra import missing
from streamdash.convergence.text import Measured, cost, cost_sentence, measure
from streamdash.convergence.verdicts import verdict_sentence
from streamdash.plots import convergence
from streamdash.plots.live import LiveFigure
from streamdash.statistics.spectrum import KINDS

LEGEND = (
    ("band-grey", "68 % of the streams of the setting compared with"),
    ("none", "colours of the settings: see the table; last figure: density spectra against the reference"),
)

ANSWERS = "The question that matters: do classifier and evidence change?"
SETTINGS = ("X", "times", "length", "size")


class ConvergencePage(Page):
    """One test at a time in full, above the verdicts on all."""

    key, title, group = "convergence", "Convergence", "Machine room"
    question = "Do the spectra depend on the numerical choices?"
    uses = frozenset({"knob", "lab_streams", "lab_seed"})

    def __init__(self, session: Session, services: Services) -> None:
        super().__init__(session, services)
        self.measured: Measured | None = None
        self.found: list[Measured] = []

    def view(self) -> Viewable:
        self.opening = ui.Opening(self.question)
        self.watch = Watch(self._show_task)
        self.task = TaskControls("Simulate", self.start, self.watch.cancel, "lab")
        self.about = ui.plain_text("", margin=(4, 0), css_classes=["sd-lab-question"])
        self.figures = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.table = ui.Html(stylesheets=[STYLE], css_classes=["sd-lab-shifts"])
        self.all = ui.Html(stylesheets=[STYLE], css_classes=["sd-lab-verdicts"])
        self._make_cards()
        self._show()
        self._show_all()
        answers = other_streams.shipped_results()
        return ui.page_layout(
            self.card.view,
            self.all_card.view,
            *([other_streams_card(answers, SETTINGS, ANSWERS).view] if answers else []),
            opening=self.opening,
            panel=self._controls(),
        )

    @property
    def knob(self) -> ConvergenceTest:
        """The test that is chosen, with its settings."""
        return knob(self.session.knob, int(self.session.lab_streams), self.session.lab_seed)

    def update(self, changed: frozenset[str]) -> None:
        self.watch.leave()
        self._show()

    def close(self) -> None:
        self.watch.leave()
        super().close()

    def start(self) -> None:
        """Simulate what is missing of the chosen test, or join those who wait for it already."""
        self.watch.follow(self.services.laboratory.ask(*self._job()))

    def code(self) -> str:
        """Lines of Python that compute, draw and judge the chosen test."""
        arguments = (
            f'"{self.session.knob}", n_streams={self.session.lab_streams}, seed={self.session.lab_seed}'
        )
        return (
            "from pathlib import Path\n\n"
            "from streamdash.plots.convergence import convergence_figure, measured\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.convergence.spectra import compute_missing\n"
            "from streamdash.convergence.knobs import knob\n"
            "from streamdash.convergence.verdicts import verdict_sentence\n"
            "from streamdash.store.cache import Cache\n\n"
            f"cache, chosen = Cache.default(), knob({arguments})\n"
            "compute_missing([setting.config for setting in chosen.settings], cache)\n"
            f"figure = convergence_figure(cache, {arguments})\n"
            'Path("convergence.png").write_bytes(export(figure, "png"))\n'
            "print(verdict_sentence(chosen, measured(cache, chosen)[1]))\n"
        )

    # ------------------------------------------------------------ inside

    def _controls(self) -> Viewable:
        return ui.side_panel(
            [ui.select(self, "knob", "Test")],
            [
                ui.toggle(self, "lab_streams", "Streams per setting"),
                ui.int_slider(self, "lab_seed", "Seed of the random numbers"),
            ],
        )

    def _make_cards(self) -> None:
        self.card = ui.FigureCard(
            "One test of convergence",
            pn.Column(self.task.view, self.figures, self.about, self.table, sizing_mode=ui.WIDE, margin=0),
            name="convergence",
            page=self,
            drawn=lambda: self._layout(),
            table=lambda: convergence.table(self.knob, self._ready().spectra),
            code=self.code,
            legend=ui.legend(LEGEND),
        )
        self.all_card = ui.FigureCard(
            "All tests at a glance",
            self.all,
            name="verdicts",
            page=self,
            drawn=lambda: convergence.draw_verdicts(self.found, "matplotlib"),
            table=lambda: convergence.all_shifts(self.found),
            code=lambda: VERDICTS_CODE,
        )

    def _show(self) -> None:
        """The chosen test, as far as it is in the cache."""
        chosen = self.knob
        self.about.write(f"{chosen.question} {_paper(chosen)}")
        found, _ = measure(
            self.services.cache, [chosen.key], int(self.session.lab_streams), self.session.lab_seed
        )
        self.measured = found[0] if found else None
        self.task.start.visible = self.measured is None
        if self.measured is None:
            lacking = len(missing([s.config for s in chosen.settings], self.services.cache))
            self.figures.clear()
            self.table.write("")
            self.task.text.text = (
                f"{lacking} of the {len(chosen.settings)} settings are not simulated yet for "
                f"{self.session.lab_streams} streams and seed {self.session.lab_seed}."
            )
            self.card.say("")
            self.opening.say("")
            task = self.services.laboratory.find(self._job()[0])
            if task is not None and task.active:
                self.watch.follow(task)
            return
        self.task.text.text = ""
        figures = [
            LiveFigure(convergence.draw(chosen, self.measured.spectra, kind, "bokeh")).figure
            for kind in KINDS
        ]
        figures.append(LiveFigure(convergence.draw_ratios(chosen, self.measured.spectra, "bokeh")).figure)
        self.figures[:] = [ui.figure_grid(figures)]
        self.table.write(shifts_html(self.measured))
        verdict = verdict_sentence(chosen, self.measured.verdict)
        self.opening.say(verdict.partition(". ")[0].rstrip(".") + ".")
        self.card.say(f"{verdict} {convergence.sentence(chosen, self.measured.spectra)}")

    def _show_all(self) -> None:
        """The verdicts on the shipped settings of all tests."""
        self.found, lacking = measure(self.services.cache)
        self.all.write(verdicts_html(self.found, lacking))
        if self.found:
            self.all_card.say(
                f"What all of this took: {cost_sentence(cost(self.services.cache, self.found))}"
            )

    def _show_task(self, task: Task) -> None:
        self.task.show(task)
        if task.state == "done":
            self._show()
            self._show_all()

    def _job(self) -> tuple[Any, Compute]:
        """Key and computation of what is missing of the chosen test."""
        limits = self.services.jobs.limits
        configs = [setting.config for setting in self.knob.settings]

        compute = partial(laboratory, self.services, configs, limits)
        return ("laboratory", *(config.key for config in configs)), compute

    def _layout(self) -> hv.Layout:
        session = self.session
        return convergence.convergence_figure(
            self.services.cache, session.knob, int(session.lab_streams), session.lab_seed
        )

    def _ready(self) -> Measured:
        if self.measured is None:
            raise ValueError("This test has not been simulated yet; press Simulate first.")
        return self.measured


def _paper(chosen: ConvergenceTest) -> str:
    return f"The paper: {chosen.paper}" if chosen.paper else "The paper has no such test."


VERDICTS_CODE = """from streamdash.convergence.text import convergence_markdown, cost, measure
from streamdash.store.cache import Cache

cache = Cache.default()
found, lacking = measure(cache)
print(convergence_markdown(found, cost(cache, found)))
"""
