"""The one door to panel-material-ui: frame, theme, shared widgets, cards, error and empty states."""

from __future__ import annotations

import html
import io
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd
import panel as pn
import panel_material_ui as pmui
import param
from panel.viewable import Viewable

from app.page import Page
from app.session.catalog import CLASSES_MAX, CLASSES_MIN
from app.ui.browser import LiveText
from app.ui.layout import (  # pages find all of it in `ui`
    CODE_STYLE,
    WIDE,
    class_heading,
    controls,
    figure_cell,
    figure_grid,
    legend,
    page_layout,
    plain_text,
)
from app.ui.theme import CARD, MENU_STYLE, STYLE, TEMPLATE, THEME
from streamdash.naming import class_colour

__all__ = [
    "WIDE",
    "FigureCard",
    "button",
    "caption",
    "class_button",
    "class_heading",
    "controls",
    "document",
    "download",
    "ensemble_picker",
    "error_state",
    "figure_cell",
    "figure_grid",
    "folded",
    "int_slider",
    "legend",
    "menu",
    "message",
    "navigation",
    "no_ensembles",
    "noise_slider",
    "number_slider",
    "page_frame",
    "page_layout",
    "plain_text",
    "select",
    "slider",
    "stream_picker",
    "text_field",
    "toggle",
    "unwatch_busy",
]

SLIDER_DELAY = 10
"""Milliseconds in which moves of one slider are gathered; Panel's 50 are a third of our budget."""

# ---------------------------------------------------------------- frame


def page_frame(main: Sequence[Viewable], dark: bool) -> pmui.Page:
    """Title bar with the light/dark switch around `main`; everything comes from this server."""
    page = pmui.Page(
        title="streamdash",
        meta_description="Which dark-matter perturbers made the gaps in a stellar stream?",
        main=list(main),
        dark_theme=dark,
        theme_config=THEME,
        raw_css=[STYLE],
        busy_indicator=None,
        site_url=".",
        main_width=1600,
        css_classes=["sd-page"],
        template=TEMPLATE % pmui.Page._render_esm(server=True),
    )
    unwatch_busy(page)
    return page


def unwatch_busy(page: pmui.Page) -> None:
    """Detach a page from the process-wide ``pn.state.busy``.

    panel-material-ui 0.16.6 binds every `Page` to it: each callback of any session then walks every
    session's model graph, and pages are never freed. The reference lives in param's private
    bookkeeping; ``tests/app/test_leaks.py`` fails when this stops working.
    """
    private = page._param__private
    private.refs = {name: ref for name, ref in private.refs.items() if name != "busy"}
    kept = []
    for names, watcher in private.ref_watchers:
        if "busy" in names:
            (watcher.cls if watcher.inst is None else watcher.inst).param.unwatch(watcher)
        else:
            kept.append((names, watcher))
    private.ref_watchers = kept


def navigation(pages: Sequence[tuple[str, Viewable]], active: int) -> pmui.Tabs:
    """The pages as tabs; only the open one is sent to the browser."""
    return pmui.Tabs(
        *pages,
        dynamic=True,
        active=active,
        sizing_mode=WIDE,
        margin=0,
        css_classes=["sd-nav"],
    )


# ---------------------------------------------------------------- states


def message(sentences: Sequence[str], kind: str = "info") -> pmui.Alert:
    """Sentences in a coloured bar that can be closed; ``kind`` is info, warning or error."""
    return _alert(sentences, kind, "sd-message", closeable=True)


def error_state(sentence: str) -> pmui.Alert:
    """What takes the place of a page or panel that cannot be shown."""
    return _alert([sentence], "error", "sd-error-state")


def no_ensembles() -> pmui.Alert:
    """What a page shows when the cache holds nothing to show."""
    return _alert(
        [
            "There are no simulated streams in the cache yet.",
            "Run “streamdash simulate --mass 1e3-1e5 --streams 1000”, the same for 1e5-1e9, and reload.",
        ],
        "info",
        "sd-empty-state",
    )


def _alert(sentences: Sequence[str], kind: str, css_class: str, **params: Any) -> pmui.Alert:
    return pmui.Alert(
        # Not the alert's own text: that is read as Markdown.
        *(plain_text(sentence, margin=0) for sentence in sentences),
        severity=kind,
        sizing_mode=WIDE,
        margin=(8, 16),
        css_classes=[css_class, f"sd-{kind}"],
        **params,
    )


