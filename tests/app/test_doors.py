"""Locks of those who guess passwords: how long, for whom, and with how much memory."""

from __future__ import annotations

import pytest

from app.doors import ADDRESSES, FORGET_S, FREE_GUESSES, LONGEST_LOCK_S, Guesses


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        return self.now


def test_each_wrong_password_doubles_the_wait_up_to_a_bound():
    clock = Clock()
    guesses = Guesses(clock)
    waits = []
    for _ in range(40):
        guesses.wrong("192.0.2.1")
        waits.append(guesses.wait("192.0.2.1"))
        clock.now += waits[-1]
    assert waits[: FREE_GUESSES - 1] == [0] * (FREE_GUESSES - 1)
    assert waits[FREE_GUESSES - 1 : FREE_GUESSES + 3] == pytest.approx([1, 2, 4, 8])
    assert waits[-1] == pytest.approx(LONGEST_LOCK_S)
    assert guesses.wait("192.0.2.2") == 0


def test_the_right_password_and_an_hour_of_rest_begin_anew():
    clock = Clock()
    guesses = Guesses(clock)
    for _ in range(FREE_GUESSES):
        guesses.wrong("192.0.2.1")
    assert guesses.wait("192.0.2.1") > 0
    guesses.right("192.0.2.1")
    assert guesses.wait("192.0.2.1") == 0
    for _ in range(FREE_GUESSES + 8):
        guesses.wrong("192.0.2.1")
    clock.now += FORGET_S + 1
    guesses.wrong("192.0.2.1")
    assert guesses.wait("192.0.2.1") == 0


def test_one_ipv6_network_is_one_person():
    guesses = Guesses(Clock())
    for i in range(FREE_GUESSES):
        guesses.wrong(f"2001:db8::{i:x}")
    assert guesses.wait("2001:db8::ffff") > 0
    assert guesses.wait("2001:db8:0:1::1") == 0


def test_memory_is_bounded_however_many_guess():
    guesses = Guesses(Clock())
    for i in range(3 * ADDRESSES):
        guesses.wrong(f"10.{i >> 16}.{i >> 8 & 255}.{i & 255}")
    for text in ("", "no address", "x" * 10_000):
        guesses.wrong(text)
    assert len(guesses) <= ADDRESSES
