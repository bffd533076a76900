"""Learn page, the story: each step with words, something to predict, one live figure and links."""

from __future__ import annotations

from typing import Any

import panel as pn
from bokeh.models import CustomJS, Text
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.layout import FIGURE_FIRST, FIGURES, row
from app.pages.learn.predict import TYPE, Prediction
from app.pages.learn.prose import Prose
from app.pages.learn.steps import STEPS, Step
from app.pages.learn.text import GLOSSARY
from app.session.listing import ensembles_code
from app.session.session import Session, link_to
from app.ui.links import Links
from streamdash.config import StreamModel
from streamdash.plots.live import LiveFigure

DRAGGED = {"mass10": 0.25, "noise": 0.02}
"""Numbers that can be dragged in the text, and their steps."""
USES = frozenset({"step", "theme"}).union(*(step.uses for step in STEPS))

FOOT = {
    "position": "sticky",
    "bottom": "0",
    "z-index": "5",
    "background": "var(--mui-palette-background-default, Canvas)",
}
"""Back and Next stay in sight, however long the text is."""

LARGE = "clamp(24px, 1.3vw, 40px)"
WALL = {"--sd-prose-size": LARGE, "--sd-type": LARGE, "--sd-heading": "clamp(28px, 1.8vw, 52px)"}
"""Type that is read from the last row of a room."""
KEPT = "if (cb_obj[name] !== size) { cb_obj[name] = size }"
WALL_FIGURE = "calc(100vh - 250px)"
"""Height of a figure on a wall: what legend and sentence leave; the film's player takes some of it."""


def projected(session: Session) -> bool:
    """Whether the story is shown on a wall: large, and without controls."""
    return session.lesson == "story" and session.projector == "yes"


def enlarge(figure: Any) -> None:
    """Make a Bokeh figure readable from afar."""
    figure.toolbar_location = None
    for axis in figure.axis:
        for name, size in (("axis_label_text_font_size", "26px"), ("major_label_text_font_size", "24px")):
            axis.update(**{name: size})
            # The theme gives every axis of a page its own size, whenever light or dark is chosen.
            axis.js_on_change(name, CustomJS(args={"name": name, "size": size}, code=KEPT))
    for text in figure.select({"type": Text}):
        text.text_font_size = "24px"


