"""Which of the shipped ensembles a test means: those of other streams have the same masses."""

from __future__ import annotations

from streamdash.config import StreamModel
from streamdash.store.cache import Entry


def of_default_stream(entry: Entry) -> bool:
    """Whether an entry is an ensemble of the paper's stream and of one population."""
    return entry.kind == "ensemble" and entry.config.stream == StreamModel() and entry.config.prior is None
