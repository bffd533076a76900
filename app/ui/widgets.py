"""Widgets of a session's choices, bound both ways, and buttons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import panel as pn
import panel_material_ui as pmui
import param
from panel.viewable import Viewable

from app.borrowed import gather_events_for
from app.page import Page
from app.session.catalog import CLASSES_MAX, CLASSES_MIN, Choice, Stream
from app.ui.browser import LiveText
from app.ui.layout import WIDE, controls
from app.ui.templates import literally
from app.ui.text import caption, plain_text
from streamdash.config import StreamModel
from streamdash.naming import class_colour
from streamdash.plots.live import LiveFigure
from streamdash.plots.style import noise_label
from streamdash.streams import stream_of

SLIDER_DELAY = 10
"""Milliseconds in which moves of one slider are gathered; Panel's 50 are a third of our budget."""
_ARROW = "%3Cpath d='M2 4l4 5 4-5z' fill='%23808080'/%3E"
MENU_STYLE = f"""
.bk-input-group > label {{ background: var(--sd-ground, var(--mui-palette-background-default)) !important; }}
select.bk-input {{ background-image: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' \
width='12' height='12'%3E{_ARROW}%3C/svg%3E") !important; }}
select.bk-input:focus-visible {{ outline: 3px solid #e69f00 !important; outline-offset: 2px; }}
"""
"""The browser's own menu, with an arrow that is seen on any ground; Panel's is black. Its label lies on the
frame and has the ground of the panel that it stands in."""
TOGGLE_STYLE = {
    "display": "flex",
    "width": "100%",
    "flexWrap": "wrap",
    # In one row where they fit; together as wide as there is room.
    "& button": {"flex": "1 1 auto", "width": "auto", "whiteSpace": "nowrap", "padding": "5px 8px"},
}
FEW_BANDS = 2
"""Bands that can lie over one another."""
TOO_FEW = f"At least {CLASSES_MIN} are compared: choose another one before you take this one away."
TOO_MANY = f"At most {CLASSES_MAX} are compared: take one away before you choose another."
PICKER_STYLE = {
    "display": "flex",
    "flexWrap": "wrap",
    "gap": "4px",
    "maxWidth": "620px",
    # One beside the other where they are short; long names go on in another line.
    "& button": {
        "flex": "1 1 auto",
        "width": "auto",
        "maxWidth": "100%",
        "minHeight": "32px",
        "padding": "3px 8px",
        "whiteSpace": "normal",
        "textAlign": "left",
        "justifyContent": "flex-start",
        "lineHeight": 1.3,
        "border": "1px solid #80808066 !important",
        "borderRadius": "4px !important",
        "margin": "0 !important",
    },
}
"""Buttons of the mass ranges: as many in a row as there is room for."""


def slider(page: Page, name: str, label: str, step: float = 0.01, **params: Any) -> pmui.FloatSlider:
    """Slider of a session number with bounds; every move arrives, not only the last."""
    low, high = page.session.param[name].bounds
    choices = {"start": low, "end": high, "format": "0.00", **params}
    widget = pmui.FloatSlider(label=label, step=step, **_sized(name, choices))
    gather_events_for(widget, SLIDER_DELAY)
    return page.bind(name, widget, to_session=lambda value: round(value, 3))


def int_slider(
    page: Page, name: str, label: str, start: int | None = None, end: int | None = None, **params: Any
) -> pmui.IntSlider:
    """Slider of a session's whole number, from ``start`` to ``end``, or over its soft bounds."""
    low, high = page.session.param[name].get_soft_bounds()
    start, end = low if start is None else start, high if end is None else end
    widget = pmui.IntSlider(label=label, start=start, end=end, **_sized(name, params))
    gather_events_for(widget, SLIDER_DELAY)
    return page.bind(name, widget, to_widget=lambda value: min(max(value, start), end))


def number_slider(label: str, start: int, end: int, value: int, name: str) -> pmui.IntSlider:
    """Slider of a whole number that is not itself a session parameter; ``sd-<name>`` is its class."""
    return pmui.IntSlider(label=label, start=start, end=end, value=value, **_sized(name, {}))


def toggle(
    page: Page, name: str, label: str, options: dict[str, Any] | None = None, **params: Any
) -> Viewable:
    """One of a few values as buttons side by side.

    ``options`` maps what is read to the value; when they are not given they are the field's own.
    """
    widget = pmui.RadioButtonGroup(
        options=page.session.param[name].options if options is None else options,
        value=getattr(page.session, name),
        size="small",
        margin=0,
        sizing_mode=WIDE,
        css_classes=[f"sd-{name}"],
        sx=TOGGLE_STYLE,
    )
    page.bind(name, widget)
    return pn.Column(caption(label), widget, margin=(4, 10), width_policy="min", **params)


def menu(name: str, label: str, options: dict[str, Any], **params: Any) -> pn.widgets.Select:
    """The browser's own menu: panel-material-ui 0.16.6's cannot be opened with the keyboard."""
    return pn.widgets.Select(
        label=label, options=options, **_sized(name, {"stylesheets": [MENU_STYLE], **params})
    )


def select(page: Page, name: str, label: str, **params: Any) -> pn.widgets.Select:
    """One of the values of a session's field as a menu."""
    options = page.session.param[name].options
    return page.bind(name, menu(name, label, options, value=getattr(page.session, name), **params))