class StoryLesson:
    """One step at a time; all of them share the session's choices."""

    def __init__(self, page: Page) -> None:
        self.page, self.session = page, page.session
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.inner: Page | None = None
        self._open()

    def view(self) -> Viewable:
        """Navigation, the step, the glossary."""
        session, wall = self.session, projected(self.session)
        foot: Any = {"margin": (4, 10), "sx": TYPE}
        titles = {f"{i}": i for i in range(1, len(STEPS) + 1)}
        self.back = ui.button("Back", lambda: self._go(-1), css_classes=["sd-back"], **foot)
        self.on = ui.button("Next step", lambda: self._go(1), css_classes=["sd-on"], **foot)
        self._limit()
        glossary = ui.Html(ui.from_markdown(GLOSSARY), margin=(0, 8))
        buttons = [self.back, self.on]
        if wall:
            buttons.append(
                ui.button(
                    "Usual screen",
                    lambda: session.param.update(projector="no"),
                    css_classes=["sd-usual"],
                    **foot,
                )
            )
        parts: list[Viewable] = [self.slot, pn.Row(*buttons, margin=0, styles=FOOT, css_classes=["sd-foot"])]
        if not wall:
            words = "Glossary: every word and symbol"
            steps = row(self.page, "step", "Step", titles, space=15)
            parts = [
                ui.controls(steps),
                *parts,
                ui.folded(words, [glossary], "glossary", title_variant="subtitle1"),
            ]
        return pn.Column(
            *parts,
            styles=WALL if wall else {},
            sizing_mode=ui.WIDE,
            margin=0,
        )

    def update(self, changed: frozenset[str]) -> None:
        """Patch the figure and the words, or turn the page."""
        if "step" in changed:
            self._open()
            self._limit()
            return
        if changed & self.step.uses:
            self.step.compute()
            self.live.patch(self.step.columns())
            ranges = self.step.ranges()
            if ranges is not None:
                self.live.move(ranges[0], ranges[1])
            self._say()
        if "theme" in changed:
            self.live.set_ink(self.session.dark)
            self._link()

    def close(self) -> None:
        """Let go of the step's controls."""
        if self.inner is not None:
            self.inner.close()

    # ------------------------------------------------------------ inside

    def _open(self) -> None:
        session = self.session
        self.close()
        # A page of its own for what a step binds, which ends with the step.
        self.inner = Page(session, self.page.services)
        self.step: Step = STEPS[session.step - 1](self.inner)
        self.live = LiveFigure(self.step.draw("bokeh"), ink=self.step.ink)
        self.live.set_ink(session.dark)
        self.words = Prose(margin=(0, 4), sizing_mode=ui.WIDE, css_classes=["sd-story"])
        self.words.on_move(self._move)
        self.links = Links(sizing_mode=ui.WIDE, margin=(4, 4), css_classes=["sd-links"])
        step = self.step
        self.prediction = Prediction(step.question, step.answers, step.outcome, self._reveal)
        self.player = step.player(self.live.sources)
        wall = projected(session)
        if wall:
            enlarge(self.live.figure)
        taken = "" if self.player is None else " - 70px"
        height = f"calc({WALL_FIGURE}{taken})" if wall else ui.FIGURE_HEIGHT
        figure = ui.figure_grid([ui.figure_pane(self.live.figure, height, step.square)])
        if self.player is not None:
            figure = pn.Column(self.player, figure, sizing_mode=ui.WIDE, margin=0)
        self.card = ui.FigureCard(
            step.title,
            figure,
            name=f"story-{session.step}",
            page=self.page,
            drawn=lambda: step.draw("matplotlib"),
            table=step.table,
            code=self.code,
            legend=ui.legend(step.swatches(), session.configs),
            bare=wall,
        )
        self._say()
        left = pn.Column(
            ui.heading(f"{session.step}. {step.title}"),
            self.words,
            self.prediction.view,
            self.links,
            margin=0,
            styles={"flex": "1 1 340px", "min-width": "0", "max-width": "46vw" if wall else "680px"},
        )
        right = pn.Column(
            *([] if wall else [ui.controls(*step.controls())]),
            self.card.view,
            margin=0,
            styles={"flex": "1.4 1 420px", "min-width": "0"},
            css_classes=[FIGURES],
        )
        self.slot[:] = [
            pn.FlexBox(left, right, gap="4px 24px", sizing_mode=ui.WIDE, margin=0, **FIGURE_FIRST)
        ]

    def _say(self) -> None:
        self.words.text = self.step.text()
        self.card.say(self.step.sentence())
        self._link()

    def _link(self) -> None:
        self.links.links = [[words, link_to(self.session, **changes)] for words, changes in self.step.links()]

    def _go(self, by: int) -> None:
        self.session.step = min(max(self.session.step + by, 1), len(STEPS))

    def _reveal(self, changes: dict[str, Any]) -> None:
        """Let it be seen what was asked for a prediction."""
        if self.player is not None:
            self.player.plays += 1
        self.session.param.update(**changes)

    def _move(self, name: str, steps: int) -> None:
        """A number in the text was dragged."""
        if name in DRAGGED and name in self.step.uses:
            low, high = self.session.param[name].bounds
            value = round(getattr(self.session, name) + steps * DRAGGED[name], 3)
            setattr(self.session, name, min(max(value, low), high))

    def _limit(self) -> None:
        self.back.disabled = self.session.step == 1
        self.on.disabled = self.session.step == len(STEPS)

    def code(self) -> str:
        """Lines of Python that make the figure as it is now."""
        module, function, arguments = self.step.call()
        listed = ensembles_code(self.session.ensembles) if "ensembles" in arguments else ""
        stream = "from streamdash.config import StreamModel\n" if self.step.stream != StreamModel() else ""
        flyby = "from streamdash.engine.flyby import Flyby\n" if "Flyby(" in arguments else ""
        return (
            "from pathlib import Path\n\n"
            f"{stream}{flyby}"
            "from streamdash.plots.live import export\n"
            f"from streamdash.plots.{module} import {function}\n"
            "from streamdash.store.cache import Cache\n\n"
            f"{listed}figure = {function}(Cache.default(){arguments})\n"
            f'Path("story.png").write_bytes(export(figure, "png"))\n'
        )
