"""Links: every choice round-trips, nothing in a URL can break a session."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlencode

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.session.catalog import Catalog, of_paper, read_catalog
from app.session.fields import Decimal, Whole
from app.session.session import FIELDS, OWN, Session, link_to, read_query
from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.plots.style import COORDINATE_LABELS
from streamdash.statistics.evidence import RULES
from streamdash.store.cache import Entry
from streamdash.streams import named_stream

PAGES = ("profiles", "pdf")
RANGES = ("1e3-1e5", "1e5-1e7", "1e5-1e9", "1e7-1e9")
TRAILING = StreamModel(arm="trailing")


def entry(config: EnsembleConfig, state: str = "complete", reason: str = "") -> Entry:
    return Entry(
        kind="ensemble",
        key=config.key,
        label=config.population.label,
        path=Path(config.key),
        state=state,
        reason=reason,
        config=config,
        n_done=config.n_streams,
        n_total=config.n_streams,
        size_bytes=1,
        date="2020-01-01T00:00:00",
        cost_s=1.0,
        code_version="0",
        shipped=True,
    )


def ensemble(mass: str, **values) -> EnsembleConfig:
    return EnsembleConfig(perturbers=Perturbers(mass_range=mass), n_streams=100, **values)


@pytest.fixture(scope="module")
def catalog() -> Catalog:
    configs = [ensemble(mass) for mass in RANGES] + [
        ensemble(mass, stream=TRAILING) for mass in ("1e3-1e5", "1e6-1e8")
    ]
    return read_catalog(entry(config) for config in configs)


def opened(catalog: Catalog, search: str) -> Session:
    session = Session(PAGES, catalog)
    session.load(search)
    return session


def masses(session: Session) -> list[str]:
    return [choice.token for choice in session.ensembles]


def test_an_empty_link_shows_the_papers_two_classes(catalog):
    session = opened(catalog, "")
    assert masses(session) == ["1e3-1e5", "1e5-1e9"]
    assert session.problems == []
    assert session.search == ""


@given(
    noise=st.floats(0, 1).map(lambda value: round(value, 3)),
    n_bin=st.integers(*Session.param.n_bin.bounds),
    x=st.sampled_from(list(COORDINATE_LABELS)),
    y=st.sampled_from(Session.param.y.objects),
    highlight=st.integers(*Session.param.highlight.bounds),
    seed=st.integers(*Session.param.seed.bounds),
    theme=st.sampled_from(["default", "dark"]),
    page=st.sampled_from(PAGES),
    chosen=st.lists(st.sampled_from(RANGES), min_size=2, max_size=4, unique=True),
)
def test_a_link_reproduces_every_choice(catalog, page, chosen, **values):
    first = opened(catalog, "")
    stream = catalog.streams[0]
    wanted = [choice.key for choice in stream.ensembles if choice.token in chosen]
    first.param.update(page=page, mass=wanted, **values)
    second = opened(catalog, first.search)
    assert second.problems == []
    assert second.mass == wanted
    assert (second.page or PAGES[0]) == page
    assert {name: getattr(second, name) for name in values} == values
    assert second.search == first.search


@given(st.dictionaries(st.sampled_from([*FIELDS, "page", "stream", "mass"]) | st.text(), st.text()))
def test_hostile_values_become_sentences_and_leave_a_session_that_works(catalog, query):
    session = opened(catalog, "?" + urlencode(query))
    assert 2 <= len(session.ensembles) <= 4
    assert 0 <= session.noise <= 1
    for sentence in session.problems:
        assert len(sentence) < 400
        assert sentence.isprintable()
    again = opened(catalog, session.search)
    assert again.search == session.search
    assert again.problems == []


@given(st.text())
def test_any_text_at_all_can_stand_behind_the_question_mark(catalog, text):
    assert opened(catalog, text).ensembles


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("noise", "-0.1"),
        ("noise", "1.0001"),
        ("noise", "nan"),
        ("noise", "inf"),
        ("noise", "0,1"),
        ("n_bin", "1"),
        ("n_bin", "20.5"),
        ("n_bin", "²0"),
        ("n_bin", "1_0"),
        ("seed", "99999999999999999999"),
        ("highlight", "11"),
        ("x", "longitude"),
        ("y", "<script>alert(1)</script>"),
        ("page", "admin"),
        ("stream", "0123456789abcdef"),
        ("mass", "1e3-1e6"),
        ("theme", "blue"),
    ],
)
def test_a_bad_value_is_named_and_the_other_keys_are_kept(catalog, name, text):
    others = {"noise": "0.37", "n_bin": "50", "x": "theta"}
    others.pop(name, None)
    session = opened(catalog, "?" + urlencode({**others, name: text}))
    assert any(sentence.startswith(f"{name}=") for sentence in session.problems)
    for key, value in others.items():
        assert FIELDS[key].write(getattr(session, key)) == value
    default = opened(catalog, "")
    assert getattr(session, name) == getattr(default, name)


def test_unknown_and_repeated_keys_are_named(catalog):
    problems = opened(catalog, "?colour=red&noise=0.2&noise=0.9").problems
    assert any("colour" in sentence for sentence in problems)
    assert any(sentence.startswith("noise is given twice") for sentence in problems)


def test_one_range_that_is_gone_leaves_the_others(catalog):
    session = opened(catalog, "?mass=1e3-1e5,1e3-1e6,1e7-1e9")
    assert masses(session) == ["1e3-1e5", "1e7-1e9"]
    assert len(session.problems) == 1


def test_too_few_or_too_many_ranges_fall_back_to_the_default(catalog):
    five = read_catalog([entry(ensemble(m)) for m in (*RANGES, "1e4-1e6")])
    for known, search in ((catalog, "?mass=1e3-1e5"), (five, "?mass=" + ",".join((*RANGES, "1e4-1e6")))):
        session = opened(known, search)
        assert masses(session) == ["1e3-1e5", "1e5-1e9"]
        assert "2 to 4" in session.problems[0]


@pytest.fixture(scope="module")
def named() -> Catalog:
    """The paper's stream and both arms of Palomar 5."""
    arms = [StreamModel(), *named_stream("pal5").arms.values()]
    return read_catalog(entry(ensemble(mass, stream=arm)) for arm in arms for mass in RANGES[:2])


