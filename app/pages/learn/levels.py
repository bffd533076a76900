"""Which mass ranges the quiz asks about: neighbours, which are hard to tell apart."""

from __future__ import annotations

from collections.abc import Hashable

from app.session.catalog import CLASSES_MAX, CLASSES_MIN, Choice, Stream
from app.session.session import Session


def asked_about(session: Session) -> tuple[Choice, ...]:
    """Ranges of the chosen difficulty; those somebody has chosen on another page, if they did.

    By default they are the longest chain of ranges that border on one another, and the two ends of it
    where the difficulty is easy.
    """
    stream = session.catalog.stream(session.stream)
    if stream is None or [c.key for c in session.ensembles] != [c.key for c in stream.default()]:
        return session.ensembles
    chain = neighbours(stream)
    if len(chain) < CLASSES_MIN:
        return session.ensembles
    return (chain[0], chain[-1]) if session.difficulty == "easy" else chain


def game_of(session: Session) -> Hashable:
    """What makes two games of the quiz the same."""
    return session.stream, tuple(session.mass), session.difficulty, session.game


def neighbours(stream: Stream) -> tuple[Choice, ...]:
    """The longest chain of plain mass ranges each of which begins where the one before ends."""
    plain = [c for c in stream.ensembles if c.token == c.config.population.label and not _many(c)]
    best: tuple[Choice, ...] = ()
    chains: list[tuple[Choice, ...]] = [(c,) for c in plain]
    while chains:
        chain = chains.pop()
        if len(chain) > len(best):
            best = chain
        if len(chain) < CLASSES_MAX:
            chains += [(*chain, c) for c in plain if _range(c)[0] == _range(chain[-1])[1]]
    return best


def _many(choice: Choice) -> bool:
    return len(choice.config.population.components) > 1


def _range(choice: Choice) -> tuple[float, float]:
    return choice.config.population.components[0].mass_range
