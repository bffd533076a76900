"""Steps of the story about streams and evidence: what each computes, draws, says and links to."""

from __future__ import annotations

import holoviews as hv
import numpy as np
import pandas as pd
from panel.viewable import Viewable

from app import ui
from app.pages.learn.judging import EvidenceStep, QuestionStep
from app.pages.learn.mass import mass_slider
from app.pages.learn.mystery import MysteryStep, OddsStep, OrbitsStep, SolvedStep
from app.pages.learn.predict import Outcome
from app.pages.learn.step import Link, Ranges, Step
from app.pages.learn.text import (
    gap_text,
    many_text,
    noise_text,
    stream_text,
)
from streamdash import streams
from streamdash.engine.flyby import kick_along_stream
from streamdash.engine.galpy_streams import time_unit_gyr
from streamdash.naming import class_names
from streamdash.plots import flyby as flyby_plot
from streamdash.plots import flyby_words, story
from streamdash.plots.live import Backend, Columns
from streamdash.survey.flyby import struck
from streamdash.survey.story import stars_per_bin, track


class StreamStep(Step):
    """What a stellar stream is."""

    title = "A stream of stars"
    legend = (("dots-grey", "the stream: the thicker, the more stars"), ("dots-hand", "the progenitor"))

    def compute(self) -> None:
        self.track = track(self.geometry)

    def draw(self, backend: Backend) -> hv.Overlay:
        return story.draw_track(self.track, backend)

    question = "Which stars left the cluster first?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "those next to it", "those at the far end"

    def outcome(self) -> Outcome:
        drift, length = self.geometry.mean_omega / time_unit_gyr(), self.geometry.length
        return Outcome(
            1,
            f"Stars drift away at {drift:.2g} rad per billion years on average; {length:.2f} rad take about "
            f"{length / drift:.0f} billion years.",
        )

    def text(self) -> str:
        distance, drift = self.track.distance, self.geometry.mean_omega / time_unit_gyr()
        return stream_text(
            streams.stream_text(self.stream),
            self.stream.arm == "leading",
            streams.stream_of(self.stream).frame.longitude_symbol,
            streams.bins_of(self.stream).coordinate == "ell",
            self.stream.age_gyr,
            self.track.sky_length,
            float(distance.min()),
            float(distance.max()),
            drift,
            self.geometry.length,
        )

    def sentence(self) -> str:
        ell, b = self.track.ell, self.track.b
        return (
            f"The undisturbed stream on the sky today, from the progenitor at ℓ = {ell[0]:.0f}°, "
            f"latitude {b[0]:.0f}°, to ℓ = {ell[-1]:.0f}°, latitude {b[-1]:.0f}°, where its density has "
            f"fallen to {100 * self.track.density[-1]:.0f} %."
        )

    def table(self) -> pd.DataFrame:
        return story.track_table(self.track)

    def call(self) -> tuple[str, str, str]:
        return "story", "track_figure", self.stream_argument()

    def links(self) -> list[Link]:
        return [("See its density on the Profiles page", {"page": "profiles", "y": "rho", "highlight": 0})]


