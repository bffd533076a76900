"""The Observe page without a browser: what is read, refused, classified, revealed and forgotten."""

from __future__ import annotations

import ast
import base64
import hashlib
import html
import io
import json
import time

import numpy as np
import pandas as pd
import pytest
from bokeh.document import Document
from bokeh.io.doc import set_curdoc
from hypothesis import given, settings
from hypothesis import strategies as st

from app.pages.observe.parts import ASK, step_words
from app.pages.observe.state import Upload
from app.pages.registry import PAGES
from app.services.services import Services
from app.session.session import Session
from app.shell import Shell
from app.ui.upload import decoded
from app.work.tasks import Task, Work
from streamdash.observe.table import MAX_BYTES, UploadLimit
from streamdash.simulation.limits import Limits
from streamdash.store.cache import Cache
from streamdash.survey.mock import EXAMPLE, EXAMPLE_TRUTH

EXAMPLE_LINK = "?page=observe&example=yes"


@pytest.fixture(autouse=True)
def documents():
    """Outside a server HoloViews ties its figures to Bokeh's one default document."""
    yield
    set_curdoc(Document())


def settle(page, seconds: float = 300) -> None:
    """Wait as the page's timer does until nothing is being computed."""
    deadline = time.monotonic() + seconds
    while page.watch.following:
        assert time.monotonic() < deadline, "still computing"
        page.watch.look()
        time.sleep(0.02)


def upload(page, data: bytes, name: str = "mine.csv") -> None:
    """What the browser sends when a file was chosen."""
    page.drop._handle_msg({"chosen": name})
    page.drop._handle_msg({"data": base64.b64encode(data).decode(), "name": name})


@pytest.fixture(scope="module")
def services(small_cache) -> Services:
    """Services on a cache with few streams, from which is learnt in no time."""
    return Services(Cache.default(small_cache), limits=Limits(nice=0))


@pytest.fixture
def open_page(services):
    """The page at a link, with its layout at hand."""

    def open_at(search: str = "?page=observe"):
        session = Session(tuple(page.key for page in PAGES), services.catalog())
        session.load(search)
        shell = Shell(session, services, PAGES)
        page = shell.page
        page.layout = shell.slot.objects[0]
        return page

    return open_at


def problems(page) -> str:
    return " ".join(text.object for alert in page.problem for text in alert.objects)


def test_nothing_is_shown_before_there_is_a_file(open_page):
    page = open_page()
    assert not page.read_part.visible and not page.result_part.visible
    assert "Choose a table" in page.opening.answer
    # In the figure's place stands the example, as what it is.
    assert page.look is not None and page.look.bands.shape == (2, 3, 35)
    assert page.card._sentence.text.startswith("This is the example, as your table would be shown.")


def test_the_example_is_read_and_every_assumption_stated(open_page):
    page = open_page(EXAMPLE_LINK)
    assert page.read_part.visible
    for words in ("“phi1” is φ1", "with one gap", "polynomial of order 3", "“density_error”"):
        assert words in page.stated.object
    assert page.assumptions.widgets["value"].value == "density"
    assert "35 bins" in page.status.text


def test_a_profile_is_seen_over_the_classes_before_anything_is_learnt(open_page):
    page = open_page(EXAMPLE_LINK)
    assert page.outcome is None and page.look.bands.shape == (2, 3, 35)
    assert "Share of them within the band" in page.card._sentence.text
    assert len(pd.read_csv(io.BytesIO(page.card.files["csv"]()), comment="#")) == 35
    assert "press Classify" in page.opening.answer
    assert "Share of them" in page._known()  # said again while the answer is computed
    before = page.look.bands
    page.assumptions.widgets["order"].value = "1"
    assert not np.allclose(page.look.bands, before)  # as observed now


def test_a_coordinate_that_numbers_alone_suggest_is_asked_for(open_page):
    page = open_page()
    rows = "\n".join(f"{x} {1 + 0.1 * (x % 3)} 0.1" for x in range(165, 235, 2))
    upload(page, rows.encode())
    assert "coordinate" in page.reading.assumptions.undecided
    assert page.assumptions.widgets["coordinate"].value == ASK
    assert page.assumptions.widgets["coordinate"].css_classes == ["sd-chip", "sd-asked"]
    assert not page.controls.view.visible and "has to be said" in page.opening.answer
    page.assumptions.widgets["coordinate"].value = "ell"
    assert "coordinate" not in page.reading.assumptions.undecided
    assert page.assumptions.widgets["coordinate"].css_classes == ["sd-chip"]