def stream_picker(page: Page) -> pn.widgets.Select:
    """Menu of the stream models that have complete ensembles."""
    session = page.session

    def options() -> dict[str, str]:
        return {stream.label: stream.key for stream in session.catalog.streams}

    widget = menu("stream", "Stream", options(), value=session.stream)
    widget.param.watch(lambda event: session.choose_stream(event.new), "value")
    page.follow("catalog", lambda: widget.param.update(options=options()))
    return widget


def one_arm(stream: Stream, words: str, choose: Callable[[str], Any]) -> Viewable:
    """What a page shows in its place that takes one arm of a stream: why, and which would you like?"""
    buttons = [
        button(arm.label, partial(choose, arm.key), css_classes=[f"sd-arm-{arm.model.arm}"])
        for arm in stream.arms
    ]
    chosen = plain_text(f"Both arms of {stream_of(stream.model).title} are chosen. {words}", margin=(8, 10))
    return pn.Column(chosen, controls(*buttons), sizing_mode=WIDE, margin=(8, 16))


def ensemble_picker(page: Page) -> Viewable:
    """Choice of the 2 to 4 mass ranges that are compared: buttons, which the keyboard reaches too."""
    session = page.session

    def options() -> dict[str, str]:
        stream = session.catalog.stream(session.stream)
        choices = stream.ensembles if stream else ()
        # Plain mass ranges first: most people look for one of them.
        ordered = sorted(choices, key=lambda choice: choice.token != choice.config.population.label)
        return {choice.label: choice.key for choice in ordered}

    widget = pmui.CheckButtonGroup(
        options=options(),
        value=list(session.mass),
        size="small",
        margin=0,
        css_classes=["sd-mass"],
        sizing_mode=WIDE,
        sx=PICKER_STYLE,
    )

    refusal = LiveText(margin=0, sizing_mode=WIDE, css_classes=["sd-mass-refusal"])

    def picked(event: param.parameterized.Event) -> None:
        stream = session.catalog.stream(session.stream)
        keys = [choice.key for choice in (stream.ensembles if stream else ())]
        if min(CLASSES_MIN, len(keys)) <= len(event.new) <= CLASSES_MAX:
            refusal.text = ""
            session.mass = [key for key in keys if key in event.new]
        elif set(event.new) != set(session.mass):
            refusal.text = TOO_FEW if len(event.new) < CLASSES_MIN else TOO_MANY
            widget.value = list(session.mass)

    widget.param.watch(picked, "value")
    page.follow("catalog", lambda: widget.param.update(options=options()))
    heading = caption(f"Mass ranges of the perturbers ({CLASSES_MIN} to {CLASSES_MAX})")
    return pn.Column(heading, widget, refusal, margin=(4, 10), sizing_mode=WIDE)


def noise_slider(page: Page) -> pmui.FloatSlider:
    """Shot noise σ_ε per bin of the stream that is shown, 0 to 1."""
    stream = page.session.catalog.stream(page.session.stream)
    return slider(page, "noise", noise_label(stream.model if stream else StreamModel()))


def band_picker(page: Page) -> list[Viewable]:
    """Whose band is drawn, where there are more than two classes: four over one another are mud."""
    count = len(page.session.ensembles)
    if count <= FEW_BANDS:
        return []
    page.session.focus = min(page.session.focus, count)
    options = {"All": 0, **{f"M{i}": i + 1 for i in range(count)}}
    return [toggle(page, "focus", "Band of", options)]


def show_bands(page: Page, live: LiveFigure) -> None:
    """Show the bands that were asked for; medians stay."""
    count, focus = len(page.session.ensembles), page.session.focus
    for m in range(count):
        live.show(f"band {m}", count <= FEW_BANDS or focus in (0, m + 1))


def button(label: str, action: Callable[[], Any], **params: Any) -> pmui.Button:
    """A button that calls ``action()``."""
    return pmui.Button(label=label, on_click=lambda _: action(), variant="outlined", **params)


def class_button(
    index: int, classes: Sequence[Choice], action: Callable[[], Any], **params: Any
) -> pmui.Button:
    """A button in the colour of one of the classes."""
    style = {
        "borderColor": class_colour(index, [choice.config for choice in classes]),
        "borderWidth": 3,
        "textTransform": "none",
        "color": "inherit",
    }
    return button(f"M{index} · {classes[index].label}", action, sx=style, margin=(4, 10), **params)


class TextField:
    """A line of text with a line of help below it, in whose place `say` puts what is wrong."""

    def __init__(self, page: Page, name: str, label: str, help: str, placeholder: str = "") -> None:
        options = {"size": "small", "sizing_mode": WIDE, "margin": 0, "css_classes": [f"sd-{name}"]}
        self.label, self._help = label, help
        self.widget = page.bind(name, pmui.TextInput(label=label, placeholder=placeholder, **options))
        self.below = caption(help)
        self.view = pn.Column(self.widget, self.below, sizing_mode=WIDE, margin=(4, 10))

    def say(self, wrong: str) -> None:
        """Mark the text as wrong and say why; an empty sentence takes that back."""
        self.widget.error_state = bool(wrong)
        self.below.object = literally(wrong or self._help)
        self.below.sx = {"color": "error.main"} if wrong else {}


def _sized(name: str, params: dict[str, Any]) -> dict[str, Any]:
    return {"width": 260, "margin": (4, 10), "css_classes": [f"sd-{name}"], **params}
