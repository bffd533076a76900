"""Spectrum page: power, cross and bispectra of each class against the noise (paper, appendix B)."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.spectrum.parts import STYLE, statements_html, statistics_study
from app.services.services import Services
from app.session.catalog import Choice
from app.session.listing import code_head, ensembles_code
from app.session.session import Session
from app.ui.study import StudyCard, study_list
from app.work import pieces
from app.work.later import Later
from streamdash.classifier.data import ClassifierError
from streamdash.config import EnsembleConfig
from streamdash.plots import spectrum
from streamdash.plots.answers import spectrum_answer
from streamdash.plots.live import LiveFigure
from streamdash.statistics.bispectrum import Bispectrum
from streamdash.statistics.spectra_in_noise import Shown, show
from streamdash.statistics.spectrum import NoisySpectra, SpectrumBand, observed_spectra, shot_noise_level
from streamdash.survey.design import Design

LEGEND = (
    ("line", "median over streams, noise included"),
    ("band", "68 % of the streams"),
    ("dashes", "median without noise"),
    ("dashes-grey", "the paper’s 8° and 20°"),
    ("line-ink", "shot noise alone"),
    ("band-grey", "68 % of its draws"),
)
LEGEND_PLAIN = (("line", "median over streams"), ("band", "68 % of the streams"))
PARTS: tuple[spectrum.Part, ...] = ("real", "imaginary")
WAITING = "Computing …"


class SpectrumPage(Page):
    """Spectra of 2 to 4 mass ranges along Galactic longitude, live with the noise."""

    key, title, group = "spectrum", "Spectrum", "Explore"
    question = "On which angular scales do the perturbers rise above the noise?"
    uses = frozenset({"noise", "theme"})

    def __init__(self, session: Session, services: Services, arm: int | None = None) -> None:
        super().__init__(session, services)
        self.arm = arm
        self.opening = ui.Opening(self.question)
        self.arms: list[SpectrumPage] = []

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The ensembles compared; of both arms, those of the one that these figures show."""
        chosen = self.session.ensembles
        return chosen if self.arm is None else tuple(choice.arms[self.arm] for choice in chosen)

    @property
    def configs(self) -> list[EnsembleConfig]:
        """Configurations of `choices`."""
        return [choice.config for choice in self.choices]

    def view(self) -> Viewable:
        """The page; of both arms, the figures of each side by side: there is no power across the gap."""
        arms = self.session.ensembles[0].arms
        self.statistics = self._statistics()
        if arms:
            self.arms = [SpectrumPage(self.session, self.services, i) for i in range(len(arms))]
            columns = [
                pn.Column(
                    ui.heading(f"{arm.config.stream.arm.capitalize()} arm"),
                    *page.cards(),
                    sizing_mode=ui.WIDE,
                )
                for arm, page in zip(arms, self.arms, strict=True)
            ]
            figures: list[Viewable] = [ui.figure_grid(columns, narrowest=420)]
        else:
            figures = self.cards()
        classes = [ui.class_heading(i, self.session.ensembles) for i in range(len(self.session.ensembles))]
        panel = ui.side_panel([ui.noise_slider(self)], [ui.stream_picker(self), ui.ensemble_picker(self)])
        return ui.page_layout(
            ui.controls(*classes),
            *figures,
            *(
                [study_list("Beside other statistics", [self.statistics], "studies")]
                if self.statistics
                else []
            ),
            opening=self.opening,
            panel=panel,
        )

    def cards(self) -> list[Viewable]:
        """The cards of one arm."""
        self.data = self._shown()
        self.bispectra: list[Bispectrum] = []
        chosen = self.configs
        self.live = {
            kind: LiveFigure(spectrum.draw(self.data, chosen, kind, "bokeh"), ink=(spectrum.NOISE,))
            for kind in spectrum.KINDS
        }
        self.live["density"].set_ink(self.session.dark)
        self.live_b: dict[spectrum.Part, LiveFigure] = {}
        self.later = Later(self.services, self._show_bispectra, self._fail)
        self.statements = ui.Html(stylesheets=[STYLE], css_classes=["sd-statements"])
        self.slots = {
            part: pn.Column(ui.plain_text(WAITING), sizing_mode=ui.WIDE, margin=0) for part in PARTS
        }
        self._make_cards()
        self._say()
        self._ask()
        return [self.card.view, self.track_card.view, self.bispectrum_card.view]

    def update(self, changed: frozenset[str]) -> None:
        for page in self.arms or (self,):
            page.renew(changed)
        if "noise" in changed and self.statistics:
            self.statistics.renew()

    def renew(self, changed: frozenset[str]) -> None:
        """Patch the figures of one arm."""
        if "theme" in changed:
            self.live["density"].set_ink(self.session.dark)
        if "noise" in changed:
            self.data = self._shown()
            for kind, live in self.live.items():
                live.patch(spectrum.columns(self.data, kind))
            self._say()
            self._ask()

    def close(self) -> None:
        for page in self.arms or (self,):
            page.later.cancel()
        if self.statistics:
            self.statistics.close()
        super().close()

    # ------------------------------------------------------------ code shown

    def code(self) -> str:
        """Lines of Python that make the figure of the density spectrum as it is now."""
        return self._listing("density")

    def code_track(self) -> str:
        """Lines of Python that make the figure of the cross spectrum as it is now."""
        return self._listing("cross")

    def code_bispectrum(self) -> str:
        """Lines of Python that compute the bispectra as they are now."""
        return (
            "from streamdash.statistics.bispectrum import bispectrum\n"
            "from streamdash.store.cache import Cache\n"
            "from streamdash.survey.observed import ObservedStreams\n\n"
            f"{ensembles_code(self.choices)}"
            "streams = ObservedStreams.read(Cache.default(), ensembles)\n"
            f"for q in streams.noisy({self.session.noise:g}):\n"
            "    found = bispectrum(q, streams.design.step)\n"
            "    print(found.scale_1, found.real.median, found.imaginary.median)\n"
        )

    def _listing(self, kind: str) -> str:
        return (
            f"{code_head(self.choices, 'spectrum', 'spectrum_figure')}"
            f'figure = spectrum_figure(Cache.default(), ensembles, "{kind}", noise={self.session.noise:g})\n'
            f'Path("spectrum-{kind}.png").write_bytes(export(figure, "png"))\n'
        )

    # ------------------------------------------------------------ inside

    @property
    def _suffix(self) -> str:
        """Of the names of cards and files: the arm, where there are both."""
        return "" if self.arm is None else f"-{self.choices[0].config.stream.arm}"

    def _make_cards(self) -> None:
        figure = self.live["density"].figure
        below = pn.Column(pn.pane.Bokeh(figure, sizing_mode=ui.WIDE, margin=0), self.statements, margin=0)
        self.card = ui.FigureCard(
            "Power spectrum of the density",
            # Beside another arm the table has its place under the figure.
            [figure, self.statements] if self.arm is None else below,
            name=f"spectrum{self._suffix}",
            page=self,
            drawn=lambda: self._figure("density"),
            table=lambda: spectrum.table(self.data, self.configs, ["density"]),
            code=self.code,
            legend=ui.legend(LEGEND, self.configs),
        )
        self.track_card = ui.FigureCard(
            "Power spectrum of the track, and cross spectrum with the density",
            [self.live["track"].figure, self.live["cross"].figure],
            name=f"spectrum-track{self._suffix}",
            page=self,
            drawn=lambda: self._figure("track") + self._figure("cross"),
            table=lambda: spectrum.table(self.data, self.configs, ["track", "cross"]),
            code=self.code_track,
            legend=ui.legend(LEGEND_PLAIN, self.configs),
        )
        self.bispectrum_card = ui.FigureCard(
            "Bispectrum of the density",
            list(self.slots.values()),
            name=f"bispectrum{self._suffix}",
            page=self,
            drawn=lambda: self._bispectrum("real") + self._bispectrum("imaginary"),
            table=lambda: spectrum.bispectrum_table(self.bispectra, self.configs),
            code=self.code_bispectrum,
            legend=ui.legend(LEGEND_PLAIN, self.configs),
        )

    def _statistics(self) -> StudyCard | None:
        """The comparison of statistics; None where the chosen ensembles are not classes to tell apart."""
        try:
            study = statistics_study(self.services, self.session)
        except ClassifierError:
            return None
        card = StudyCard(study, self.services.work, self)
        card.renew()
        return card

    def _say(self) -> None:
        chosen = self.configs
        self.statements.write(statements_html(self.data, chosen))
        self.opening.say(spectrum_answer(self.data, chosen))
        self.card.say(spectrum.sentence(self.data, chosen))
        self.track_card.say(spectrum.track_sentence(self.data, chosen))

    def _figure(self, kind: str) -> Any:
        return spectrum.draw(self.data, self.configs, kind, "matplotlib")

    def _bispectrum(self, part: spectrum.Part) -> Any:
        return spectrum.draw_bispectrum(self.bispectra, self.configs, part, "matplotlib")

    # ------------------------------------------------------------ results

    def _shown(self) -> Shown:
        """Bands and statements at the chosen noise, computed once for all sessions."""
        choices, noise = self.choices, self.session.noise

        def compute() -> Shown:
            return show([self._spectra(choice) for choice in choices], self._level(), noise)

        return self.services.shared(("spectra shown", *(choice.key for choice in choices), noise), compute)

    def _spectra(self, choice: Choice) -> NoisySpectra:
        def compute() -> NoisySpectra:
            services = self.services
            geometry = services.geometry(choice.config.stream)
            return observed_spectra(geometry, services.ensemble(choice.key), services.observed([choice]))

        return self.services.shared(("spectra", choice.key), compute)

    def _design(self) -> Design:
        return self.services.observed(self.choices).design

    def _level(self) -> SpectrumBand:
        """√P of shot noise of σ_ε = 1 in these bins."""
        n_bin, step = self._design().n_bin, self._design().step
        return self.services.shared(("noise level", n_bin, step), lambda: shot_noise_level(n_bin, step))

    def _ask(self) -> None:
        """Have the bispectra computed once the slider rests."""
        services, choices, noise = self.services, self.choices, self.session.noise
        step, keys = self._design().step, tuple(choice.key for choice in self.choices)

        compute = partial(pieces.bispectra, services, choices, noise, step)
        self.later.ask(compute, key=("bispectra", *keys, noise))

    def _show_bispectra(self, bispectra: list[Bispectrum]) -> None:
        self.bispectra = bispectra
        chosen = self.configs
        for part, slot in self.slots.items():
            if part in self.live_b:
                self.live_b[part].patch(spectrum.bispectrum_columns(bispectra, part))
            else:
                live = LiveFigure(spectrum.draw_bispectrum(bispectra, chosen, part, "bokeh"))
                self.live_b[part] = live
                slot[:] = [ui.figure_pane(live.figure)]
        self.bispectrum_card.say(spectrum.bispectrum_sentence(bispectra, chosen))

    def _fail(self, sentence: str) -> None:
        self.live_b.clear()
        self.bispectrum_card.say("")
        for slot in self.slots.values():
            slot[:] = [ui.error_state(sentence)]
