"""The story on the Learn page without a browser: every number is computed, every link leads somewhere."""

from __future__ import annotations

import re

import numpy as np
import pytest

from app.pages.learn.steps import STEPS
from app.pages.learn.text import GLOSSARY
from app.services.comparison import noisy_profiles, shared_comparison
from app.session.session import Session
from streamdash.observe.wording import percent
from streamdash.plots import story
from streamdash.statistics.held_out import held_out

STORY = "?page=learn"


def lesson(shell):
    return shell.page.lesson


def words(shell) -> str:
    return lesson(shell).words.text


def bold(shell) -> list[str]:
    """What is printed bold: the numbers that matter."""
    return re.findall(r"\*\*(?:\w+~)?([^*]+)\*\*", " ".join(words(shell).split()))


def test_the_story_is_told_step_by_step_and_its_code_runs(open_shell, shipped_cache, tmp_path, monkeypatch):
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    shell = open_shell(STORY)
    assert lesson(shell).back.disabled
    texts = []
    for number in range(1, len(STEPS) + 1):
        assert shell.session.step == number
        assert f"step={number}" in shell.session.search or number == 1
        texts.append(words(shell))
        assert len(lesson(shell).card._sentence.text) > 40
        assert len(lesson(shell).step.table()) > 5
        exec(compile(lesson(shell).code(), "<shown>", "exec"), {})
        assert (tmp_path / "story.png").read_bytes().startswith(b"\x89PNG")
        (tmp_path / "story.png").unlink()
        for _, query in lesson(shell).links.links:
            there = Session(shell.session.pages, shell.session.catalog)
            there.load(query)
            assert there.problems == []
            assert (there.page, there.lesson, there.step) != ("learn", "story", number)
        lesson(shell)._go(1)
    assert lesson(shell).on.disabled
    assert not re.search(r"\b(nan|inf|None)\b", " ".join(texts))
    for symbol in (
        "ρ̄",
        "Qρ",
        "θ∥",
        "ℓ",
        "σ_ε",
        "M☉",
        "Gyr",
        "kpc",
        "PDF(Qρ)",
        "ln B",
        "primordial black hole",
    ):
        assert symbol in " ".join(texts), symbol
        assert symbol in GLOSSARY, symbol


def test_the_numbers_of_the_pattern_are_the_ensembles(open_shell, services):
    shell = open_shell(f"{STORY}&step=5")
    light, heavy = shell.session.ensembles
    for choice in (light, heavy):
        assert f"{float(services.ensemble(choice.key)['n_impacts'].mean()):.0f}" in bold(shell)
        assert f"{np.median(services.observed([choice]).q[0].std(axis=1)):.2g}" in bold(shell)
    shown = np.array(lesson(shell).live.sources["clean 1"].data["y"])
    np.testing.assert_array_equal(shown, services.observed([heavy]).q[0][0])
    lesson(shell).step._draw_others()
    np.testing.assert_array_equal(
        lesson(shell).live.sources["clean 1"].data["y"], services.observed([heavy]).q[0][1]
    )


def test_the_noise_slider_moves_dots_and_words(open_shell, services):
    shell = open_shell(f"{STORY}&step=6&noise=0.1")
    assert "100 stars" in bold(shell)
    before = np.array(lesson(shell).live.sources["noisy 0"].data["y"])
    shell.session.noise = 0.2
    assert "25 stars" in bold(shell)
    after = np.array(lesson(shell).live.sources["noisy 0"].data["y"])
    clean = np.array(lesson(shell).live.sources["clean 0"].data["y"])
    np.testing.assert_allclose(after - clean, 2 * (before - clean), atol=1e-5)
    share = 100 * (np.abs(services.observed([shell.session.ensembles[0]]).q[0] - 1) > 0.2).mean()
    assert f"{share:.0f} %" in bold(shell)
    shell.session.noise = 0
    assert "endlessly" in words(shell)


def test_the_evidence_told_is_the_evidence_pages(open_shell, services):
    shell = open_shell(f"{STORY}&step=8&noise=0.2")
    found = shared_comparison(services, shell.session).evidence
    for value in (found.cumulative(0, 0, 1).value, found.cumulative(1, 1, 0).value):
        assert f"{value:.1f}" in words(shell)
        assert f"{value:.1f}" not in bold(shell)
    q = noisy_profiles(services, shell.session.ensembles, 0.2)
    judged = held_out(q[0], q[1], shell.session.n_bin)
    assert bold(shell)[-2:] == [percent(one.right) for one in judged]


