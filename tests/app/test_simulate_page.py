"""The Simulate page without a browser: knobs, preview, job, and new ensembles in every session."""

from __future__ import annotations

import shutil
import time

import pytest
from bokeh.document import Document
from bokeh.io.doc import set_curdoc

from app.pages.registry import PAGES
from app.pages.simulate.forecast import duration, words_state
from app.pages.simulate.knobs import BY_NAME, KNOBS, check, config_of, text_of, texts_of
from app.pages.simulate.presets import PRESETS
from app.services.cache_watch import CacheWatch
from app.services.services import Services
from app.serving import News
from app.session.catalog import read_catalog
from app.session.session import Session
from app.shell import Shell
from streamdash.config import ConfigError, EnsembleConfig, Perturbers
from streamdash.engine.impacts import expected_impacts
from streamdash.simulation.ensemble import simulate
from streamdash.simulation.jobs import JobStatus, Limits
from streamdash.store.cache import Cache

HERE = "?page=simulate&sim_mass=1e7-1e8&sim_n=60"
CONFIG = EnsembleConfig(perturbers=Perturbers(mass_range="1e7-1e8"), n_streams=60)


@pytest.fixture
def own(shipped_cache, tmp_path):
    """Services of a server on a cache of its own: the default geometry and one small ensemble."""
    shutil.copytree(shipped_cache / "geometries", tmp_path / "cache" / "geometries")
    cache = Cache.default(tmp_path / "cache")
    simulate(EnsembleConfig(perturbers=Perturbers(mass_range="1e8-1e9"), n_streams=10), "inline", cache=cache)
    services = Services(cache, limits=Limits(workers=2, nice=0))
    yield services
    services.jobs.close()
    set_curdoc(Document())  # outside a server HoloViews ties its figures to Bokeh's one default document


@pytest.fixture
def open_own(own):
    def open_at(search: str = HERE) -> Shell:
        session = Session(tuple(page.key for page in PAGES), own.catalog())
        session.load(search)
        return Shell(session, own, PAGES)

    return open_at


def follow(page, seconds: float = 300) -> list[JobStatus]:
    """Look as the page's timer does until its job has ended; gives what was seen."""
    seen = []
    deadline = time.monotonic() + seconds
    while not seen or seen[-1].active:
        assert time.monotonic() < deadline
        seen.append(page._status())
        page.look()
        time.sleep(0.02)
    page.look()
    return seen


# ------------------------------------------------------------------ knobs


def test_every_field_of_perturbers_and_stream_has_a_knob_and_defaults_make_the_default():
    fields = {f"perturbers.{name}" for name in Perturbers.model_fields}
    fields |= {f"stream.{name}" for name in CONFIG.stream.__class__.model_fields} - {"stream.potential"}
    assert fields | {"population", "stream.potential.q", "n_streams", "seed"} == {knob.path for knob in KNOBS}
    assert config_of({knob.name: knob.default for knob in KNOBS}) == EnsembleConfig()
    assert all(knob.help and knob.label for knob in KNOBS)


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_configurations_that_their_texts_bring_back(preset):
    config = config_of(PRESETS[preset])
    assert config_of(texts_of(config)) == config
    assert all(text_of(config, BY_NAME[name]) for name in PRESETS[preset])


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("sim_X", "100", "Largest impact parameter: input should be less than or equal to 50"),
        ("sim_mass", "1e9-1e5", "Mass range: the lower mass must come first"),
        ("sim_mass", "wide", "Mass range: mass range 'wide' is not of the form 1e3-1e5"),
        ("sim_rate", "", "Abundance: must be a number"),
        ("sim_times", "3, 2", "Stream model: times_gyr must increase"),
        ("sim_progenitor", "1, 2", "Progenitor today: must be six numbers"),
        ("sim_n", "1.5", "Streams: must be a whole number"),
    ],
)
def test_wrong_texts_are_refused_in_a_sentence_that_names_the_knob(name, text, words):
    with pytest.raises(ConfigError) as error:
        config_of({name: text})
    assert str(error.value).startswith(words)
    with pytest.raises(ValueError):
        check(BY_NAME[name], text)


# ------------------------------------------------------------------ before the start


def test_impacts_time_and_the_first_streams_are_shown_before_the_start(own, open_own):
    page = open_own().page
    impacts = expected_impacts(own.geometry(CONFIG.stream), CONFIG.perturbers)
    words = f"{impacts:.4g} impacts are expected per stream. 60 streams take about"
    assert page.progress.text.text.startswith(words)
    assert page.panels[0].highlighted.shape == (5, CONFIG.n_theta)
    assert "of the first 5 streams" in page.card._sentence.text
    assert not page.progress.start.disabled and not page.progress.cancel.visible


