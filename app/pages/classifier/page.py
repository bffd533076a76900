"""Classifier page: train, judge and question the gradient-boosted trees (paper §2.5, §3.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import panel as pn
from bokeh.events import Tap
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.classifier.full_range import FullRange
from app.pages.classifier.parts import STYLE, scores_html, studies_of
from app.pages.other_streams import other_streams_card
from app.services.services import Unavailable
from app.session.catalog import of_paper
from app.ui.browser import LiveText
from app.ui.study import StudyCard, TaskControls, study_list
from app.work.tasks import Task, Watch
from app.work.training import choices_of, code_head, free_task, streams_of, training
from streamdash.classifier import other_streams
from streamdash.classifier.model import PRESETS
from streamdash.classifier.train import Judged
from streamdash.paper.full_range import shipped_results
from streamdash.plots import classifier
from streamdash.plots.answers import classifier_answer
from streamdash.plots.live import LiveFigure

LEGEND_CALIBRATION = (
    ("bars", "test streams, binned; bars: 68 %"),
    ("dots-grey", "single ones, if few are uncertain"),
    ("dashes-grey", "honest"),
)
LEGEND_STREAMS = (("line", "without noise, in class colour"), ("line-grey", "as observed, with noise"))
OTHER_STREAMS = "Accuracy where rate or age is not the trained one: what if the streams are others?"


class ClassifierPage(Page):
    """Train a classifier of 2 to 4 mass ranges at any noise, and see whether to trust it."""

    key, title, group = "classifier", "Classifier", "Explore"
    question = "Can a machine tell which mass range made the gaps of one stream?"
    uses = frozenset({"noise", "preset", "n_pca", "features", "depth", "trees", "cell", "theme"})

    def view(self) -> Viewable:
        try:
            self.streams = streams_of(self.services, self.session)
        except ValueError as error:
            raise Unavailable(str(error)) from None
        self.opening = ui.Opening(self.question)
        self.judged: Judged | None = None
        self.watch = Watch(self._show)
        self.free_watch = Watch(self._show_free)
        self.abundance = LiveText(margin=(8, 0), css_classes=["sd-abundance"])
        self.controls = TaskControls(
            "Train", self.train, self.watch.cancel, "train", color="primary", size="large"
        )
        self.matrix = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.scores = ui.Html(stylesheets=[STYLE], css_classes=["sd-scores"])
        self.roc = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.calibration = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.shown = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self._make_cards()
        self.studies = [
            StudyCard(study, self.services.work, self) for study in studies_of(self.services, self.session)
        ]
        self.results = pn.Column(
            self.card.view,
            self.streams_card.view,
            ui.figure_grid([self.roc_card.view, self.calibration_card.view], narrowest=420),
            study_list("Studies of the classifier", self.studies, "studies"),
            sizing_mode=ui.WIDE,
            margin=0,
            visible=False,
        )
        for study in self.studies:
            study.renew()
        self.train()
        shipped = shipped_results()
        self.full_range = FullRange(shipped) if shipped is not None else None
        elsewhere = other_streams.shipped_results()
        return ui.page_layout(
            self.results,
            *([other_streams_card(elsewhere, ("rate", "age"), OTHER_STREAMS).view] if elsewhere else []),
            *([self.full_range.view] if self.full_range else []),
            opening=self.opening,
            panel=self._choices(),
        )

    def update(self, changed: frozenset[str]) -> None:
        if changed <= {"theme", "cell"}:
            if self.judged is not None:
                if "theme" in changed:
                    self._draw_matrix()
                else:
                    self.live.patch(classifier.selected_columns(*self.selected))
                    self._draw_streams()
            return
        if "preset" in changed:
            self.session.param.update(**choices_of(PRESETS[self.session.preset]))
        task = self.services.work.find(self._question()[0])
        if task is not None:
            self.train()
        else:
            self.watch.leave()
            self.controls.start.disabled = False
            self.controls.cancel.visible = self.controls.bar.visible = False
            self.controls.text.text = (
                "The choices have changed; what is shown below is still the classifier before. Press Train."
            )
        for study in self.studies:
            study.renew()

    def close(self) -> None:
        self.watch.leave()
        self.free_watch.leave()
        for study in self.studies:
            study.close()
        super().close()

    def train(self) -> None:
        """Train the classifier that the controls describe, or join those who wait for the same."""
        self.free_watch.leave()
        self.abundance.text = ""
        self.watch.follow(self.services.work.ask(*self._question()))

    @property
    def selected(self) -> tuple[int, int]:
        """Cell of the confusion matrix looked into: true class, class taken for."""
        n_classes = len(self.streams.q)
        if 0 < self.session.cell <= n_classes**2:
            return divmod(self.session.cell - 1, n_classes)
        counts = self._ready().scores.counts.copy()
        np.fill_diagonal(counts, 0)
        return divmod(int(counts.argmax()), n_classes)

    # ------------------------------------------------------------ building

    def _choices(self) -> Viewable:
        return ui.side_panel(
            [ui.noise_slider(self), self.controls.view],
            [
                ui.stream_picker(self),
                ui.ensemble_picker(self),
                ui.toggle(self, "preset", "Start from"),
                ui.toggle(self, "features", "Features"),
                ui.int_slider(self, "n_pca", "Principal components"),
            ],
        )

    def _cell_picker(self) -> Viewable:
        names = classifier.class_names(self.streams.labels)
        cells = [(a, b) for a in names for b in names]
        words = [f"{a}, put right" if a == b else f"{a}, taken for {b}" for a, b in cells]
        options = {"the most common mistake": 0} | {word: k + 1 for k, word in enumerate(words)}
        menu = ui.menu("cell", "Streams of the cell", options, width=340)
        return self.bind("cell", menu, to_widget=lambda cell: cell if cell <= len(cells) else 0)

    def _matrix_and_scores(self) -> Viewable:
        """The table of scores is seen whole before the matrix is wider than it must be."""
        scores = pn.Column(
            self.scores, self.abundance, margin=0, styles={"flex": "1 1 620px", "min-width": "0"}
        )
        matrix = pn.Column(self.matrix, margin=0, styles={"flex": "1 1 330px", "min-width": "0"})
        return pn.FlexBox(matrix, scores, gap="8px 12px", sizing_mode=ui.WIDE, margin=0)

    def _make_cards(self) -> None:
        classes = [ui.class_heading(i, self.session.ensembles) for i in range(len(self.session.ensembles))]
        self.card = ui.FigureCard(
            "Confusion matrix on streams never trained on",
            self._matrix_and_scores(),
            name="confusion",
            page=self,
            drawn=lambda: classifier.draw_matrix(self._ready(), "matplotlib"),
            table=lambda: classifier.matrix_table(self._ready()),
            code=lambda: self._code("draw_matrix(judged, 'matplotlib')", "draw_matrix", "confusion"),
            legend=ui.controls(*classes),
        )
        self.streams_card = ui.FigureCard(
            "The streams of one cell: click the matrix, or choose here",
            pn.Column(self._cell_picker(), self.shown, sizing_mode=ui.WIDE, margin=0),
            name="cell",
            page=self,
            drawn=lambda: self._streams_layout(),
            table=lambda: classifier.streams_table(self.streams, self._ready(), self._rows()),
            code=self._code_streams,
            legend=ui.legend(LEGEND_STREAMS, self.session.configs),
        )
        self.roc_card = ui.FigureCard(
            "Each class against the rest: ROC, or the doubt that is left",
            self.roc,
            name="roc",
            page=self,
            drawn=lambda: self._draw_roc("matplotlib"),
            table=self._roc_table,
            code=lambda: self._code(f"{self._roc_drawer()}(judged, 'matplotlib')", self._roc_drawer(), "roc"),
            legend=ui.legend((("line", "class colour"), ("dashes-grey", "guessing")), self.session.configs),
        )
        self.calibration_card = ui.FigureCard(
            "Calibration: is 80 % right 80 % of the time?",
            self.calibration,
            name="calibration",
            page=self,
            drawn=lambda: classifier.draw_calibration(self._ready(), "matplotlib"),
            table=lambda: classifier.calibration_table(self._ready()),
            code=lambda: self._code(
                "draw_calibration(judged, 'matplotlib')", "draw_calibration", "calibration"
            ),
            legend=ui.legend(LEGEND_CALIBRATION),
        )

    # ------------------------------------------------------------ showing

    def _show(self, task: Task) -> None:
        self.controls.show(task, _trained_words(task.result) if task.state == "done" else "")
        if task.state != "done":
            return
        self.judged = task.result
        self.results.visible = True
        self._draw_matrix()
        self._draw_streams()
        self.scores.write(scores_html(task.result, of_paper(self.session.configs)))
        self.roc[:] = [_pane(self._draw_roc("bokeh"))]
        self.calibration[:] = [_pane(classifier.draw_calibration(task.result, "bokeh"))]
        self.opening.say(classifier_answer(task.result))
        self.card.say(classifier.matrix_sentence(task.result))
        corner = classifier.nearly_perfect(task.result)
        of_doubt = f" {classifier.doubt_sentence(task.result)}" if corner else ""
        self.roc_card.say(f"{classifier.roc_sentence(task.result)}{of_doubt}")
        self.calibration_card.say(classifier.calibration_sentence(task.result))
        self.free_watch.follow(self.services.work.ask(*free_task(self.services, self.session, task.result)))

    def _show_free(self, task: Task) -> None:
        """Say what changes if the abundance is free."""
        if task.state == "done":
            unknown = "What changes if the abundance is free is not known: the cache has no such streams."
            self.abundance.text = unknown if task.result is None else task.result.sentence
        else:
            self.abundance.text = "Learning what changes if the abundance is free …" if task.active else ""

    def _roc_drawer(self) -> str:
        """Name of what draws errors: the ROC curve, unless that is a corner."""
        return "draw_doubt" if classifier.nearly_perfect(self._ready()) else "draw_roc"

    def _draw_roc(self, backend: Any) -> Any:
        return getattr(classifier, self._roc_drawer())(self._ready(), backend)

    def _roc_table(self) -> Any:
        judged = self._ready()
        corner = classifier.nearly_perfect(judged)
        return classifier.doubt_table(judged) if corner else classifier.roc_table(judged)

    def _draw_matrix(self) -> None:
        dark = self.session.dark
        self.live = LiveFigure(classifier.draw_matrix(self._ready(), "bokeh", self.selected, dark))
        self.live.figure.on_event(Tap, self._tapped)
        self.matrix[:] = [ui.figure_pane(self.live.figure)]

    def _draw_streams(self) -> None:
        rows = self._rows()
        if len(rows) == 0:
            self.shown[:] = [ui.plain_text("No test stream is in this cell.")]
        else:
            figures = classifier.draw_streams(self.streams, self._ready(), rows, "bokeh")
            table = classifier.streams_table(self.streams, self._ready(), rows[: len(figures)])
            captions = [classifier.stream_caption(record) for record in table.to_dict("records")]
            cells = [
                pn.Column(
                    ui.plain_text(words, margin=(6, 0, 0, 0)), _pane(figure), sizing_mode=ui.WIDE, margin=0
                )
                for words, figure in zip(captions, figures, strict=True)
            ]
            self.shown[:] = [ui.figure_grid(cells, narrowest=310)]
        self.streams_card.say(classifier.streams_sentence(self.streams, self._ready(), *self.selected))

    def _tapped(self, event: Tap) -> None:
        if event.x is None or event.y is None:
            return
        truth, taken_for, last = round(-event.y), round(event.x), len(self.streams.q) - 1
        if 0 <= truth <= last and 0 <= taken_for <= last:
            self.session.cell = 1 + truth * (last + 1) + taken_for

    def _rows(self) -> np.ndarray:
        return self._ready().cell(*self.selected)

    def _streams_layout(self) -> Any:
        return classifier.streams_layout(self.streams, self._ready(), self._rows())

    def _ready(self) -> Judged:
        if self.judged is None:
            raise Unavailable("No classifier has been trained yet; press Train.")
        return self.judged

    def _question(self) -> tuple:
        return training(self.services, self.session)

    # ------------------------------------------------------------ code

    def _code(self, figure: str, function: str, name: str) -> str:
        head = code_head(
            self.session,
            "from streamdash.classifier.train import train",
            f"from streamdash.plots.classifier import {function}",
            "from streamdash.plots.live import export",
        )
        return (
            f"{head}judged = train(streams, {self.session.noise:g}, settings)\n"
            f'Path("{name}.png").write_bytes(export({figure}, "png"))\n'
        )

    def _code_streams(self) -> str:
        figure = f"streams_layout(streams, judged, judged.cell{self.selected})"
        return self._code(figure, "streams_layout", "cell")


def _pane(overlay: Any) -> Viewable:
    return ui.figure_pane(LiveFigure(overlay).figure, "320px")


def _trained_words(judged: Judged) -> str:
    card = judged.classifier.card
    took = "read from disk" if np.isnan(judged.seconds) else f"trained in {judged.seconds:.1f} s"
    return (
        f"Classifier {took}: {card.n_trees} trees per class of depth {card.settings.boosting.max_depth}, "
        f"{len(judged.classifier.features.names)} features, σ_ε = {card.noise:g}."
    )
