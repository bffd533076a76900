"""Numbers in sentences."""

from __future__ import annotations

import doctest

from streamdash import words
from streamdash.words import between, is_or_are, number_of, percent_between


def test_examples_of_the_module_hold():
    assert doctest.testmod(words).failed == 0


def test_one_is_singular_and_all_else_plural():
    assert [number_of(n, "bin") for n in (0, 1, 2)] == ["0 bins", "1 bin", "2 bins"]
    assert (is_or_are(0), is_or_are(1), is_or_are(2)) == ("are", "is", "are")


def test_nothing_is_minus_zero():
    assert between(-0.0001, -0.2, 0.0001, digits=1) == "0.0 (-0.2–0.0)"
    assert percent_between(1.0, 0.9987, 1.0) == "100.0 % (99.9–100.0 %)"
