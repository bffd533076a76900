"""For teachers: a class is opened, students' results arrive without names, and memory stays bounded."""

from __future__ import annotations

import re

import pytest

from app.pages.learn.state import ROUNDS
from app.pages.learn.teaching import PLAN
from app.services.classrooms import CLASSROOMS, LASTS_S, RESULTS_MAX, Classrooms, Result
from app.session.session import Session

TEACH = "?page=learn&lesson=teach"
RESULT = Result((True,) * 10, 1000.0)


def test_the_plan_fills_a_lesson_and_every_part_is_a_page(open_shell):
    assert sum(minutes for minutes, *_ in PLAN) == 45
    shell = open_shell(TEACH)
    for _, _, _, there in PLAN:
        assert there["lesson"] in ("story", "flyby", "quiz")
        shell.session.param.update(**there)
        assert shell.page is not None
    shell.session.lesson = "teach"
    page = shell.page.lesson.worksheet().decode()
    assert page.startswith("<!doctype html>")
    assert page.count("<td>&nbsp;</td>") >= 3 * ROUNDS
    assert "http" not in page


def test_students_results_come_to_the_teachers_screen_without_names(open_shell):
    teacher = open_shell(f"{TEACH}&game=3&difficulty=easy")
    desk = teacher.page.lesson
    assert not desk.link.visible
    desk.open()
    assert re.fullmatch(r"[\w-]{12}", teacher.session.room)
    assert desk.link.query.startswith("?page=learn&lesson=quiz")
    for answer in (0, 1):
        student = open_shell(desk.link.query)
        assert student.session.problems == []
        quiz = student.page.lesson
        assert "without your name" in quiz.sent.text
        for _ in range(ROUNDS):
            quiz.guess(answer)
            quiz.go_on()
        assert quiz.sent.text.startswith("Your result has gone")
    desk.look()
    assert desk.state.text.startswith("2 finished")
    first, second = teacher.services.classrooms.results(teacher.session.room)
    assert [not one for one in first.right] == list(second.right)
    assert f"{(sum(first.right) + sum(second.right)) / 2:.1f} of 10" in desk.state.text
    assert desk.chart.object.count('class="fill"') == ROUNDS + 1
    other = open_shell(desk.link.query.replace("game=3", "game=4"))
    for _ in range(ROUNDS):
        other.page.lesson.guess(0)
        other.page.lesson.go_on()
    assert "stays here" in other.page.lesson.sent.text
    assert len(teacher.services.classrooms.results(teacher.session.room)) == 2


def test_classes_end_and_are_bounded():
    now = [0.0]
    rooms = Classrooms(lambda: now[0])
    code = rooms.open("game")
    assert rooms.add(code, "game", "one", RESULT)
    assert not rooms.add(code, "game", "one", Result((False,) * 10, 0.0))  # the first counts
    assert not rooms.add(code, "another game", "two", RESULT)
    assert not rooms.add("no-such-code", "game", "two", RESULT)
    for number in range(2 * RESULTS_MAX):
        rooms.add(code, "game", str(number), RESULT)
    assert len(rooms.results(code)) == RESULTS_MAX
    codes = [rooms.open("game") for _ in range(CLASSROOMS)]
    assert len(set(codes)) == CLASSROOMS
    assert not rooms.knows(code)  # the oldest had to go
    now[0] = LASTS_S + 1
    assert not any(map(rooms.knows, codes))
    assert rooms.results(codes[0]) == ()


def test_a_class_that_is_over_and_a_code_that_is_none_are_explained(open_shell):
    shell = open_shell(f"{TEACH}&room=abcdefghijkl")
    assert "closed" in shell.page.lesson.state.text
    session = open_shell(f"{TEACH}&room=x").session
    assert "code of a class" in session.problems[0]


@pytest.mark.parametrize("projector", ["no", "yes"])
def test_on_a_projector_the_story_has_no_controls(open_shell, projector):
    shell = open_shell(f"?page=learn&step=6&projector={projector}")
    page = shell.page
    assert page.choice.visible == (projector == "no")
    # How large it is, and its letters, a browser test measures.
    assert (page.lesson.live.figure.toolbar_location is None) == (projector == "yes")
    there = Session(shell.session.pages, shell.session.catalog)
    there.load(shell.session.search)
    assert there.projector == projector
