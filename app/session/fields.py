"""Choices that stand in links. Each is declared once, as a parameter of a session.

Its bounds, values and default are those of the widgets (`app.ui.widgets`), of the check of whatever a
browser sends, and of the links: a `Field` can also be read from a link and written to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Protocol, cast, runtime_checkable

import param


@runtime_checkable
class Field(Protocol):
    """A parameter that has a form in links."""

    default: Any

    def read(self, text: str) -> Any:
        """Value of a link's text; ValueError with the allowed values in words."""

    def write(self, value: Any) -> str:
        """Text of a value in links."""


class Decimal(param.Number):
    """A decimal number in ``bounds``, with at most so many digits behind the point in links."""

    __slots__ = ["digits"]

    def __init__(self, default: float, bounds: tuple[float, float], *, digits: int = 3, doc: str) -> None:
        super().__init__(default, bounds=bounds, doc=doc)
        self.digits = digits

    def read(self, text: str) -> float:
        low, high = cast(tuple[float, float], self.bounds)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise ValueError(f"must be a number between {low:g} and {high:g}")
        return round(value, self.digits) + 0.0  # no negative zero

    def write(self, value: float) -> str:
        return f"{round(value, self.digits):g}"


class Whole(param.Integer):
    """A whole number in ``bounds``; sliders show ``softbounds`` where those are given."""

    def __init__(
        self, default: int, bounds: tuple[int, int], *, softbounds: tuple[int, int] | None = None, doc: str
    ) -> None:
        super().__init__(default, bounds=bounds, softbounds=softbounds, doc=doc)

    def read(self, text: str) -> int:
        low, high = cast(tuple[int, int], self.bounds)
        # Only plain digits: int() would also take "1_0", " 1 " and other scripts' digits.
        if not (text.isascii() and text.isdigit() and len(text) <= 12 and low <= int(text) <= high):
            raise ValueError(f"must be a whole number between {low} and {high}")
        return int(text)

    def write(self, value: int) -> str:
        return str(value)


class OneOf(param.Selector):
    """One of a few words; of a mapping, which gives each its words for people, one of the keys."""

    __slots__ = ["words"]

    def __init__(self, default: str, allowed: Iterable[str] | Mapping[str, str], *, doc: str) -> None:
        super().__init__(default=default, objects=list(allowed), doc=doc)
        self.words = allowed if isinstance(allowed, Mapping) else {word: word for word in self.objects}

    @property
    def options(self) -> dict[str, str]:
        """What is read on a widget, and the value it stands for."""
        return {words: value for value, words in self.words.items()}

    def read(self, text: str) -> str:
        return check_word(text, self.objects)

    def write(self, value: str) -> str:
        return value


class Text(param.String):
    """Text that ``check`` takes as it is or tidied, or refuses with a ValueError."""

    __slots__ = ["read"]

    def __init__(self, default: str, check: Callable[[str], str], *, doc: str) -> None:
        super().__init__(default, doc=doc)
        self.read = check

    def write(self, value: str) -> str:
        return value


class Listed(param.List):
    """Several values of one type, with a reader and a writer of their own."""

    __slots__ = ["read", "write"]

    def __init__(
        self,
        item_type: type,
        longest: int,
        read: Callable[[str], list],
        write: Callable[[Sequence], str],
        *,
        doc: str,
    ) -> None:
        super().__init__([], item_type=item_type, bounds=(0, longest), doc=doc)
        self.read, self.write = read, write


def check_word(text: str, allowed: Sequence[str]) -> str:
    """A text that is one of the words allowed; ValueError naming them otherwise."""
    if text not in allowed:
        raise ValueError(f"must be one of {', '.join(allowed)}")
    return text


def fields_of(state: type[param.Parameterized]) -> dict[str, Field]:
    """All fields of a class of choices and of what it inherits, its own first, as they were declared."""
    found: dict[str, Field] = {}
    for part in state.__mro__:
        found |= {name: field for name, field in vars(part).items() if isinstance(field, Field)}
    return found