def test_a_link_names_a_stream_and_has_its_noise_and_axis_unless_it_says_otherwise(named):
    assert [stream.token for stream in named.streams][0] == "gd1-like"
    assert {stream.token for stream in named.streams[1:]} == {"pal5", "pal5-leading", "pal5-both"}
    for stream in named.streams[1:]:
        session = opened(named, f"?stream={stream.token}")
        assert session.problems == []
        assert session.stream == stream.key
        assert (session.noise, session.x) == (named_stream("pal5").bins["trailing"].noise, OWN)
        assert session.search == f"?stream={stream.token}"
        older = "?" + urlencode({"stream": stream.key})
        assert opened(named, older).search == session.search
        told = opened(named, f"?stream={stream.token}&noise=0.1&x=ell")
        assert (told.noise, told.x) == (0.1, "ell")
        assert opened(named, told.search).noise == 0.1
        other = link_to(session, noise=0.1, y="rho")
        assert (opened(named, other).noise, opened(named, other).y) == (0.1, "rho")
    assert (opened(named, "").noise, opened(named, "").x) == (0.1, "ell")


def test_a_link_to_simulate_a_stream_takes_the_arm_that_is_shown_unless_it_says_otherwise(named):
    session = opened(named, "?sim_stream=pal5")
    assert session.sim_arm == named_stream("pal5").default_arm == "trailing"
    assert session.search == "?sim_stream=pal5"
    session.sim_arm = "leading"
    assert opened(named, session.search).sim_arm == "leading"
    assert opened(named, "").sim_arm == "leading"


def test_the_papers_numbers_stand_beside_its_own_stream_only():
    assert of_paper([ensemble(mass) for mass in RANGES])
    assert not of_paper([ensemble(mass, stream=named_stream("gd1").arm()) for mass in RANGES[:2]])
    assert not of_paper([EnsembleConfig(perturbers=Perturbers(mass_range="1e5-1e9", rs_factor=0.4))])


def test_changing_the_stream_brings_its_own_mass_ranges(catalog):
    session = opened(catalog, "")
    session.choose_stream(TRAILING.key)
    assert masses(session) == ["1e3-1e5", "1e6-1e8"]
    assert masses(opened(catalog, session.search)) == ["1e3-1e5", "1e6-1e8"]


