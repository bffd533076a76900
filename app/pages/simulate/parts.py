"""Parts of the Simulate page: presets and knobs, start and progress, the list of all simulations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import panel as pn
from panel.viewable import Viewable

from app import ui
from app.page import Page
from app.pages.simulate.forecast import words_numbers, words_row, words_state
from app.pages.simulate.knobs import (
    ARM,
    BOTH,
    BY_NAME,
    KNOBS,
    NAMED,
    SAMPLE,
    STREAM,
    SUBHALOS,
    Knob,
    config_of,
    texts_of,
)
from app.pages.simulate.own import OWN
from app.pages.simulate.presets import PRESETS
from app.session.catalog import Choice, label_of
from app.ui.browser import LiveText
from app.ui.widgets import TextField
from streamdash.config import ConfigError, EnsembleConfig, Perturbers, Population
from streamdash.naming import differences, population_text
from streamdash.population import COMPONENTS_MAX
from streamdash.populations import HIGH, LOW
from streamdash.simulation.jobs import JobStatus
from streamdash.simulation.preview import COARSE_TIMES
from streamdash.streams import STREAM_NAMES, named_stream


def presets(page: Page) -> tuple[Viewable, Viewable, Viewable]:
    """Menu of the stream, choice of its arm, and populations by name, which set the perturbers' knobs."""
    plain = {knob.name: knob.default for knob in KNOBS if knob.group == SUBHALOS}
    start = "Start from …"
    menu = ui.menu(
        "preset", "Population", {start: "", **{words: words for words in PRESETS}}, value="", width=330
    )

    def chosen(event: Any) -> None:
        if event.new:
            page.session.param.update(**{**plain, **PRESETS[event.new]})
            menu.value = ""  # the knobs may be changed after: the menu does not say what they are

    menu.param.watch(chosen, "value")
    streams = {named_stream(name).title: name for name in STREAM_NAMES}
    stream = ui.menu(NAMED, "Stream", streams, value=page.session.sim_stream)

    def turned(event: Any) -> None:
        if event.new == page.session.sim_stream:
            return
        arms = named_stream(event.new).arms
        now = getattr(page.session, ARM)
        kept = now if len(arms) > 1 and now == BOTH else ""
        own = dict.fromkeys(OWN, "")  # another stream has another age, potential and progenitor
        texts = {**own, ARM: kept or next(iter(arms)), NAMED: event.new}
        page.session.param.update(**texts)

    stream.param.watch(turned, "value")
    page.follow(NAMED, lambda: stream.param.update(value=page.session.sim_stream))
    arms = ui.toggle(page, ARM, "Arm", {option.capitalize(): option for option in BY_NAME[ARM].options})
    return stream, arms, menu


