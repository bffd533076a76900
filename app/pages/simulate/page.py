"""Simulate page: any mass range and stream, watched while it is computed, then on every page."""

from __future__ import annotations

import math
import time
from typing import Any

import pandas as pd
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.simulate.forecast import Outlook, look_ahead, n_workers, panel_of, words_before, words_curves
from app.pages.simulate.knobs import BY_NAME, config_of, place_of, texts_of
from app.pages.simulate.parts import Components, Others, Progress, knobs, presets
from app.services.services import Unavailable
from app.session.catalog import CLASSES_MAX
from app.work.later import REST_S, Later
from streamdash.config import ConfigError, EnsembleConfig
from streamdash.plots import profiles
from streamdash.plots.live import LiveFigure, export
from streamdash.simulation.jobs import JobStatus, Refused
from streamdash.survey.bands import Bands

LOOK_MS = 300
REDRAW_S = 1.0
"""Curves are drawn no more often than this while streams are finished, for the sake of other pages."""
INKED = (profiles.MEDIAN, profiles.SMOOTH)
LEGEND = (
    ("image", "finished streams"),
    ("band", "68 % of them"),
    ("ink", "their median"),
    ("line", "the first five"),
    ("dashes", "smooth stream without perturbers"),
)


class SimulatePage(Page):
    """Choose, preview, start, watch, cancel and resume a simulation."""

    key, title = "simulate", "Simulate"
    uses = frozenset({*BY_NAME, "sim_title", "theme"})
    needs_ensembles = False

    def view(self) -> Viewable:
        self.config: EnsembleConfig | None = None
        self.outlook: Outlook | None = None
        self.panel: Bands | None = None
        self.live: LiveFigure | None = None
        self._asked: tuple = ()
        self._waiting = self._closed = False
        self._drawn = -math.inf
        self._seen = -1
        self._timer: Any = None
        self.later = Later(self.services, self._show_outlook, self._fail)
        self.components = Components(lambda texts: self.session.param.update(**texts))
        self.progress = Progress(self.start, self.cancel, self.see_profiles)
        self.others = Others(self.show)
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.card = ui.FigureCard(
            "The first streams, and all as they are finished",
            self.slot,
            name="simulate",
            image=lambda kind: export(profiles.layout([self._ready()], "matplotlib"), kind),
            table=self.table,
            code=self.code,
            legend=ui.legend(LEGEND, 1),
        )
        self._read()
        self.follow("catalog", self.look)
        if pn.state.curdoc is not None:
            pn.state.onload(self._look_on)
            self.services.jobs.prepare()
        return ui.page_layout(
            presets(self),
            self.components.view,
            knobs(self),
            self.progress.view,
            self.card.view,
            self.others.view,
        )

    def update(self, changed: frozenset[str]) -> None:
        if "theme" in changed and self.live is not None:
            self.live.set_ink(self.session.theme == "dark")
        if changed & BY_NAME.keys():
            self._read()

    def close(self) -> None:
        self._closed = True
        self.later.cancel()
        if self._timer is not None:
            self._timer.stop()
            self._timer = None
        super().close()

    # ------------------------------------------------------------ actions

    def start(self) -> None:
        """Start or resume what the knobs say, or join those who wait for the same."""
        if self.config is None:
            return
        try:
            self.services.jobs.submit(self.config, self.session.visitor, self.session.sim_title)
        except Refused as refusal:
            self.progress.refuse(str(refusal))
        else:
            self.progress.refuse("")
            self.look()

    def cancel(self) -> None:
        """Withdraw from the job; it stops when nobody else wants it."""
        if self.config is not None:
            self.services.jobs.cancel(self.config.key, self.session.visitor)
            self.look()

    def show(self, config: EnsembleConfig, title: str) -> None:
        """Set the knobs to a configuration."""
        self.session.param.update(**texts_of(config), sim_title=title)

    def see_profiles(self) -> None:
        """Go to the Profiles page with this ensemble among those compared."""
        key, session = self._complete_key(), self.session
        if key is None or self.config is None:
            return
        stream = session.catalog.stream(self.config.stream.key)
        assert stream is not None
        others = session.mass if session.stream == stream.key else [c.key for c in stream.default()]
        wanted = {key, *[other for other in others if other != key][: CLASSES_MAX - 1]}
        mass = [c.key for c in stream.ensembles if c.key in wanted]
        session.param.update(stream=stream.key, mass=mass, page="profiles")

    # ------------------------------------------------------------ following

    def look(self) -> None:
        """Show how far the simulations are."""
        jobs, catalog = self.services.jobs, self.session.catalog
        self.others.show(jobs.statuses, catalog.unfinished)
        status = self._status()
        if status is not None:
            self.progress.show(status, self.session.visitor)
            news = (status.key, status.done, status.active)
            rested = not status.active or time.monotonic() - self._drawn > REDRAW_S
            if self._asked != news and not self._waiting and rested and not self._shows(status):
                self._ask(news, rest_s=0.0)
        self.progress.see.visible = self._complete_key() is not None

    def _look_on(self) -> None:
        if not self._closed and self._timer is None:
            self._timer = pn.state.add_periodic_callback(self.look_if_new, LOOK_MS)

    def look_if_new(self) -> None:
        """`look`, unless nothing can have changed; called by a timer on the session's event loop."""
        version, status = self.services.jobs.version, self._status()
        if version != self._seen or (status is not None and status.active):
            self._seen = version
            self.look()

    def _status(self) -> JobStatus | None:
        """The job of the configuration shown, unless it ended and was completed by other means."""
        if self.config is None:
            return None
        status = self.services.jobs.find(self.config.key)
        there = self.outlook is not None and self.outlook.config == self.config and self.outlook.covering
        return None if status is not None and there and status.state in ("cancelled", "failed") else status

    def _shows(self, status: JobStatus) -> bool:
        """Whether the figure has all streams that an active job has finished."""
        outlook = self.outlook
        same = outlook is not None and outlook.config == self.config and outlook.n_done == status.done
        return same and status.active

    def _complete_key(self) -> str | None:
        """Key of the ensemble in the catalog that holds the streams of the configuration shown."""
        outlook = self.outlook
        if self.config is None or outlook is None or outlook.config != self.config or not outlook.covering:
            return None
        stream = self.session.catalog.stream(self.config.stream.key)
        keys = [choice.key for choice in stream.ensembles] if stream else []
        return outlook.covering.key if outlook.covering.key in keys else None

    def _read(self) -> None:
        """Take the knobs' texts over."""
        try:
            texts = {name: getattr(self.session, name) for name in BY_NAME}
            self.config = config_of(texts)
            self.components.show(self.config, place_of(texts, self.config))
        except ConfigError as error:
            self.config = None
            self.later.cancel()
            self._waiting = False
            self.progress.announce("", can_start=False, resume=False)
            self.progress.refuse(str(error))
            return
        self.progress.refuse("")
        self.progress.announce("Looking ahead …", can_start=True, resume=False)
        self._ask(())
        self.look()

    def _ask(self, about: tuple, rest_s: float = REST_S) -> None:
        config, services = self.config, self.services
        assert config is not None
        self._asked, self._waiting = about, True
        self.later.ask(lambda: look_ahead(services, config), rest_s)

    def _show_outlook(self, outlook: Outlook) -> None:
        self._waiting = False
        self._drawn = time.monotonic()
        self.outlook = outlook
        if outlook.config == self.config:
            self.components.expect(outlook.impacts)
        status = self._status()
        if status is None or status.state == "done":
            can = outlook.covering is None
            resume = can and outlook.n_done > 0
            self.progress.announce(words_before(outlook, n_workers(self.services)), can, resume)
        self._draw(outlook)
        self.look()

    def _fail(self, sentence: str) -> None:
        self._waiting = False
        self.progress.announce("", can_start=False, resume=False)
        self.progress.refuse(sentence)

    # ------------------------------------------------------------ the figure

    def _draw(self, outlook: Outlook) -> None:
        self.panel = panel_of(outlook.config, outlook.preview.streams, outlook.finished)
        if self.panel is None:
            self.live = None
            self.slot[:] = [ui.plain_text("There are no streams to show yet.", margin=(16, 0))]
            self.card.say("")
            return
        if self.live is None or len(self.panel.x) != self._n_shown:
            self._n_shown = len(self.panel.x)
            self.live = LiveFigure(profiles.draw(self.panel, "bokeh"), ink=INKED)
            self.live.set_ink(self.session.theme == "dark")
            self.slot[:] = [pn.pane.Bokeh(self.live.figure, sizing_mode=ui.WIDE, margin=0)]
        else:
            self.live.patch(profiles.columns(self.panel))
        self.card.say(words_curves(outlook, self.panel))

    _n_shown = 0

    def table(self) -> pd.DataFrame:
        """The figure's numbers as they are now."""
        return profiles.table([self._ready()])

    def code(self) -> str:
        """Lines of Python that make the ensemble and the figure."""
        if self.config is None:
            raise Unavailable("The knobs describe no simulation yet.")
        text = self.config.model_dump_json(exclude_defaults=True)
        return (
            "from pathlib import Path\n\n"
            "from streamdash.config import EnsembleConfig\n"
            "from streamdash.simulation.ensemble import simulate\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.plots.profiles import profiles_figure\n"
            "from streamdash.store.cache import Cache\n\n"
            f"config = EnsembleConfig.parse('{text}')\n"
            "simulate(config)\n"
            'figure = profiles_figure(Cache.default(), [config], "q_rho", "theta", highlight=5)\n'
            'Path("simulate.png").write_bytes(export(figure, "png"))\n'
        )

    def _ready(self) -> Bands:
        if self.panel is None:
            raise Unavailable("There are no streams to show yet.")
        return self.panel
