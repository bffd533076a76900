"""Widgets of a session's choices, bound both ways, and buttons."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn
import panel_material_ui as pmui
import param
from panel.viewable import Viewable

from app.borrowed import gather_events_for
from app.page import Page
from app.session.catalog import CLASSES_MAX, CLASSES_MIN, Stream
from app.ui.layout import WIDE, controls
from app.ui.text import caption, plain_text
from streamdash.config import StreamModel
from streamdash.naming import class_colour
from streamdash.plots.style import noise_label
from streamdash.streams import stream_of

SLIDER_DELAY = 10
"""Milliseconds in which moves of one slider are gathered; Panel's 50 are a third of our budget."""
_ARROW = "%3Cpath d='M2 4l4 5 4-5z' fill='%23808080'/%3E"
MENU_STYLE = f"""
.bk-input-group > label {{ background: var(--sd-ground, var(--mui-palette-background-default)) !important; }}
select.bk-input {{ background-image: url("data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' \
width='12' height='12'%3E{_ARROW}%3C/svg%3E") !important; }}
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

    def picked(event: param.parameterized.Event) -> None:
        stream = session.catalog.stream(session.stream)
        keys = [choice.key for choice in (stream.ensembles if stream else ())]
        if min(CLASSES_MIN, len(keys)) <= len(event.new) <= CLASSES_MAX:
            session.mass = [key for key in keys if key in event.new]
        else:
            widget.value = list(session.mass)

    widget.param.watch(picked, "value")
    page.follow("catalog", lambda: widget.param.update(options=options()))
    heading = caption(f"Mass ranges of the perturbers ({CLASSES_MIN} to {CLASSES_MAX})")
    return pn.Column(heading, widget, margin=(4, 10), sizing_mode=WIDE)


def noise_slider(page: Page) -> pmui.FloatSlider:
    """Shot noise σ_ε per bin of the stream that is shown, 0 to 1."""
    stream = page.session.catalog.stream(page.session.stream)
    return slider(page, "noise", noise_label(stream.model if stream else StreamModel()))


def button(label: str, action: Callable[[], Any], **params: Any) -> pmui.Button:
    """A button that calls ``action()``."""
    return pmui.Button(label=label, on_click=lambda _: action(), variant="outlined", **params)


def class_button(index: int, label: str, action: Callable[[], Any], **params: Any) -> pmui.Button:
    """A button in the colour of a class."""
    style = {
        "borderColor": class_colour(index),
        "borderWidth": 3,
        "textTransform": "none",
        "color": "inherit",
    }
    return button(f"M{index} · {label}", action, sx=style, margin=(4, 10), **params)


def text_field(page: Page, name: str, label: str, help: str, placeholder: str = "") -> Viewable:
    """A line of text with a line of help below it."""
    options = {"size": "small", "sizing_mode": WIDE, "margin": 0, "css_classes": [f"sd-{name}"]}
    widget = page.bind(name, pmui.TextInput(label=label, placeholder=placeholder, **options))
    return pn.Column(widget, caption(help), sizing_mode=WIDE, margin=(4, 10))


def _sized(name: str, params: dict[str, Any]) -> dict[str, Any]:
    return {"width": 260, "margin": (4, 10), "css_classes": [f"sd-{name}"], **params}
