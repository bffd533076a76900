"""What the names of columns say: which are errors, of what, and whether they are relative."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Literal

_ERROR = re.compile(
    r"^(e|err|error|sigma|sig|unc|uncertainty|std|stdev|rms|d)[_ .-]|err|sigma|uncert|stddev|stdev|"
    r"[_ .-](e|std|unc|rms)$|^σ|^(e|std|unc|rms)$"
)
_MARKS = ("uncertainty", "uncert", "unc", "errors", "error", "err", "sigma", "sig", "stddev", "stdev", "std")
"""What stands for an error inside of a name, longest first."""
_WHOLE = frozenset({*_MARKS, "e", "d", "rms", "percent", "perc", "pct", "frac", "fraction", "fractional"}) | {
    "rel",
    "relative",
    "σ",
}
_LOWER = frozenset("lo low lower min minus m neg 16".split())
_UPPER = frozenset("hi high upp upper up max plus p pos 84".split())
_BESIDE = frozenset("phi2 eta b glat ra dec id bin index row".split())
_PERCENT = re.compile(r"percent|perc|pct|%")
_FRACTION = re.compile(r"frac|relative|(^|[_ .-])rel([_ .-]|$)|^relerr|errrel$")
_RIGHT_ASCENSION = re.compile(
    r"(ra|alpha|α|rightascension)(j?2000|j?1950|j?2016|icrs|fk5|fk4|deg|degrees|hms|hours|mean|c)*"
)


def plain_name(name: str) -> str:
    """Letters and digits of a name, in lower case."""
    return "".join(c for c in name.lower() if c.isalnum())


def is_error(name: str) -> bool:
    """Whether a column is called an error."""
    return _ERROR.search(name.strip().lower()) is not None


def is_right_ascension(name: str) -> bool:
    """Whether a column is called a right ascension."""
    return _RIGHT_ASCENSION.fullmatch(plain_name(name)) is not None


def error_stem(name: str) -> str:
    """What an error column is the error of: its plain name without the words for errors."""
    words = [word for word in re.split(r"[_ .()\[\]-]+", name.strip().lower()) if word]
    left = [word for word in words if plain_name(word) not in _WHOLE and plain_name(word)]
    stem = "".join(plain_name(word) for word in left)
    for mark in _MARKS:
        if len(mark) > 2:
            stem = stem.removeprefix(mark).removesuffix(mark)
    return stem.removeprefix("σ")


def one_sided(name: str) -> bool:
    """Whether an error column is called that of one side alone."""
    return _side(name) is not None


def other_side(name: str, names: Iterable[str]) -> str | None:
    """The column with the error of the other side, ``err_hi`` of ``err_lo``; None where there is not one.

    In the catalogues of the CDS ``e_x`` is the lower error of x where there is ``E_x`` too.
    """
    if name[:2] in ("e_", "E_"):
        twin = name[0].swapcase() + name[1:]
        return twin if twin in names else None
    mine = _side(name)
    if mine is None:
        return None
    found = [n for n in names if is_error(n) and _side(n) == (mine[0], not mine[1])]
    return found[0] if len(found) == 1 else None


def _side(name: str) -> tuple[str, bool] | None:
    """What is left of an error column's name without its side, and whether that is the upper one."""
    stripped = name.strip().lower()
    if stripped[-1:] in ("+", "-"):
        return plain_name(stripped[:-1]), stripped[-1] == "+"
    words = [plain_name(w) for w in re.split(r"[_ .()\[\]-]+", stripped)]
    for i, word in enumerate(words):
        for sides, endings, upper in ((_LOWER, ("lower", "minus"), False), (_UPPER, ("upper", "plus"), True)):
            ending = word if word in sides else next((e for e in endings if word.endswith(e)), None)
            if ending is not None:
                return "".join([*words[:i], word.removesuffix(ending), *words[i + 1 :]]), upper
    return None


def is_beside(name: str) -> bool:
    """Whether a column is called neither what was measured nor its error: another coordinate, a number."""
    plain = plain_name(name).rstrip("0123456789")
    whole = plain_name(name)
    return (
        whole in _BESIDE
        or plain in _BESIDE
        or "j2000" in whole
        or plain.startswith("dist")
        or plain.endswith("width")
    )


def error_unit_of(name: str, unit: str | None = None) -> Literal["percent", "fraction"] | None:
    """Whether an error is called relative, by its name or its unit; None where nothing says so."""
    if _PERCENT.search(name.lower()) or (unit or "").strip().lower() in ("%", "percent", "pct"):
        return "percent"
    return "fraction" if _FRACTION.search(name.strip().lower()) else None