def test_the_steps_with_classes_name_their_colours(open_shell):
    for step in (5, 6, 8, 9):
        shell = open_shell(f"{STORY}&step={step}")
        assert [words for kind, words in lesson(shell).step.swatches() if kind.startswith("line-#")] == [
            "M0 · 10³–10⁵ M☉",
            "M1 · 10⁵–10⁹ M☉",
        ]
        assert "(blue)" in words(shell)
        assert "(orange)" in words(shell)


def test_the_mass_slider_moves_the_gap_and_the_words(open_shell):
    shell = open_shell(f"{STORY}&step=4")
    before = bold(shell)
    shell.session.mass10 = 6.5
    film = lesson(shell).step.film
    assert bold(shell) != before
    assert f"{100 * (1 - np.nanmin(film.q_rho[-1])):.0f} %" in bold(shell)
    np.testing.assert_array_equal(lesson(shell).live.sources["now"].data["y"], film.density[-1])


def test_what_it_takes_to_see_the_lightest(open_shell):
    shell = open_shell(f"{STORY}&step=9&noise=0.1")
    data = lesson(shell).step.data
    assert f"{data.visible_from(0):.1f}°" in bold(shell)
    assert f"{data.deviation[0, 1, 0]:.2g}" in bold(shell)
    shell.session.noise = 0.3
    noise = lesson(shell).live.sources[story.NOISE].data["y"]
    assert noise[0] == pytest.approx(0.3)
    assert f"{lesson(shell).step.data.visible_from(0):.1f}°" in bold(shell)


def test_steps_and_lessons_that_are_left_let_go_of_the_session(open_shell):
    shell = open_shell(f"{STORY}&step=6")
    session = shell.session

    def watchers() -> int:
        return sum(len(found) for kinds in session.param.watchers.values() for found in kinds.values())

    before = watchers()
    for step in (4, 9, 3, 6):
        session.step = step
    assert watchers() == before
    session.lesson = "flyby"
    session.lesson = "story"
    assert watchers() == before


def test_whatever_is_predicted_the_outcome_is_computed_and_seen(open_shell):
    shell = open_shell(f"{STORY}&noise=0.2")
    session = shell.session
    for number in range(1, len(STEPS) + 1):
        session.step = number
        prediction = lesson(shell).prediction
        before = {name: getattr(session, name) for name in ("mass10", "noise", "seed")}
        prediction.say(0)
        right = [button.label.startswith("✓") for button in prediction.buttons]
        assert sum(right) == 1
        assert prediction.verdict.text.startswith("As you said." if right[0] else "No: ")
        assert not re.search(r"\b(nan|inf|None)\b", prediction.verdict.text)
        changed = {name for name in before if getattr(session, name) != before[name]}
        assert changed <= lesson(shell).step.uses
        said = prediction.verdict.text
        prediction.say(1)  # the first answer counts
        assert prediction.verdict.text == said


def test_a_number_in_the_text_is_dragged_and_the_figure_follows(open_shell):
    shell = open_shell(f"{STORY}&step=4")
    session, prose = shell.session, lesson(shell).words
    before = np.array(lesson(shell).live.sources["now"].data["y"])
    prose.moved = ["mass10", 2, 1]
    assert session.mass10 == 8
    assert "mass10~1.0·10⁸ M☉" in prose.text
    assert np.abs(lesson(shell).live.sources["now"].data["y"] - before).max() > 0.01
    for message in (["noise", 1, 2], ["game", 1, 3], ["mass10", "x", 4], "nonsense", ["mass10", 99, 5]):
        prose.moved = message
    assert (session.mass10, session.noise, session.game) == (9, 0.1, 0)


def test_the_gap_of_the_first_step_is_solved_in_the_last(open_shell):
    shell = open_shell(STORY)
    first = lesson(shell).step
    assert np.isnan(lesson(shell).live.sources["truth 1"].data["y"]).all()
    shell.session.step = len(STEPS)
    last = lesson(shell).step
    np.testing.assert_array_equal(first.shown.observed, last.shown.observed)
    assert last.shown.names[last.shown.truth].replace("–", "") in words(shell).replace("–", "").replace(
        "\\", ""
    )
    np.testing.assert_array_equal(
        lesson(shell).live.sources[f"truth {last.shown.truth}"].data["y"], last.shown.clean
    )
