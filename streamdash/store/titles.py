"""Names of entries: labels made from configurations, and titles that people give, which are checked."""

from __future__ import annotations

import unicodedata

from streamdash.config import Config, EnsembleConfig, SpectraConfig, StreamModel
from streamdash.streams import STREAM_NAMES, stream_of

TITLE_LENGTH = 60
"""Longest name that people may give to an ensemble."""


def check_title(text: str) -> str:
    """A name that people give to an ensemble, tidied; it is shown to others.

    Raises
    ------
    ValueError
        When it is too long, or holds line breaks or characters that cannot be seen.
    """
    text = " ".join(word for word in unicodedata.normalize("NFC", text).split(" ") if word)
    if len(text) > TITLE_LENGTH:
        raise ValueError(f"a name may have at most {TITLE_LENGTH} characters, this one has {len(text)}")
    # Controls, invisible marks (some of which turn the direction of writing), unassigned code points.
    if any(unicodedata.category(c)[0] in "CZ" and c != " " for c in text):
        raise ValueError("a name may hold letters, digits, signs and plain spaces only")
    return text


def label_of(config: Config) -> str:
    """How people recognise an entry: the masses of ensembles and spectra, arm and age of geometries."""
    if isinstance(config, StreamModel):
        return geometry_label(config)
    if isinstance(config, SpectraConfig):
        return spectra_label(config)
    assert isinstance(config, EnsembleConfig)
    return config.label


def geometry_label(stream: StreamModel) -> str:
    """How people recognise a stream's geometry, for example ``leading-9Gyr-64times``.

    All but the default stream are named, as in ``pal5-trailing-5Gyr-64times``.
    """
    name = stream_of(stream).name
    named = "" if name == STREAM_NAMES[0] else f"{name}-"
    return f"{named}{stream.arm}-{stream.age_gyr:g}Gyr-{len(stream.impact_times_gyr)}times"


def spectra_label(config: SpectraConfig) -> str:
    """How people recognise spectra, for example ``1e3-1e5-32times-1000streams``."""
    n_times = len(config.ensemble.stream.impact_times_gyr)
    return f"{config.ensemble.label}-{n_times}times-{config.n_streams}streams"
