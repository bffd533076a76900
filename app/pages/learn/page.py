"""Learn page: a story in ten steps, a sandbox for one fly-by, a quiz against the classifier, for teachers."""

from __future__ import annotations

from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.flyby import USES as FLYBY_USES
from app.pages.learn.flyby import FlybyLesson
from app.pages.learn.layout import row
from app.pages.learn.quiz import USES as QUIZ_USES
from app.pages.learn.quiz import QuizLesson
from app.pages.learn.story import USES as STORY_USES
from app.pages.learn.story import StoryLesson, projected
from app.pages.learn.teach import USES as TEACH_USES
from app.pages.learn.teach import TeachLesson

MADE_BY: dict[str, Any] = {
    "story": StoryLesson,
    "flyby": FlybyLesson,
    "quiz": QuizLesson,
    "teach": TeachLesson,
}


class LearnPage(Page):
    """One of four lessons at a time."""

    key, title, group = "learn", "Learn", ""
    one_arm = (
        "A lesson follows one stream of stars from its progenitor to its end, so it needs one arm: choose "
        "which. Both are seen side by side on Profiles and Spectrum."
    )
    uses = STORY_USES | FLYBY_USES | QUIZ_USES | TEACH_USES | {"lesson"}

    def view(self) -> Viewable:
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.lesson: Any = None
        self.choice = ui.controls(row(self, "lesson", "Learn by"))
        self._open()
        return ui.page_layout(self.choice, self.slot)

    def update(self, changed: frozenset[str]) -> None:
        if changed & {"lesson", "projector"}:
            self._open()
        elif self.lesson is not None:
            self.lesson.update(changed)

    def close(self) -> None:
        self._leave()
        super().close()

    def _open(self) -> None:
        """Build the lesson that is chosen."""
        self._leave()
        self.choice.visible = not projected(self.session)
        # A page of its own for what a lesson binds, which ends with the lesson.
        self.inner = Page(self.session, self.services)
        self.lesson = MADE_BY[self.session.lesson](self.inner)
        self.slot[:] = [self.lesson.view()]

    def _leave(self) -> None:
        if self.lesson is not None:
            self.lesson.close()
            self.inner.close()
            self.lesson = None
