"""Profiles page: all simulated profiles of the chosen mass ranges (paper figs. 1–2)."""

from __future__ import annotations

import holoviews as hv
import pandas as pd
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.services.services import Unavailable
from app.session.catalog import Choice
from app.session.listing import ensembles_code
from app.session.session import OWN
from streamdash.plots import profiles
from streamdash.plots.answers import profiles_answer
from streamdash.plots.live import LiveFigure
from streamdash.plots.style import COORDINATE_LABELS, coordinate_label
from streamdash.store.cache import StoreError
from streamdash.streams import SkyFrame, stream_of
from streamdash.survey import bands

INKED = (profiles.MEDIAN, profiles.SMOOTH)
LEGEND = (
    ("image", "all simulated streams"),
    ("band", "68 % of them"),
    ("line-ink", "their median"),
    ("line", "highlighted streams"),
    ("dashes-ink", "smooth stream without perturbers"),
)
REDRAW = frozenset({"x", "y", "scale"})
"""Changes of axes: they need new figures; all others only new data."""


def frame_of(choice: Choice) -> SkyFrame:
    """The stream's own frame of the sky."""
    return stream_of(choice.config.stream).frame


class ProfilesPage(Page):
    """Profiles of 2 to 4 mass ranges as density images, with bands and highlighted streams."""

    key, title, group = "profiles", "Profiles", "Explore"
    question = "What do perturbers of different masses do to the density along a stream?"
    uses = frozenset({"noise", "x", "y", "scale", "highlight", "seed", "theme"})

    height = ui.FIGURE_HEIGHT
    """Height of a panel, in terms of CSS."""

    def prepare(self) -> None:
        """What the page consists of, before anything is drawn."""
        self.opening = ui.Opening(self.question)
        self.live: dict[int, LiveFigure] = {}
        self.panels: list[bands.Bands] = []
        self.grid = pn.Column(sizing_mode=ui.WIDE, margin=0)

    def view(self) -> Viewable:
        self.prepare()
        self.card = ui.FigureCard(
            "Simulated profiles along the stream",
            self.grid,
            name="profiles",
            page=self,
            drawn=lambda: self.layout(),
            table=self.table,
            code=self.code,
            legend=ui.legend(LEGEND, self.session.configs),
        )
        self._draw()
        return ui.page_layout(self.card.view, opening=self.opening, panel=self._controls())

    def update(self, changed: frozenset[str]) -> None:
        if changed & REDRAW:
            self._draw()
            return
        if "theme" in changed:
            for live in self.live.values():
                live.set_ink(self.session.dark)
        if changed - {"theme"}:
            before = [panel.extent for panel in self.panels]
            self.panels = self._compute()
            if before != [panel.extent for panel in self.panels]:  # a scale of its own follows the noise
                self._draw(computed=True)
                return
            for cell, panel in zip(self.cells, self.panels, strict=True):
                self.live[cell].patch(profiles.columns(panel))
            self.say()

    def say(self) -> None:
        """Answer and sentence for what is shown now."""
        self.opening.say(profiles_answer(self.panels))
        self.card.say(profiles.sentence(self.panels))

    def layout(self) -> hv.Layout:
        """The figure as it is now, declared for a file."""
        return profiles.layout(self.panels, "matplotlib")

    def table(self) -> pd.DataFrame:
        """The figure's numbers as they are now."""
        return profiles.table(self.panels)

    def code(self) -> str:
        """Lines of Python that make the figure as it is now."""
        session = self.session
        chosen = [session.ensembles[index] for index in sorted({panel.index for panel in self.panels})]
        axis = frame_of(chosen[0]).longitude if session.x == OWN else session.x
        return (
            "from pathlib import Path\n\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.plots.profiles import profiles_figure\n"
            "from streamdash.store.cache import Cache\n\n"
            f"{ensembles_code(chosen)}"
            "figure = profiles_figure(\n"
            "    Cache.default(),\n"
            "    ensembles,\n"
            f'    quantity="{session.y}",\n'
            f'    coordinate="{axis}",\n'
            f"    noise={session.noise:g},\n"
            f"    highlight={session.highlight},\n"
            f"    seed={session.seed},\n"
            + (f'    scale="{self.scale}",\n' if self.scale != "shared" else "")
            + ")\n"
            'Path("profiles.png").write_bytes(export(figure, "png"))\n'
        )

    @property
    def scale(self) -> str:
        """Vertical scale of the figures."""
        return self.session.scale

    def draw_others(self) -> None:
        """Highlight other random streams."""
        self.session.advance("seed")

    # ------------------------------------------------------------ inside

    def _controls(self) -> Viewable:
        axes = {self._label(name): name for name in COORDINATE_LABELS}
        return ui.side_panel(
            [ui.noise_slider(self)],
            [
                ui.stream_picker(self),
                ui.ensemble_picker(self),
                ui.toggle(self, "y", "Quantity"),
                ui.toggle(self, "x", "Along the stream", axes),
                ui.toggle(self, "scale", "Vertical scale"),
                ui.int_slider(self, "highlight", "Highlighted streams"),
                ui.button("Draw others", self.draw_others, css_classes=["sd-draw-others"], margin=(4, 10)),
            ],
        )

    def _compute(self) -> list[bands.Bands]:
        """Panels of all ensembles that can be read; the others are named in `failures`."""
        session = self.session
        panels, self.failures, self.cells = [], {}, []
        for cell, (index, choice) in enumerate(self._shown()):
            try:
                binned = self._binned(choice, session.y)
            except (StoreError, Unavailable) as error:
                self.failures[cell] = str(error)
                continue
            axis = frame_of(choice).longitude if session.x == OWN else session.x
            chosen = session.noise, session.highlight, session.seed, self.scale
            panels.append(bands.compute(binned, index, axis, *chosen))
            self.cells.append(cell)
        return panels

    def _shown(self) -> list[tuple[int, Choice]]:
        """Number of the class and ensemble of every panel: of both arms, each."""
        return [
            (index, arm)
            for index, choice in enumerate(self.session.ensembles)
            for arm in choice.arms or (choice,)
        ]

    def _label(self, axis: str) -> str:
        """Label of an axis along the stream that is shown."""
        frame = frame_of(self.session.ensembles[0])
        return coordinate_label(frame.longitude if axis == OWN else axis)

    def _binned(self, choice: Choice, quantity: str) -> bands.Binned:
        services = self.services
        return services.shared(
            ("profiles", choice.key, quantity),
            lambda: bands.bin_profiles(
                services.geometry(choice.config.stream),
                services.ensemble(choice.key),
                services.observed([choice]),
                quantity,
            ),
        )

    def _draw(self, computed: bool = False) -> None:
        """New figures, for new axes."""
        if not computed:
            self.panels = self._compute()
        told = zip(self.cells, self.panels, profiles.colours(self.panels), strict=True)
        self.live = {
            cell: LiveFigure(profiles.draw(panel, "bokeh", colour=colour), ink=INKED)
            for cell, panel, colour in told
        }
        cells: list[Viewable] = []
        both = any(choice.arms for choice in self.session.ensembles)
        for cell, (index, choice) in enumerate(self._shown()):
            arm = f"{choice.config.stream.arm} arm" if both else ""
            heading = ui.class_heading(index, self.session.ensembles, arm)
            if cell in self.failures:
                cells.append(pn.Column(heading, ui.error_state(self.failures[cell]), sizing_mode=ui.WIDE))
                continue
            live = self.live[cell]
            live.set_ink(self.session.dark)
            cells.append(ui.figure_cell(heading, live.figure, self.height))
        # As many side by side as there is room for; the two arms of every class stand in a row.
        self.grid[:] = [ui.figure_grid(cells, narrowest=560 if both else 380)]
        if self.panels:
            self.say()
