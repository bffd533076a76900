"""Tables of measured profiles that tests are made from, and what is said when one is refused."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.observe.guess import assume
from streamdash.observe.observation import interpret
from streamdash.observe.table import ObservationError, read_table

PHI1 = np.arange(-90.0, -28.0, 2.0)
Q = 1 + 0.3 * np.sin(PHI1 / 7)


def csv(*columns: np.ndarray, header: str = "", separator: str = ",") -> bytes:
    rows = "\n".join(separator.join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True))
    return (f"{header}\n{rows}\n" if header else f"{rows}\n").encode()


def comma(data: bytes) -> bytes:
    """The same table with decimal commas, in every number."""
    return b"\n".join(
        line if i == 0 else line.replace(b".", b",") for i, line in enumerate(data.splitlines())
    )


def shuffled(data: bytes) -> bytes:
    """The same table with its rows in another order."""
    head, *rows = data.decode().splitlines()
    return "\n".join([head, *np.random.default_rng(1).permutation(rows)]).encode()


def profile(**changes: str) -> bytes:
    """A good table of φ1, Qρ and error, with the words of some lines replaced."""
    lines = csv(PHI1, Q, 0.1 + 0 * Q, header="phi1,q_rho,error").decode().splitlines()
    for line, text in changes.items():
        lines[int(line.lstrip("line")) - 1] = text
    return "\n".join(lines).encode()


def refused(data: bytes, geometry, **changes) -> str:
    with pytest.raises(ObservationError) as error:
        table = read_table(data)
        interpret(table, assume(table, changes), geometry)
    sentence = str(error.value)
    assert "\n" not in sentence
    assert len(sentence) < 400
    return sentence
