"""The Classifier page without a browser: it trains in the background, shows, and follows the choices."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.events import Tap
from bokeh.io.doc import set_curdoc

from app.work.tasks import Task, Watch, Work
from app.work.training import settings_of
from streamdash.classifier.data import Cancelled
from streamdash.classifier.model import BEST, PAPER
from streamdash.plots import classifier
from streamdash.plots.classifier import SHOWN_STREAMS
from tests.waiting import PATIENCE_S, wait_until

TWO = "?page=classifier&mass=1e3-1e5,1e5-1e9&preset=paper&n_pca=8&features=pca"


@pytest.fixture(autouse=True)
def models(tmp_path_factory, monkeypatch):
    """Trained models go to a folder of the tests' own; figures are let go of after each test."""
    monkeypatch.setenv("STREAMDASH_MODELS", str(tmp_path_factory.getbasetemp() / "models"))
    yield
    # Outside a server HoloViews ties its figures to Bokeh's one default document.
    set_curdoc(Document())


def settle(page) -> None:
    """Wait as the page's timer does until nothing is being computed."""
    watches = [page.watch, page.free_watch, *(study.watch for study in page.studies)]

    def look() -> bool:
        for watch in watches:
            watch.look()
        return not any(watch.following for watch in watches)

    wait_until(look, "still computing")


def test_page_trains_at_once_and_shows_the_matrix(open_shell):
    page = open_shell(TWO).page
    assert not page.results.visible
    settle(page)
    assert page.results.visible
    counts = page.judged.scores.counts
    assert counts.sum() == 1000 and np.trace(counts) >= 990
    assert f"{counts[0, 0]}" in page.matrix[0][0].object.renderers[1].data_source.data["text"][0]
    assert "paper 0.98" in page.scores.object and "paper 0.99" in page.scores.object
    assert "1000 streams" in page.card._sentence.text
    assert "Where the abundance is anywhere from 0.1 to 10 times" in page.abundance.text


def test_the_choices_make_the_settings(open_shell):
    session = open_shell(TWO).session
    assert settings_of(session) == PAPER
    session.preset = "best"
    assert settings_of(session) == BEST
    assert (session.n_pca, session.features) == (30, "both")
    session.param.update(features="summaries", depth=3, trees=17)
    settings = settings_of(session)
    assert settings.features.n_pca == 0 and settings.features.summaries
    assert (settings.boosting.max_depth, settings.boosting.n_estimators) == (3, 17)
    assert settings.boosting.early_stopping_rounds is None


def test_changed_choices_say_so_and_train_again_on_demand(open_shell):
    shell = open_shell(TWO)
    page = shell.page
    settle(page)
    first = page.judged
    shell.session.noise = 0.3
    assert "Press Train" in page.controls.text.text and page.judged is first
    page.train()
    settle(page)
    assert page.judged is not first and page.judged.classifier.card.noise == 0.3
    shell.session.noise = 0.1  # known already: shown without being asked for
    settle(page)
    assert page.judged is first


def test_two_sessions_share_one_training(open_shell):
    a, b = open_shell(TWO + "&noise=0.17"), open_shell(TWO + "&noise=0.17")
    settle(a.page)
    settle(b.page)
    assert a.page.judged is b.page.judged


def test_a_click_shows_the_streams_of_the_cell_and_is_in_the_link(open_shell):
    shell = open_shell(TWO)
    page = shell.page
    settle(page)
    page._tapped(Tap(None, x=1.2, y=-0.9))
    assert page.selected == (1, 1) and "cell=4" in shell.session.search
    frame = page.live.sources["selected"].data
    assert frame["left"][0] < 1 < frame["right"][0] and frame["bottom"][0] < -1 < frame["top"][0]
    assert "put right" in page.streams_card._sentence.text
    assert len(page.shown[0].objects) == SHOWN_STREAMS
    page._tapped(Tap(None, x=7.0, y=3.0))
    assert page.selected == (1, 1)


@pytest.mark.parametrize("kind", ["png", "svg", "csv"])
def test_every_card_downloads(open_shell, kind):
    page = open_shell(TWO + "&cell=1").page
    settle(page)
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "csv": b""}
    for card in (page.card, page.streams_card, page.roc_card, page.calibration_card):
        data = card.files[kind]()
        assert data.startswith(starts[kind]) and len(data) > 50


def test_studies_are_shipped_for_what_is_shown_first(open_shell):
    """A sentence each, at once; the figure when it is opened; what is not of the choice says so."""
    shell = open_shell("?page=classifier&mass=1e3-1e5,1e5-1e9")
    page = shell.page
    assert page.studies and all(study.result is not None for study in page.studies)
    study = page.studies[0]
    assert "Most is lost" in study.said.object and not study.controls.start.visible
    assert not study.figure.objects and not study.card.view.visible  # drawn when it is opened
    study._toggle()
    assert study.figure.objects and study.card.view.visible
    assert b"\nell_low_deg" in study.card.files["csv"]()
    shell.session.noise = 0.3
    curve, wrong = (
        next(s for s in page.studies if s.study.name == n) for n in ("noise-curve", "wrong-noise")
    )
    assert "As shipped, for the best settings at σ_ε = 0.1" in study.card._sentence.text
    assert study.controls.start.visible and "Takes" in study.controls.text.text
    assert "As shipped, for" not in curve.said.object  # one curve runs over all noises
    assert wrong.result is None and "Takes" in wrong.controls.text.text


