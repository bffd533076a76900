"""The Infer page without a browser: its answers, what they are made of, and what it withholds."""

from __future__ import annotations

import base64
import io
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest

from app.pages.infer import answers
from app.pages.infer.joined import together
from streamdash.inference.files import load_estimator
from streamdash.inference.held_out import load_streams
from streamdash.inference.words import sentences
from streamdash.plots import corner, infer
from streamdash.store.cache import Cache
from streamdash.survey.design import divided
from streamdash.survey.mock import EXAMPLE

LINK = "?page=infer"


@pytest.fixture
def page(open_shell):
    return open_shell(LINK).page


def shown(live, label: str, column: str) -> np.ndarray:
    return np.array(live.sources[label].data[column])


def test_another_mock_is_answered_by_the_shipped_estimator_and_the_figures_follow(page):
    sharp = page.mocks
    assert sharp.estimator.design.key == page.base.estimator.design.key and not sharp.told
    for number in (2, 5):
        page.session.infer_number = number
        found = page.found
        q = answers.mock(sharp, sharp, number, "whole", 1.0).q
        expected = sharp.estimator.posteriors(q[None])[0]  # it knows the usual age and errors alone
        np.testing.assert_allclose(found.posterior.p, expected.p)
        first = sentences(expected, sharp.estimator.prior)[0]
        assert first in page.answer.object
        for name, live in page.cards.corner.diagonals.items():
            columns = corner.diagonal_columns(expected, name, found.data.truth)
            for label, new in columns.items():
                for column, values in new.items():
                    np.testing.assert_allclose(shown(live, label, column), values)
        np.testing.assert_allclose(shown(page.cards.live, infer.MEDIAN, "y0"), found.bands[2])
        assert found.data.truth == {"age_gyr": 9.0} | dict(sharp.streams.truth.iloc[number - 1])
    assert page.session.search == f"{LINK}&infer_number=5"


def test_bands_hold_the_streams_they_are_made_of(page):
    q, bands = page.found.data.q, page.found.bands
    assert (np.diff(bands, axis=0) >= 0).all()
    assert np.mean((q >= bands[0]) & (q <= bands[4])) > 0.8


def test_what_each_assumption_does_is_the_same_posterior_conditioned(page):
    rows = dict(page.cards.rows)
    joint = page.base.estimator.posteriors(page.found.data.q[None])[0]
    np.testing.assert_allclose(rows["as asked"].p, rows["age 9 Gyr"].p)
    for age in (3.0, 5.0, 7.0):
        np.testing.assert_allclose(rows[f"age {age:g} Gyr"].p, joint.at("age_gyr", age).p)
    np.testing.assert_allclose(rows["age unknown"].p, joint.marginal("log10_rate"))
    assert any("LSST, year 1:" in name for name in rows) and any("LSST, year 10" in name for name in rows)
    # An older stream was hit more often: the younger it is thought, the more there must have been.
    medians = [joint.at("age_gyr", age).median("log10_rate") for age in (3.0, 5.0, 7.0, 9.0)]
    assert medians == sorted(medians, reverse=True)
    page.session.infer_errors = 0.9  # not the usual ones: another estimator, that is told them
    rows = dict(page.cards.rows)
    assert page.found.oracle.told
    np.testing.assert_allclose(rows["as asked"].p, page.found.joint.at("age_gyr", 9.0).p)


def test_errors_and_age_are_followed(page):
    base, session = page.base, page.session
    session.infer_errors = 0.4
    q = answers.mock(base, page.mocks, 1, "whole", 0.4).q
    full = answers.mock(base, page.mocks, 1, "whole", 0.8).q
    assert page.found.noise_factor == 0.4
    np.testing.assert_allclose(page.found.sigma, 0.4 * base.estimator.design.sigma)
    np.testing.assert_allclose(page.found.joint.p, base.estimator.posteriors(q[None], 0.4)[0].p)
    assert np.std(full - q) > 0
    assert page.found.data.truth["log10_rate"] == page.mocks.streams.truth.log10_rate[0]
    session.infer_age = "3"
    assert page.found.posterior.names == ("log10_rate",)
    np.testing.assert_allclose(page.found.posterior.p, page.found.joint.at("age_gyr", 3.0).p)
    session.infer_age = "open"
    assert page.found.posterior.names == ("age_gyr", "log10_rate")
    assert set(page.cards.corner.pairs) == {("age_gyr", "log10_rate")}
    assert session.search == f"{LINK}&infer_errors=0.4&infer_age=open"


