"""What the steps of the story have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import holoviews as hv
import pandas as pd
from panel.viewable import Viewable

from app.page import Page
from app.pages.learn.predict import Outcome
from app.ui.player import Player
from app.ui.templates import literally
from streamdash.config import EnsembleConfig, StreamModel
from streamdash.naming import COLOUR_WORDS, class_colours, model_labels
from streamdash.plots.live import Backend, Columns

Ranges = tuple[tuple[float, float], tuple[float, float]]
Link = tuple[str, dict[str, Any]]
"""Words, and what to change in the session's link."""


class Step:
    """One step. `compute` first; the others say what it found."""

    title: str
    uses: frozenset[str] = frozenset()
    ink: tuple[str, ...] = ()
    legend: tuple[tuple[str, str], ...] = ()
    """Swatches and words, see `app.ui.legend`."""
    question = ""
    """What to predict, see `outcome`."""
    square = False
    """Whether the figure's two axes are one space."""
    by_class = False
    """Whether the legend also names the colour of each class."""

    def __init__(self, page: Page) -> None:
        self.page, self.session, self.services = page, page.session, page.services
        self.choices = page.session.ensembles
        self.stream: StreamModel = self.choices[0].config.stream
        self.geometry = self.services.geometry(self.stream)
        self.compute()

    @property
    def light(self) -> str:
        """The lowest mass range compared, in words for Markdown."""
        return literally(self.choices[0].label)

    @property
    def colours(self) -> tuple[str, str]:
        """What the colours of the lowest and of the highest mass range are called."""
        first, *_, last = class_colours(self.configs)
        return COLOUR_WORDS[first], COLOUR_WORDS[last]

    @property
    def configs(self) -> list[EnsembleConfig]:
        """Configurations of the classes."""
        return [choice.config for choice in self.choices]

    @property
    def ends(self) -> list[EnsembleConfig]:
        """Those of the lowest and the highest mass range."""
        return [self.configs[0], self.configs[-1]]

    def swatches(self) -> list[tuple[str, str]]:
        """The whole legend."""
        labels = model_labels(self.configs) if self.by_class else []
        colours = class_colours(self.configs) if self.by_class else []
        named = ((f"line-{colour}", label) for colour, label in zip(colours, labels, strict=True))
        return [*named, *self.legend]

    @property
    def heavy(self) -> str:
        """The highest."""
        return literally(self.choices[-1].label)

    @property
    def answers(self) -> tuple[str, ...]:
        """What can be answered to the question."""
        return ()

    def outcome(self) -> Outcome:
        """What comes out of it."""
        raise NotImplementedError

    def player(self, sources: Mapping[str, Any]) -> Player | None:
        """A player for the figure's sources, where the figure is a film."""
        return None

    def compute(self) -> None:
        """Find what is shown for the session's choices."""

    def controls(self) -> list[Viewable]:
        """What the reader can change."""
        return []

    def draw(self, backend: Backend) -> hv.Overlay:
        """The figure."""
        raise NotImplementedError

    def columns(self) -> Columns:
        """The figure's arrays that can change."""
        return {}

    def ranges(self) -> Ranges | None:
        """The figure's axes, where they can change."""
        return None

    def text(self) -> str:
        """The story, Markdown."""
        raise NotImplementedError

    def sentence(self) -> str:
        """What the figure shows now."""
        raise NotImplementedError

    def table(self) -> pd.DataFrame:
        """The figure's numbers."""
        raise NotImplementedError

    def call(self) -> tuple[str, str, str]:
        """Module and function that make the figure from nothing, and its arguments after the cache."""
        raise NotImplementedError

    def links(self) -> list[Link]:
        """Where to go on."""
        raise NotImplementedError

    def stream_argument(self) -> str:
        if self.stream == StreamModel():
            return ""
        return f", stream=StreamModel.parse('{self.stream.model_dump_json(exclude_defaults=True)}')"
