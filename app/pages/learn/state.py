"""What the Learn page remembers, and its form in links."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import param

from app.session.catalog import CLASSES_MAX
from app.session.fields import Decimal, Listed, OneOf, Text, Whole
from streamdash.classifier.quiz import ROUNDS
from streamdash.config import ConfigError
from streamdash.engine.flyby import FRAMES, Flyby

LESSONS = {"story": "The story", "flyby": "One fly-by", "quiz": "Guess the mass", "teach": "For teachers"}
STEPS = 10
FLYBYS_MAX = 12
CROWD_MAX = 100
DIFFICULTIES = {"easy": "Easy", "medium": "Medium", "hard": "Hard", "extreme": "Very hard"}
QUIZ_NOISE = {"easy": 0.3, "medium": 0.3, "hard": 0.6, "extreme": 1.0}
"""Shot noise σ_ε per bin of each difficulty."""
SURE = (0.6, 0.75, 0.9, 0.99)
"""How sure one can say to be in the quiz, above a guess."""

HAND = {
    "mass10": "log10_mass",
    "size": "size",
    "b": "b",
    "speed": "speed",
    "pitch": "pitch",
    "azimuth": "azimuth",
    "when": "time_gyr",
    "where": "place",
}
"""Session parameters of the fly-by in hand, and the fields of `Flyby` that they are."""
DIGITS = {"mass10": 2, "size": 2, "b": 2, "speed": 0, "pitch": 0, "azimuth": 0, "when": 2, "where": 2}
"""Digits behind the point in links."""


def hand_field(name: str) -> Any:
    """Lowest, highest and default value of one choice about the fly-by in hand."""
    info = Flyby.model_fields[HAND[name]]
    limits = {
        kind: getattr(limit, kind)
        for limit in info.metadata
        for kind in ("ge", "gt", "le")
        if hasattr(limit, kind)
    }
    return limits.get("ge", 0.1), limits["le"], info.default


def read_flybys(text: str) -> list[tuple[float, ...]]:
    """Several fly-bys out of a link: eight numbers each, joined by commas; fly-bys joined by ``~``."""
    flybys = []
    for rank, item in enumerate(text.split("~")[: FLYBYS_MAX + 1], 1):
        try:
            words = zip(item.split(","), DIGITS.values(), strict=True)
            values = tuple(round(float(word), digits) + 0.0 for word, digits in words)
            Flyby(**dict(zip(HAND.values(), values, strict=True)))
        except ConfigError as error:
            raise ValueError(
                f"has a fly-by (number {rank}) that cannot be: {str(error).rstrip('.')}"
            ) from None
        except ValueError:
            raise ValueError(
                f"must list {len(HAND)} numbers per fly-by, as in 8,1,0.5,200,90,0,4,0.5"
            ) from None
        flybys.append(values)
    if len(flybys) > FLYBYS_MAX:
        raise ValueError(f"must list at most {FLYBYS_MAX} fly-bys")
    return flybys


def write_flybys(flybys: Sequence[tuple[float, ...]]) -> str:
    """Inverse of `read_flybys`."""
    digits = DIGITS.values()
    return "~".join(
        ",".join(f"{round(value, n):g}" for value, n in zip(flyby, digits, strict=True)) for flyby in flybys
    )


def check_answers(text: str) -> str:
    """Guesses of one game: four hexadecimal digits that name the game, a dash, two digits a round.

    The first is the class, the second how sure one was: 0 for a guess, else the place in `SURE`, from 1.
    """
    if not re.fullmatch(rf"[0-9a-f]{{4}}-([0-{CLASSES_MAX - 1}][0-{len(SURE)}]){{1,{ROUNDS}}}", text):
        raise ValueError("must be what this page wrote, such as 1a2b-0211")
    return text


def check_room(text: str) -> str:
    """Code of a class."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{12}", text):
        raise ValueError("must be the code of a class, as its link has it")
    return text


def _hand(name: str, doc: str) -> Decimal:
    low, high, default = hand_field(name)
    return Decimal(default, (low, high), digits=DIGITS[name], doc=doc)


class LearnState(param.Parameterized):
    """Choices of the Learn page."""

    lesson = OneOf("story", LESSONS, doc="part of the page shown")
    step = Whole(1, (1, STEPS), doc="step of the story")
    mass10 = _hand("mass10", "log₁₀ of the mass of the fly-by in hand, M☉")
    size = _hand("size", "its scale radius relative to the usual one of that mass")
    b = _hand("b", "its impact parameter in scale radii")
    speed = _hand("speed", "its speed, km/s")
    pitch = _hand("pitch", "angle to the stream's motion, degrees")
    azimuth = _hand("azimuth", "side it comes from, degrees")
    when = _hand("when", "time before today, Gyr")
    where = _hand("where", "fraction of the stream's length then")
    flybys = Listed(
        tuple,
        FLYBYS_MAX,
        read_flybys,
        write_flybys,
        doc="fly-bys added before, values in the order of `HAND`",
    )
    crowd = Whole(0, (0, CROWD_MAX), doc="random fly-bys on top")
    crowd_of = Whole(1, (0, CLASSES_MAX - 1), doc="model whose masses the random fly-bys have")
    crowd_seed = Whole(0, (0, 9999), doc="seed of the random fly-bys")
    frame = Whole(FRAMES - 1, (0, FRAMES - 1), doc="frame of the film shown; the last is today")
    difficulty = OneOf("medium", DIFFICULTIES, doc="difficulty of the quiz: its mass ranges and noise")
    sure = Whole(1, (0, len(SURE)), doc="how sure the next guess is: 0 a guess, else the place in `SURE`")
    game = Whole(0, (0, 9999), doc="seed of the quiz: the same ten streams for everybody")
    round = Whole(1, (1, ROUNDS), doc="round of the quiz shown")
    answers = Text("", check_answers, doc="guesses of this game so far")
    room = Text("", check_room, doc="class that the quiz's result goes to")
    projector = OneOf("no", ("no", "yes"), doc="whether the story is shown in large type, without controls")
    average = Whole(1, (1, 63), doc="bins averaged over in the quiz's figure")

    @property
    def hand(self) -> tuple[float, ...]:
        """Values of the fly-by in hand, in the order of `HAND`."""
        return tuple(getattr(self, name) for name in HAND)

    @property
    def chosen(self) -> list[Flyby]:
        """All fly-bys chosen by hand; the one in hand is the last."""
        return [
            Flyby(**dict(zip(HAND.values(), values, strict=True))) for values in (*self.flybys, self.hand)
        ]
