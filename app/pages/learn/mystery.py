"""Steps of the story: the gap it begins and ends with, stars pulled forward, and the odds of one number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd
from panel.viewable import Viewable
from scipy.ndimage import uniform_filter1d

from app import ui
from app.pages.learn.predict import Outcome
from app.pages.learn.step import Link, Step
from app.pages.learn.text import mystery_text, odds_text, orbits_text, solved_text
from app.services.comparison import shared_comparison
from app.services.services import Unavailable
from app.ui.player import Player
from app.ui.templates import literally
from streamdash.classifier.model import BEST
from streamdash.classifier.quiz import draw_rounds, find_clue, learn, quiz_split
from streamdash.engine.flyby import kick_along_stream
from streamdash.plots import passing as orbits
from streamdash.plots import quiz, story
from streamdash.plots.live import Backend, Columns
from streamdash.plots.style import coordinate_symbol
from streamdash.survey.passing import pulled
from streamdash.survey.story import odds

MYSTERY_NOISE, MYSTERY_GAME = 0.1, 3
"""How the stream of the first page is counted, and the game one of whose streams it is."""
STRETCH = 15
"""Bins that make a stretch the eye sees at once."""
LOWEST, HIGHEST = 0.45, 1.7
"""Qρ that the emptiest stretch should about have, and that none should exceed."""


class MysteryStep(Step):
    """A stream with gaps: who made them?"""

    title = "Who made this gap?"
    legend: tuple[tuple[str, str], ...] = (
        ("dots-grey", "stars counted, over what is expected"),
        ("dashes-grey", "a stream that nothing has hit"),
    )
    reveal = False
    question = "What could leave such marks?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "the way we count", "the pull of something that flew past", "the light of other stars"

    def outcome(self) -> Outcome:
        off = float(np.abs(self.smooth - 1).max())
        return Outcome(
            1,
            f"Counting moves a dot by {MYSTERY_NOISE:g} or so; here whole stretches are off by "
            f"{off:.2f}. Light "
            "pushes no star "
            "about. What moves stars is gravity.",
        )

    def compute(self) -> None:
        streams = self.services.observed(self.choices)
        try:
            self.streams, self.sets = streams, quiz_split(streams, BEST.seed)
        except ValueError as error:
            raise Unavailable(str(error)) from None
        key = ("observed", *streams.keys, MYSTERY_NOISE)
        self.observed = self.services.shared(key, lambda: streams.observed(MYSTERY_NOISE))
        rows = draw_rounds(streams, self.sets, MYSTERY_GAME)
        # A gap that everybody sees, in a stream that is not torn apart.
        stretches = uniform_filter1d(streams.clean[rows], STRETCH, axis=1, mode="nearest")
        unlike = np.abs(stretches.min(axis=1) - LOWEST) + np.maximum(stretches.max(axis=1) - HIGHEST, 0)
        self.number = int(unlike.argmin()) + 1
        self.row = int(rows[self.number - 1])
        self.shown = quiz.make_round(streams, self.observed, self.row, MYSTERY_NOISE)
        self.smooth = uniform_filter1d(self.shown.observed, STRETCH, mode="nearest")

    def draw(self, backend: Backend) -> hv.Overlay:
        return quiz.draw_round(self.shown, 1, self.reveal, backend)

    def text(self) -> str:
        return mystery_text(MYSTERY_NOISE, float(self.smooth.min()), float(self.smooth.max()))

    def sentence(self) -> str:
        low = int(self.smooth.argmin())
        where = f"{coordinate_symbol(self.shown.coordinate)} = {self.shown.position[low]:.1f}°"
        return (
            f"The emptiest place is at {where}: "
            f"{100 * self.smooth[low]:.0f} % of the "
            "stars that an undisturbed stream would have there."
        )

    def table(self) -> pd.DataFrame:
        return quiz.round_table(self.shown, self.reveal)

    def call(self) -> tuple[str, str, str]:
        more = ", reveal=True" if self.reveal else ""
        return (
            "quiz",
            "quiz_figure",
            f", ensembles, noise={MYSTERY_NOISE:g}, game={MYSTERY_GAME}, number={self.number}{more}",
        )

    def links(self) -> list[Link]:
        return [("Guess the mass of ten streams like this one", {"lesson": "quiz"})]


class SolvedStep(MysteryStep):
    """Whose gap it was."""

    title = "Who it was"
    by_class = True
    legend = (("dots-grey", "stars counted"), ("line", "the stream without the scatter of counting"))
    reveal = True
    question = "Before you read on: whose gap was it?"

    @property
    def answers(self) -> tuple[str, ...]:
        return self.shown.names

    def outcome(self) -> Outcome:
        return Outcome(
            self.shown.truth,
            f"It was hit by {self.shown.n_impacts} objects; the coloured line has the colour of their "
            "masses.",
        )

    def text(self) -> str:
        noise, sets, streams = MYSTERY_NOISE, self.sets, self.streams
        known = self.services.shared(
            ("quiz measures", *streams.keys, noise), lambda: learn(streams, sets, noise)
        )
        clue = find_clue(known, self.observed[self.row], self.shown.truth)
        low, high = clue.usual[self.shown.truth]
        return solved_text(
            literally(self.shown.names[self.shown.truth]),
            self.shown.n_impacts,
            f"the {quiz.clue_words(clue, streams.design.step)} is {clue.value:.2g}",
            f"{low:.2g} to {high:.2g}",
        )

    def sentence(self) -> str:
        return quiz.truth_sentence(self.shown, 1, 1)

    def links(self) -> list[Link]:
        return [
            ("Classify a stream: an example, or your own counts", {"page": "observe"}),
            ("Guess the mass of ten streams", {"lesson": "quiz"}),
        ]


class OrbitsStep(Step):
    """Stars on neighbouring orbits: pulled forward falls back."""

    title = "Pulled forward, falls back"
    square = True
    uses = frozenset({"mass10"})
    ink = (orbits.PATH.format(orbits.FREE),)
    legend = (
        ("dots-ink", "left alone"),
        ("dots-hand", "pulled forward"),
        (f"dots-{orbits.BACK_COLOUR}", "held back"),
        ("dashes-grey", "their ways"),
    )
    question = "A star is pulled forward. Where is it, 700 million years later?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "ahead of the others", "level with the one left alone", "behind"

    def outcome(self) -> Outcome:
        lead = float(self.shown.lead[-1, 0])
        right = 1 if abs(lead) < 1 else 0 if lead > 0 else 2
        return Outcome(
            right,
            f"It runs ahead for {1000 * self.shown.falls_back:.0f} million years. But the push has "
            "lifted it onto a "
            f"wider orbit, which takes longer to go round: in the end it is {abs(lead):.0f}° "
            f"{'ahead' if lead > 0 else 'behind'}.",
            {},
        )

    def compute(self) -> None:
        self.flyby = self.session.chosen[-1]
        key = ("pulled", self.stream.key, self.flyby)
        self.shown = self.services.shared(key, lambda: pulled(self.geometry, self.flyby))

    def player(self, sources: Mapping[str, Any]) -> Player:
        player = Player(label="Time since the pull", seconds=8.0, sizing_mode=ui.WIDE, margin=(4, 0))
        player.load(orbits.pulled_frames(self.shown), sources, orbits.pulled_captions(self.shown), 0)
        return player

    def draw(self, backend: Backend) -> hv.Overlay:
        return orbits.draw_pulled(self.shown, 0, backend)

    def text(self) -> str:
        real = float(np.abs(kick_along_stream(self.geometry, self.flyby).dv_along).max())
        return orbits_text(self.shown.kick, real)

    def sentence(self) -> str:
        lead = self.shown.lead[-1]
        return (
            f"The Galaxy’s centre is in the middle. After {1000 * self.shown.time_gyr[-1]:.0f} million "
            "years the star "
            f"that was pulled forward is {orbits.ahead(float(lead[0]))}, the one that was held back "
            f"{orbits.ahead(float(lead[1]))}."
        )

    def table(self) -> pd.DataFrame:
        return orbits.pulled_table(self.shown)

    def call(self) -> tuple[str, str, str]:
        values = ", ".join(f"{field}={value:g}" for field, value in self.flyby)
        return "passing", "pulled_figure", f", Flyby({values}){self.stream_argument()}"

    def links(self) -> list[Link]:
        return [("Watch a fly-by on the sky", {"lesson": "flyby", "flybys": [], "crowd": 0})]


class OddsStep(Step):
    """The odds of one number."""

    title = "The odds of one number"
    uses = frozenset({"noise", "seed", "n_bin", "exclude"})
    by_class = True
    ink = (story.THIS,)
    legend = (("dashes-ink", "one new stream"),)
    question = "Draw another stream, hit by the heavier objects. Which way will its odds point?"

    @property
    def answers(self) -> tuple[str, ...]:
        return f"to {self.choices[0].label}", f"to {self.choices[-1].label}", "now here, now there"

    def outcome(self) -> Outcome:
        share = self.found.right[1]
        right = 1 if share > 0.9 else 0 if share < 0.1 else 2
        return Outcome(
            right,
            f"Of all streams hit by the heavier objects, the odds of this one number point the right way for "
            f"{100 * share:.0f} %, and for {100 * self.found.right[0]:.0f} % of those hit by the lighter.",
            {"seed": (self.session.seed + 1) % 10_000},
        )

    def compute(self) -> None:
        self.data = shared_comparison(self.services, self.session)
        at = self.data.bin_at(1.0)
        key = (
            "odds",
            *(c.key for c in self.choices),
            self.data.noise,
            len(self.data.edges),
            self.session.exclude,
        )
        light, heavy = self.data.sorted_y[0][at], self.data.sorted_y[-1][at]
        self.range = float(self.data.edges[at]), float(self.data.edges[at + 1])
        self.all_odds = self.services.shared(key, lambda: odds(light, heavy))
        rank = np.random.default_rng(self.session.seed).integers(len(heavy))
        self.found = self.all_odds
        self.value = float(heavy[rank])

    def controls(self) -> list[Viewable]:
        return [
            ui.button(
                "Draw others",
                lambda: self.session.advance("seed"),
                css_classes=["sd-draw-others"],
                margin=(4, 10),
            )
        ]

    def draw(self, backend: Backend) -> hv.Overlay:
        return story.draw_odds(self.found, self.value, self.ends, backend)

    def columns(self) -> Columns:
        return story.odds_columns(self.found, self.value)

    def text(self) -> str:
        return odds_text(
            self.light, self.heavy, self.colours, *self.range, self.value, self.found.at(self.value)
        )

    def sentence(self) -> str:
        low, high = self.range
        return (
            f"Density of {low:.2f} < Qρ < {high:.2f} in streams of each kind, at σ_ε = "
            f"{self.data.noise:g}. The new "
            f"stream has {self.value:.2f}; it was hit by {self.choices[-1].label}."
        )

    def table(self) -> pd.DataFrame:
        return story.odds_table(self.found)

    def call(self) -> tuple[str, str, str]:
        session = self.session
        return (
            "story",
            "odds_figure",
            f", ensembles, noise={session.noise:g}, number={session.seed}, n_bin={session.n_bin}, "
            f'rules="{session.exclude}"',
        )

    def links(self) -> list[Link]:
        return [("The PDF page: look into any bin", {"page": "pdf"})]
