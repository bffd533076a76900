"""The quiz on the Learn page without a browser: rounds, guesses, the classifier's and the truth."""

from __future__ import annotations

import numpy as np
import pytest

from streamdash.classifier.data import split
from streamdash.plots import quiz as plot
from tests.waiting import wait_until

QUIZ = "?page=learn&lesson=quiz"
THREE = "1e3-1e5,1e5-1e7,1e7-1e9"


def lesson(shell):
    return shell.page.lesson


def wait(shell) -> None:
    """Until the classifier has been trained, as the timer of a session would."""

    def look() -> bool:
        lesson(shell).watch.look()
        return lesson(shell).judged is not None

    wait_until(look, "still training", 0.1)


def test_the_same_link_asks_everybody_about_the_same_ten(open_shell):
    one, other = open_shell(f"{QUIZ}&game=7"), open_shell(f"{QUIZ}&game=7")
    np.testing.assert_array_equal(lesson(one).rows, lesson(other).rows)
    assert (lesson(open_shell(f"{QUIZ}&game=8")).rows != lesson(one).rows).any()
    lesson(one).guess(0)
    assert lesson(one).link.query == lesson(other).link.query == f"{QUIZ}&game=7"


def test_a_game_is_played_to_its_end(open_shell):
    shell = open_shell(f"{QUIZ}&game=2")
    wait(shell)
    quiz, session = lesson(shell), shell.session
    truths = quiz.streams.y[quiz.rows]
    assert not set(quiz.rows) - set(split(quiz.streams.y, quiz.judged.classifier.card.settings.seed).test)
    for number in range(1, 11):
        assert (quiz.number, quiz.revealed) == (number, False)
        assert not quiz.clue_card.view.visible
        line = quiz.live.sources[plot.TRUTH.format(truths[number - 1])]
        assert np.isnan(line.data["y"]).all()
        quiz.guess(0)
        assert quiz.revealed
        assert ("Right" in quiz.status.text) == (truths[number - 1] == 0)
        np.testing.assert_allclose(line.data["y"], quiz.streams.clean[quiz.rows[number - 1]])
        assert quiz.clue is not None
        quiz.guess(1)  # too late
        assert quiz.guesses[-1] == 0
        quiz.go_on()
    mine, machine = int((truths == 0).sum()), [quiz.taken_for(i + 1) for i in range(10)]
    assert f"You: {mine} of 10" in quiz.summary.text
    assert f"The classifier: {int((truths == machine).sum())} of 10" in quiz.summary.text
    judged = quiz.judged
    own = judged.classifier.predict(quiz.observed[quiz.rows])
    np.testing.assert_array_equal(machine, own)
    again = open_shell(session.search)
    assert lesson(again).guesses == [0] * 10
    assert f"{mine} of 10" in lesson(again).scores.object
    quiz.new_game()
    assert (session.game, quiz.number, quiz.guesses) == (3, 1, [])


@pytest.mark.parametrize("change", [{"difficulty": "medium"}, {"game": 5}])
def test_answers_of_another_game_do_not_count(open_shell, change):
    shell = open_shell(QUIZ)
    lesson(shell).guess(1)
    assert lesson(shell).guesses == [1]
    shell.session.param.update(**change)
    assert lesson(shell).guesses == []
    assert lesson(shell).number == 1


def test_nobody_looks_ahead(open_shell):
    shell = open_shell(f"{QUIZ}&round=9")
    assert lesson(shell).number == 1
    table = lesson(shell).card.files["csv"]().decode()
    assert "q_rho," not in table.splitlines()[0]
    assert not table.splitlines()[0].endswith("q_rho")
    bad = open_shell(f"{QUIZ}&answers=zzzz-0").session
    assert "answers" in bad.problems[0]


def test_averaging_and_noise_are_those_chosen(open_shell):
    shell = open_shell(f"{QUIZ}&difficulty=medium&average=15&mass={THREE}")
    quiz = lesson(shell)
    assert len(quiz.buttons) == 3
    shown = np.array(quiz.live.sources[plot.OBSERVED].data["y"])
    residual = shown - quiz.streams.clean[quiz.rows[0]]
    assert residual.std() == pytest.approx(0.3, rel=0.15)
    averaged = np.array(quiz.live.sources[plot.AVERAGED].data["y"])
    assert averaged[100] == pytest.approx(shown[93:108].mean(), rel=1e-4)


def test_code_runs_as_shown(open_shell, shipped_cache, tmp_path, monkeypatch):
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    shell = open_shell(QUIZ)
    lesson(shell).guess(0)
    for card in (lesson(shell).card, lesson(shell).clue_card):
        exec(compile(card._code(), "<shown>", "exec"), {})
    assert {p.name for p in tmp_path.glob("*.png")} == {"quiz.png", "clue.png"}
    assert lesson(shell).clue_card.files["csv"]().decode().startswith("from,to,share_")
