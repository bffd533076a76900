"""Simulate page: any mass range and stream, watched while it is computed, then on every page."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from functools import partial

import pandas as pd
import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.simulate.forecast import (
    Forecast,
    coarse_previews,
    glance,
    look_ahead,
    n_workers,
    panel_of,
    words_before,
    words_coarse,
    words_curves,
)
from app.pages.simulate.knobs import BY_NAME, MORE, NAMED, config_of, configs_of, texts_of
from app.pages.simulate.parts import Components, Others, Progress, knobs, presets
from app.services.services import Unavailable
from app.session.catalog import CLASSES_MAX
from app.session.visitor import this_visitor
from app.work.later import REST_S, Later
from app.work.tasks import Task, Watch
from streamdash.config import ConfigError, EnsembleConfig
from streamdash.naming import ACCENT
from streamdash.plots import profiles
from streamdash.plots.live import LiveFigure
from streamdash.simulation.jobs import JobStatus, Refused
from streamdash.simulation.limits import check_size
from streamdash.simulation.preview import coarse_config
from streamdash.streams import stream_text
from streamdash.survey.bands import Bands

LOOK_S = 0.5
"""Least time between two looks at the jobs."""
TEXTS = frozenset({NAMED, *BY_NAME})
"""Parameters of the session that describe a simulation."""
REDRAW_S = 2.0
"""Curves are drawn no more often than this while streams are finished, for the sake of other pages."""
INKED = (profiles.MEDIAN, profiles.SMOOTH)
LEGEND = (
    ("image", "finished streams"),
    ("band", "68 % of them"),
    ("line-ink", "their median"),
    ("line", "the first five"),
    ("dashes-ink", "smooth stream without perturbers"),
)


class SimulatePage(Page):
    """Choose, preview, start, watch, cancel and resume a simulation."""

    key, title, group = "simulate", "Simulate", "Machine room"
    question = "What would other perturbers do to a stream?"
    uses = frozenset({*TEXTS, "sim_title", "theme"})
    needs_ensembles = False

    def view(self) -> Viewable:
        self.config: EnsembleConfig | None = None
        self.configs: tuple[EnsembleConfig, ...] = ()
        self.forecasts: tuple[Forecast, ...] = ()
        self.panels: list[Bands] = []
        self.lives: list[LiveFigure] = []
        self.watch = Watch(self._show_coarse)
        self._asked: tuple = ()
        self._waiting = self._closed = False
        self._drawn = -math.inf
        self._leave: Callable[[], None] | None = None
        self.later = Later(self.services, self._show_forecasts, self._fail)
        self.soon = Later(self.services, self._show_glance, self._fail, self.services.here)
        self.components = Components(lambda texts: self.session.param.update(**texts))
        self.progress = Progress(self.start, self.cancel, self.see_profiles, self.preview)
        self.caveats = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.others = Others(self.show)
        self.slot = pn.Column(sizing_mode=ui.WIDE, margin=0, css_classes=["sd-sim-figure"])
        self.knobs, self.fields = knobs(self)
        self.card = ui.FigureCard(
            "The first streams, and all as they are finished",
            self.slot,
            name="simulate",
            page=self,
            drawn=lambda: profiles.layout(self._ready(), "matplotlib", ACCENT),
            table=self.table,
            code=self.code,
            legend=ui.legend(LEGEND),
        )
        self._read()
        self.follow("catalog", self.look)
        if pn.state.curdoc is not None:
            pn.state.onload(self._look_on)
            self.services.jobs.prepare()
        stream, arms, population = presets(self)
        return ui.page_layout(
            self.progress.view,
            self.card.view,
            self.others.view,
            self.caveats,
            opening=ui.Opening(self.question),
            panel=ui.side_panel([stream, population], [arms, self.components.view, self.knobs]),
        )

    def update(self, changed: frozenset[str]) -> None:
        if "theme" in changed:
            for live in self.lives:
                live.set_ink(self.session.dark)
        if changed & TEXTS:
            self._read()

    def close(self) -> None:
        self._closed = True
        self.later.cancel()
        self.soon.cancel()
        self.watch.leave()
        if self._leave is not None:
            self._leave()
            self._leave = None
        super().close()

    # ------------------------------------------------------------ actions

    def start(self) -> None:
        """Start or resume what the knobs say, or join those who wait for the same."""
        if not self.configs:  # what is wrong stands there
            return
        try:
            place, _ = this_visitor()
            for config in self.configs:
                self.services.jobs.submit(config, self.session.visitor, self.session.sim_title, place)
        except Refused as refusal:
            self.progress.refuse(str(refusal))
        else:
            self.progress.refuse("")
            self.look()

    def cancel(self) -> None:
        """Withdraw from the job; it stops when nobody else wants it."""
        for config in self.configs:
            self.services.jobs.cancel(config.key, self.session.visitor)
        self.look()

    def preview(self) -> None:
        """Have streams of a coarse geometry computed: seconds where the true one takes minutes."""
        compute = partial(coarse_previews, self.configs, self.services.jobs.limits)
        self.watch.follow(self.services.laboratory.ask(self._coarse_key(), compute))

    def _coarse_key(self) -> tuple[str, ...]:
        return ("coarse preview", *(config.key for config in self.configs))

    def _show_coarse(self, task: Task) -> None:
        """Show how far a coarse preview is, and then its streams."""
        waiting = task.active and task.waiting_for_it > 0
        self.progress.coarse.disabled = waiting
        self.progress.bar.visible = waiting
        self.progress.bar.value = int(100 * task.fraction)
        if task.state == "failed":
            self.progress.refuse(task.error)
        if task.state != "done" or task.key != self._coarse_key():
            return
        shown = [
            panel_of(coarse_config(config), one.streams, None)
            for config, one in zip(self.configs, task.result, strict=True)
        ]
        self._draw([panel for panel in shown if panel is not None])
        if self.panels:
            self.card.say(words_coarse(self.configs[0], task.result, self.panels))

    def show(self, config: EnsembleConfig, title: str) -> None:
        """Set the knobs to a configuration."""
        self.session.param.update(**texts_of(config), sim_title=title)

    def see_profiles(self) -> None:
        """Go to the Profiles page with this ensemble among those compared."""
        key, session = self._complete_key(), self.session
        if key is None:
            return
        stream = session.catalog.stream(self._stream_key())
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
            self.progress.show(status, self.session.visitor, self._which(status.config))
            news = (status.key, status.done, status.active)
            rested = not status.active or time.monotonic() - self._drawn > REDRAW_S
            if self._asked != news and not self._waiting and rested and not self._shows(status):
                self._ask(news, rest_s=0.0)
        self.progress.see.visible = self._complete_key() is not None

    def _look_on(self) -> None:
        if not self._closed and self._leave is None:
            jobs = self.services.jobs
            self._leave = self.services.bell.follow(lambda: jobs.version, self.look, LOOK_S)
            self.look()

    def _status(self) -> JobStatus | None:
        """The job of the configuration shown, unless it ended and was completed by other means.

        Of both arms, that of the one which is being computed, else of the one that is not there yet.
        """
        found = []
        for config in self.configs:
            status, forecast = self.services.jobs.find(config.key), self._forecast(config)
            there = forecast is not None and forecast.covering
            if status is not None and not (there and status.state in ("cancelled", "failed")):
                found.append(status)
        order = ("running", "geometry", "stopping", "elsewhere", "waiting", "failed", "cancelled", "done")
        return min(found, key=lambda status: order.index(status.state), default=None)

    def _which(self, config: EnsembleConfig) -> str:
        """Of both arms, which one a configuration is, to begin a sentence with."""
        return f"{config.stream.arm.capitalize()} arm: " if len(self.configs) > 1 else ""

    def _forecast(self, config: EnsembleConfig) -> Forecast | None:
        return next((forecast for forecast in self.forecasts if forecast.config == config), None)

    def _stream_key(self) -> str:
        """Key in the catalog of the stream shown; of both arms, theirs together."""
        return "+".join(config.stream.key for config in self.configs)

    def _shows(self, status: JobStatus) -> bool:
        """Whether the figure has all streams that an active job has finished."""
        forecast = self._forecast(status.config)
        return forecast is not None and forecast.n_done == status.done and status.active

    def _complete_key(self) -> str | None:
        """Key of the ensemble in the catalog that holds the streams of the configuration shown."""
        known = [forecast for forecast in map(self._forecast, self.configs) if forecast is not None]
        there = [forecast.covering.key for forecast in known if forecast.covering is not None]
        stream = self.session.catalog.stream(self._stream_key()) if self.configs else None
        if stream is None or len(there) < len(self.configs):
            return None
        keys = [choice.key for choice in stream.ensembles]
        if "+".join(there) in keys or len(there) == 1:
            return "+".join(there) if "+".join(there) in keys else None
        population = self.configs[0].population  # both arms' longest ensembles stand for all of a population
        return next((c.key for c in stream.ensembles if c.config.population == population), None)

    def _read(self) -> None:
        """Take the knobs' texts over."""
        try:
            texts = {name: getattr(self.session, name) for name in TEXTS}
            self.configs = configs_of(texts)
            self.config = self.configs[0]
            self.components.show(self.config, _place_of(texts, self.config))
            for config in self.configs:
                check_size(config, self.services.jobs.limits)
        except (ConfigError, Refused) as error:
            wrong = f"Streams: {error}" if isinstance(error, Refused) else str(error)
            self.config, self.configs = None, ()
            self.progress.coarse.visible = False
            self.later.cancel()
            self.soon.cancel()
            self._waiting = False
            self.progress.announce("", can_start=False, resume=False)
            self.progress.refuse(wrong)
            self._mark(wrong)
            return
        self._mark("")
        self.caveats[:] = [ui.stream_caveats(self.config.stream)]
        self.watch.leave()
        self.progress.refuse("")
        self.progress.announce("Looking ahead …", can_start=True, resume=False)
        self.soon.ask(partial(glance, self.services, self.configs, n_workers(self.services.jobs.limits)), 0.0)
        self._ask(())
        self.look()

    def _mark(self, wrong: str) -> None:
        """Say at its field what is wrong and dim the figure of other settings; nothing: all is well."""
        for label, field in self.fields.items():
            field.say(wrong.partition(": ")[2] if wrong.startswith(f"{label}: ") else "")
        self.slot.styles = {"opacity": "0.3"} if wrong else {}
        if wrong:
            self.card.say("The figure is of the settings before: these cannot be used.", ready=False)

    def _ask(self, about: tuple, rest_s: float = REST_S) -> None:
        configs, services = self.configs, self.services
        # Those who watch the same jobs share what is shown of them.
        who = "" if about else self.session.visitor
        key = ("forecast", *(config.key for config in configs), who, *about)
        self._asked, self._waiting = about, True
        compute = partial(look_ahead, services, configs, n_workers(services.jobs.limits))
        self.later.ask(compute, rest_s, key, keep=False)

    def _show_glance(self, forecasts: tuple[Forecast, ...]) -> None:
        """Say what is known at once, while streams are still looked at."""
        self.components.expect([forecast.impacts for forecast in forecasts])
        if self._status() is None:
            self._announce(forecasts)

    def _announce(self, forecasts: tuple[Forecast, ...]) -> None:
        """Say what starting would mean."""
        missing = [forecast for forecast in forecasts if forecast.covering is None]
        workers = n_workers(self.services.jobs.limits)
        words = [self._which(one.config) + words_before(one, workers) for one in forecasts]
        begun = any(forecast.n_done > 0 for forecast in missing)
        self.progress.announce(" ".join(words), bool(missing), begun)

    def _show_forecasts(self, forecasts: tuple[Forecast, ...]) -> None:
        self._waiting = False
        self.soon.cancel()
        self._drawn = time.monotonic()
        self.forecasts = forecasts
        same = tuple(forecast.config for forecast in forecasts) == self.configs
        if same:
            self.components.expect([forecast.impacts for forecast in forecasts])
        status = self._status()
        if status is None or status.state == "done":
            self._announce(forecasts)
        lacking = any(forecast.geometry_s for forecast in forecasts)
        self.progress.coarse.visible = bool(same and lacking and self.services.jobs.limits.max_jobs)
        if self.watch.following is None or not lacking:
            pairs = [(one, one.panel) for one in forecasts if one.panel is not None]
            self._draw([panel for _, panel in pairs])
            if pairs:
                words = [self._which(one.config) + words_curves(one, panel) for one, panel in pairs]
                self.card.say(" ".join(words))
        self.look()

    def _fail(self, sentence: str) -> None:
        self._waiting = False
        self.soon.cancel()
        self.progress.announce("", can_start=False, resume=False)
        self.progress.refuse(sentence)

    # ------------------------------------------------------------ the figure

    def _draw(self, panels: list[Bands]) -> None:
        """Show the streams of every arm, side by side."""
        self.panels = panels
        shape = [(panel.config.stream.key, len(panel.x)) for panel in panels]
        if not panels:
            self.lives = []
            self.slot[:] = [ui.plain_text("There are no streams to show yet.", margin=(16, 0))]
            self.card.say("")
        elif not self.lives or shape != self._drawn_shape:
            self.lives = [
                LiveFigure(profiles.draw(panel, "bokeh", colour=ACCENT), ink=INKED) for panel in panels
            ]
            cells = []
            for live, panel in zip(self.lives, panels, strict=True):
                live.set_ink(self.session.dark)
                heading = ui.caption(stream_text(panel.config.stream))
                cells.append(ui.figure_cell(heading, live.figure))
            self.slot[:] = [ui.figure_grid(cells, narrowest=420)]
        else:
            for live, panel in zip(self.lives, panels, strict=True):
                live.patch(profiles.columns(panel))
        self._drawn_shape = shape

    _drawn_shape: list[tuple[str, int]] = []

    def table(self) -> pd.DataFrame:
        """The figure's numbers as they are now."""
        return profiles.table(self._ready())

    def code(self) -> str:
        """Lines of Python that make the ensemble and the figure."""
        if not self.configs:
            raise Unavailable("The knobs describe no simulation yet.")
        texts = "\n".join(
            f"    EnsembleConfig.parse('{config.model_dump_json(exclude_defaults=True)}'),"
            for config in self.configs
        )
        name = 'f"simulate-{config.stream.arm}.png"' if len(self.configs) > 1 else '"simulate.png"'
        return (
            "from pathlib import Path\n\n"
            "from streamdash.config import EnsembleConfig\n"
            "from streamdash.simulation.ensemble import simulate\n"
            "from streamdash.plots.live import export\n"
            "from streamdash.plots.profiles import profiles_figure\n"
            "from streamdash.store.cache import Cache\n\n"
            f"configs = [\n{texts}\n]\n"
            "for config in configs:\n"
            "    simulate(config)\n"
            '    figure = profiles_figure(Cache.default(), [config], "q_rho", "theta", highlight=5)\n'
            f"    Path({name}).write_bytes(export(figure, 'png'))\n"
        )

    def _ready(self) -> list[Bands]:
        if not self.panels:
            raise Unavailable("There are no streams to show yet.")
        return self.panels


def _place_of(values: Mapping[str, str], config: EnsembleConfig) -> int:
    """Which component of a configuration the knobs of perturbers tell of."""
    alone = config_of({**values, MORE: ""})
    return config.population.components.index(alone.perturbers)