class Components:
    """The population's components as rows, each with its expected impacts, to edit, copy and remove."""

    def __init__(self, change: Callable[[dict[str, str]], Any]) -> None:
        self._change = change
        self._numbers: list[Any] = []
        self._listed: tuple = ()
        self.note = ui.plain_text("", margin=(0, 10))
        self.rows = pn.Column(sizing_mode=ui.WIDE, margin=0, css_classes=["sd-sim-components"])
        self._parts: Sequence[Perturbers] = ()
        self.add = ui.button("Add a component", self._add, size="small", css_classes=["sd-sim-add"])
        heading = pn.Column(ui.caption("What hits the stream"), margin=(0, 10))
        self.view = pn.Column(heading, self.rows, self.add, self.note, sizing_mode=ui.WIDE, margin=(4, 0))

    def show(self, config: EnsembleConfig, in_hand: int) -> None:
        """List the components; the knobs below tell of the one that is in hand."""
        listed = (config.population, in_hand)
        if listed == self._listed:
            return
        self._listed = listed
        parts = config.population.components
        self._numbers = [ui.plain_text("", margin=(0, 10)) for _ in parts]
        self.rows[:] = [self._row(config, i, i == in_hand) for i in range(len(parts))]
        self.add.disabled = len(parts) >= COMPONENTS_MAX
        self._parts = parts
        self.note.write(" ".join(config.population.overlaps()))

    def expect(self, impacts: Sequence[Sequence[float]]) -> None:
        """Tell how often each component hits each arm; nothing where that is not known yet."""
        for i, number in enumerate(self._numbers):
            known = [f"{arm[i]:.4g}" for arm in impacts if len(arm) > i]
            number.write(f"{' + '.join(known)} impacts a stream" if known else "")

    def _add(self) -> None:
        """One more component, of masses that are not there yet if possible, to be changed in the fields."""
        there = {part.mass_range for part in self._parts}
        hand = next((Perturbers(mass_range=m) for m in (LOW, HIGH) if m not in there), Perturbers())
        self._put([*self._parts, hand], hand)

    def _put(self, components: Sequence[Perturbers], hand: Perturbers) -> None:
        """Change the perturbers' knobs alone: of both arms, a configuration is only one."""
        changed = EnsembleConfig(population=Population(components=tuple(components)))
        texts = texts_of(changed, changed.population.components.index(hand))
        self._change({knob.name: texts[knob.name] for knob in KNOBS if knob.group == SUBHALOS})

    def _row(self, config: EnsembleConfig, i: int, in_hand: bool) -> Viewable:
        parts = config.population.components
        one = EnsembleConfig(perturbers=parts[i])
        label = ", ".join([population_text(one.population), *differences(one)])
        name = ui.plain_text(label, margin=(8, 10, 0, 10))

        def button(words: str, action: Callable[[], Any]) -> Viewable:
            return ui.button(words, action, size="small", css_classes=[f"sd-sim-{words.lower()}"])

        others = [*parts[:i], *parts[i + 1 :]]
        buttons: list[Viewable] = []
        if in_hand:
            buttons.append(ui.plain_text("in the fields below", margin=(0, 10)))
        else:
            buttons.append(button("Edit", lambda: self._put(parts, parts[i])))
        if len(parts) < COMPONENTS_MAX:
            buttons.append(button("Copy", lambda: self._put([*parts, parts[i]], parts[i])))
        if others:
            buttons.append(button("Remove", lambda: self._put(others, others[0])))
        row = ui.controls(*buttons)
        return pn.Column(name, self._numbers[i], row, sizing_mode=ui.WIDE, margin=0)


def knobs(page: Page) -> tuple[Viewable, dict[str, TextField]]:
    """All knobs with units, bounds and help, the stream model's folded away; and the fields by label."""
    title = TextField(
        page, "sim_title", "Name (optional)", "Under which everybody will find it, beside its mass range."
    ).view
    fields: dict[str, TextField] = {}
    groups = {
        group: [_field(page, k, fields) for k in KNOBS if k.group == group and k.name != ARM]
        for group in (SAMPLE, SUBHALOS, STREAM)
    }
    first, *others = groups[SUBHALOS]
    view = pn.Column(
        _grid([first, *groups[SAMPLE], title]),
        ui.folded(
            f"{SUBHALOS}: more",
            [_grid(others)],
            "knobs-perturbers",
            title_variant="body2",
        ),
        ui.folded(STREAM, [_grid(groups[STREAM])], "knobs-stream", title_variant="body2"),
        sizing_mode=ui.WIDE,
        margin=0,
    )
    return view, fields


def _grid(fields: list[Viewable]) -> Viewable:
    # Labels stand on the upper edge of their fields, beyond which a folded group shows nothing.
    return pn.Column(ui.figure_grid(fields, narrowest=230), sizing_mode=ui.WIDE, margin=(10, 0, 0, 0))


def _field(page: Page, knob: Knob, fields: dict[str, TextField]) -> Viewable:
    if knob.options:
        words = {option.capitalize(): option for option in knob.options}
        parts = [ui.toggle(page, knob.name, knob.label, words), ui.caption(knob.help)]
        return pn.Column(*parts, sizing_mode=ui.WIDE, margin=0)
    label = f"{knob.label} ({knob.unit})" if knob.unit else knob.label
    bounds = f" {knob.bounds[0].upper() + knob.bounds[1:]}." if knob.bounds else ""
    empty = "" if knob.default else "none"
    fields[knob.label] = TextField(page, knob.name, label, knob.help + bounds, empty)
    return fields[knob.label].view