def test_calibration_is_computed_and_said(page):
    score = page.cards.calibrated.scores["log10_rate"]
    n = page.found.oracle.streams.n_streams
    assert score.n == n == len(page.cards.calibrated.ranks)
    # Four standard errors of so many streams about the bounds.
    assert abs(score.coverage[0] - 0.68) < 0.03 + 4 * np.sqrt(0.68 * 0.32 / n)
    assert f"{score.coverage[0]:.0%}" in page.cards.rank_card._sentence.text
    assert "<td>" in page.cards.scores.object


def test_downloads_hold_the_numbers_that_are_shown(page):
    cells = pd.read_csv(io.BytesIO(page.cards.corner_card.files["csv"]()), comment="#")
    np.testing.assert_allclose(cells.posterior, page.found.posterior.p.ravel(), rtol=1e-4, atol=1e-9)
    assert np.isclose(cells.prior.sum(), 1, atol=1e-4)
    bins = pd.read_csv(io.BytesIO(page.cards.band_card.files["csv"]()), comment="#")
    np.testing.assert_allclose(bins.value, page.found.data.q, rtol=1e-4)
    assert page.cards.corner_card.files["png"]().startswith(b"\x89PNG")
    assert (
        b"as asked" in page.cards.moves_card.files["csv"]()
        and b"rank_low" in page.cards.rank_card.files["csv"]()
    )


@pytest.mark.parametrize("data", ["mock", "simulated"])
def test_the_code_gives_what_is_shown(open_shell, shipped_cache, tmp_path, monkeypatch, capsys, data):
    page = open_shell(f"{LINK}&infer_number=3&infer_data={data}").page
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    monkeypatch.chdir(tmp_path)
    for card in (page.cards.corner_card, page.cards.band_card, page.cards.moves_card, page.cards.rank_card):
        exec(compile(card.code(), "<shown>", "exec"), {})
    printed = capsys.readouterr().out
    assert sentences(page.found.posterior, page.base.estimator.prior)[0] in printed
    assert (tmp_path / "posterior.png").stat().st_size > 10_000
    assert (tmp_path / "predictive.png").stat().st_size > 10_000


def test_several_streams_say_more_together(page):
    for number in (1, 2, 3):
        page.session.infer_number = number
        page.put_aside()
    rows = page.joined.rows
    assert [name for name, _ in rows[:-1]] == [f"GD-1-like, mock {n}" for n in (1, 2, 3)]
    parts, whole = [p for _, p in rows[:-1]], rows[-1][1]
    expected = np.prod([p.p for p in parts], axis=0)
    np.testing.assert_allclose(whole.p, expected / expected.sum(), rtol=1e-6, atol=1e-12)
    assert page.joined.card.view.visible and "together" in page.joined.card._sentence.text
    page.put_aside()
    assert len(page.joined.rows) == 4, "the same answer counts once"
    page.joined.forget()
    assert not page.joined.card.view.visible and not page.joined.rows
    assert together([("other", parts[0].given("log10_rate", -1, 0))], None) == []


def test_the_other_arm_is_asked_about_with_one_press(open_shell):
    shell = open_shell(f"{LINK}&stream=pal5")
    page = shell.page
    assert page.model.arm == "trailing" and not page.controls.other.visible
    page.put_aside()
    assert "Palomar 5, trailing arm, mock 1" in page.controls.kept.text
    assert page.controls.other.visible and "leading" in page.controls.other.label
    page.go_to_other_arm()
    page = shell.page
    assert page.model.arm == "leading" and not page.controls.other.visible
    assert [name for name, _ in page.session.infer_kept] == ["Palomar 5, trailing arm, mock 1"]