# ---------------------------------------------------------------- widgets, bound both ways


def slider(page: Page, name: str, label: str, step: float = 0.01, **params: Any) -> pmui.FloatSlider:
    """Slider of a session number with bounds; every move arrives, not only the last."""
    low, high = page.session.param[name].bounds
    choices = {"start": low, "end": high, "format": "0.00", **params}
    widget = pmui.FloatSlider(label=label, step=step, **_sized(name, choices))
    _answer_at_once(widget)
    return page.bind(name, widget, to_session=lambda value: round(value, 3))


def int_slider(page: Page, name: str, label: str, start: int, end: int, **params: Any) -> pmui.IntSlider:
    """Slider of a session integer; ``start`` and ``end`` may be narrower than its bounds."""
    widget = pmui.IntSlider(label=label, start=start, end=end, **_sized(name, params))
    _answer_at_once(widget)
    return page.bind(name, widget, to_widget=lambda value: min(max(value, start), end))


def _answer_at_once(widget: Any) -> None:
    """Shorten the time in which Panel gathers a widget's events, for this one widget."""
    widget._debounce = SLIDER_DELAY


def number_slider(label: str, start: int, end: int, value: int, name: str) -> pmui.IntSlider:
    """Slider of a whole number that is not itself a session parameter; ``sd-<name>`` is its class."""
    return pmui.IntSlider(label=label, start=start, end=end, value=value, **_sized(name, {}))


def toggle(page: Page, name: str, label: str, options: dict[str, Any], **params: Any) -> Viewable:
    """One of a few values as buttons side by side; ``options`` maps what is read to the value."""
    widget = pmui.RadioButtonGroup(
        options=options,
        value=getattr(page.session, name),
        size="small",
        margin=0,
        css_classes=[f"sd-{name}"],
        sx={"& button": {"whiteSpace": "nowrap"}},
    )
    page.bind(name, widget)
    return pn.Column(caption(label), widget, margin=(4, 10), width_policy="min", **params)


def menu(name: str, label: str, options: dict[str, Any], **params: Any) -> pn.widgets.Select:
    """The browser's own menu: panel-material-ui 0.16.6's cannot be opened with the keyboard."""
    return pn.widgets.Select(
        label=label, options=options, **_sized(name, {"stylesheets": [MENU_STYLE], **params})
    )


def select(page: Page, name: str, label: str, options: dict[str, Any], **params: Any) -> pn.widgets.Select:
    """One of several values of a session as a menu."""
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


def ensemble_picker(page: Page) -> Viewable:
    """Choice of the 2 to 4 mass ranges that are compared: buttons, which the keyboard reaches too."""
    session = page.session

    def options() -> dict[str, str]:
        stream = session.catalog.stream(session.stream)
        return {choice.label: choice.key for choice in (stream.ensembles if stream else ())}

    widget = pmui.CheckButtonGroup(
        options=options(),
        value=list(session.mass),
        size="small",
        margin=0,
        css_classes=["sd-mass"],
        sx={"flexWrap": "wrap", "& button": {"whiteSpace": "nowrap", "width": "auto", "flex": "0 0 auto"}},
    )

    def picked(event: param.parameterized.Event) -> None:
        keys = list(options().values())
        if min(CLASSES_MIN, len(keys)) <= len(event.new) <= CLASSES_MAX:
            session.mass = [key for key in keys if key in event.new]
        else:
            widget.value = list(session.mass)

    widget.param.watch(picked, "value")
    page.follow("catalog", lambda: widget.param.update(options=options()))
    heading = caption(f"Mass ranges of the perturbers ({CLASSES_MIN} to {CLASSES_MAX})")
    return pn.Column(heading, widget, margin=(4, 10), max_width=620, styles={"flex": "1 1 300px"})


def noise_slider(page: Page) -> pmui.FloatSlider:
    """Shot noise σ_ε per 0.2° bin, 0 to 1."""
    return slider(page, "noise", "Shot noise σ_ε per 0.2° bin")


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
    return pn.Column(widget, caption(help), sizing_mode=WIDE, margin=(4, 0))


def caption(text: str) -> pmui.Typography:
    """Small heading of a control that has none of its own."""
    return pmui.Typography(html.escape(text), variant="caption", margin=0)


def _sized(name: str, params: dict[str, Any]) -> dict[str, Any]:
    return {"width": 260, "margin": (4, 10), "css_classes": [f"sd-{name}"], **params}


# ---------------------------------------------------------------- layout


