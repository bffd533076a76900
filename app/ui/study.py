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
from app.page import Page
from app.ui.browser import LiveText
from app.ui.templates import fill
from app.work.tasks import Compute, Task, Watch, Work
from streamdash.plots.live import Backend, LiveFigure


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


def about(seconds: float) -> str:
    """A time that is an estimate, in words."""
    if seconds < 3:
        return "a few seconds"
    if seconds < 60:
        return f"about {5 * max(1, round(seconds / 5))} s"
    minutes = round(seconds / 60)
    return "about a minute" if minutes == 1 else f"about {minutes} minutes"


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
    shipped: Callable[[], tuple[Any, str] | None] = lambda: None
    """Returns the result that is shipped for the chosen classes, and what it is of where that is not
    what is chosen now."""
    seconds: Callable[[], float | None] = lambda: None
    """About how long it takes on one processor, where that is known."""


ROW = "border-bottom: 1px solid var(--mui-palette-divider, #80808060); padding: 4px 0 6px"


def study_list(title: str, studies: Sequence[StudyCard], name: str) -> Viewable:
    """Studies one below the other: what each answers, how long it takes, how far it is, what came out."""
    return pn.Column(
        ui.heading(title),
        *(study.view for study in studies),
        sizing_mode=ui.WIDE,
        margin=(4, 0, 8, 0),
        styles=ui.CARD,
        css_classes=[f"sd-{name}"],
    )


class StudyCard:
    """One study of a page: a line of the list of studies, whose figure is opened when it is wanted.

    What is shipped for the chosen classes, or known already, is said at once; anything else is computed
    when the button is pressed.
    """

    def __init__(self, study: Study, work: Work, page: Page) -> None:
        self.study, self.work = study, work
        self.result: Any = None
        self.watch = Watch(self._show)
        self.controls = TaskControls("Compute", self.start, self.watch.cancel, study.name)
        self.controls.view.styles = {"flex": "0 1 420px"}
        self.figure = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.said = ui.plain_text("", margin=0, styles={"font-size": "14px"})
        self.opener = ui.button(
            "Show the figure",
            self._toggle,
            css_classes=[f"sd-{study.name}-open"],
            margin=(4, 10),
            disabled=True,
        )
        self.card = ui.FigureCard(
            study.title,
            self.figure,
            name=study.name,
            page=page,
            drawn=lambda: study.draw(self._ready(), "matplotlib"),
            table=lambda: study.table(self._ready()),
            code=study.code,
            legend=ui.legend(study.legend, page.session.configs) if study.legend else None,
        )
        self.card.view.visible = False
        words = ui.Html(
            fill(
                '<div style="font: 15px/1.45 Roboto, sans-serif">'
                '<span style="font-weight: 600">{{ title }}</span><br>{{ purpose }}</div>',
                title=study.title,
                purpose=study.purpose,
            ),
            margin=0,
        )
        row = pn.FlexBox(
            pn.Column(words, self.said, sizing_mode=ui.WIDE, margin=0, styles={"flex": "1 1 340px"}),
            self.controls.view,
            self.opener,
            gap="4px 16px",
            align_items="center",
            sizing_mode=ui.WIDE,
            margin=0,
        )
        self.view = pn.Column(
            row,
            self.card.view,
            sizing_mode=ui.WIDE,
            margin=0,
            stylesheets=[f":host {{ {ROW} }}"],
            css_classes=["sd-study"],
        )

    def start(self) -> None:
        """Compute, or join those who wait for the same already; what comes out is shown whole."""
        self.card.view.visible = True
        self.watch.follow(self.work.ask(*self.study.question()))

    def renew(self) -> None:
        """After the choices changed: show what is known for them already, what is shipped, or nothing."""
        self.watch.leave()
        self.result = None
        self.figure.clear()
        self.said.write("")
        self.card.say("")
        self.controls.start.visible = True
        self.controls.start.disabled = False
        self.controls.cancel.visible = self.controls.bar.visible = False
        self.opener.disabled = True
        task = self.work.find(self.study.question()[0])
        shipped = self.study.shipped()
        if task is not None:
            self.watch.follow(task)
        elif shipped is not None:
            result, other = shipped
            self._present(result, other)
            self.controls.start.visible = bool(other)
            self.controls.text.text = (
                self._lasts() if other else f"As shipped. {self._lasts('Anew, it takes')}"
            )
        else:
            self.card.view.visible = False
            self.controls.text.text = self._lasts()

    def _toggle(self) -> None:
        """Open the figure, or close it."""
        self.card.view.visible = not self.card.view.visible
        self._draw()

    def _lasts(self, words: str = "Takes") -> str:
        """How long it takes, as far as is known."""
        seconds = self.study.seconds()
        return "" if seconds is None else f"{words} {about(seconds)}."

    def _present(self, result: Any, other: str = "") -> None:
        """Show a result; ``other`` says of what it is, where that is not what is chosen."""
        self.result = result
        sentence = self.study.sentence(result)
        sentence = f"{other} {sentence}" if other else sentence
        self.card.say(sentence)
        self.opener.disabled = False
        self.figure.clear()
        self._draw()
        self.said.write("" if self.card.view.visible else sentence)

    def _draw(self) -> None:
        """Draw what is open and not drawn yet: most stay closed."""
        self.opener.label = "Hide the figure" if self.card.view.visible else "Show the figure"
        if self.result is None or not self.card.view.visible or self.figure.objects:
            return
        self.said.write("")
        figure = LiveFigure(self.study.draw(self.result, "bokeh")).figure
        self.figure[:] = [ui.figure_pane(figure)]
        if self.study.extra is not None:
            self.figure.append(self.study.extra(self.result))

    def close(self) -> None:
        """Look no more."""
        self.watch.leave()

    def _show(self, task: Task) -> None:
        self.controls.show(task, "")
        if task.state != "done":
            return
        self._present(task.result)

    def _ready(self) -> Any:
        if self.result is None:
            raise ValueError("Nothing has been computed yet; press Compute first.")
        return self.result
