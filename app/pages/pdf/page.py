"""PDF page: how often each Qρ occurs, per class, and one of its bins looked into (paper figs. 3–4)."""

from __future__ import annotations

import weakref
from typing import Any

from bokeh.events import Tap
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.services.comparison import shared_comparison
from app.session.listing import code_head
from streamdash.plots import pdf
from streamdash.plots.answers import pdf_answer
from streamdash.plots.live import LiveFigure
from streamdash.statistics.evidence import Comparison

LEGEND = (
    ("line", "median over streams, in class colour"),
    ("band", "68 % of the streams"),
    ("band-grey", "bins that do not count for the evidence"),
    ("frame", "the bin looked into: click another, or move Bin α"),
)


class PdfPage(Page):
    """PDF(Qρ) of 2 to 4 mass ranges; a click on a bin α shows Π(y_α|M)."""

    key, title, group = "pdf", "PDF", "Explore"
    question = "How often does each density occur, and which densities tell the mass ranges apart?"
    uses = frozenset({"noise", "n_bin", "alpha", "exclude", "focus", "theme"})

    def view(self) -> Viewable:
        self.opening = ui.Opening(self.question)
        self.data: Comparison = shared_comparison(self.services, self.session)
        chosen = self.session.configs
        self.live = LiveFigure(pdf.draw(self.data, chosen, "bokeh", self.selected), ink=(pdf.SELECTED,))
        self.live_y = LiveFigure(pdf.draw_y(self.data, self.selected, chosen, "bokeh"))
        self.live.set_ink(self.session.dark)
        ui.show_bands(self, self.live)
        self._listen()
        self.slider = ui.number_slider("Bin α", 1, self.n_bin, self.selected + 1, "alpha")
        self.slider.param.watch(self._slid, "value")
        classes = [ui.class_heading(i, self.session.ensembles) for i in range(len(self.session.ensembles))]
        self.card = ui.FigureCard(
            "PDF of Qρ along a stream",
            self.live.figure,
            name="pdf",
            page=self,
            drawn=lambda: pdf.draw(self.data, self.session.configs, "matplotlib"),
            table=lambda: pdf.table(self.data, self.session.configs),
            code=self.code,
            legend=ui.legend(LEGEND, chosen),
        )
        self.card_y = ui.FigureCard(
            "One bin: Π(y_α|M) over the streams",
            self.live_y.figure,
            name="pdf-bin",
            page=self,
            drawn=lambda: self._y_figure(),
            table=lambda: pdf.y_table(self.data, self.selected, self.session.configs),
            code=self.code_y,
            legend=ui.legend((("band", "distribution of y_α, in class colour"),), chosen),
        )
        self._say()
        return ui.page_layout(
            ui.controls(*classes),
            ui.figure_grid([self.card.view, self.card_y.view], narrowest=420),
            opening=self.opening,
            panel=self._controls(),
        )

    @property
    def n_bin(self) -> int:
        """Number of bins shown."""
        return len(self.data.edges) - 1

    @property
    def selected(self) -> int:
        """The bin looked into, counted from 0."""
        alpha = self.session.alpha
        return min(alpha, self.n_bin) - 1 if alpha else self.data.bin_at(1.0)

    def update(self, changed: frozenset[str]) -> None:
        if "theme" in changed:
            self.live.set_ink(self.session.dark)
        if "focus" in changed:
            ui.show_bands(self, self.live)
        if changed & {"noise", "n_bin", "exclude"}:
            self._recompute(keep_place="n_bin" in changed and "alpha" not in changed)
        elif "alpha" in changed:
            self.live.patch(pdf.selected_columns(self.data, self.selected))
            self._patch_y()
        self.slider.param.update(end=self.n_bin, value=self.selected + 1)

    def code(self) -> str:
        """Lines of Python that make the figure of PDF(Qρ) as it is now."""
        session = self.session
        return (
            f"{code_head(session.ensembles, 'pdf', 'pdf_figure')}"
            "figure = pdf_figure(\n"
            f"    Cache.default(), ensembles, noise={session.noise:g}, n_bin={session.n_bin}, "
            f'rules="{session.exclude}"\n'
            ")\n"
            'Path("pdf.png").write_bytes(export(figure, "png"))\n'
        )

    def code_y(self) -> str:
        """Lines of Python that make the figure of Π(y_α|M) as it is now."""
        session = self.session
        return (
            f"{code_head(session.ensembles, 'pdf', 'y_figure')}"
            "figure = y_figure(\n"
            f"    Cache.default(), ensembles, q={self.data.centers[self.selected]:.6g}, "
            f'noise={session.noise:g}, n_bin={session.n_bin}, rules="{session.exclude}"\n'
            ")\n"
            'Path("pdf-bin.png").write_bytes(export(figure, "png"))\n'
        )

    # ------------------------------------------------------------ inside

    def _controls(self) -> Viewable:
        return ui.side_panel(
            [ui.noise_slider(self), ui.int_slider(self, "n_bin", "Bins of Qρ")],
            [ui.stream_picker(self), ui.ensemble_picker(self), self.slider, *ui.band_picker(self)],
        )

    def _recompute(self, keep_place: bool) -> None:
        place = self.data.centers[self.selected]
        self.data = shared_comparison(self.services, self.session)
        if keep_place and self.session.alpha:
            # The same Qρ has another number among other bins.
            self.session.alpha = self.data.bin_at(place) + 1
        self.live.patch(pdf.columns(self.data, self.selected))
        ranges = pdf.frame(self.data)
        self.live.move(ranges["x"], ranges["y"])
        self._patch_y()

    def _patch_y(self) -> None:
        self.live_y.patch(pdf.y_columns(self.data, self.selected))
        ranges = pdf.y_frame(self.data, self.selected)
        self.live_y.move(ranges["x"], ranges["y"])
        self._say()

    def _say(self) -> None:
        chosen = self.session.configs
        self.opening.say(pdf_answer(self.data, chosen))
        self.card.say(pdf.sentence(self.data, chosen))
        self.card_y.say(pdf.y_sentence(self.data, self.selected, chosen))

    def _y_figure(self) -> Any:
        title = f"α = {self.selected + 1}"
        return pdf.draw_y(self.data, self.selected, self.session.configs, "matplotlib", title)

    def _listen(self) -> None:
        """Hear clicks on the figure, without keeping the page alive: Bokeh never forgets a listener."""
        tapped = weakref.WeakMethod(self._tapped)

        def hear(event: Tap) -> None:
            method = tapped()
            if method is not None:
                method(event)

        self.live.figure.on_event(Tap, hear)

    def _tapped(self, event: Tap) -> None:
        low, high = self.data.edges[[0, -1]]
        if event.x is not None and low <= event.x <= high:
            self.session.alpha = self.data.bin_at(event.x) + 1

    def _slid(self, event: Any) -> None:
        if event.new != self.selected + 1:
            self.session.alpha = event.new
