"""What pages are put together from: frame, messages, widgets, cards and layout."""

from app.ui.cards import FigureCard, document, download, folded
from app.ui.frame import navigation, page_frame, unwatch_busy
from app.ui.layout import (
    WIDE,
    class_heading,
    controls,
    figure_cell,
    figure_grid,
    legend,
    page_layout,
    plain_text,
)
from app.ui.messages import error_state, message, no_ensembles
from app.ui.widgets import (
    button,
    caption,
    class_button,
    ensemble_picker,
    int_slider,
    menu,
    noise_slider,
    number_slider,
    select,
    slider,
    stream_picker,
    text_field,
    toggle,
)

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
