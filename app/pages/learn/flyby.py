"""Learn page, one fly-by: choose it, see the kick, let the gap open, look at it through noise."""

from __future__ import annotations

from functools import partial
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.learn.layout import FIGURE_FIRST, FIGURES, row
from app.pages.learn.mass import mass_slider
from app.pages.learn.state import CROWD_MAX, FLYBYS_MAX, HAND
from app.ui.browser import LiveText
from app.ui.player import Player
from app.work.later import Later
from app.work.pieces import film_of
from streamdash.config import StreamModel
from streamdash.engine.flyby import FRAMES, Film, kick_along_stream, random_impacts
from streamdash.engine.geometry import Geometry
from streamdash.plots import flyby as plot
from streamdash.plots import flyby_words as words
from streamdash.plots import passing as orbits
from streamdash.plots.live import LiveFigure
from streamdash.survey.flyby import Scene, make_film, see, struck
from streamdash.survey.passing import passing

CHANGES = frozenset({*HAND, "flybys", "crowd", "crowd_of", "crowd_seed"})
"""What makes another stream."""
USES = CHANGES | {"noise", "frame", "theme"}
LAST = FRAMES - 1
WAITING = "Computing the film …"
FILM_LEGEND = (
    ("image", "the stream"),
    ("line-ink", "its density"),
    ("dashes-grey", "without any fly-by"),
    ("dots-hand", "the stars that were hit, drifting with the stream"),
    ("dots-grey", "random fly-bys: drops that reach the stream when they pass"),
)
SKY_LEGEND = (("dots-grey", "stars of the stream"), ("dots-hand", "the dark object"))
KICK_LEGEND = (("line-hand", "along the stream"), ("dashes-grey", "across it"))
SEEN_LEGEND = (
    ("dots-grey", "as observed, with noise"),
    ("line-ink", "without noise"),
    ("dashes-hand", "the fly-by in hand alone"),
)
STEP_AWAY = 0.37
"""How far from the last one, in lengths of the stream, the next fly-by is put."""


