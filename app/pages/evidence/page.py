"""Evidence page: ln B per bin, the cumulative table beside the paper's, and whether it has converged."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.evidence.parts import STYLE, evidence_table
from app.services.comparison import choice_key, shared_comparison
from app.session.catalog import PAPER_RANGES, of_paper
from app.session.listing import code_head, ensembles_code
from app.work import pieces
from app.work.later import Later
from streamdash.naming import class_labels
from streamdash.paths import DOCS
from streamdash.plots import cumulative, evidence, pdf
from streamdash.plots.answers import evidence_answer
from streamdash.plots.live import LiveFigure
from streamdash.plots.pdf import frame
from streamdash.statistics.evidence import RULES
from streamdash.statistics.evidence_growth import Growth
from streamdash.statistics.evidence_noise import AgainstNoise

LEGEND = (
    ("line", "above: median of PDF(Qρ)"),
    ("band", "68 % of the streams"),
    ("bars", "ln B against that class; bars: spread over 10–500 bins of y"),
    ("band-grey", "excluded: too few samples, or, by the paper’s rule, far from the peak"),
    ("dashes-grey", "|ln B| = 1, 2.5, 5: weak, moderate, strong"),
)
WAITING = "Computing …"
PDF_HEIGHT = "clamp(170px, calc(40vh - 150px), 300px)"
LN_B_HEIGHT = "clamp(240px, calc(60vh - 250px), 420px)"
"""Of the two figures that share their axis of Qρ."""
AXIS_PX = 60
"""Room for the labels of both vertical axes, so that one lies over the other."""
DIFFERENCES = DOCS / "differences.md"


class EvidencePage(Page):
    """Bayes factors of 2 to 4 mass ranges for the fiducial that is chosen."""

    key, title, group = "evidence", "Evidence", "Explore"
    question = "How strongly would a stream of one mass range speak against the others?"
    uses = frozenset({"noise", "n_bin", "fiducial", "exclude", "focus", "theme"})

    def view(self) -> Viewable:
        self.opening = ui.Opening(self.question)
        self.data = shared_comparison(self.services, self.session)
        self.tables: list[dict[str, Any]] = []
        self.curves: dict[int, Growth] = {}
        self.dimmed = False
        self.live_chart: LiveFigure | None = None
        self.live_growth: LiveFigure | None = None
        self.later_table = Later(self.services, self._show_table, self._fail_table)
        self.later_growth = Later(self.services, self._show_growth, self._fail_growth)
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.table_pane = ui.Html(WAITING, stylesheets=[STYLE], css_classes=["sd-table-1"])
        self.chart = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.noise_curves: dict[int, AgainstNoise] = {}
        self.live_noise: LiveFigure | None = None
        self.later_noise = Later(self.services, self._show_noise, self._fail_noise)
        self.noise_slot = pn.Column(ui.plain_text(WAITING), sizing_mode=ui.WIDE, margin=0)
        self.growth_slot = pn.Column(ui.plain_text(WAITING), sizing_mode=ui.WIDE, margin=0)
        self._make_cards()
        self._draw()
        self._ask()
        classes = [ui.class_heading(i, self.session.ensembles) for i in range(len(self.session.ensembles))]
        return ui.page_layout(
            ui.controls(*classes),
            self.card.view,
            self.table_card.view,
            self.noise_card.view,
            self.growth_card.view,
            *_differences(),
            opening=self.opening,
            panel=self._controls(),
        )

    @property
    def fiducial(self) -> int:
        """The model data are assumed to come from."""
        return min(self.session.fiducial, len(self.session.ensembles) - 1)

    @property
    def is_paper(self) -> bool:
        """Whether the classes are the paper's two, so that its table can stand beside ours."""
        chosen = self.session.configs
        return tuple(c.population.label for c in chosen) == PAPER_RANGES and of_paper(chosen)

    def update(self, changed: frozenset[str]) -> None:
        for live in (self.live_chart, self.live_noise):
            if "theme" in changed and live is not None:
                live.set_ink(self.session.dark)
        if "noise" in changed and self.live_noise is not None:
            ends = self.live_noise.figure.y_range
            self.live_noise.patch(evidence.noise_columns(self.session.noise, (ends.start, ends.end)))
        if "focus" in changed:
            ui.show_bands(self, self.live_pdf)
        if changed <= {"theme", "focus"}:
            return
        if changed & {"noise", "n_bin", "exclude"}:
            self.data = shared_comparison(self.services, self.session)
        if "fiducial" in changed:
            self._draw()
            self.live_chart = self.live_growth = None  # other models, other lines
            self.growth_slot[:] = [ui.plain_text(WAITING)]
            if self.tables:
                self._show_table(self.tables)
        else:
            self.live.patch(evidence.columns(self.data, self.fiducial))
            self.live.move(frame(self.data)["x"], evidence.y_frame(self.data, self.fiducial))
            shown = pdf.columns(self.data, 0)
            self.live_pdf.patch({label: shown[label] for label in shown if label in self.live_pdf.sources})
            self.live_pdf.move(y=frame(self.data)["y"])
        self._say()
        self._ask(table=bool(changed & {"noise", "exclude"}))

    def close(self) -> None:
        self.later_table.cancel()
        self.later_growth.cancel()
        self.later_noise.cancel()
        super().close()

    def code(self) -> str:
        """Lines of Python that make the figure of ln B as it is now."""
        session = self.session
        return (
            f"{code_head(session.ensembles, 'evidence', 'evidence_figure')}"
            "figure = evidence_figure(\n"
            f"    Cache.default(), ensembles, fiducial={self.fiducial}, "
            f'noise={session.noise:g}, n_bin={session.n_bin}, rules="{session.exclude}"\n'
            ")\n"
            'Path("evidence.png").write_bytes(export(figure, "png"))\n'
        )

    def code_table(self) -> str:
        """Lines of Python that compute the cumulative table as it is now."""
        session = self.session
        return (
            f"{_code_profiles(session)}"
            "from streamdash.statistics.cumulative import cumulative_tables\n"
            "from streamdash.statistics.evidence import RULES\n\n"
            "tables = cumulative_tables(\n"
            f'    profiles, noise={session.noise:g}, rules=RULES["{session.exclude}"],\n'
            f"    redraw=lambda number: streams.noisy({session.noise:g}, number),\n"
            ")\n"
            "for table in tables:\n"
            '    for pair in table["pairs"]:\n'
            '        print(table["n_bin"], pair["i"], pair["j"], pair["sum"], pair["joint"], pair["word"])\n'
        )

    def code_growth(self) -> str:
        """Lines of Python that compute the growth of Σ ln B with the streams as it is now."""
        session, others = self.session, evidence.others(self.data, self.fiducial)
        return (
            f"{_code_profiles(session)}"
            "from streamdash.statistics.evidence import RULES, measured_evidence\n"
            "from streamdash.statistics.evidence_growth import growth\n\n"
            f'rules = RULES["{session.exclude}"]\n'
            f"pdfs, evidence = measured_evidence(profiles, {session.noise:g}, {session.n_bin}, rules)\n"
            f"for j in {others}:\n"
            f"    print(growth(pdfs, evidence, {self.fiducial}, j))\n"
        )

    def code_noise(self) -> str:
        """Lines of Python that compute Σ ln B at several noises as it is now."""
        session = self.session
        return (
            "from streamdash.statistics.evidence import RULES\n"
            "from streamdash.statistics.evidence_noise import against_noise\n"
            "from streamdash.store.cache import Cache\n"
            "from streamdash.survey.observed import ObservedStreams\n\n"
            f"{ensembles_code(session.ensembles)}"
            "streams = ObservedStreams.read(Cache.default(), ensembles)\n"
            f'rules = RULES["{session.exclude}"]\n'
            f"curves = against_noise(streams.noisy, {session.n_bin}, rules, {self.fiducial})\n"
            "for j, curve in curves.items():\n"
            "    print(j, curve)\n"
        )

    # ------------------------------------------------------------ building

    def _controls(self) -> Viewable:
        fiducials = {f"M{i}": i for i in range(len(self.session.ensembles))}
        self.session.fiducial = self.fiducial
        return ui.side_panel(
            [ui.noise_slider(self), ui.toggle(self, "fiducial", "Fiducial model", fiducials)],
            [
                ui.stream_picker(self),
                ui.ensemble_picker(self),
                ui.int_slider(self, "n_bin", "Bins of Qρ"),
                ui.toggle(self, "exclude", "Bins of Qρ that count"),
                *ui.band_picker(self),
            ],
        )

    def _make_cards(self) -> None:
        chosen = self.session.configs
        self.card = ui.FigureCard(
            "PDF(Qρ) and ln B of every bin",
            self.slot,
            name="evidence",
            page=self,
            drawn=lambda: (pdf.draw(self.data, self.session.configs, "matplotlib") + self._figure()).cols(1),
            table=lambda: evidence.table(self.data, self.fiducial, self.session.configs),
            code=self.code,
            legend=ui.legend(LEGEND, chosen),
        )
        self.table_card = ui.FigureCard(
            "Cumulative evidence",
            # Side by side where all columns of the table have room.
            ui.figure_grid([self.table_pane, self.chart], narrowest=560),
            name="cumulative",
            page=self,
            drawn=lambda: self._cumulative("matplotlib"),
            table=lambda: cumulative.table(self.tables, self.session.configs, self.is_paper),
            code=self.code_table,
            legend=ui.legend(
                (
                    ("line-dots", "sum over bins, ± its error"),
                    ("dashes", "all bins together, correlations included"),
                    *((("cross", "paper, table 1"),) if self.is_paper else ()),
                ),
                chosen,
            ),
        )
        self.noise_card = ui.FigureCard(
            "Up to which noise? Σ ln B against the shot noise",
            self.noise_slot,
            name="noise",
            page=self,
            drawn=lambda: evidence.draw_noise(
                self.noise_curves, self.session.configs, self.session.noise, "matplotlib"
            ),
            table=lambda: evidence.noise_table(self.noise_curves, self.fiducial),
            code=self.code_noise,
            legend=ui.legend(
                (("line-dots", "Σ ln B against that class, ± its error"), ("dashes-ink", "the noise chosen")),
                chosen,
            ),
        )
        self.growth_card = ui.FigureCard(
            "Has it converged? Σ ln B from ever more simulated streams",
            self.growth_slot,
            name="growth",
            page=self,
            drawn=lambda: evidence.draw_growth(self.curves, self.session.configs, "matplotlib"),
            table=lambda: evidence.growth_table(self.curves, self.fiducial),
            code=self.code_growth,
            legend=ui.legend(
                (("line-dots", "Σ ln B against that class; bars: scatter between separate sets"),), chosen
            ),
        )

    def _draw(self) -> None:
        """A new figure of ln B, for another fiducial."""
        chosen = self.session.configs
        self.live = LiveFigure(evidence.draw(self.data, self.fiducial, chosen, "bokeh"))
        self.live_pdf = LiveFigure(pdf.draw(self.data, chosen, "bokeh", None))
        # One axis of Qρ: what is seen above at a density speaks below it.
        self.live_pdf.figure.x_range = self.live.figure.x_range
        self.live_pdf.figure.below[0].axis_label = None
        for figure in (self.live.figure, self.live_pdf.figure):
            figure.min_border_left = AXIS_PX
        ui.show_bands(self, self.live_pdf)
        self.slot[:] = [
            ui.figure_pane(self.live_pdf.figure, PDF_HEIGHT),
            ui.figure_pane(self.live.figure, LN_B_HEIGHT),
        ]
        self._say()

    def _say(self) -> None:
        chosen = self.session.configs
        self.opening.say(evidence_answer(self.data, self.fiducial, chosen))
        self.card.say(evidence.sentence(self.data, self.fiducial, chosen))

    # ------------------------------------------------------------ slow results

    def _ask(self, table: bool = True) -> None:
        """Have the table and the growth computed once the controls rest."""
        session, services = self.session, self.services
        choices, noise, n_bin, fiducial = session.ensembles, session.noise, session.n_bin, self.fiducial
        rules = RULES[session.exclude]
        key = choice_key(session)

        if table:
            if self.tables and not self.dimmed:  # once, not at every step of a slider
                self._write_table(waiting=True)
            self.later_table.ask(
                partial(pieces.tables_of, services, choices, noise, rules), key=("cumulative", *key)
            )
        if self._noise_key() != self._noise_asked:  # the same at every noise
            self._noise_asked = self._noise_key()
            self.later_noise.ask(
                partial(pieces.against_noise_of, services, choices, n_bin, rules, fiducial),
                key=self._noise_asked,
            )
        self.later_growth.ask(
            partial(pieces.growth_of, services, choices, noise, n_bin, rules, fiducial),
            key=("growth", n_bin, fiducial, *key),
        )

    def _show_table(self, tables: list[dict[str, Any]]) -> None:
        self.tables = tables
        self._write_table(waiting=False)
        if self.live_chart is None:
            crosses = tuple(f"paper {j}" for j in cumulative.rivals(tables, self.fiducial))
            self.live_chart = LiveFigure(self._cumulative("bokeh"), ink=crosses)
            self.live_chart.set_ink(self.session.dark)
            self.chart[:] = [ui.figure_pane(self.live_chart.figure)]
        else:
            self.live_chart.patch(cumulative.columns(tables, self.fiducial, self.is_paper))
            self.live_chart.move(y=cumulative.y_frame(tables, self.fiducial, self.is_paper))
        self.table_card.say(cumulative.sentence(tables, self.fiducial, self.session.configs))

    def _write_table(self, waiting: bool) -> None:
        self.dimmed = waiting
        shown = range(2) if len(self.session.ensembles) == 2 else [self.fiducial]
        table = evidence_table(self.tables, self.session.configs, shown, self.is_paper, waiting)
        self.table_pane.write(table)

    def _fail_table(self, sentence: str) -> None:
        self.live_chart = None
        self.chart[:] = [ui.error_state(sentence)]
        self.table_card.say("")

    _noise_asked: tuple = ()

    def _noise_key(self) -> tuple:
        keys, _, exclude = choice_key(self.session)
        return ("against noise", self.session.n_bin, self.fiducial, keys, exclude)

    def _show_noise(self, curves: dict[int, AgainstNoise]) -> None:
        session = self.session
        self.noise_curves = curves
        overlay = evidence.draw_noise(curves, session.configs, session.noise, "bokeh")
        self.live_noise = LiveFigure(overlay, ink=(evidence.NOW,))
        self.live_noise.set_ink(session.dark)
        self.noise_slot[:] = [ui.figure_pane(self.live_noise.figure)]
        self.noise_card.say(evidence.noise_sentence(curves, self.fiducial))

    def _fail_noise(self, sentence: str) -> None:
        self.live_noise = None
        self.noise_slot[:] = [ui.error_state(sentence)]
        self.noise_card.say("")

    def _show_growth(self, curves: dict[int, Growth]) -> None:
        self.curves = curves
        if self.live_growth is None:
            self.live_growth = LiveFigure(evidence.draw_growth(curves, self.session.configs, "bokeh"))
            figure = self.live_growth.figure
            self.growth_slot[:] = [ui.figure_pane(figure)]
        else:
            self.live_growth.patch(evidence.growth_columns(curves))
            self.live_growth.move(y=evidence.growth_frame(curves)[1])
        self.growth_card.say(evidence.growth_sentence(curves, self.fiducial, self.session.n_bin))

    def _fail_growth(self, sentence: str) -> None:
        self.live_growth = None
        self.growth_slot[:] = [ui.error_state(sentence)]
        self.growth_card.say("")

    def _figure(self) -> Any:
        title = f"fiducial {class_labels(self.session.configs)[self.fiducial]}"
        return evidence.draw(self.data, self.fiducial, self.session.configs, "matplotlib", title)

    def _cumulative(self, backend: Any) -> Any:
        return cumulative.draw(self.tables, self.fiducial, self.session.configs, backend, paper=self.is_paper)


def _differences() -> list[Viewable]:
    """The text that `streamdash reproduce --text` wrote, where this checkout has it."""
    if not DIFFERENCES.is_file():
        return []
    heading, _, text = DIFFERENCES.read_text(encoding="utf-8").partition("\n")
    return [ui.document(heading.lstrip("# "), text, "differences")]


def _code_profiles(session: Any) -> str:
    """Lines that read the chosen ensembles and add their noise."""
    return (
        "from streamdash.store.cache import Cache\n"
        "from streamdash.survey.observed import ObservedStreams\n\n"
        f"{ensembles_code(session.ensembles)}"
        "streams = ObservedStreams.read(Cache.default(), ensembles)\n"
        f"profiles = streams.noisy({session.noise:g})\n"
    )
