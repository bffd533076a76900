"""Steps of the story that judge: the evidence of many streams, and what it takes to see light objects."""

from __future__ import annotations

import holoviews as hv
import numpy as np
import pandas as pd
from panel.viewable import Viewable

from app import ui
from app.pages.learn.predict import Outcome
from app.pages.learn.step import Link, Ranges, Step
from app.pages.learn.text import evidence_text, question_text
from app.services.comparison import noisy_profiles, shared_comparison
from app.session.catalog import Choice
from streamdash.naming import class_names
from streamdash.observe.wording import percent
from streamdash.plots import pdf, story
from streamdash.plots.live import Backend, Columns
from streamdash.statistics.held_out import held_out
from streamdash.survey.story import deviations, pieces, stars_per_bin

EQUAL = 0.5
"""Shares (%) that differ by less are equal, as far as a few thousand streams can tell."""
STARS = (100, 1_000, 10_000, 100_000)
"""Numbers of stars per bin to choose from."""


class EvidenceStep(Step):
    """PDF(Qρ) and the Bayes factor."""

    title = "Weighing the evidence"
    uses = frozenset({"noise", "n_bin", "exclude"})
    by_class = True
    legend = (
        ("line", "median of the streams"),
        ("band", "68 % of them"),
        ("band-grey", "bins that do not count"),
    )

    def compute(self) -> None:
        self.data = shared_comparison(self.services, self.session)

    def controls(self) -> list[Viewable]:
        return [ui.noise_slider(self.page)]

    def draw(self, backend: Backend) -> hv.Overlay:
        return pdf.draw(self.data, self.session.configs, backend, None)

    def columns(self) -> Columns:
        columns = dict(pdf.columns(self.data, 0))
        del columns[pdf.SELECTED]
        return columns

    def ranges(self) -> Ranges:
        frame = pdf.frame(self.data)
        return frame["x"], frame["y"]

    def text(self) -> str:
        evidence, last = self.data.evidence, self.data.n_models - 1
        both = (evidence.cumulative(0, 0, last).value, evidence.cumulative(last, last, 0).value)
        light, heavy = self._right()
        right = percent(light / 100), percent(heavy / 100)
        return evidence_text(self.light, self.heavy, self.colours, right, both, self.session.n_bin)

    question = "Of which are we surer: that light objects hit a stream, or heavy ones?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "light ones", "heavy ones", "equally sure"

    def outcome(self) -> Outcome:
        light, heavy = self._right()
        right = 2 if abs(light - heavy) < EQUAL else 0 if light > heavy else 1
        return Outcome(
            right,
            f"Put right are {percent(light / 100)} of the streams hit by the lightest and "
            f"{percent(heavy / 100)} of "
            "those hit by the heaviest.",
        )

    def _right(self) -> tuple[float, float]:
        """Percent of the streams of the lowest and the highest range that their PDF alone puts right."""
        session, services = self.session, self.services
        ends = (self.choices[0], self.choices[-1])

        def judge() -> tuple[float, float]:
            q = noisy_profiles(services, ends, session.noise)
            light, heavy = held_out(q[0], q[1], session.n_bin)
            return 100 * light.right, 100 * heavy.right

        key = ("story held out", ends[0].key, ends[1].key, session.noise, session.n_bin)
        return services.shared(key, judge)

    def sentence(self) -> str:
        return pdf.sentence(self.data, self.session.configs)

    def table(self) -> pd.DataFrame:
        return pdf.table(self.data, self.session.configs)

    def call(self) -> tuple[str, str, str]:
        session = self.session
        return (
            "pdf",
            "pdf_figure",
            f', ensembles, noise={session.noise:g}, n_bin={session.n_bin}, rules="{session.exclude}"',
        )

    def links(self) -> list[Link]:
        return [
            ("The Evidence page: ln B of every bin, and the paper’s table", {"page": "evidence"}),
            ("The PDF page: look into a bin", {"page": "pdf"}),
        ]


class QuestionStep(Step):
    """What it would take to see primordial black holes."""

    title = "Could we see primordial black holes?"
    uses = frozenset({"noise"})
    ink = (story.NOISE,)
    by_class = True
    legend = (
        ("line-dots", "median; bars: 68 % of the streams"),
        ("dashes-ink", "shot noise"),
    )

    def compute(self) -> None:
        self.width = self.services.observed(self.choices).design.step
        deviation = [self._deviations(choice) for choice in self.choices]
        self.data = pieces(deviation, self.session.noise, self.width)

    question = "How many stars must be counted in every bin to see the lightest objects bin by bin?"

    @property
    def answers(self) -> tuple[str, ...]:
        return tuple(f"about {number:,}" for number in STARS)

    def outcome(self) -> Outcome:
        single = float(self.data.deviation[0, 1, 0])
        need = stars_per_bin(single)
        right = int(np.abs(np.log(np.array(STARS) / need)).argmin())
        return Outcome(
            right,
            f"Their ups and downs are {single:.2g} of the density, so σ_ε must be no more: {need:,.0f} "
            "stars.",
            {"noise": round(single, 3)},
        )

    def _deviations(self, choice: Choice) -> np.ndarray:
        key = ("deviations", choice.key)
        return self.services.shared(key, lambda: deviations(self.services.observed([choice]).q[0]))

    def controls(self) -> list[Viewable]:
        return [ui.noise_slider(self.page)]

    def draw(self, backend: Backend) -> hv.Overlay:
        return story.draw_pieces(self.data, self.configs, backend)

    def columns(self) -> Columns:
        return story.pieces_columns(self.data)

    def text(self) -> str:
        single = float(self.data.deviation[0, 1, 0])
        return question_text(
            self.light,
            self.heavy,
            self.colours,
            self.session.noise,
            (self.data.visible_from(0), self.data.visible_from(len(self.choices) - 1)),
            single,
            self.width,
            (stars_per_bin(single), stars_per_bin(self.session.noise)),
        )

    def sentence(self) -> str:
        parts = [
            f"{choice.label}: {self.data.deviation[i, 1, 0]:.2g}" for i, choice in enumerate(self.choices)
        ]
        return (
            f"Typical distance of Qρ from 1 in single bins: {'; '.join(parts)}; shot noise: "
            f"{self.session.noise:g}. In pieces of {self.data.width[-1]:.0f}° the noise is down to "
            f"{self.data.noise[-1]:.2g}."
        )

    def table(self) -> pd.DataFrame:
        return story.pieces_table(self.data, class_names([choice.config for choice in self.choices]))

    def call(self) -> tuple[str, str, str]:
        return "story", "pieces_figure", f", ensembles, noise={self.session.noise:g}"

    def links(self) -> list[Link]:
        return [
            ("The Spectrum page: ups and downs of every size against noise", {"page": "spectrum"}),
            ("The Classifier page: how well a program tells the masses apart", {"page": "classifier"}),
        ]