def test_floats_are_written_as_people_would(catalog):
    session = opened(catalog, "?noise=0.15000000000000002")
    assert session.noise == 0.15
    assert session.search == "?noise=0.15"


def test_ensembles_with_other_knobs_get_tokens_and_labels_of_their_own():
    doubled = EnsembleConfig(perturbers=Perturbers(mass_range="1e3-1e5", rate_factor=2.0))
    larger = EnsembleConfig(perturbers=Perturbers(mass_range="1e3-1e5"), n_streams=500)
    catalog = read_catalog(map(entry, [doubled, ensemble("1e3-1e5"), larger]))
    tokens = {choice.key: choice.token for choice in catalog.streams[0].ensembles}
    labels = [choice.label for choice in catalog.streams[0].ensembles]
    assert tokens[larger.key] == "1e3-1e5"
    assert len(set(tokens.values())) == len(set(labels)) == 3
    assert any("rate × 2" in label for label in labels)
    values, problems = read_query(f"?mass=1e3-1e5,1e3-1e5~{doubled.key[:8]}", PAGES, catalog)
    assert problems == []
    assert set(values["mass"]) == {larger.key, doubled.key}


def test_damaged_entries_are_named_and_left_out():
    good, bad = ensemble("1e3-1e5"), ensemble("1e5-1e9")
    partial = ensemble("1e7-1e9")
    catalog = read_catalog(
        [entry(good), entry(bad, "damaged", "a checksum differs"), entry(partial, "partial")]
    )
    assert [choice.key for choice in catalog.streams[0].ensembles] == [good.key]
    assert len(catalog.problems) == 1
    assert "1e5-1e9" in catalog.problems[0]
    assert "checksum" in catalog.problems[0]


def test_an_empty_cache_gives_a_session_without_ensembles():
    session = opened(Catalog(), "?mass=1e3-1e5&noise=0.3")
    assert session.ensembles == ()
    assert session.noise == 0.3


ORDER = (
    "noise n_bin alpha fiducial exclude x y highlight seed preset n_pca features depth trees cell theme "
    "lesson step mass10 size b speed pitch azimuth when where flybys crowd crowd_of crowd_seed frame "
    "difficulty game round answers average example profile_kind profile_order profile_coordinate"
).split()


def test_links_keep_the_order_that_links_of_before_have():
    names = list(FIELDS)
    assert [name for name in names if name in ORDER] == ORDER
    assert names.index("average") < names.index("knob") < names.index("sim_mass") < names.index("sim_title")


def test_the_rules_on_offer_are_the_rules_there_are():
    assert Session.param.exclude.objects == list(RULES)


@pytest.mark.parametrize(
    "name", [name for name, field in FIELDS.items() if isinstance(field, Decimal | Whole)]
)
def test_links_sessions_and_widgets_have_the_same_bounds(catalog, name):
    field = Session.param[name]
    low, high = field.bounds
    shown = field.get_soft_bounds()
    assert low <= shown[0] <= field.default <= shown[1] <= high
    for value, beyond in ((low, low - 1), (high, high + 1)):
        assert field.read(field.write(value)) == value
        session = opened(catalog, "?" + urlencode({name: field.write(value)}))
        assert session.problems == [] and getattr(session, name) == value
        with pytest.raises(ValueError, match="must be"):
            field.read(field.write(beyond))
        with pytest.raises(ValueError):
            setattr(session, name, beyond)
        assert getattr(session, name) == value


def test_a_seed_advances_and_begins_anew(catalog):
    session = opened(catalog, "")
    session.seed = Session.param.seed.bounds[1] - 1
    session.advance("seed")
    assert session.seed == Session.param.seed.bounds[1]
    session.advance("seed", highlight=2)
    assert (session.seed, session.highlight) == (0, 2)


def test_links_of_the_time_when_profiles_was_the_first_page_still_show_it(catalog):
    pages = ("home", "profiles", "pdf")
    for search, page in (
        ("", None),
        ("?noise=0.3", None),
        ("?y=rho", "profiles"),
        ("?page=pdf&y=rho", "pdf"),
    ):
        values, problems = read_query(search, pages, catalog)
        assert (values.get("page"), problems) == (page, [])