def test_choices_are_in_the_link_and_wrong_ones_say_why(open_own):
    shell = open_own(HERE + "&sim_X=100&sim_title=a%0Ab")
    assert [p.partition(" in the link")[0] for p in shell.session.problems] == ["sim_X=100", "sim_title=a�b"]
    page = shell.page
    page.session.sim_slope = "-1.8"
    assert "sim_slope=-1.8" in shell.session.search and "sim_X" not in shell.session.search
    page.session.sim_slope = "steep"
    assert page.config is None and page.progress.start.disabled
    assert "slope: must be a number" in page.progress.problem[0][0].object
    field = page.fields["Mass function's slope"]
    assert field.widget.error_state and "must be a number" in field.below.object
    assert float(page.slot.styles["opacity"]) < 0.5 and "settings before" in page.card._sentence.text
    assert not page.card.ready
    page.session.sim_slope = "-2"
    assert page.config == CONFIG and not page.progress.problem.objects
    assert not field.widget.error_state and page.slot.styles == {}


def test_more_streams_than_are_allowed_are_refused_before_anything_is_costed(own, open_own):
    page = open_own().page
    page.session.sim_n = str(own.jobs.limits.max_streams + 1)
    assert page.progress.start.disabled and page.progress.text.text == ""
    assert "allows in one simulation" in page.fields["Streams"].below.object


def test_what_is_in_the_cache_needs_no_start(open_own):
    page = open_own("?page=simulate&sim_mass=1e8-1e9&sim_n=5").page
    assert "All 5 streams are in the cache, the first of 10" in page.progress.text.text
    assert page.progress.start.disabled and page.progress.see.visible
    assert page.card._sentence.text.startswith("5 finished streams of 5:")


def test_an_empty_cache_can_be_filled_from_the_page(tmp_path):
    services = Services(Cache.default(tmp_path / "none"))
    session = Session(tuple(page.key for page in PAGES), services.catalog())
    session.load("?page=profiles")
    shell = Shell(session, services, PAGES)
    assert shell.page is None
    session.param.update(page="simulate", sim_X="far")
    assert "Largest impact parameter" in shell.page.progress.problem[0][0].object


@pytest.mark.parametrize("key", [page.key for page in PAGES])
def test_every_page_shows_or_says_what_it_can_do_with_a_single_ensemble(open_own, key):
    shell = open_own(f"?page={key}")
    assert len(shell.session.ensembles) == 1
    if shell.page is None:
        (refusal,) = shell.slot
        assert "two mass ranges" in refusal[0].object or "2 to 4 classes" in refusal[0].object


# ------------------------------------------------------------------ components

MIXED = "?page=simulate&sim_n=60&sim_mass=1e7-1e8&sim_more=1e3-1e5,rate%3D3%3B1e6-1e7,profile%3Dplummer"


def rows(page) -> list[str]:
    return [row[0].object for row in page.components.rows]


def press(page, row: int, words: str) -> None:
    (button,) = [part for part in page.components.rows[row][2] if getattr(part, "label", "") == words]
    button.param.trigger("clicks")


def test_components_of_a_link_are_rows_with_their_impacts(own, open_own):
    page = open_own(MIXED).page
    parts = page.config.population.components
    assert [part.label for part in parts] == ["1e3-1e5", "1e6-1e7", "1e7-1e8"]
    assert (parts[0].rate_factor, parts[1].profile) == (3.0, "plummer")
    assert rows(page) == ["10³–10⁵ M☉, rate × 3", "10⁶–10⁷ M☉, Plummer spheres", "10⁷–10⁸ M☉"]
    geometry = own.geometry(page.config.stream)
    for part, row in zip(parts, page.components.rows, strict=True):
        assert row[1].object == f"{expected_impacts(geometry, part):.4g} impacts a stream"
    total = expected_impacts(geometry, page.config.population)
    assert page.progress.text.text.startswith(f"{total:.4g} impacts are expected")


@pytest.mark.slow
def test_components_are_edited_copied_and_removed_by_their_buttons(open_own):
    page = open_own(MIXED).page
    before = page.config
    press(page, 0, "Edit")
    assert page.config == before
    assert (page.session.sim_mass, page.session.sim_rate) == ("1e3-1e5", "3")
    assert page.session.sim_more == "1e6-1e7,profile=plummer; 1e7-1e8"
    page.session.sim_rate = "2"
    assert page.config.population.components[0].rate_factor == 2.0
    press(page, 0, "Copy")
    assert [part.label for part in page.config.population.components][:2] == ["1e3-1e5", "1e3-1e5"]
    assert "1e3-1e5 and 1e3-1e5 overlap in mass" in page.components.note.object
    for _ in range(3):
        press(page, 0, "Remove")
    assert [part.label for part in page.config.population.components] == ["1e7-1e8"]
    assert page.session.sim_more == ""
    assert len(page.components.rows) == 1
    assert page.components.note.object == ""


def test_components_that_cannot_be_used_are_refused_in_a_sentence(open_own):
    page = open_own().page
    page.session.sim_more = "1e3-1e5,speed=3"
    assert page.config is None
    assert "Further components: component" in page.progress.problem[0][0].object
    page.session.sim_more = ";".join(["1e3-1e5"] * 8)
    assert "at most 8 components, this one 9" in page.progress.problem[0][0].object
    shell = open_own(HERE + "&sim_more=many")
    assert "sim_more=many" in shell.session.problems[0]