class FlybyLesson:
    """A sandbox for one stream."""

    def __init__(self, page: Page) -> None:
        self.page, self.session, self.services = page, page.session, page.services
        self.geometry: Geometry = self.services.geometry(self.stream)
        self.raining = False
        self.later = Later(self.services, self._show_film, self._fail)
        self.film = self._make_film(self.scene)
        self._compute()
        self._draw()
        self._make_cards()
        self._say()

    @property
    def stream(self) -> StreamModel:
        """The stream model that is hit."""
        return self.session.ensembles[0].config.stream

    @property
    def scene(self) -> Scene:
        """What is chosen now."""
        session = self.session
        choice = session.ensembles[min(session.crowd_of, len(session.ensembles) - 1)]
        return Scene(tuple(session.chosen), session.crowd, choice.config.population, session.crowd_seed)

    def view(self) -> Viewable:
        """Controls beside the cards, on a phone below them."""
        cards = pn.Column(
            self.film_card.view,
            ui.figure_grid([self.sky_card.view, self.seen_card.view], narrowest=420),
            self.kick_card.view,
            margin=0,
            styles={"flex": "1 1 560px", "min-width": "0"},
            css_classes=[FIGURES],
        )
        return pn.FlexBox(
            self._controls(), cards, gap="4px 16px", sizing_mode=ui.WIDE, margin=0, **FIGURE_FIRST
        )

    def update(self, changed: frozenset[str]) -> None:
        """Patch what changed."""
        if "theme" in changed:
            self._ink()
        if changed & CHANGES:
            self._compute()
            self.kick_live.patch(plot.kick_columns_of(self.kick, plot.ALONG, plot.ACROSS))
            self.turn_live.patch(plot.kick_columns_of(self.kick, plot.TURN))
            for live, (x, y) in zip(
                (self.kick_live, self.turn_live), plot.kick_frame(self.kick), strict=True
            ):
                live.move(x, y)
            self._load_sky()
            self.film_card.say(WAITING, ready=False)
            scene = self.scene
            self.later.ask(
                partial(film_of, self.services, self.stream, scene), key=("film", self.stream.key, scene)
            )
        elif "noise" in changed:
            self._see()
        if changed & (CHANGES | {"noise"}):
            self.seen_live.patch(plot.seen_columns(self.seen))
            self.seen_live.move(y=plot.seen_range(self.seen))
            self._say(film=False)
        if changed == {"frame"}:
            self.film_card.say(words.film_sentence(self.film, self.session.frame))

    def close(self) -> None:
        """Wait for nothing any more."""
        self.later.cancel()

    def add(self) -> None:
        """Keep the fly-by in hand and take another into the hand, elsewhere along the stream."""
        session = self.session
        if len(session.flybys) < FLYBYS_MAX:
            away = session.where + STEP_AWAY
            session.param.update(
                flybys=[*session.flybys, session.hand], where=round(away if away <= 1 else away - 0.9, 2)
            )

    def remove(self) -> None:
        """Drop the fly-by in hand and take the one before into the hand."""
        session = self.session
        if session.flybys:
            before = dict(zip(HAND, session.flybys[-1], strict=True))
            session.param.update(flybys=session.flybys[:-1], **before)

    def rain(self) -> None:
        """Let all that one stream meets, or as many as can be shown, fall on it in one film."""
        scene = self.scene
        drawn = len(random_impacts(self.geometry, scene.population, CROWD_MAX, scene.seed))
        self.raining = True
        if self.session.crowd == drawn:
            self._show_film(self.film)
        else:
            self.session.crowd = drawn

    def draw_others(self) -> None:
        """Other random fly-bys, and other noise."""
        self.session.advance("crowd_seed")

    @property
    def _sky_frame(self) -> int:
        return self.sky_player.value

    def code(self, call: str, function: str, name: str, module: str = "flyby") -> str:
        """Lines of Python that make one of the figures as it is now."""
        scene = self.scene
        flybys = "\n".join(
            "        Flyby(" + ", ".join(f"{field}={value:g}" for field, value in flyby) + "),"
            for flyby in scene.flybys
        )
        crowd = ""
        if scene.crowd:
            text = scene.population.model_dump_json(exclude_defaults=True)
            crowd = f"    crowd={scene.crowd},\n    population=Population.parse('{text}'),\n"
        stream = ""
        if self.stream != StreamModel():
            stream = f", stream=StreamModel.parse('{self.stream.model_dump_json(exclude_defaults=True)}')"
        imports = sorted(
            [
                f"from streamdash.plots.{module} import {function}\n",
                "from streamdash.plots.live import export\n",
            ]
        )
        return (
            "from pathlib import Path\n\n"
            "from streamdash.config import Population, StreamModel\n"
            "from streamdash.engine.flyby import Flyby\n"
            + "".join(imports)
            + "from streamdash.store.cache import Cache\n"
            "from streamdash.survey.flyby import Scene\n\n"
            f"scene = Scene(\n    (\n{flybys}\n    ),\n{crowd}    seed={scene.seed},\n)\n"
            f"figure = {call}{stream})\n"
            f'Path("{name}.png").write_bytes(export(figure, "png"))\n'
        )

    # ------------------------------------------------------------ inside

    def _make_film(self, scene: Scene) -> Film:
        key = ("film", self.stream.key, scene)
        return self.services.shared(key, lambda: make_film(self.geometry, scene))

    def _compute(self) -> None:
        flyby = self.scene.flybys[-1]
        key = ("passing", self.stream.key, flyby)
        self.passing = self.services.shared(key, lambda: passing(self.geometry, flyby))
        self.kick = kick_along_stream(self.geometry, self.scene.flybys[-1])
        self._see()

    def _see(self) -> None:
        noise = self.session.noise
        key = ("seen", self.stream.key, self.scene, noise)
        self.seen = self.services.shared(key, lambda: see(self.geometry, self.scene, noise))

    @property
    def _marks(self) -> Any:
        return struck(self.geometry, self.scene.flybys, self.film.time_gyr)

    @property
    def _rain(self) -> plot.Rain:
        return plot.rain_of(self.geometry, self.scene, self.film)

    def _draw(self) -> None:
        frame, marks = self.session.frame, self._marks
        drawn = plot.draw_density(self.film, marks, frame, "bokeh", self._rain)
        self.density_live = LiveFigure(drawn, ink=(plot.NOW,))
        self.gap_live = LiveFigure(plot.draw_gap(self.film, frame, "bokeh"), ink=(plot.GAP,))
        self.kick_live = LiveFigure(plot.draw_kick(self.kick, "bokeh"))
        self.turn_live = LiveFigure(plot.draw_turn(self.kick, "bokeh"))
        self.seen_live = LiveFigure(plot.draw_seen(self.seen, "bokeh"), ink=(plot.CLEAN,))
        self.player = Player(
            label="Time since the first fly-by",
            autoplay=frame == LAST,
            sizing_mode=ui.WIDE,
            margin=(8, 0),
            css_classes=["sd-player"],
        )
        self.sky_live = LiveFigure(orbits.draw_passing(self.passing, 0, "bokeh"))
        self.sky_player = Player(
            label="Time from the fly-by",
            seconds=4.0,
            autoplay=frame == LAST,
            sizing_mode=ui.WIDE,
            margin=(4, 0),
        )
        self._load_sky()
        self.page.bind("frame", self.player)
        self._load_player()
        self._ink()

    def _load_sky(self) -> None:
        shown = self.passing
        middle = len(shown.time_myr) // 2
        captions = orbits.passing_captions(shown)
        self.sky_player.load(orbits.passing_frames(shown), self.sky_live.sources, captions, middle)

    def _load_player(self) -> None:
        sources = {**self.density_live.sources, **self.gap_live.sources}
        frames = plot.film_frames(self.film, self._marks, self._rain)
        self.player.load(frames, sources, words.captions(self.film), self.session.frame)

    def _show_film(self, film: Film) -> None:
        self.film = film
        frame, marks = self.session.frame, self._marks
        self.density_live.patch(plot.density_columns(film, marks, frame, self._rain))
        top, q_top = plot.film_tops(film)
        self.density_live.move(y=(0, top))
        self.gap_live.move(y=(0, q_top))
        self._load_player()
        self.film_card.say(words.film_sentence(film, frame))
        if self.raining:
            self.raining = False
            self.player.plays += 1

    def _fail(self, sentence: str) -> None:
        self.film_card.say(sentence, ready=False)

    def _ink(self) -> None:
        for live in (self.density_live, self.gap_live, self.seen_live):
            live.set_ink(self.session.dark)

    def _say(self, film: bool = True) -> None:
        if film:
            self.film_card.say(words.film_sentence(self.film, self.session.frame))
        self.sky_card.say(orbits.passing_sentence(self.passing))
        self.kick_card.say(words.kick_sentence(self.geometry, self.scene, self.kick))
        self.seen_card.say(words.seen_sentence(self.seen))
        self.hand_text.text = words.hand_sentence(self.geometry, self.scene)
        count = len(self.session.flybys)
        self.remove_button.disabled = count == 0
        self.add_button.disabled = count >= FLYBYS_MAX

    def _controls(self) -> Viewable:
        page, times = self.page, self.stream.impact_times_gyr
        masses = {c.label: i for i, c in enumerate(self.session.ensembles)}
        finer = ui.folded(
            "Size, speed and direction",
            [
                ui.slider(page, "size", "Size (times the usual)", step=0.1, format="0.0"),
                ui.slider(page, "speed", "Speed (km/s)", step=10, format="0"),
                ui.slider(page, "pitch", "Angle to the stream’s motion (°)", step=5, format="0"),
                ui.slider(page, "azimuth", "Side it comes from (°)", step=10, format="0"),
            ],
            "finer",
            title_variant="body2",
            margin=(0, 4),
        )
        crowd = ui.folded(
            "Many random fly-bys on top",
            [
                ui.button(
                    "Let the whole population rain", self.rain, css_classes=["sd-rain"], margin=(4, 10)
                ),
                ui.int_slider(page, "crowd", "How many"),
                row(page, "crowd_of", "with masses of", masses),
                ui.button("Draw others", self.draw_others, css_classes=["sd-draw-others"], margin=(4, 10)),
            ],
            "many",
            title_variant="body2",
            margin=(0, 4),
            active=[0] if self.session.crowd else [],
        )
        return pn.Column(
            mass_slider(page),
            ui.slider(page, "b", "Closest approach (times its size)", step=0.1, format="0.0"),
            ui.slider(page, "when", "When (Gyr before today)", step=0.1, start=times[0], end=times[-1]),
            ui.slider(page, "where", "Where (0: progenitor, 1: far end)", step=0.01),
            finer,
            self.hand_text,
            ui.controls(self.add_button, self.remove_button),
            crowd,
            margin=0,
            styles={"flex": "0 1 290px"},
            css_classes=["sd-controls"],
        )

    def _make_cards(self) -> None:
        self.hand_text = LiveText(sizing_mode=ui.WIDE, margin=(4, 10), css_classes=["sd-hand"])
        self.add_button = ui.button(
            "Keep it and add another", self.add, css_classes=["sd-add-flyby"], margin=(4, 10)
        )
        self.remove_button = ui.button(
            "Remove it", self.remove, css_classes=["sd-remove-flyby"], margin=(4, 10)
        )
        film = pn.Column(
            self.player,
            ui.figure_grid([self.density_live.figure, self.gap_live.figure], narrowest=420),
            sizing_mode=ui.WIDE,
            margin=0,
        )
        self.film_card = ui.FigureCard(
            "The gap opens: from the first fly-by until today",
            film,
            name="film",
            page=self.page,
            drawn=lambda: self._film_layout(),
            table=lambda: words.film_table(self.film),
            code=lambda: self.code(
                f"film_figure(Cache.default(), scene, frame={self.session.frame}", "film_figure", "film"
            ),
            legend=ui.legend(FILM_LEGEND),
        )
        self.kick_card = ui.FigureCard(
            "The kick: what the fly-by in hand did to the stars’ velocities",
            [self.kick_live.figure, self.turn_live.figure],
            name="kick",
            page=self.page,
            drawn=lambda: plot.kick_layout(self.kick, "matplotlib"),
            table=lambda: words.kick_table(self.kick),
            code=lambda: self.code("kick_figure(Cache.default(), scene.flybys[-1]", "kick_figure", "kick"),
            legend=ui.legend(KICK_LEGEND),
        )
        self.seen_live_pane = ui.figure_grid([self.seen_live.figure])
        self.sky_card = ui.FigureCard(
            "The fly-by itself, as it would have been seen on the sky",
            pn.Column(self.sky_player, ui.figure_grid([self.sky_live.figure]), sizing_mode=ui.WIDE, margin=0),
            name="sky",
            page=self.page,
            drawn=lambda: orbits.draw_passing(self.passing, self._sky_frame, "matplotlib"),
            table=lambda: orbits.passing_table(self.passing),
            code=lambda: self.code(
                f"passing_figure(Cache.default(), scene.flybys[-1], {self._sky_frame}",
                "passing_figure",
                "sky",
                "passing",
            ),
            legend=ui.legend(SKY_LEGEND),
        )
        self.seen_card = ui.FigureCard(
            "What is left to see today",
            pn.Column(ui.noise_slider(self.page), self.seen_live_pane, sizing_mode=ui.WIDE, margin=0),
            name="seen",
            page=self.page,
            drawn=lambda: plot.draw_seen(self.seen, "matplotlib"),
            table=lambda: words.seen_table(self.seen),
            code=lambda: self.code(
                f"seen_figure(Cache.default(), scene, noise={self.session.noise:g}", "seen_figure", "seen"
            ),
            legend=ui.legend(SEEN_LEGEND),
        )

    def _film_layout(self) -> Any:
        return plot.film_layout(self.film, self._marks, self.session.frame, "matplotlib", self._rain)