@pytest.mark.parametrize(
    ("fraction", "seconds", "words"),
    [
        (0.0, 0.0, "Learning to tell the classes apart: 0 % done."),
        (0.5, 10.0, "Learning what mistakes in a table look like: 50 % done, about 10 s left."),
        (1.0, 20.0, "Trying errors that are wrong: 100 % done, about 5 s left."),
    ],
)
def test_the_step_that_runs_and_the_time_left_are_said(fraction, seconds, words):
    assert step_words(fraction, seconds) == words


def test_a_changed_assumption_is_followed_and_what_belongs_in_a_link_is_there(open_page):
    page = open_page(EXAMPLE_LINK)
    page.assumptions.widgets["order"].value = "2"
    assert page.session.search == f"{EXAMPLE_LINK}&profile_order=2"
    assert "order 2" in page.stated.object
    page.assumptions.widgets["error_kind"].value = "constant"
    page.assumptions.widgets["constant"].value = 0.2
    np.testing.assert_allclose(page.reading.observation.design.sigma, 0.2)
    page.assumptions.widgets["value"].value = "phi1"
    assert "“phi1” may be" in problems(page)  # neither its kind nor its error is known
    assert page.assumptions.widgets["kind"].value == page.assumptions.widgets["error_kind"].value == ASK
    assert not page.controls.view.visible and page.controls.start.disabled
    page.assumptions.widgets["value"].value = "density"
    assert not problems(page)
    assert page.controls.view.visible


def test_an_upload_replaces_what_was_there_and_stays_out_of_the_link(open_page):
    page = open_page(f"{EXAMPLE_LINK}&profile_order=2")
    upload(page, EXAMPLE.read_bytes().replace(b"density", b"secret"))
    assert page.session.search == "?page=observe"
    assert "“secret” may be" in problems(page)
    page.assumptions.widgets["kind"].value = "density"
    assert "“secret”" in page.stated.object
    assert "order 3" in page.stated.object
    assert "“mine.csv” was read" in page.status.text
    assert page.session.upload == Upload(EXAMPLE.read_bytes().replace(b"density", b"secret"), "mine.csv")


def test_what_cannot_be_read_is_one_sentence(open_page):
    page = open_page(EXAMPLE_LINK)
    for data, words in (
        (b"\x00\x01", "not text"),
        (b"phi1,q\n1,x\n", "“x” is not a number"),
        (b"", "is empty"),
    ):
        upload(page, data)
        assert words in problems(page)
        assert not page.read_part.visible or not page.controls.view.visible


def test_names_from_a_file_are_never_markup(open_page):
    page = open_page()
    upload(
        page, EXAMPLE.read_bytes().replace(b"density_error", b"<b>x</b>").replace(b"density", b"<img/src=x>")
    )
    assert "<img" not in page.preview.object + page.stated.object
    assert "&lt;img/src=x&gt;" in page.preview.object


def test_an_operator_can_allow_less(services, open_page, monkeypatch):
    monkeypatch.setattr(services, "uploads", UploadLimit(max_upload_mb=5e-4))
    page = open_page()
    upload(page, EXAMPLE.read_bytes())
    assert "larger than 0.0005 MB" in problems(page)
    upload(page, EXAMPLE.read_bytes()[:450])  # not the whole table, and that is what is said
    assert "larger than" not in problems(page)


@settings(max_examples=300, deadline=None, database=None)
@given(
    st.one_of(st.none(), st.integers(), st.text(), st.dictionaries(st.sampled_from(["data", "x"]), st.text()))
)
def test_whatever_a_browser_sends_is_bytes_or_one_sentence(message):
    try:
        assert len(decoded(message, MAX_BYTES)) <= MAX_BYTES + 8
    except ValueError as error:
        assert "choose it again" in str(error) or "larger than" in str(error)


def test_a_message_that_is_too_large_is_refused_before_it_is_decoded():
    with pytest.raises(ValueError, match="larger than 1 MB"):
        decoded({"data": "A" * (2 * MAX_BYTES)}, MAX_BYTES)


