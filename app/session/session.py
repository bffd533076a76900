"""What one browser session has chosen, and its form in the URL.

`read_query` and `write_query` are pure functions; `Session` holds the values widgets bind to.
To let a page remember something new, add a field of `app.session.fields` to `Session`, or, where it is
that page's alone, to the class in ``app/pages/<page>/state.py``, which `Session` inherits from.
"""

from __future__ import annotations

from typing import Any
from urllib.parse import parse_qsl, urlencode
from uuid import uuid4

import param

from app.pages.convergence.state import ConvergenceState
from app.pages.infer.state import InferState
from app.pages.learn.state import LearnState
from app.pages.observe.state import ObserveState
from app.pages.simulate.knobs import ARM, NAMED
from app.pages.simulate.state import SimulateState
from app.session.catalog import CLASSES_MAX, CLASSES_MIN, Catalog, Choice, Stream
from app.session.fields import Decimal, Field, OneOf, Whole, check_word, fields_of
from streamdash.config import EnsembleConfig
from streamdash.plots.style import COORDINATE_LABELS
from streamdash.streams import bins_of, named_stream
from streamdash.survey.bands import SCALES

QUANTITIES = {"q_rho": "Qρ", "rho": "ρ", "omega": "⟨Ω∥⟩"}
RULE_WORDS = {"central": "central 99.8 %", "noise": "paper: 3 σ", "measured": "3 own widths"}
N_BIN_MAX = 500
_LONGEST_SHOWN = 40
PROFILES, OF_PROFILES = "profiles", {"x", "y", "scale", "highlight", "seed"}
"""Page that a link without one meant while it was the first; and what only its links say."""
OWN = "phi1"
"""In links, the longitude of the stream's own frame, whatever its name there: older links say so."""