class FigureCard:
    """A figure with heading, sentence, downloads and the code that makes it.

    Parameters
    ----------
    title
        Heading.
    figures
        One Bokeh figure or Panel object, or several shown side by side.
    name
        Stem of the downloaded files' names; ``sd-card-<name>`` is the card's CSS class.
    image
        Called with ``"png"`` or ``"svg"``; returns the bytes of the figure as it is now.
    table
        Returns the figure's numbers as they are now, units in the column names.
    code
        Returns the lines of Python that make the figure as it is now.
    legend
        Shown between heading and figure.

    Attributes
    ----------
    files : dict
        By kind (``png``, ``svg``, ``csv``), what a download calls for its bytes.
    """

    def __init__(
        self,
        title: str,
        figures: Any,
        *,
        name: str,
        image: Callable[[str], bytes],
        table: Callable[[], pd.DataFrame],
        code: Callable[[], str],
        legend: Viewable | None = None,
    ) -> None:
        self._code = code
        self._sentence = LiveText(sizing_mode=WIDE, margin=(6, 0), css_classes=["sd-sentence"])
        self._listing = pn.pane.HTML(
            "", stylesheets=[CODE_STYLE], sizing_mode=WIDE, margin=0, css_classes=["sd-code"]
        )
        figures = figures if isinstance(figures, list | tuple) else [figures]
        heading = pmui.Typography(html.escape(title), variant="h6", margin=0, sx={"flex": "1 1 auto"})
        self.files = {
            "png": lambda: image("png"),
            "svg": lambda: image("svg"),
            "csv": lambda: table().to_csv(index=False, float_format="%.6g").encode(),
        }
        self._downloads = [
            download(f"streamdash-{name}.{kind}", kind, make, disabled=True)
            for kind, make in self.files.items()
        ]
        self._accordion = pmui.Accordion(
            ("Show the code", self._listing),
            title_variant="body2",
            disable_gutters=True,
            sizing_mode=WIDE,
            margin=0,
            elevation=0,
            css_classes=["sd-show-code"],
        )
        self._accordion.param.watch(lambda _: self._list(), "active")
        kinds = pn.Row(*self._downloads, margin=0)
        head = pn.FlexBox(heading, kinds, align_items="center", gap="4px 12px", sizing_mode=WIDE, margin=0)
        self.view = pn.Column(
            head,
            *([legend] if legend else []),
            figure_grid(figures),
            self._sentence,
            self._accordion,
            sizing_mode=WIDE,
            margin=(8, 0),
            styles=CARD,
            css_classes=["sd-card", f"sd-card-{name}"],
        )

    def say(self, sentence: str, *, ready: bool = True) -> None:
        """Set the sentence under the figure; also refreshes the code where it is open.

        The downloads can be pressed while there is a sentence, unless ``ready`` says otherwise:
        a figure that is not there yet has none.
        """
        self._sentence.text = sentence
        for file in self._downloads:
            file.disabled = not (sentence and ready)
        self._list()

    def _list(self) -> None:
        if self._accordion.active:
            self._listing.object = f"<pre tabindex='0'><code>{html.escape(self._code())}</code></pre>"


def folded(title: str, parts: Sequence[Viewable], name: str, **params: Any) -> Viewable:
    """What few need, closed until somebody opens it; ``sd-<name>`` is its class."""
    return pmui.Accordion(
        (title, pn.Column(*parts, sizing_mode=WIDE, margin=0, styles={"overflow-x": "auto"})),
        disable_gutters=True,
        elevation=0,
        css_classes=[f"sd-{name}"],
        **{"sizing_mode": WIDE, "margin": (8, 0), **params},
    )


def document(title: str, markdown: str, name: str) -> Viewable:
    """A longer text of ours, closed until somebody opens it; ``sd-<name>`` is its class."""
    text = pn.pane.Markdown(markdown, renderer_options={"html": False}, sizing_mode=WIDE, margin=(0, 8))
    return folded(title, [text], name)


def download(filename: str, kind: str, make: Callable[[], bytes], **params: Any) -> pmui.FileDownload:
    """A button that downloads what ``make()`` returns then; ``sd-download-<kind>`` is its class."""
    return pmui.FileDownload(
        callback=lambda: io.BytesIO(make()),
        filename=filename,
        label=kind.upper(),
        variant="text",
        size="small",
        margin=0,
        css_classes=[f"sd-download-{kind}"],
        **params,
    )
