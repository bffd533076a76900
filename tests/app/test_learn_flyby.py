"""One fly-by on the Learn page without a browser: what is chosen is what the engine is asked."""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
import pytest

from app.pages.learn.state import FLYBYS_MAX
from streamdash.engine.density import perturbed_stream
from streamdash.engine.flyby import FRAMES, Flyby, flyby_impacts, kick_along_stream
from streamdash.plots import flyby as plot
from streamdash.survey.sky import longitude_bins

FLYBY = "?page=learn&lesson=flyby"
TWO_MORE = "&flybys=7,1,0.5,200,90,0,6,0.3~6.5,2,1,150,60,45,3,0.8"


def lesson(shell):
    return shell.page.lesson


def sent(shell) -> dict[str, np.ndarray]:
    """Frames that the browser has, by column: density, smooth, …"""
    player = lesson(shell).player
    values = np.frombuffer(player.frames, dtype=np.float32)
    n_frames, first, found = len(player.captions), 0, {}
    sources = {source.id: label for label, source in _sources(shell).items()}
    for identity, _, length in player.targets:
        found[sources[identity]] = values[first : first + n_frames * length].reshape(n_frames, length)
        first += n_frames * length
    assert first == len(values)
    return found


def _sources(shell) -> dict:
    return {**lesson(shell).density_live.sources, **lesson(shell).gap_live.sources}


def test_a_link_brings_back_every_flyby(open_shell):
    link = f"{FLYBY}{TWO_MORE}&mass10=8.25&b=0&where=0.9&crowd=5&crowd_seed=3&frame=40&azimuth=180"
    session = open_shell(link).session
    assert session.problems == []
    assert [f.log10_mass for f in session.chosen] == [7, 6.5, 8.25]
    assert session.chosen[1] == Flyby(
        log10_mass=6.5, size=2, b=1, speed=150, pitch=60, azimuth=45, time_gyr=3, place=0.8
    )
    again = open_shell(session.search).session
    assert (again.chosen, again.crowd, again.frame) == (session.chosen, 5, 40)
    assert again.search == session.search


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("flybys=1,2", "8 numbers"),
        ("flybys=7,1,0.5,200,5,0,6,0.3", "fly-by (number 1) that cannot be: pitch"),
        ("flybys=" + "~".join(["7,1,0.5,200,90,0,6,0.3"] * (FLYBYS_MAX + 1)), "at most"),
        ("mass10=12", "between 3 and 9"),
    ],
)
def test_a_wrong_link_is_explained_and_the_rest_is_kept(open_shell, query, words):
    session = open_shell(f"{FLYBY}&{query}&where=0.8").session
    assert len(session.problems) == 1
    assert words in session.problems[0]
    assert session.where == 0.8
    assert session.flybys == []