class Session(LearnState, ObserveState, InferState, ConvergenceState, SimulateState):
    """One browser session's choices. Widgets bind to these; the URL follows them."""

    page = param.String("", doc="key of the page shown; empty: the first")
    stream = param.String("", doc="key of the stream model; empty: the first of the catalog")
    mass = param.List([], item_type=str, doc="cache keys of the ensembles compared, lowest masses first")
    noise = Decimal(0.1, (0, 1), doc="shot noise σ_ε per bin of the stream")
    n_bin = Whole(20, (2, N_BIN_MAX), softbounds=(5, 100), doc="number of bins of PDF(Qρ)")
    alpha = Whole(0, (0, N_BIN_MAX), doc="bin of PDF(Qρ) looked into, from 1; 0: at Qρ = 1")
    focus = Whole(1, (0, CLASSES_MAX), doc="of more than two classes, whose band is drawn; 0: all")
    fiducial = Whole(0, (0, CLASSES_MAX - 1), doc="model that data are assumed to come from")
    exclude = OneOf("central", RULE_WORDS, doc="rules that say which bins of Qρ count in the evidence")
    x = OneOf("ell", COORDINATE_LABELS, doc="coordinate along the stream")
    y = OneOf("q_rho", QUANTITIES, doc="quantity shown in profiles")
    scale = OneOf("shared", SCALES, doc="vertical scale of profiles")
    highlight = Whole(3, (0, 10), doc="number of highlighted streams")
    seed = Whole(0, (0, 9999), doc="seed that picks the highlighted streams")
    preset = OneOf("best", {"best": "Best", "paper": "Paper"}, doc="classifier to start from")
    n_pca = Whole(30, (1, 100), doc="principal components the classifier is given")
    features = OneOf(
        "both",
        {"both": "Both", "pca": "Components", "summaries": "Summaries"},
        doc="what the classifier is given",
    )
    depth = Whole(0, (0, 128), doc="depth of the trees; 0: the preset's")
    trees = Whole(0, (0, 2000), doc="trees per class; 0: the preset's")
    cell = Whole(
        0,
        (0, CLASSES_MAX**2),
        doc="cell of the confusion matrix looked into, row by row from 1; 0: the most common mistake",
    )
    theme = OneOf("default", ("default", "light", "dark"), doc="light, dark, or as the system prefers")
    system_dark = param.Boolean(False, doc="whether the visitor's system prefers dark pages")

    problems = param.List([], item_type=str, doc="what was wrong with the link, one sentence each")
    catalog = param.ClassSelector(class_=Catalog, default=Catalog(), doc="streams and ensembles there are")

    def __init__(self, pages: tuple[str, ...] = (), catalog: Catalog = Catalog(), **values: Any) -> None:
        self.pages = pages
        self.visitor = uuid4().hex
        self.pinned: dict[str, Any] = {}
        """Views that are kept beside the next ones, by the figure's name."""
        super().__init__(catalog=catalog, **values)

    @property
    def dark(self) -> bool:
        """Whether the page is dark: as chosen, else as the system prefers."""
        return self.theme == "dark" or (self.theme == "default" and self.system_dark)

    @property
    def ensembles(self) -> tuple[Choice, ...]:
        """The chosen `Choice` objects, lowest masses first: models M0, M1, …"""
        stream = self.catalog.stream(self.stream)
        return tuple(c for c in stream.ensembles if c.key in self.mass) if stream else ()

    @property
    def configs(self) -> list[EnsembleConfig]:
        """Configurations of the chosen ensembles, M0 first."""
        return [choice.config for choice in self.ensembles]

    def load(self, search: str) -> None:
        """Take over a URL's query; what is missing or wrong becomes the default of its stream."""
        values, problems = read_query(search, self.pages, self.catalog)
        simulated = values.get(NAMED, FIELDS[NAMED].default)
        defaults = defaults_of(self.catalog.stream(values["stream"]), simulated)
        self.param.update(**{**defaults, "page": "", **values, "problems": problems})

    def refresh(self, catalog: Catalog) -> None:
        """Take over a newer catalog; what is chosen stays as far as it still exists."""
        stream = catalog.stream(self.stream) or catalog.stream("")
        values: dict[str, Any] = {"catalog": catalog, "stream": stream.key if stream else "", "mass": []}
        if stream is not None:
            kept = [c.key for c in stream.ensembles if c.key in self.mass]
            enough = len(kept) >= min(CLASSES_MIN, len(stream.ensembles))
            values["mass"] = kept if enough else [c.key for c in stream.default()]
            if self.mass and not set(self.mass) <= set(values["mass"]):
                gone = "An ensemble that was shown is no longer in the cache; others are shown."
                values["problems"] = [*self.problems, gone]
        self.param.update(**values)

    def advance(self, name: str, **others: Any) -> None:
        """Give a whole number, such as a seed, its next value (after the last the first), and set others."""
        low, high = self.param[name].bounds
        self.param.update(**{name: low + (getattr(self, name) + 1 - low) % (high + 1 - low)}, **others)

    @property
    def search(self) -> str:
        """The query that reproduces this view; what has its default value is left out."""
        return write_query(self)

    def choose_stream(self, key: str) -> None:
        """Switch to another stream model, its default mass ranges, and the axis in which it lies along.

        The noise follows as well, unless somebody has chosen another than the default of the stream before.
        """
        stream, before = self.catalog.stream(key), self.catalog.stream(self.stream)
        if stream is None:
            return
        values: dict[str, Any] = {"stream": key, "mass": [c.key for c in stream.default()]}
        own = looks_of(stream)
        if before is not None and self.noise != looks_of(before)["noise"]:
            del own["noise"]
        self.param.update(**values, **own)


FIELDS: dict[str, Field] = fields_of(Session)
"""Choices that can be checked alone; ``page``, ``stream`` and ``mass`` need to know what exists."""


def looks_of(stream: Stream) -> dict[str, Any]:
    """How a stream is looked at unless asked otherwise: the axis that it lies along, and its noise."""
    bins = bins_of(stream.model)
    return {"x": "ell" if bins.coordinate == "ell" else OWN, "noise": bins.noise}


def defaults_of(stream: Stream | None, simulated: str) -> dict[str, Any]:
    """What links need not say, for the stream that is looked at and the name of that which is simulated."""
    plain = {name: field.default for name, field in FIELDS.items()}
    own = looks_of(stream) if stream is not None else {}
    return plain | own | {ARM: named_stream(simulated).default_arm}


