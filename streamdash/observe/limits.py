"""How large and how slow a table may be, and how refusals are said."""

from __future__ import annotations

import time

from pydantic import Field

from streamdash.settings import Settings

MAX_BYTES = 1_000_000
MAX_ROWS = 5000
MAX_COLUMNS = 64
MAX_LINES = 4 * MAX_ROWS
"""Ends of lines, comments and empty lines included; files for Windows have two a line."""
MAX_SECONDS = 20.0
"""Longest time that is spent on one file; the largest ones take a second or two on an idle machine."""
MAX_NAME = 40
"""Characters of a column's name that are kept."""


class UploadLimit(Settings):
    """How large a table the operator of a server lets people upload."""

    max_upload_mb: float = Field(
        MAX_BYTES / 1e6,
        gt=0,
        le=MAX_BYTES / 1e6,
        description="largest table that people may upload, MB; more than 1 is never read",
    )


class ObservationError(ValueError):
    """A table that cannot be used; one sentence that says where and what to do."""


class Deadline:
    """Ends reading that takes too long: whatever a file is made of, others wait for the same processor."""

    def __init__(self, seconds: float) -> None:
        self.end = time.monotonic() + seconds

    def check(self) -> None:
        """Raise `ObservationError` when the time is over."""
        if time.monotonic() > self.end:
            raise ObservationError(
                f"Reading the file took longer than {MAX_SECONDS:g} s; give fewer rows and columns: a "
                "profile has a few dozen rows."
            )


def too_large(limit: int) -> str:
    """What is said of a file of more than `limit` bytes."""
    return f"The file is larger than {limit / 1e6:g} MB; a profile has a few dozen rows."


def too_many(n_rows: int, n_columns: int = 0) -> None:
    """Refuse more rows or columns than are read.

    Raises
    ------
    ObservationError
        When there are too many.
    """
    if n_rows > MAX_ROWS:
        raise ObservationError(f"The table has {n_rows} rows; at most {MAX_ROWS} are read: average some.")
    if n_columns > MAX_COLUMNS:
        raise ObservationError(f"The table has {n_columns} columns; at most {MAX_COLUMNS} are read.")


def shown(text: str) -> str:
    """Text of a stranger for a sentence: printable, on one line and short."""
    clean = "".join(c if c.isprintable() else "�" for c in text.strip())
    return clean if len(clean) <= MAX_NAME else clean[: MAX_NAME - 1] + "…"
