"""A card whose figure takes long to compute: a button, progress, cancel, then the figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import holoviews as hv
import pandas as pd
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.ui.browser import LiveText
from app.work.tasks import Compute, Task, Watch, Work
from streamdash.plots.live import Backend, LiveFigure, export


class TaskControls:
    """Start and cancel buttons with a progress bar and a sentence that screen readers hear.

    Parameters
    ----------
    label
        What the start button says.
    start, cancel
        Called when the buttons are pressed.
    name
        ``sd-<name>-start`` and the like are the CSS classes.
    """

    def __init__(
        self, label: str, start: Callable[[], Any], cancel: Callable[[], Any], name: str, **params: Any
    ) -> None:
        self.start = ui.button(label, start, css_classes=[f"sd-{name}-start"], margin=(4, 10), **params)
        self.cancel = ui.button(
            "Cancel", cancel, css_classes=[f"sd-{name}-cancel"], margin=(4, 10), visible=False
        )
        self.bar = pn.indicators.Progress(
            value=0, max=100, width=180, height=12, sizing_mode="fixed", margin=(14, 10), visible=False
        )
        self.text = LiveText(margin=(4, 10), styles={"flex": "1 1 180px"}, css_classes=[f"sd-{name}-status"])
        self.view = ui.controls(self.start, self.cancel, self.bar, self.text)

    def show(self, task: Task, words: str = "") -> None:
        """Show how far a task is; ``words`` replace the plain word for a task that is done."""
        active = task.active and task.waiting_for_it > 0
        self.cancel.visible = self.bar.visible = active
        self.start.disabled = active
        self.bar.value = math.floor(100 * task.fraction)
        if active:
            percent = 5 * math.floor(20 * task.fraction)  # a reader need not hear every percent
            self.text.text = "Waiting for other work …" if task.state == "waiting" else f"{percent} % done"
        else:
            self.text.text = {"done": words, "failed": task.error}.get(task.state, "Cancelled.")


@dataclass(frozen=True)
class Study:
    """What a `StudyCard` shows.

    Attributes
    ----------
    name, title, purpose : str
        Stem of files and CSS classes; heading; one sentence on what it answers.
    question : callable
        Returns the key and the computation for what is chosen now.
    draw : callable (result, backend)
    table : callable (result)
    sentence : callable (result)
    code : callable
        Lines of Python that run as shown.
    legend : sequence of (kind, words)
        See `app.ui.legend`.
    """

    name: str
    title: str
    purpose: str
    question: Callable[[], tuple[Hashable, Compute]]
    draw: Callable[[Any, Backend], hv.Overlay]
    table: Callable[[Any], pd.DataFrame]
    sentence: Callable[[Any], str]
    code: Callable[[], str]
    legend: Sequence[tuple[str, str]] = ()
    extra: Callable[[Any], Viewable] | None = None
    """Something more to show with the result."""


class StudyCard:
    """One study of a page, computed when its button is pressed."""

    def __init__(self, study: Study, work: Work, n_classes: int) -> None:
        self.study, self.work, self.n_classes = study, work, n_classes
        self.result: Any = None
        self.watch = Watch(self._show)
        self.controls = TaskControls("Compute", self.start, self.watch.cancel, study.name)
        self.figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.card = ui.FigureCard(
            study.title,
            pn.Column(
                ui.plain_text(study.purpose, margin=(4, 0)),
                self.controls.view,
                self.figure,
                sizing_mode=ui.WIDE,
                margin=0,
            ),
            name=study.name,
            image=lambda kind: export(study.draw(self._ready(), "matplotlib"), kind),
            table=lambda: study.table(self._ready()),
            code=study.code,
            legend=ui.legend(study.legend, n_classes) if study.legend else None,
        )
        self.view = self.card.view

    def start(self) -> None:
        """Compute, or join those who wait for the same already."""
        self.watch.follow(self.work.ask(*self.study.question()))

    def renew(self) -> None:
        """After the choices changed: show what is known for them already, or nothing."""
        self.watch.leave()
        self.result = None
        self.card.say("")
        task = self.work.find(self.study.question()[0])
        if task is not None:
            self.watch.follow(task)
        elif self.figure.objects:
            self.figure.clear()
            self.controls.text.text = "The choices have changed: compute it again."

    def close(self) -> None:
        """Look no more."""
        self.watch.leave()

    def _show(self, task: Task) -> None:
        self.controls.show(task, "")
        if task.state != "done":
            return
        self.result = task.result
        figure = LiveFigure(self.study.draw(self.result, "bokeh")).figure
        self.figure[:] = [ui.figure_pane(figure)]
        if self.study.extra is not None:
            self.figure.append(self.study.extra(self.result))
        self.card.say(self.study.sentence(self.result))

    def _ready(self) -> Any:
        if self.result is None:
            raise ValueError("Nothing has been computed yet; press Compute first.")
        return self.result
