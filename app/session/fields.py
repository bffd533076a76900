"""How values of a session are read from a link and written to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Field:
    """How one value of a session is read from a link and written to it.

    ``read`` raises ValueError with the allowed values in words.
    """

    read: Callable[[str], Any]
    write: Callable[[Any], str]


def number(low: float, high: float, digits: int = 3) -> Field:
    """A decimal number, rounded, in [low, high]."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ValueError(f"must be a number between {low:g} and {high:g}")
        return round(value, digits) + 0.0  # no negative zero

    return Field(read, lambda value: f"{round(value, digits):g}")


def integer(low: int, high: int) -> Field:
    """A whole number in [low, high]."""

    def read(text: str) -> int:
        # Only plain digits: int() would also take "1_0", " 1 " and other scripts' digits.
        if not (text.isascii() and text.isdigit() and len(text) <= 12 and low <= int(text) <= high):
            raise ValueError(f"must be a whole number between {low} and {high}")
        return int(text)

    return Field(read, str)


def option(*allowed: str) -> Field:
    """One of a few words."""

    def read(text: str) -> str:
        if text not in allowed:
            raise ValueError(f"must be one of {', '.join(allowed)}")
        return text

    return Field(read, str)
