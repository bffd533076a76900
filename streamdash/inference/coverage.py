"""Do the shipped estimators' intervals hold the truth as often as they say?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from streamdash.inference.cells import AGE
from streamdash.inference.diagnostics import LEVELS, Score, score, scores
from streamdash.inference.estimator import Estimator
from streamdash.inference.files import SHIPPED
from streamdash.inference.held_out import HeldOut
from streamdash.inference.posterior import Posterior

ASKED = (0.03, 0.015)
"""How far the coverage of an interval of each of `LEVELS` may be from it."""
SIGNIFICANT = 2.0
"""A coverage counts as wrong where its distance exceeds `ASKED` by so many of its standard errors."""


@dataclass(frozen=True)
class Row:
    """One parameter of one estimator, on some of its prior's streams.

    Attributes
    ----------
    what : what the posterior was told, in words: nothing, the size of the errors, an age.
    name : the parameter.
    score : Score
    """

    what: str
    name: str
    score: Score

    @property
    def right(self) -> bool:
        """Whether the coverage of both intervals is what it should be, as far as so many streams tell."""
        return all(
            abs(share - level) <= margin + SIGNIFICANT * np.sqrt(level * (1 - level) / self.score.n)
            for share, level, margin in zip(self.score.coverage, LEVELS, ASKED, strict=True)
        )


def shipped_names() -> list[tuple[str, str, bool]]:
    """Stream, prior, and whether it is told, of every estimator that is shipped."""

    def names(folder: Path) -> list[tuple[str, str]]:
        found = (path.stem.rsplit("-", 1) for path in sorted(folder.glob("*.npz")))
        return [(stream, prior) for stream, prior in found]

    plain = [(*name, False) for name in names(SHIPPED)]
    return plain + [(*name, True) for name in names(SHIPPED / "told")]


def rows(estimator: Estimator, streams: HeldOut, factors: Sequence[float] = (1.0,)) -> Iterator[Row]:
    """Coverage over all the streams, and of an estimator that infers the age also with each age known.

    Parameters
    ----------
    factors : sizes of the errors, relative to the design's, where the estimator is told.
    """
    for factor in factors if estimator.noise_told else (1.0,):
        words = f"errors × {factor:g}" if estimator.noise_told else ""
        p = estimator.posterior(streams.observed(estimator, factor), factor)
        for name, found in scores(p, estimator.grid, streams.truth).items():
            if name != AGE:
                yield Row(words, name, found)
        if AGE not in estimator.grid:
            continue
        for age in sorted(estimator.prior.ages_gyr):
            there = (streams.truth[AGE] == age).to_numpy()
            known = [Posterior(estimator.grid, one).at(AGE, age) for one in p[there]]
            for name in estimator.prior.names:
                marginal = np.array([one.marginal(name) for one in known])
                truth = streams.truth.loc[there, name].to_numpy()
                found = score(marginal, np.asarray(estimator.grid[name]), truth)
                yield Row(f"{words}, {age:g} Gyr", name, found)


def table(found: Sequence[tuple[str, Row]]) -> str:
    """Rows of several estimators, each with its estimator's name, as a table in Markdown."""
    lines = [
        "| estimator | told | parameter | streams | information (bits) "
        "| coverage of 68 % | of 95 % | as asked |",
        "|---" * 8 + "|",
    ]
    for title, row in found:
        one = row.score
        shares = " | ".join(f"{share:.3f}" for share in one.coverage)
        lines.append(
            f"| {title} | {row.what} | {row.name} | {one.n} | {one.information:.2f} ± {one.error:.2f} "
            f"| {shares} | {'yes' if row.right else 'no'} |"
        )
    return "\n".join(lines)