def test_a_profile_unlike_any_stream_is_not_answered(page, monkeypatch):
    design = page.base.estimator.design
    x = np.arange(design.n_bin)
    wave = (1 + 0.8 * np.sin(2 * np.pi * x / 9)).astype(np.float32)
    assert page.base.estimator.strangeness(wave[None])[0] > 0.99
    monkeypatch.setattr(answers, "mock", lambda *_: answers.Data(wave, "the wave", None, ()))
    page.session.infer_number = 7
    assert page.found.strange
    assert "withheld" in page.answer.object and "CDM" not in page.answer.object
    assert page.cards.corner is None and page.controls.keep.disabled
    assert not page.cards.moves_slot.objects


def upload(page, data: bytes) -> None:
    page.controls.drop._handle_msg({"data": base64.b64encode(data).decode(), "name": "mine.csv"})


def test_a_file_of_other_bins_is_read_and_an_estimator_offered(page):
    upload(page, EXAMPLE.read_bytes())
    assert page.session.infer_data == "upload"
    assert page.reading.observation is not None and "35 bins" in page.controls.status.text
    assert page.found is None and page.answer.object == ""
    assert page.controls.training.view.visible and "35 bins" in page.controls.training.text.text
    assert page.session.search == f"{LINK}&infer_data=upload", "no file is in a link"
    upload(page, b"\x00\x01")
    assert "not text" in " ".join(t.object for alert in page.problem for t in alert.objects)
    assert not page.controls.training.view.visible
    page.session.infer_data = "mock"
    assert page.found is not None and not page.problem.objects