def test_a_corner_of_a_roc_curve_gives_way_to_the_doubt_that_is_left(open_shell):
    page = open_shell(TWO).page
    settle(page)
    wrong = 1000 - int(np.trace(page.judged.scores.counts))
    assert (
        wrong < classifier.FEW and f"{wrong} of 1000 test streams are wrong" in page.roc_card._sentence.text
    )
    table = classifier.doubt_table(page.judged)
    assert (table.doubt.diff().dropna() <= 0).all()
    assert ((table.doubt > 0.5) == (table.true_class != table.taken_for)).all()
    assert page._roc_drawer() == "draw_doubt" and "draw_doubt" in page.roc_card.code()


def test_importance_is_computed_on_demand_and_shared(open_shell):
    page, other = open_shell(TWO).page, open_shell(TWO).page
    settle(page)
    study = page.studies[0]
    shipped = study.result
    assert "As shipped, for the best settings" in study.said.object  # these are the paper's
    study.start()
    settle(page)
    assert study.result is not shipped and "As shipped" not in study.card._sentence.text
    assert study.result.log_loss.max() > 0 and "Most is lost" in study.card._sentence.text
    settle(other)
    other.studies[0].start()
    settle(other)
    assert other.studies[0].result is study.result
    assert study.card.files["csv"]().partition(b"\nell_low_deg")[2]


def test_code_runs_as_shown(open_shell, shipped_cache, tmp_path, monkeypatch):
    page = open_shell(TWO).page
    settle(page)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    for code in (page.card.code(), page.streams_card.code().replace("cell(0, 0)", "cell(1, 1)")):
        exec(compile(code, "shown", "exec"), {})
    assert (tmp_path / "confusion.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "cell.png").read_bytes().startswith(b"\x89PNG")


def test_closing_the_page_stops_work_nobody_waits_for(open_shell, services):
    def endless(progress, should_stop):
        while not should_stop():
            time.sleep(0.01)
        raise Cancelled

    # All workers are busy, so that the training cannot end before the page is closed.
    others = [services.work.ask(("endless", i), endless) for i in range(8)]
    shell = open_shell(TWO + "&noise=0.23")
    task = shell.page.watch.following
    shell.page.close()
    wait_until(lambda: not task.active)
    assert task.state == "cancelled"
    for other in others:
        other.stop()
    wait_until(lambda: not any(other.active for other in others))


# ---------------------------------------------------------------- work


def wait_for(task: Task) -> None:
    wait_until(lambda: not task.active, pause_s=0.005)


def test_work_is_done_once_however_many_ask():
    work, runs, go = Work(), [], threading.Event()

    def compute(progress, should_stop):
        go.wait(PATIENCE_S)
        runs.append(1)
        return object()

    tasks = [work.ask("key", compute) for _ in range(5)]
    go.set()
    wait_for(tasks[0])
    assert len(runs) == 1 and all(task is tasks[0] for task in tasks)
    assert work.find("key") is tasks[0] and work.find("other") is None


def test_cancel_ends_it_only_when_nobody_else_waits():
    work = Work()

    def compute(progress, should_stop):
        while not should_stop():
            progress(1, 2)
            time.sleep(0.005)
        raise Cancelled

    seen = []
    first, second = Watch(seen.append), Watch(seen.append)
    task = work.ask("key", compute)
    first.follow(task)
    second.follow(task)
    first.cancel()
    time.sleep(0.05)
    assert task.active
    second.cancel()
    wait_for(task)
    assert task.state == "cancelled" and work.find("key") is None
    assert work.ask("key", compute) is not task
    work.ask("key", compute).stop()


def test_failures_are_one_sentence_and_can_be_tried_again(caplog):
    work = Work()

    def wrong(progress, should_stop):
        raise ValueError("The noise must be finite.")

    def broken(progress, should_stop):
        raise RuntimeError("secret details")

    tasks = [work.ask("wrong", wrong), work.ask("broken", broken)]
    for task in tasks:
        wait_for(task)
    assert tasks[0].error == "The noise must be finite."
    assert "secret" not in tasks[1].error and "secret" in caplog.text
    assert work.ask("wrong", lambda *_: 1) is not tasks[0]


def test_finished_work_is_forgotten_when_there_is_too_much(monkeypatch):
    monkeypatch.setattr("app.work.tasks.KEPT", 3)
    work = Work()
    for i in range(5):
        wait_for(work.ask(i, lambda *_: None))
    assert [work.find(i) is not None for i in range(5)] == [False, False, True, True, True]