# ------------------------------------------------------------------ the job


def test_a_job_is_started_watched_and_its_ensemble_selectable_in_every_session(own, open_own):
    shell, other = open_own(HERE + "&sim_title=%3Cb%3Emine"), open_own("?page=profiles")
    page = shell.page
    news = [News(s.session, own, own.watch.version) for s in (shell, other)]
    page.start()
    seen = follow(page)
    assert seen[-1].state == "done"
    assert page.progress.text.text == f"Done: 60 streams in {duration(seen[-1].took_s)}."
    assert "60 finished streams of 60" in page.card._sentence.text
    own.watch.look()
    for one in news:
        one.look()
    labels = [choice.label for choice in other.session.catalog.streams[0].ensembles]
    assert "<b>mine · 10⁷–10⁸ M☉" in labels
    picker = next(w for w in other.view.select(lambda v: "sd-mass" in getattr(v, "css_classes", [])))
    assert CONFIG.key in picker.options.values()
    assert page.progress.see.visible
    page.see_profiles()
    assert (shell.session.page, CONFIG.key in shell.session.mass) == ("profiles", True)
    assert shell.page.failures == {}


@pytest.mark.slow
def test_two_sessions_share_a_job_and_cancel_keeps_what_is_finished(own, open_own):
    many = HERE.replace("sim_n=60", "sim_n=4000")
    first, second = open_own(many).page, open_own(many).page
    first.start()
    second.look()
    assert second._status().key == first._status().key
    assert not second.progress.cancel.visible  # it is not this session's
    second.start()  # joins
    while not first._status().done:
        time.sleep(0.02)
    first.cancel()
    assert first._status().active
    second.cancel()
    follow(second)
    done = own.cache.streams_done(second.config)
    assert 0 < done < 4000
    assert second.progress.text.text == f"Cancelled; {done} of 4000 streams are kept."
    assert second.progress.start.label == "Resume" and not second.progress.start.disabled
    own.watch.look()
    third = open_own("?page=simulate").page
    assert [choice.config for choice in third.session.catalog.unfinished] == [second.config]
    third.show(second.config, "")
    assert third.config == second.config
    assert f"{done} of 4000 are finished already" in third.progress.text.text or third._status() is not None


def test_what_the_server_refuses_is_said_in_the_page(own, open_own):
    page = open_own(HERE.replace("sim_n=60", "sim_n=30000")).page
    page.start()
    assert "30000 streams are more than the 20000" in str(page.progress.problem[0][0].object)
    assert own.jobs.statuses == ()


def test_every_download_and_the_code_run_as_shown(open_own, own, tmp_path, monkeypatch):
    page = open_own().page
    assert page.card.files["png"]().startswith(b"\x89PNG")
    assert b"\nmodel,mass_range_msun,theta_rad," in page.card.files["csv"]()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STREAMDASH_CACHE", str(own.cache.roots[0]))
    code = page.card.code().replace("simulate(config)", "simulate(config, 'inline')")
    exec(compile(code, "shown", "exec"), {})
    assert (tmp_path / "simulate.png").read_bytes().startswith(b"\x89PNG")


def test_every_state_has_words():
    for state in ("waiting", "elsewhere", "geometry", "running", "stopping", "cancelled", "done"):
        assert words_state(JobStatus("k", CONFIG, "", state, 3, 4)).endswith((".", "…"))
    assert [duration(s) for s in (0.2, 99, 150, 7200)] == ["1 s", "99 s", "2 min", "2.0 h"]


# ------------------------------------------------------------------ the catalog


def test_a_session_keeps_its_choice_when_the_catalog_changes_and_says_what_has_gone(own, open_own):
    for mass in ("1e6-1e7", "1e7-1e8"):
        config = EnsembleConfig(perturbers=Perturbers(mass_range=mass), n_streams=2)
        simulate(config, "inline", cache=own.cache)
    watch = CacheWatch(own.cache)
    watch.look()
    assert watch.version == 1
    watch.look()
    assert watch.version == 1
    session = Session(tuple(page.key for page in PAGES), watch.catalog)
    session.load("?mass=1e6-1e7,1e8-1e9")
    chosen = list(session.mass)
    own.cache.remove(EnsembleConfig(perturbers=Perturbers(mass_range="1e7-1e8"), n_streams=2).key)
    watch.look()
    session.refresh(watch.catalog)
    assert (session.mass, session.problems, watch.version) == (chosen, [], 2)
    own.cache.remove(chosen[0])
    session.refresh(read_catalog(own.cache.entries()))
    assert session.mass == chosen[1:]
    assert "no longer in the cache" in session.problems[0]


def test_ensembles_that_look_alike_have_labels_of_their_own(own):
    from streamdash.config import Accuracy

    for tolerance in (3e-3, 4e-3):
        config = CONFIG.model_copy(update={"accuracy": Accuracy(kick_tolerance=tolerance), "n_streams": 1})
        simulate(config, "inline", cache=own.cache)
    labels = [choice.label for choice in own.catalog().streams[0].ensembles]
    assert len(set(labels)) == len(labels) == 3