def test_a_cut_window_asks_for_an_estimator_of_its_own(page):
    whole = page.base.estimator.design
    page.session.infer_window = "first"
    assert page.found is None and page.controls.training.view.visible
    assert str(whole.n_bin // 2) in page.controls.training.text.text
    page.session.infer_window = "whole"
    assert page.found is not None and not page.controls.training.view.visible


def test_at_a_known_age_the_ranks_are_of_streams_of_that_age(page):
    page.session.infer_age = "5"
    five = (page.base.streams.truth.age_gyr == 5).sum()
    assert page.cards.calibrated.scores["log10_rate"].n == five == len(page.cards.calibrated.ranks)
    assert f"Of {five} streams of 5 Gyr" in page.cards.rank_card._sentence.text
    page.session.infer_age = "open"
    assert page.cards.calibrated.scores["log10_rate"].n == page.base.streams.n_streams


def test_half_of_a_file_is_asked_about_as_if_no_more_had_been_measured(page):
    upload(page, EXAMPLE.read_bytes())
    whole = page.reading.observation
    assert page.controls.window.visible
    page.session.infer_window = "second"
    design = page._design()
    np.testing.assert_allclose(design.low, whole.design.low[17:])
    half = page.halves["second"]
    # It is divided by a polynomial of its own, and so are its errors.
    again = half.value / divided(half.value[None], design.fit)[0] if design.fit is not None else 1.0
    np.testing.assert_allclose(half.q * again, half.value, rtol=1e-6)
    assert not np.allclose(half.q, whole.q[17:])
    assert page.controls.training.view.visible and "18 bins" in page.controls.training.text.text
    few = b"\n".join(EXAMPLE.read_bytes().splitlines()[:14])
    upload(page, few)
    assert page.reading.observation.design.n_bin == 13 and not page.halves
    assert not page.controls.window.visible and page.window == "whole"


def test_held_out_streams_are_none_that_it_has_learnt_from():
    estimator, streams = load_estimator("gd1-like"), load_streams("gd1-like")
    assert list(streams.truth) == list(estimator.grid)
    assert streams.clean.shape[1] == estimator.design.n_bin
    low, high = estimator.prior.log10_rate
    assert ((streams.truth.log10_rate > low) & (streams.truth.log10_rate < high)).all()
    assert streams.truth.log10_rate.nunique() == streams.n_streams


@pytest.mark.slow
def test_an_estimator_is_trained_in_the_background_and_then_answers(
    open_shell, services, tmp_path, monkeypatch
):
    """With few streams: what is tested is the way from a file to its answer."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "kept"))
    monkeypatch.setattr(
        services, "cache", Cache((services.cache.roots[0], tmp_path / "own"), tmp_path / "own")
    )
    monkeypatch.setattr(answers, "learnt", partial(answers.learnt, n_streams=500))
    page = open_shell(f"{LINK}&infer_data=upload&example=yes").page
    assert page.found is None and page.controls.training.view.visible
    page.train()
    task = page.watch.following
    assert task.active and page.found is None
    settle(page)
    assert task.state == "done" and task.fraction == 1
    found = page.found
    assert not found.oracle.shipped and found.oracle.estimator.design.n_bin == 35
    np.testing.assert_allclose(found.data.q, page.reading.observation.q, rtol=1e-6)
    assert "withheld" in page.answer.object or "10⁶–10⁹ M☉" in page.answer.object
    assert not page.controls.training.view.visible
    assert found.oracle.streams.n_streams == 50, "a tenth was held out"
    page.session.infer_data = "mock"
    assert page.found.oracle.shipped
    page.session.infer_data = "upload"
    assert page.found.oracle is found.oracle, "the same bins are not learnt again"
    assert page.cutting.view.visible and [name for name, _ in page.cards.rows] == ["as asked"]
    page.cut()
    settle(page)
    for window, name in (("first", "first half alone"), ("second", "second half alone")):
        oracle, half = page._halves()[window], page.halves[window]
        assert oracle.estimator.design.key == half.design.key
        expected = oracle.estimator.posteriors(half.q[None].astype("float32"))[0]
        np.testing.assert_allclose(dict(page.cards.rows)[name].p, expected.p)
    page.session.infer_window = "first"
    assert page.found.oracle is page._halves()["first"]


def test_halves_of_the_stretch_say_less_than_the_whole(open_shell, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "kept"))
    monkeypatch.setattr(answers, "learnt", partial(answers.learnt, n_streams=500))
    page = open_shell(LINK).page
    assert page.cutting.view.visible and not any("half" in name for name, _ in page.cards.rows)
    page.cut()
    settle(page)
    rows = dict(page.cards.rows)
    for window, part in (("first", slice(0, 173)), ("second", slice(173, None))):
        oracle = page._halves()[window]
        assert oracle.estimator.design.key == page.base.estimator.design.part(part).key
        q = answers.mock(oracle, page.mocks, 1, window, 1.0).q
        np.testing.assert_allclose(rows[f"{window} half alone"].p, oracle.estimator.posteriors(q[None])[0].p)
    assert not page.cutting.view.visible, "nothing is left to be trained"
    page.session.infer_window = "first"
    assert page.found.oracle is page._halves()["first"] and not page.cutting.view.visible


def test_two_parameters_together_are_calibrated_and_said(open_shell):
    page = open_shell(f"{LINK}&infer_prior=population").page
    assert page.found.posterior.names == ("log10_rate", "log10_half_mode_mass", "log10_excess")
    pairs = page.cards.calibrated.pairs
    assert len(pairs) == 3 and "TARP" in page.cards.rank_card._sentence.text
    for pair in pairs.values():
        error = np.sqrt(0.68 * 0.32 / pair.n)
        assert abs(pair.coverage[0] - 0.68) < 0.03 + 3 * error
        assert pair.information > 0.5
    assert page.cards.scores.object.count("by TARP") == 3
    # What lies beyond the left ends is written there.
    prior, grid = page.base.estimator.prior, page.base.estimator.grid
    first = {name: corner.ticks(name, np.asarray(grid[name]), prior)[0][1] for name in grid}
    assert first["log10_rate"].endswith("← none")
    assert first["log10_half_mode_mass"].endswith("← CDM") and first["log10_excess"].endswith("← CDM")


def settle(page, seconds: float = 600) -> None:
    """Wait as the page's timer does until nothing is being computed."""
    deadline = time.monotonic() + seconds
    watches = [page.watch, *page.cut_watches]
    while any(watch.following for watch in watches):
        assert time.monotonic() < deadline, "still computing"
        for watch in watches:
            watch.look()
        time.sleep(0.02)