class GapStep(Step):
    """One fly-by opens a gap."""

    title = "Something dark flies past"
    uses = frozenset({"mass10"})
    ink = (flyby_plot.NOW,)
    legend = (
        ("image", "the stream today"),
        ("line-ink", "its density"),
        ("dashes-grey", "without the fly-by"),
        ("dots-hand", "the stars that were hit"),
    )

    def compute(self) -> None:
        self.flyby = self.session.chosen[-1]
        key = ("story gap", self.stream.key, self.flyby)
        self.film = self.services.shared(key, lambda: story.two_frames(self.geometry, self.flyby))
        self.marks = struck(self.geometry, [self.flyby], self.film.time_gyr)

    def controls(self) -> list[Viewable]:
        return [mass_slider(self.page)]

    def draw(self, backend: Backend) -> hv.Overlay:
        return flyby_plot.draw_density(self.film, self.marks, -1, backend)

    def columns(self) -> Columns:
        return flyby_plot.density_columns(self.film, self.marks, -1)

    def ranges(self) -> Ranges:
        return (0.0, float(self.film.theta[-1])), (0.0, flyby_plot.film_tops(self.film)[0])

    def text(self) -> str:
        flyby, geometry = self.flyby, self.geometry
        k = flyby.time_index(geometry)
        return gap_text(
            flyby_words.mass_words(flyby.mass_msun),
            flyby_words.length_words(flyby.r_s_kpc),
            flyby_words.length_words(flyby.b * flyby.r_s_kpc),
            flyby_words.star_speed(geometry, flyby),
            float(np.abs(kick_along_stream(geometry, flyby).dv_along).max()),
            geometry.stream.impact_times_gyr[k],
            100 * (1 - float(np.nanmin(self.film.q_rho[-1]))),
        )

    question = "Make the object ten times as heavy. How many stars are missing at the emptiest place?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "about as many", "more, but not ten times as many", "ten times as many"

    def outcome(self) -> Outcome:
        _, heaviest = self.session.param["mass10"].bounds
        now = self.session.mass10
        more = now + 1 if now + 1 <= heaviest else now - 1
        shares = {}
        for mass10 in (min(now, more), max(now, more)):
            flyby = self.flyby.model_copy(update={"log10_mass": mass10})
            shares[mass10] = 1 - float(np.nanmin(story.two_frames(self.geometry, flyby).q_rho[-1]))
        small, large = shares.values()
        ratio = large / small if small > 0 else np.inf
        right = 0 if ratio < 1.2 else 1 if ratio < 8 else 2
        return Outcome(
            right,
            f"{100 * small:.0f} % are missing for the lighter of the two, {100 * large:.0f} % for the "
            "one that is "
            "ten times as heavy: a place can lose no more stars than it has, and so the gap grows wider "
            "instead.",
            {"mass10": more},
        )

    def sentence(self) -> str:
        return flyby_words.film_sentence(self.film, -1)

    def table(self) -> pd.DataFrame:
        return flyby_words.film_table(self.film)

    def call(self) -> tuple[str, str, str]:
        values = ", ".join(f"{field}={value:g}" for field, value in self.flyby)
        return "story", "gap_figure", f", Flyby({values}){self.stream_argument()}"

    def links(self) -> list[Link]:
        return [("Play with it: one fly-by, frame by frame", {"lesson": "flyby", "flybys": [], "crowd": 0})]