def test_the_answer_comes_with_its_numbers_and_is_forgotten_with_the_page(open_page, services):
    page = open_page()
    upload(page, EXAMPLE.read_bytes())
    page.classify()
    key = page.asked
    settle(page)
    result = page.outcome.result
    assert result["answer"] in html.unescape(page.answer.object)
    assert result["agreement"] in html.unescape(page.answer.object)
    assert "How good is the method with such data?" in page.numbers.object
    assert len(pd.read_csv(io.BytesIO(page.card.files["csv"]()), comment="#")) == 35
    assert json.loads(page._json_report()) == json.loads(json.dumps(result))
    assert page._html_report().startswith(b"<!doctype html>")
    assert not page.reveal.visible
    ast.parse(page._code())
    assert services.work.find(key) is not None
    page.close()
    assert services.work.find(key) is None


def test_nothing_is_classified_while_another_file_is_on_its_way(open_page):
    """Whoever chooses a second file never sees the first one's answer beside its name."""
    page = open_page()
    upload(page, EXAMPLE.read_bytes(), "first.csv")
    page.classify()
    page.drop._handle_msg({"chosen": "second.csv"})
    assert "second.csv" in page.status.text
    assert page.controls.start.disabled and page.watch.following is None
    page.classify()
    assert page.watch.following is None and page.outcome is None and not page.result_part.visible
    upload(page, EXAMPLE.read_bytes().replace(b"-90", b"-89.9", 1), "second.csv")
    assert not page.controls.start.disabled
    page.classify()
    settle(page)
    file = page.outcome.result["provenance"]["file"]
    assert file["name"] == "second.csv"
    assert file["sha256"] == hashlib.sha256(page.session.upload.data).hexdigest()
    assert file["sha256"] in page._html_report().decode()
    page.drop._handle_msg({"name": "third.csv"})  # the browser could not read it
    assert "choose it again" in problems(page)
    assert page.controls.start.disabled and not page.result_part.visible


def test_what_would_change_the_answer_is_tried_in_the_background(open_page):
    page = open_page()
    upload(page, EXAMPLE.read_bytes())
    page.classify()
    settle(page)
    if page.trying.following:  # else another session's trials of the same file were ready
        assert "was not tried" in page.outcome.result["would_change"]
    deadline = time.monotonic() + 600
    while page.trying.following:
        assert time.monotonic() < deadline, "still trying"
        page.trying.look()
        time.sleep(0.02)
    assert len(page.outcome.result["robustness"]) > 8
    assert "What would change it was not tried" not in page.answer.object
    # HTML that a page shows is written as text that was escaped once, never handed over as markup.
    assert type(page.answer.object) is str and type(page.holds.object) is str
    assert "<table" in page.holds.object
    assert "polynomial of order 0" in page.holds.object and "errors × 2" in page.holds.object
    assert "Does it hold?" in page._html_report().decode()
    assert json.loads(page._json_report())["robustness"][0]["name"] == "as chosen"


def test_the_same_file_chosen_again_is_read_again(open_page):
    page = open_page()
    for _ in range(2):
        upload(page, EXAMPLE.read_bytes())
        assert page.reading.observation is not None and not page.controls.start.disabled


def test_an_undecided_column_is_a_choice_to_be_made(open_page):
    page = open_page()
    upload(page, b"angle,q\n" + b"\n".join(f"{x},{1 + x % 3}".encode() for x in range(-90, -30)))
    assert page.assumptions.widgets["coordinate"].value == ASK
    page.assumptions.widgets["coordinate"].value = "phi1"
    assert page.assumptions.widgets["error_kind"].value == ASK
    assert "error of “q”" in problems(page) and not page.controls.view.visible
    page.assumptions.widgets["error_kind"].value = "constant"
    assert not problems(page) and page.controls.view.visible
    # Another value column brings its own questions, whatever was said of this one's error.
    page.assumptions.widgets["value"].value = "angle"
    assert page.assumptions.widgets["error_kind"].value == ASK


def test_the_truth_of_the_example_is_revealed_when_asked_for(open_page):
    page = open_page(EXAMPLE_LINK)
    page._reveal()
    known = json.loads(EXAMPLE_TRUTH.read_text())
    assert f"hit by {known['n_impacts']} perturbers of 10⁵–10⁹ M☉" in page.truth.object


def test_a_task_that_somebody_waits_for_is_not_forgotten():
    work = Work()
    task: Task = work.ask("mine", lambda progress, should_stop: 1)
    task.waiting_for_it = 1
    work.forget("mine")
    assert work._tasks["mine"] is task
    task.waiting_for_it = 0
    work.forget("mine")
    work.forget("mine")
    assert work.find("mine") is None
