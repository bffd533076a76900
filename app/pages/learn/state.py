"""What the Learn page remembers, and its form in links."""

from __future__ import annotations

import re
from typing import Any

import param

from app.session.fields import Field, integer, number, option
from streamdash.classifier.quiz import ROUNDS
from streamdash.config import ConfigError
from streamdash.engine.flyby import FRAMES, Flyby

LESSONS = {"The story": "story", "One fly-by": "flyby", "Guess the mass": "quiz"}
STEPS = 6
FLYBYS_MAX = 12
CROWD_MAX = 100
GAME_MAX = 9999
AVERAGE_MAX = 63
DIFFICULTIES = {"Easy": "easy", "Medium": "medium", "Hard": "hard", "Very hard": "extreme"}
QUIZ_NOISE = {"easy": 0.1, "medium": 0.3, "hard": 0.6, "extreme": 1.0}
"""Shot noise σ_ε per 0.2° bin of each difficulty."""

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


def _flybys() -> Field:
    """Several fly-bys: eight numbers each, joined by commas; fly-bys joined by ``~``."""

    def read(text: str) -> list[tuple[float, ...]]:
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

    def write(flybys: list[tuple[float, ...]]) -> str:
        digits = DIGITS.values()
        return "~".join(
            ",".join(f"{round(value, n):g}" for value, n in zip(flyby, digits, strict=True))
            for flyby in flybys
        )

    return Field(read, write)


def _answers() -> Field:
    """Guesses of one game: four hexadecimal digits that name the game, a dash, one digit a round."""

    def read(text: str) -> str:
        if not re.fullmatch(rf"[0-9a-f]{{4}}-[0-3]{{1,{ROUNDS}}}", text):
            raise ValueError("must be what this page wrote, such as 1a2b-0110")
        return text

    return Field(read, str)


FIELDS: dict[str, Field] = {
    "lesson": option(*LESSONS.values()),
    "step": integer(1, STEPS),
    **{name: number(hand_field(name)[0], hand_field(name)[1], DIGITS[name]) for name in HAND},
    "flybys": _flybys(),
    "crowd": integer(0, CROWD_MAX),
    "crowd_of": integer(0, 3),
    "crowd_seed": integer(0, GAME_MAX),
    "frame": integer(0, FRAMES - 1),
    "difficulty": option(*DIFFICULTIES.values()),
    "game": integer(0, GAME_MAX),
    "round": integer(1, ROUNDS),
    "answers": _answers(),
    "average": integer(1, AVERAGE_MAX),
}


def _hand(name: str, doc: str) -> param.Number:
    low, high, default = hand_field(name)
    return param.Number(default, bounds=(low, high), doc=doc)


class LearnState(param.Parameterized):
    """Choices of the Learn page."""

    lesson: Any = param.Selector(
        default="story", objects=list(LESSONS.values()), doc="part of the page shown"
    )
    step = param.Integer(1, bounds=(1, STEPS), doc="step of the story")
    mass10 = _hand("mass10", "log₁₀ of the mass of the fly-by in hand, M☉")
    size = _hand("size", "its scale radius relative to the usual one of that mass")
    b = _hand("b", "its impact parameter in scale radii")
    speed = _hand("speed", "its speed, km/s")
    pitch = _hand("pitch", "angle to the stream's motion, degrees")
    azimuth = _hand("azimuth", "side it comes from, degrees")
    when = _hand("when", "time before today, Gyr")
    where = _hand("where", "fraction of the stream's length then")
    flybys = param.List([], item_type=tuple, doc="fly-bys added before, values in the order of `HAND`")
    crowd = param.Integer(0, bounds=(0, CROWD_MAX), doc="random fly-bys on top")
    crowd_of = param.Integer(1, bounds=(0, 3), doc="model whose masses the random fly-bys have")
    crowd_seed = param.Integer(0, bounds=(0, GAME_MAX), doc="seed of the random fly-bys")
    frame = param.Integer(
        FRAMES - 1, bounds=(0, FRAMES - 1), doc="frame of the film shown; the last is today"
    )
    difficulty: Any = param.Selector(
        default="easy", objects=list(DIFFICULTIES.values()), doc="difficulty of the quiz: its noise"
    )
    game = param.Integer(0, bounds=(0, GAME_MAX), doc="seed of the quiz: the same ten streams for everybody")
    round = param.Integer(1, bounds=(1, ROUNDS), doc="round of the quiz shown")
    answers = param.String("", doc="guesses of this game so far, see `FIELDS`")
    average = param.Integer(1, bounds=(1, AVERAGE_MAX), doc="bins averaged over in the quiz's figure")

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
