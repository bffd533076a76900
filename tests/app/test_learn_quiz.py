"""The quiz on the Learn page without a browser: rounds, guesses, the classifier's and the truth."""

from __future__ import annotations

import numpy as np
import pytest

from app.pages.learn.scoring import Said
from app.work.tasks import Task, Watch
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
    shell = open_shell(f"{QUIZ}&game=2&difficulty=easy&sure=3")
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
        assert ("+96 points" if truths[number - 1] == 0 else "-224 points") in quiz.status.text
        np.testing.assert_allclose(line.data["y"], quiz.streams.clean[quiz.rows[number - 1]])
        assert quiz.clue is not None
        quiz.guess(1)  # too late
        assert (quiz.said[-1].choice, quiz.said[-1].sure) == (0, 0.9)
        quiz.go_on()
    mine, machine = int((truths == 0).sum()), [quiz.taken_for(i + 1) for i in range(10)]
    assert f"You: {mine} of 10" in quiz.summary.text
    assert f"The classifier: {int((truths == machine).sum())} of 10" in quiz.summary.text
    judged = quiz.judged
    own = judged.classifier.predict(quiz.observed[quiz.rows])
    np.testing.assert_array_equal(machine, own)
    again = open_shell(session.search)
    assert lesson(again).guesses == [0] * 10
    got = mine * 96 - (10 - mine) * 224
    assert f'<td class="total">{got}</td>' in lesson(again).scores.object
    assert f"right 9.0 times out of 10 and were {mine} times" in quiz.calibration.text
    assert ("you were surer" in quiz.calibration.text) == (mine < 8)
    quiz.new_game()
    assert (session.game, quiz.number, quiz.guesses) == (3, 1, [])


def test_levels_ask_about_neighbours_and_a_choice_made_elsewhere_counts(open_shell):
    def asked(query):
        return [choice.token for choice in lesson(open_shell(f"{QUIZ}{query}")).choices]

    assert asked("") == asked("&difficulty=extreme") == THREE.split(",")
    assert asked("&difficulty=easy") == ["1e3-1e5", "1e7-1e9"]
    assert asked("&mass=1e5-1e7,1e7-1e9") == ["1e5-1e7", "1e7-1e9"]
    shell = open_shell(f"{QUIZ}&difficulty=easy")
    assert len(lesson(shell).buttons) == 2
    shell.session.difficulty = "hard"
    assert len(lesson(shell).buttons) == 3
    assert plot.TRUTH.format(2) in lesson(shell).live.sources


def test_points_are_those_of_the_probability_of_every_class(open_shell):
    sure = Said(1, 0.75, 3)
    missed = 0.25**2 + 2 * 0.125**2  # the other two share what is left
    assert sure.points(1) == pytest.approx(100 * (1 - missed * 3 / 2))
    stated = np.array([0.2, 0.5, 0.3])
    assert Said.of(stated).points(2) == pytest.approx(100 * (1 - (0.04 + 0.25 + 0.49) * 3 / 2))
    assert Said(0, 1 / 3, 3).points(2) == 0


@pytest.mark.parametrize("change", [{"difficulty": "hard"}, {"game": 5}])
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
    lines = lesson(shell).card.files["csv"]().decode().splitlines()
    table = next(line for line in lines if not line.startswith("#"))
    assert "q_rho," not in table
    assert not table.endswith("q_rho")
    bad = open_shell(f"{QUIZ}&answers=zzzz-0").session
    assert "answers" in bad.problems[0]


def test_averaging_and_noise_are_those_chosen(open_shell):
    shell = open_shell(f"{QUIZ}&average=15")
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
        exec(compile(card.code(), "<shown>", "exec"), {})
    assert {p.name for p in tmp_path.glob("*.png")} == {"quiz.png", "clue.png"}
    assert "\nfrom,to,share_" in lesson(shell).clue_card.files["csv"]().decode()


def test_other_streams_do_not_stop_the_classifier_that_is_learning(open_shell):
    shell = open_shell(f"{QUIZ}&difficulty=easy")
    task = lesson(shell).watch.following
    lesson(shell).new_game()
    if task is not None:  # nobody has asked for this classifier before
        assert not task.stopping
    wait(shell)
    assert lesson(shell).judged is not None


def test_a_task_asked_for_again_goes_on(monkeypatch):
    watch, task, stops = Watch(lambda _: None), Task("learns"), []
    monkeypatch.setattr(task, "stop", lambda: stops.append(task.key))
    watch.follow(task)
    watch.follow(task)
    assert (stops, task.waiting_for_it) == ([], 1)
    watch.leave()
    assert stops == ["learns"]