def test_the_browser_gets_the_engines_frames(open_shell, geometry):
    shell = open_shell(FLYBY)
    shell.session.mass10 = 8.25
    frames = sent(shell)
    assert len(frames[plot.NOW]) == FRAMES
    impacts = flyby_impacts(geometry, shell.session.chosen)
    assert impacts.mass_msun[0] == pytest.approx(10**8.25)
    today = perturbed_stream(geometry, impacts, lesson(shell).film.theta)
    np.testing.assert_allclose(frames[plot.NOW][-1], today.density, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(frames[plot.SMOOTH][-1], today.smooth, rtol=1e-5, atol=1e-7)
    for label, source in _sources(shell).items():
        if label in frames:  # what the browser writes into must have a frame's length
            column = "image" if label == plot.STRIP else "x" if label == plot.STRUCK else "y"  # a drop falls
            assert np.size(source.data[column]) == frames[label].shape[1], label


def test_the_kick_follows_the_controls(open_shell, geometry):
    shell = open_shell(FLYBY)
    shell.session.param.update(speed=350, pitch=45)
    kick = kick_along_stream(geometry, shell.session.chosen[-1])
    shown = lesson(shell).turn_live.sources[plot.TURN].data
    np.testing.assert_allclose(shown["y"], kick.d_omega)
    axis = lesson(shell).turn_live.figure.y_range
    assert axis.end >= np.abs(kick.d_omega).max()


def test_today_is_seen_with_and_without_noise(open_shell, geometry):
    shell = open_shell(f"{FLYBY}&noise=0.2")
    data = lesson(shell).seen_live.sources
    clean, noisy = (np.array(data[label].data["y"]) for label in (plot.CLEAN, plot.NOISY))
    assert len(clean) == len(longitude_bins(geometry)) - 1
    assert np.std(noisy - clean) == pytest.approx(0.2, rel=0.15)
    shell.session.noise = 0
    np.testing.assert_array_equal(data[plot.NOISY].data["y"], clean)
    assert "This is one fly-by alone" in lesson(shell).seen_card._sentence.text


def test_flybys_are_added_one_by_one_until_the_one_in_hand_drowns(open_shell):
    shell = open_shell(FLYBY)
    session = shell.session
    first = session.hand
    lesson(shell).add()
    assert session.flybys == [first]
    assert session.hand != first
    assert len(lesson(shell).seen.alone) and lesson(shell).seen.n_impacts == 2
    few = lesson(shell).seen.share
    session.crowd = 60
    assert lesson(shell).seen.share < 0.5 * few
    assert "62 fly-bys" in lesson(shell).seen_card._sentence.text
    lesson(shell).remove()
    assert (session.flybys, session.hand) == ([], first)


def test_scrubbing_says_what_is_shown_and_resends_nothing(open_shell):
    shell = open_shell(FLYBY)
    frames = lesson(shell).player.frames
    lesson(shell).player.value = 0
    assert shell.session.frame == 0
    assert "nothing has hit" in lesson(shell).film_card._sentence.text
    assert "frame=0" in shell.session.search
    assert lesson(shell).player.frames is frames


def test_code_runs_as_shown_and_files_hold_what_is_shown(open_shell, shipped_cache, tmp_path, monkeypatch):
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    shell = open_shell(f"{FLYBY}{TWO_MORE}&crowd=3&frame=50")
    for name in ("film", "kick", "seen", "sky"):
        card = getattr(lesson(shell), f"{name}_card")
        scope: dict = {}
        exec(compile(card.code(), "<shown>", "exec"), scope)
        assert scope["scene"] == lesson(shell).scene
    assert {p.name for p in tmp_path.glob("*.png")} == {"film.png", "kick.png", "seen.png", "sky.png"}
    table = pd.read_csv(io.BytesIO(lesson(shell).seen_card.files["csv"]()), comment="#")
    np.testing.assert_allclose(table.q_rho, lesson(shell).seen.clean, rtol=1e-5)
    assert (
        len(pd.read_csv(io.BytesIO(lesson(shell).film_card.files["csv"]()), comment="#"))
        == lesson(shell).film.density.size
    )
    assert b"<svg" in lesson(shell).film_card.files["svg"]()[:2000]


def test_the_whole_population_rains_in_one_film(open_shell, geometry):
    shell = open_shell(f"{FLYBY}&crowd_of=1")
    lesson(shell).rain()
    assert shell.session.crowd > 10
    assert lesson(shell).player.plays == 1
    impacts = lesson(shell).scene.random(geometry)
    assert len(impacts) == shell.session.crowd
    heights = sent(shell)[plot.RAIN]
    times = lesson(shell).film.time_gyr
    for i in range(len(impacts)):
        seen = np.flatnonzero(np.isfinite(heights[:, i]))
        assert times[seen[-1]] == pytest.approx(impacts.time_gyr[i], abs=times[0] - times[1])
        assert (np.diff(heights[seen, i]) <= 1e-6).all()
    lesson(shell).rain()  # again
    assert lesson(shell).player.plays == 2
