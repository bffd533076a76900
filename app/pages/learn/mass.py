"""The slider of a fly-by's mass, which says the mass and not its logarithm."""

from __future__ import annotations

from panel.viewable import Viewable

from app import ui
from app.page import Page
from streamdash.plots.flyby_words import mass_words


def mass_slider(page: Page) -> Viewable:
    """Slider of ``mass10``, labelled like ``Mass: 3.2·10⁷ M☉``."""
    session = page.session

    def label() -> str:
        return f"Mass: {mass_words(10**session.mass10)}"

    widget = ui.slider(page, "mass10", label(), step=0.25, show_value=False)
    page.follow("mass10", lambda: widget.param.update(label=label()))
    return widget