def read_query(search: str, pages: tuple[str, ...], catalog: Catalog) -> tuple[dict[str, Any], list[str]]:
    """Read a URL's query, each key on its own.

    Parameters
    ----------
    search
        Query with or without its question mark.
    pages
        Keys of the pages that exist.
    catalog
        Streams and ensembles that exist.

    Returns
    -------
    values, problems
        Values by name (always with ``stream`` and ``mass``), and one sentence, naming the key,
        for everything that was ignored.
    """
    given, problems = _split(search)
    values: dict[str, Any] = {}
    for name, text in given.items():
        if name in ("stream", "mass"):
            continue
        try:
            values[name] = check_word(text, pages) if name == "page" else FIELDS[name].read(text)
        except ValueError as error:
            problems.append(f"{name}={_short(text)} in the link was ignored: {name} {error}.")
    if "page" not in given and PROFILES in pages and OF_PROFILES & given.keys():
        values["page"] = PROFILES
    stream = catalog.stream(given.get("stream", ""))
    if stream is None and catalog.streams:
        problems.append(
            f"stream={_short(given['stream'])} in the link was ignored: no complete ensemble of this "
            f"stream is in the cache; the {catalog.streams[0].label} stream is shown."
        )
        stream = catalog.streams[0]
    values["stream"] = stream.key if stream else ""
    values["mass"] = _read_mass(given.get("mass"), stream, problems) if stream else []
    return values, problems


def _split(search: str) -> tuple[dict[str, str], list[str]]:
    try:
        pairs = parse_qsl(search.lstrip("?"), keep_blank_values=True, max_num_fields=50)
    except ValueError:
        return {}, ["The link was ignored: it has more than 50 keys."]
    given, problems = {}, []
    for name, text in pairs:
        if name.startswith("bokeh-"):  # the server's own
            continue
        if name not in (*FIELDS, "page", "stream", "mass"):
            problems.append(f"{_short(name)} in the link was ignored: there is no such key.")
        elif name in given:
            problems.append(f"{name} is given twice in the link: only the first one counts.")
        else:
            given[name] = text
    return given, problems


def _read_mass(text: str | None, stream: Stream, problems: list[str]) -> list[str]:
    default = [c.key for c in stream.default()]
    if text is None:
        return default
    found: list[str] = []
    for token in text.split(",")[:50]:
        choice = stream.find(token.strip())
        if choice is None:
            known = ", ".join(c.token for c in stream.ensembles[:8])
            problems.append(
                f"mass={_short(token)} in the link was ignored: no complete ensemble has this mass "
                f"range; there are {known}."
            )
        elif choice.key not in found:
            found.append(choice.key)
    fewest = min(CLASSES_MIN, len(stream.ensembles))
    if not fewest <= len(found) <= CLASSES_MAX:
        problems.append(
            f"mass in the link was ignored: it must name {CLASSES_MIN} to {CLASSES_MAX} mass ranges."
        )
        return default
    return [c.key for c in stream.ensembles if c.key in found]


def write_query(session: Session) -> str:
    """Write a session's choices as a URL query, leaving out defaults; inverse of `read_query`."""
    query: dict[str, str] = {}
    if session.page and session.pages and session.page != session.pages[0]:
        query["page"] = session.page
    stream = session.catalog.stream(session.stream)
    if stream is not None:
        if stream.key != session.catalog.streams[0].key:
            query["stream"] = stream.token
        if [c.key for c in session.ensembles] != [c.key for c in stream.default()]:
            query["mass"] = ",".join(c.token for c in session.ensembles)
    for name, default in defaults_of(stream, session.sim_stream).items():
        value = getattr(session, name)
        if value != default:
            query[name] = FIELDS[name].write(value)
    return f"?{urlencode(query, safe=',~')}" if query else ""


def link_to(session: Session, **changes: Any) -> str:
    """Query of a session's view with some of its choices changed."""
    query = dict(parse_qsl(write_query(session).lstrip("?")))
    for name, value in changes.items():
        query[name] = value if name == "page" else FIELDS[name].write(value)
    other = Session(session.pages, session.catalog)
    other.load(urlencode(query))
    return other.search  # as the address bar will have it


def _short(text: str) -> str:
    clean = "".join(c if c.isprintable() else "�" for c in text)
    return clean if len(clean) <= _LONGEST_SHOWN else clean[: _LONGEST_SHOWN - 1] + "…"