class Progress:
    """Start, cancel, coarse preview, and how far the configuration of the page is."""

    def __init__(
        self,
        start: Callable[[], Any],
        cancel: Callable[[], Any],
        profiles: Callable[[], Any],
        coarse: Callable[[], Any],
    ) -> None:
        def button(words: str, action: Callable[[], Any], name: str, **params: Any) -> Any:
            return ui.button(words, action, css_classes=[f"sd-sim-{name}"], margin=(4, 10), **params)

        self.start = button("Simulate", start, "start", color="primary", size="large")
        self.cancel = button("Cancel", cancel, "cancel", visible=False)
        self.see = button("See its profiles", profiles, "see", visible=False)
        words = f"Coarse preview from {COARSE_TIMES} impact times"
        self.coarse = button(words, coarse, "coarse", visible=False)
        self.bar = pn.indicators.Progress(
            value=0, max=100, width=220, height=12, sizing_mode="fixed", margin=(14, 10), visible=False
        )
        self.numbers = ui.plain_text(
            "", sizing_mode=None, width=330, margin=(8, 10), css_classes=["sd-sim-numbers"]
        )
        self.text = LiveText(margin=(4, 10), css_classes=["sd-sim-status"])
        self.problem = pn.Column(sizing_mode=ui.WIDE, margin=0)
        self.view = pn.Column(
            self.problem,
            ui.controls(self.start, self.cancel, self.coarse, self.see, self.bar, self.numbers),
            self.text,
            sizing_mode=ui.WIDE,
            margin=0,
        )

    def show(self, status: JobStatus, visitor: str, which: str = "") -> None:
        """Show how far a job is; `which` arm it is of, where there are two."""
        self.bar.visible = status.active
        self.bar.value = int(100 * status.fraction)
        self.numbers.write(words_numbers(status))
        self.text.text = which + words_state(status) if status.state != "failed" else ""
        ended = status.state in ("cancelled", "failed")
        self.start.disabled = not ended
        self.start.label = "Resume" if ended and (status.done or status.times_done) else "Simulate"
        mine = visitor in status.owners or not status.owners
        self.cancel.visible = status.active and status.state != "stopping" and mine
        self.refuse(status.error if status.state == "failed" else "")

    def announce(self, words: str, can_start: bool, resume: bool) -> None:
        """Show what starting would mean."""
        self.bar.visible = self.cancel.visible = False
        self.numbers.write("")
        self.text.text = words
        self.start.disabled = not can_start
        self.start.label = "Resume" if resume else "Simulate"

    def refuse(self, sentence: str) -> None:
        """Show why something cannot be simulated, or has failed; nothing for an empty sentence."""
        if sentence != self._refusal:
            self._refusal = sentence
            self.problem[:] = [ui.error_state(sentence)] if sentence else []

    _refusal = ""


class Others:
    """All simulations of this server, and what was begun and not finished, each to be shown above."""

    def __init__(self, show: Callable[[EnsembleConfig, str], Any]) -> None:
        self._show = show
        self._listed: tuple = ()
        self._numbers: dict[str, Any] = {}
        self.rows = pn.Column(sizing_mode=ui.WIDE, margin=0, css_classes=["sd-sim-others"])
        self.view = ui.folded("Simulations on this server", [self.rows], "sim-list", title_variant="body2")

    def show(self, statuses: tuple[JobStatus, ...], unfinished: tuple[Choice, ...]) -> None:
        """List them, the newest first."""
        known = {status.key for status in statuses}
        waiting = [choice for choice in unfinished if choice.key not in known]
        listed = (tuple(status.key for status in statuses), tuple(choice.key for choice in waiting))
        if listed != self._listed or not self.rows.objects:
            self._listed = listed
            self._numbers = {}
            rows = [self._row(s.key, label_of(s.config, s.title), s.config, s.title) for s in statuses[::-1]]
            rows += [self._row(c.key, c.label, c.config, "") for c in waiting]
            self.rows[:] = rows or [ui.plain_text("None is running, waiting or unfinished.")]
        for status in statuses:
            self._numbers[status.key].write(words_row(status))
        for choice in waiting:
            self._numbers[choice.key].write(f"of {choice.config.n_streams} streams · unfinished")

    def _row(self, key: str, label: str, config: EnsembleConfig, title: str) -> Viewable:
        numbers = self._numbers[key] = ui.plain_text("", sizing_mode=None, width=330, margin=(8, 10))
        name = ui.plain_text(label, sizing_mode=None, width=330, margin=(8, 10))
        parts: list[Viewable] = [name, numbers]
        if told_by_knobs(config):  # others came from the command line with more settings
            parts.append(
                ui.button(
                    "Show", lambda: self._show(config, title), size="small", css_classes=["sd-sim-show"]
                )
            )
        return ui.controls(*parts)


def told_by_knobs(config: EnsembleConfig) -> bool:
    """Whether the knobs can say all that a configuration says."""
    try:
        return config_of(texts_of(config)) == config
    except ConfigError:
        return False
