"""Front page: the question, the one figure that answers it, where to go on, how to cite."""

from __future__ import annotations

from typing import Any

from panel.viewable import Viewable

from app import ui
from app.pages.profiles.page import LEGEND, ProfilesPage
from app.services.comparison import shared_comparison
from app.session.catalog import Choice
from app.session.session import link_to
from app.ui.links import Doors
from streamdash.paper.studies import shipped_studies
from streamdash.plots.answers import profiles_answer
from streamdash.plots.classifier import class_names
from streamdash.plots.profiles import sentence
from streamdash.statistics.evidence import Comparison
from streamdash.words import percent_between

DOORS = (
    ("profiles", "Explore", "Thousands of simulated streams: profiles, statistics, evidence, a classifier."),
    (
        "observe",
        "Classify your stream",
        "Bring a measured density; see which masses it speaks for, and how surely.",
    ),
    ("learn", "Learn", "Watch a gap open, guess the mass, play against the classifier."),
)


class HomePage(ProfilesPage):
    """The lightest and the heaviest mass range chosen, at a noise that can be moved."""

    key, title, group = "home", "Home", ""
    question = "What do the gaps in a stream of stars say about the dark objects that flew past it?"
    uses = frozenset({"noise", "theme"})
    height = "clamp(240px, calc(100vh - 560px), 420px)"

    def view(self) -> Viewable:
        self.prepare()
        self.card = ui.FigureCard(
            "The same stream, hit by light and by heavy objects",
            self.grid,
            name="home",
            page=self,
            drawn=lambda: self.layout(),
            table=self.table,
            code=self.code,
            legend=ui.legend(LEGEND, [choice.config for _, choice in self._shown()]),
        )
        self.doors = Doors(sizing_mode=ui.WIDE, margin=(8, 0), css_classes=["sd-doors"])
        self.facts = ui.Html(margin=(8, 4), css_classes=["sd-facts"])
        self._draw()
        return ui.page_layout(
            self.card.view,
            self.doors,
            self.facts,
            opening=self.opening,
            panel=ui.side_panel([ui.noise_slider(self)]),
            beside=False,
        )

    def say(self) -> None:
        """Answer, sentence, numbers and links for what is shown now."""
        self.opening.say(profiles_answer(self.panels))
        self.card.say(sentence(self.panels))
        self.doors.doors = [[words, about, link_to(self.session, page=key)] for key, words, about in DOORS]
        self.facts.write(self._facts())

    @property
    def scale(self) -> str:
        """That of the paper, whatever was chosen on Profiles."""
        return "shared"

    def _shown(self) -> list[tuple[int, Choice]]:
        """The first and the last class alone."""
        shown = super()._shown()
        ends = {0, len(self.session.ensembles) - 1}
        return [(index, choice) for index, choice in shown if index in ends]

    def _facts(self) -> str:
        """What the shipped simulations say in numbers, and what to cite."""
        session, last = self.session, len(self.session.ensembles) - 1
        streams = sum(
            choice.config.n_streams
            for stream in session.catalog.streams
            for choice in stream.ensembles
            if not stream.arms
        )
        sums = []
        if last > 0:
            found: Comparison = shared_comparison(self.services, session)
            for i, j in ((0, last), (last, 0)):
                total = found.evidence.cumulative(i, i, j)
                if total.n_kept:
                    sums.append(
                        (f"{session.ensembles[i].label} against {session.ensembles[j].label}", total.value)
                    )
        return ui.render(
            "pages/home/facts.html", streams=streams, sums=sums, noise=session.noise, accuracy=_accuracy()
        )


def _accuracy() -> dict[str, Any] | None:
    """How well the shipped study's classifier tells its classes apart."""
    found = shipped_studies()
    if found is None:
        return None
    return {
        "noise": found["noise"],
        "share": percent_between(found["accuracy"], *found["accuracy_interval"]),
        "n": found["n_test"],
        "classes": " or ".join(class_names(found["labels"])),
    }
