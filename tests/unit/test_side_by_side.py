"""Steps of learning side by side: their order, their progress, and how they end."""

import threading

import pytest

from streamdash.classifier.data import Cancelled
from streamdash.observe.side_by_side import SideBySide


def test_progress_begins_at_once_never_falls_and_ends_whole():
    seen = []
    with SideBySide(lambda done, total: seen.append((done, total)), None, 10.0) as steps:
        assert seen == [(0, 100)]
        long = steps.within(4.0)
        results = [steps.start(1.0, pow, 2, n) for n in range(6)]
        for done in (1, 2, 4):
            long(done, 4)
    assert [step.result() for step in results] == [1, 2, 4, 8, 16, 32]
    assert seen == sorted(seen)
    assert seen[-1] == (100, 100)


def test_steps_that_were_not_begun_do_not_begin_once_it_is_stopped():
    stopped, begun = threading.Event(), []
    with pytest.raises(Cancelled), SideBySide(None, stopped.is_set, 2.0) as steps:
        steps.start(1.0, begun.append, 1).result()
        stopped.set()
        steps.start(1.0, begun.append, 2).result()
    assert begun == [1]


def test_what_a_step_raises_ends_the_others():
    def fails():
        raise ValueError("no such streams")

    release = threading.Event()
    with pytest.raises(ValueError, match="no such streams"), SideBySide(None, None, 2.0) as steps:
        failed = steps.start(1.0, fails)
        later = [steps.start(1.0, release.wait, 60) for _ in range(1000)]  # more than there are processors
        later[-1].add_done_callback(lambda _: release.set())
        failed.result()
    assert later[-1].cancelled()
