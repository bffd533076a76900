"""Learn page, for teachers: a lesson of 45 minutes, questions with answers, a worksheet, and a class."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.layout import row
from app.pages.learn.levels import game_of
from app.pages.learn.state import ROUNDS
from app.pages.learn.teaching import GOALS, PLAN, QUESTIONS
from app.services.classrooms import Result
from app.session.session import link_to
from app.ui.browser import LiveText
from app.ui.links import CopyLink, Links

USES = frozenset({"room", "game", "difficulty", "projector"})
POLL_MS = 2000
"""How often a teacher's screen asks for new results."""
STYLE = """
table { border-collapse: collapse; font: 15px/1.5 Roboto, sans-serif; max-width: 760px; }
th, td { padding: 4px 10px 4px 0; text-align: left; vertical-align: top; border-bottom: 1px solid #80808040; }
ul { font: 15px/1.6 Roboto, sans-serif; margin: 0; padding-left: 22px; max-width: 760px; }
details { font: 15px/1.6 Roboto, sans-serif; max-width: 760px; padding: 6px 0; }
summary { cursor: pointer; font-weight: 500; min-height: 24px; }
.bars { display: flex; align-items: flex-end; gap: 4px; height: 200px; max-width: 760px;
        font: 14px/1.2 Roboto, sans-serif; }
.bar { flex: 1 1 0; display: flex; flex-direction: column; justify-content: flex-end; text-align: center;
       height: 100%; }
.fill { background: #0072B2; min-height: 1px; }
.all { background: #009E73; }
"""


class TeachLesson:
    """What a teacher needs; the class that is opened here sends its results to this screen."""

    def __init__(self, page: Page) -> None:
        self.page, self.session, self.services = page, page.session, page.services
        self._timer: Any = None
        self._shown: tuple[Result, ...] | None = None
        self.chart = ui.Html(stylesheets=[STYLE], margin=(4, 10), css_classes=["sd-class-results"])
        self.state = LiveText(sizing_mode=ui.WIDE, margin=(4, 10), css_classes=["sd-class-state"])
        self.link = CopyLink(
            label="Link for your class: the same ten streams for everybody, results come here",
            margin=(4, 10),
            css_classes=["sd-room-link"],
            sizing_mode=ui.WIDE,
        )
        self.look()
        if pn.state.curdoc is not None:
            pn.state.onload(self._look_on)

    def view(self) -> Viewable:
        """Plan, class, goals, questions, worksheet."""
        session = self.session
        story = [[f"{title} ({minutes} min)", link_to(session, **there)] for minutes, title, _, there in PLAN]
        sheet = ui.download("streamdash-worksheet.html", "worksheet", self.worksheet)
        sheet.label = "Worksheet to print"
        return pn.Column(
            ui.heading("A lesson of 45 minutes: weighing what nobody sees"),
            ui.Html(ui.render("pages/learn/plan.html", plan=PLAN), stylesheets=[STYLE], margin=(4, 10)),
            Links(links=story, margin=(4, 10), sizing_mode=ui.WIDE, css_classes=["sd-links"]),
            ui.controls(
                row(self.page, "projector", "Screen", {"Usual": "no", "Projector": "yes"}),
                sheet,
            ),
            ui.heading("Your class"),
            ui.controls(
                ui.button("Open a class", self.open, css_classes=["sd-open-class"], margin=(4, 10)),
            ),
            self.state,
            self.link,
            self.chart,
            ui.heading("Goals"),
            ui.Html(ui.render("pages/learn/goals.html", goals=GOALS), stylesheets=[STYLE], margin=(4, 10)),
            ui.heading("Questions, with answers"),
            ui.Html(
                ui.render("pages/learn/questions.html", questions=QUESTIONS),
                stylesheets=[STYLE],
                margin=(4, 10),
                css_classes=["sd-teach"],
            ),
            sizing_mode=ui.WIDE,
            margin=0,
        )

    def update(self, changed: frozenset[str]) -> None:
        """Follow the class that is open."""
        self.look()

    def close(self) -> None:
        """Ask for results no more."""
        if self._timer is not None:
            self._timer.stop()
            self._timer = None

    def open(self) -> None:
        """Open a class of this screen's game and difficulty."""
        # Its results are of this game alone: another one is another class.
        self.session.room = self.services.classrooms.open(game_of(self.session))

    def worksheet(self) -> bytes:
        """A page for students, to be printed by the browser."""
        link = link_to(self.session, **PLAN[0][3])
        return ui.render(
            "pages/learn/worksheet.html", goals=GOALS, questions=QUESTIONS, rounds=ROUNDS, link=link
        ).encode()

    def look(self) -> None:
        """Show what has come in."""
        room = self.session.room
        known = bool(room) and self.services.classrooms.knows(room)
        self.link.visible = self.chart.visible = known
        if not known:
            self.state.text = (
                "This class is closed: it was open for four hours, or the server was started anew."
                if room
                else "Open a class, and give it the link. Nobody is asked for a name, and nothing is kept: "
                "results are in this computer’s memory for four hours."
            )
            return
        self.link.query = link_to(
            self.session,
            lesson="quiz",
            round=1,
            answers="",
            average=1,
            sure=1,
            projector="no",
            theme="default",
        )
        found = self.services.classrooms.results(room)
        if found != self._shown:
            self._shown = found
            self.state.text = summary(found)
            self.chart.write(chart(found))

    def _look_on(self) -> None:
        if self._timer is None:
            self._timer = pn.state.add_periodic_callback(self.look, POLL_MS)


def summary(found: tuple[Result, ...]) -> str:
    """The class in a sentence."""
    if not found:
        return "The class is open. Results appear here when somebody has answered all ten."
    right = np.array([sum(one.right) for one in found])
    points = np.array([one.points for one in found])
    return (
        f"{len(found)} finished: {right.mean():.1f} of {ROUNDS} right on average, {points.mean():.0f} "
        "points on "
        f"average, the best {points.max():.0f}."
    )


def chart(found: tuple[Result, ...]) -> str:
    """How many had how many right, and the share that was right in each round."""
    if not found:
        return ""
    counts = Counter(sum(one.right) for one in found)
    most = max(counts.values())
    shares = np.mean([one.right for one in found], axis=0)
    return ui.render(
        "pages/learn/class.html",
        counts=[(n, counts.get(n, 0), 100 * counts.get(n, 0) / most) for n in range(ROUNDS + 1)],
        rounds=[(i, f"{100 * share:.0f}") for i, share in enumerate(shares, 1)],
    )