class ManyStep(Step):
    """Many fly-bys make a pattern."""

    title = "Not one, but many"
    question = "Draw ten streams of each kind. Whose ups and downs are larger?"
    uses = frozenset({"seed"})
    by_class = True
    legend: tuple[tuple[str, str], ...] = ()

    @property
    def noise(self) -> float:
        """Shot noise shown: none in this step."""
        return 0.0

    @property
    def answers(self) -> tuple[str, ...]:
        return (
            f"those of {self.choices[0].label}",
            f"those of {self.choices[-1].label}",
            "now these, now those",
        )

    def outcome(self) -> Outcome:
        light, heavy = (q[:: max(1, len(q) // 200)].std(axis=1) for q in (self.qs[0], self.qs[-1]))
        share = float((heavy[:, None] > light[None, :]).mean())
        right = 1 if share > 0.9 else 0 if share < 0.1 else 2
        return Outcome(
            right,
            f"Take one stream of each at random: in {100 * share:.0f} of 100 such pairs the one hit by "
            "the heavier "
            "objects goes up and down more.",
        )

    def compute(self) -> None:
        number, noise = self.session.seed, self.noise
        streams = self.services.observed(self.choices)
        self.design, self.qs = streams.design, streams.q
        self.clean, self.noisy = story.pair(streams, number, noise)

    def controls(self) -> list[Viewable]:
        return [ui.button("Draw others", self._draw_others, css_classes=["sd-draw-others"], margin=(4, 10))]

    def draw(self, backend: Backend) -> hv.Overlay:
        return story.draw_pair(self.design, self.clean, self.noisy, self.noise, self.configs, backend)

    def columns(self) -> Columns:
        return story.pair_columns(self.design, self.clean, self.noisy, self.noise)

    def text(self) -> str:
        keys = [self.choices[0].key, self.choices[-1].key]
        hits = [float(self.services.ensemble(key)["n_impacts"].mean()) for key in keys]
        size = [float(np.median(q.std(axis=1))) for q in (self.qs[0], self.qs[-1])]
        return many_text(
            self.light,
            self.heavy,
            self.colours,
            (hits[0], hits[1]),
            (size[0], size[1]),
            (len(self.qs[0]), len(self.qs[-1])),
        )

    def sentence(self) -> str:
        parts = [
            f"{choice.label}: {q.min():.2f} to {q.max():.2f}"
            for choice, q in zip(self.choices, self.clean, strict=True)
        ]
        noise = f", dots with shot noise σ_ε = {self.noise:g}" if self.noise else ""
        spans = "; for ".join(parts)
        return f"One simulated stream of each mass range{noise}. Without noise Qρ goes, for {spans}."

    def table(self) -> pd.DataFrame:
        labels = class_names([choice.config for choice in self.choices])
        return story.pair_table(self.design, self.clean, self.noisy, labels)

    def call(self) -> tuple[str, str, str]:
        return "story", "pair_figure", f", ensembles, number={self.session.seed}, noise={self.noise:g}"

    def links(self) -> list[Link]:
        return [
            (
                "See all simulated streams on the Profiles page",
                {"page": "profiles", "y": "q_rho", "noise": 0.0},
            )
        ]

    def _draw_others(self) -> None:
        self.session.advance("seed")


class NoiseStep(ManyStep):
    """The pattern through shot noise."""

    title = "What a telescope counts"
    uses = frozenset({"seed", "noise"})
    legend = (
        ("dots", "with the scatter of counting"),
        ("line", "without"),
    )

    question = "Count four times as many stars. What happens to the noise?"

    @property
    def answers(self) -> tuple[str, ...]:
        return "it falls to a quarter", "it falls to a half", "it stays"

    def outcome(self) -> Outcome:
        noise = self.session.noise
        if noise == 0:
            return Outcome(1, "It goes as one over the root of the number of stars.")
        finer = round(noise / 2, 3)
        stars = stars_per_bin(noise), stars_per_bin(finer)
        return Outcome(
            1,
            f"From σ_ε = {noise:g} with {stars[0]:.0f} stars per bin to {finer:g} with {stars[1]:.0f}: "
            "it goes as "
            "one over the root of the number of stars.",
            {"noise": finer},
        )

    @property
    def noise(self) -> float:
        return self.session.noise

    def controls(self) -> list[Viewable]:
        return [ui.noise_slider(self.page), *super().controls()]

    def text(self) -> str:
        share = [100 * float((np.abs(q - 1) > self.noise).mean()) for q in (self.qs[0], self.qs[-1])]
        return noise_text(
            self.noise,
            stars_per_bin(self.noise),
            self.design.n_bin,
            self.design.step,
            self.light,
            self.heavy,
            self.colours,
            (share[0], share[1]),
        )

    def links(self) -> list[Link]:
        return [("See all streams at this noise on the Profiles page", {"page": "profiles", "y": "q_rho"})]


STEPS: tuple[type[Step], ...] = (
    MysteryStep,
    StreamStep,
    OrbitsStep,
    GapStep,
    ManyStep,
    NoiseStep,
    OddsStep,
    EvidenceStep,
    QuestionStep,
    SolvedStep,
)
"""The story, in order."""
