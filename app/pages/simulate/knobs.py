"""The knobs of a simulation: texts that a person types, and the configuration they make. Pure; no Panel.

Bounds, defaults and meaning are those of the fields in `streamdash.config`; only units and a few words
are added here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from app.pages.simulate.own import (
    HM_LABEL,
    OWN,
    PROGENITOR_LABEL,
    Q_LABEL,
    base_of,
    listed_text,
    mass_of_kev,
    number_text,
    of_named,
    on_named,
    progenitor_of,
)
from streamdash.config import Config, ConfigError, EnsembleConfig, Perturbers, Population, mass_label
from streamdash.populations import component_text, parse_component
from streamdash.simulation.limits import Limits
from streamdash.stream_model import SkyProgenitor
from streamdash.streams import STREAM_NAMES, named_stream

_DEFAULT = EnsembleConfig()


@dataclass(frozen=True)
class Knob:
    """One number, word or list that a person may choose.

    Attributes
    ----------
    name : in links and of the session's parameter.
    path : dotted name of the field in `EnsembleConfig`.
    label, unit : for people; the unit may be empty.
    help : one line on what it does.
    group : heading under which it stands.
    """

    name: str
    path: str
    label: str
    unit: str
    help: str
    group: str

    @property
    def default(self) -> str:
        """Text of the default value; of a stream's own value, none."""
        return text_of(_DEFAULT, self)

    @property
    def options(self) -> tuple[str, ...]:
        """The words allowed; empty for a knob that is a number or a list."""
        kind = self._field.annotation
        if kind is bool:
            return ("yes", "no")
        if self.name == ARM:
            return (*get_args(kind), BOTH)
        return get_args(kind) if get_origin(kind) is Literal else ()

    @property
    def bounds(self) -> str:
        """The values allowed, in words; empty where help says it."""
        limits = {}
        for rule in self._field.metadata:
            for sign in ("ge", "gt", "le", "lt"):
                if getattr(rule, sign, None) is not None:
                    limits[sign[0]] = f"{getattr(rule, sign):g}"
        if self.name == "sim_n":
            limits["l"] = f"{Limits().max_streams}"
        if self.name == "sim_seed":
            return "a whole number"
        return f"{limits['g']} to {limits['l']}" if len(limits) == 2 else ""

    @property
    def _field(self) -> Any:
        *parents, last = self.path.split(".")
        model: type[Config] = EnsembleConfig
        for parent in parents:
            if parent == "perturbers":  # short for the population's one component
                model = Perturbers
                continue
            found: Any = model.model_fields[parent].annotation
            model = found if isinstance(found, type) else get_args(get_args(found)[0])[0]
        return model.model_fields[last]


NAMED = "sim_stream"
"""Name, in links and of the session's parameter, of the stream by name that the stream's knobs start from."""
ARM, BOTH = "sim_arm", "both"
"""Name of the knob of the arm, and its word for two ensembles at once."""
MORE = "sim_more"
"""Name of the knob that holds all components but one."""
SUBHALOS, STREAM, SAMPLE = "Perturbers", "Stream model", "How many"
KNOBS = tuple(
    Knob(*row)
    for row in (
        (
            "sim_mass",
            "perturbers.mass_range",
            "Mass range",
            "M☉",
            "Lowest and highest mass, as 1e3-1e5; at most 8 decades.",
            SUBHALOS,
        ),
        (
            "sim_rate",
            "perturbers.rate_factor",
            "Abundance",
            "× CDM",
            "How many perturbers there are, relative to cold dark matter.",
            SUBHALOS,
        ),
        (
            "sim_profile",
            "perturbers.profile",
            "Density profile",
            "",
            "Of one perturber: Hernquist's or Plummer's sphere.",
            SUBHALOS,
        ),
        (
            "sim_rs",
            "perturbers.rs_factor",
            "Size",
            "× the usual",
            "Scale radius relative to 1.05 kpc (Plummer 1.62 kpc) · (M / 10⁸ M☉)^½.",
            SUBHALOS,
        ),
        (
            "sim_slope",
            "perturbers.slope",
            "Mass function's slope",
            "",
            "dn/dM ∝ M^slope; cold dark matter has about −2.",
            SUBHALOS,
        ),
        (
            "sim_cutoff",
            "perturbers.cutoff_mass",
            "Cutoff mass",
            "M☉",
            "Fewer below, by exp(−cutoff / M). Empty: none.",
            SUBHALOS,
        ),
        (
            "sim_hm",
            "perturbers.half_mode_mass",
            HM_LABEL,
            "M☉, or a particle's 5 keV",
            "Warm dark matter as published: fewer by (1 + 2.7 m / M)^−0.99, m being this mass. Empty: cold.",
            SUBHALOS,
        ),
        (
            "sim_X",
            "perturbers.X",
            "Largest impact parameter",
            "scale radii",
            "How far perturbers may pass, in their scale radii.",
            SUBHALOS,
        ),
        (
            "sim_sigma_h",
            "perturbers.sigma_h",
            "Velocity dispersion of perturbers",
            "km/s",
            "How fast they fly by.",
            SUBHALOS,
        ),
        (
            "sim_length",
            "perturbers.length_factor",
            "Length hit",
            "× stream",
            "Impacts reach out to this times the stream's length.",
            SUBHALOS,
        ),
        (
            "sim_floor",
            "perturbers.width_floor",
            "Count to half the stream's width",
            "",
            "As galpy and the paper count impacts. No: as many as the largest impact parameter says.",
            SUBHALOS,
        ),
        (
            "sim_more",
            "population",
            "Further components",
            "",
            "Other perturbers that hit the same stream, as 1e3-1e5,rate=3; a semicolon between them.",
            SUBHALOS,
        ),
        (
            "sim_age",
            "stream.age_gyr",
            "Age",
            "Gyr",
            "Time since the progenitor began to disrupt. Empty: the stream's own.",
            STREAM,
        ),
        (
            "sim_sigma_v",
            "stream.sigma_v_kms",
            "Velocity dispersion of the stream",
            "km/s",
            "Empty: the stream's own, which goes as 1 / age and keeps its length.",
            STREAM,
        ),
        (
            ARM,
            "stream.arm",
            "Arm",
            "",
            "Leading or trailing the progenitor; both are hit by one population, each by its own impacts.",
            STREAM,
        ),
        (
            "sim_n_times",
            "stream.n_times",
            "Impact times",
            "",
            "Evenly spaced over the age; each costs seconds, once per stream model.",
            STREAM,
        ),
        (
            "sim_times",
            "stream.times_gyr",
            "Impact times of your own",
            "Gyr ago",
            "A list such as 0.5, 1, 3 instead of evenly spaced ones. Empty: none.",
            STREAM,
        ),
        (
            "sim_q",
            "stream.potential.q",
            Q_LABEL,
            "",
            "q of the logarithmic potential; 1 is a sphere. Empty: the stream's own potential.",
            STREAM,
        ),
        (
            "sim_b",
            "stream.isochrone_b",
            "Isochrone scale b",
            "8 kpc",
            "Of the action-angle approximation. Empty: the stream's own.",
            STREAM,
        ),
        (
            "sim_progenitor",
            "stream.progenitor",
            PROGENITOR_LABEL,
            "8 kpc, 220 km/s",
            "Six numbers R, vR, vT, z, vz, φ, or as seen: ra=, dec=, distance_kpc=, pm_ra=, pm_dec=, "
            "v_los_kms= (or ell=, b=, pm_ell=, pm_b=). Empty: the stream's own.",
            STREAM,
        ),
        (
            "sim_n",
            "n_streams",
            "Streams",
            "",
            "Each an independent realisation; more can be added later.",
            SAMPLE,
        ),
        (
            "sim_seed",
            "seed",
            "Seed",
            "",
            "Of all random numbers: the same seed gives the same streams.",
            SAMPLE,
        ),
    )
)
BY_NAME = {knob.name: knob for knob in KNOBS}


def configs_of(values: Mapping[str, str]) -> tuple[EnsembleConfig, ...]:
    """The configurations that texts of knobs make: one, or of both arms two, as `config_of`."""
    if values.get(ARM) != BOTH:
        return (config_of(values),)
    stream = named_stream(values.get(NAMED, STREAM_NAMES[0]))
    if len(stream.arms) < 2:
        raise ConfigError(
            f"Arm: {stream.title} has a {stream.default_arm} arm only; choose that one, or another stream."
        )
    return tuple(config_of({**values, ARM: arm}) for arm in stream.arms)


def config_of(values: Mapping[str, str]) -> EnsembleConfig:
    """The configuration that texts of knobs make; knobs that are not named have their defaults.

    Of both arms, that of the first.

    Raises
    ------
    ConfigError
        In one sentence that begins with the knob's label.
    """
    if values.get(ARM) == BOTH:
        return configs_of(values)[0]
    data: dict[str, Any] = {}
    further = _components(values.get(MORE, ""))
    for name, text in values.items():
        if name in (MORE, NAMED):
            continue
        *parents, last = BY_NAME[name].path.split(".")
        place = data
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = _value(BY_NAME[name], text.strip())
    data["stream"] = on_named(named_stream(values.get(NAMED, STREAM_NAMES[0])), data.get("stream", {}))
    try:
        config = EnsembleConfig.parse(data)
        if not further:
            return config
        population = Population(components=(config.perturbers, *further))
        return config.model_copy(update={"population": population})
    except ConfigError as error:
        raise ConfigError(_labelled(str(error))) from None


def check(knob: Knob, text: str) -> str:
    """The text of one knob, if it can be used whatever the others are.

    Raises
    ------
    ValueError
        Saying what is allowed.
    """
    if len(text) > 4000 or not text.isprintable():
        raise ValueError("must be plain text")
    # A list of times is judged by the longest age there is.
    others = {"sim_age": "13.8"} if knob.name == "sim_times" else {}
    if knob.name == ARM:
        others = {NAMED: STREAM_NAMES[1]}  # which has both
    try:
        config_of({**others, knob.name: text})
    except ConfigError as error:
        sentence = str(error).partition(": ")[2].rstrip(".")
        raise ValueError(sentence.partition(" (got")[0]) from None
    return text.strip()


def text_of(config: EnsembleConfig, knob: Knob, component: int = 0) -> str:
    """A configuration's value as the text of a knob; `config_of` reads it back.

    The knobs of perturbers tell of one component of its population, `MORE` of all others.
    """
    parts = config.population.components
    if knob.name == MORE:
        return "; ".join(component_text(part) for i, part in enumerate(parts) if i != component)
    if knob.name in OWN and of_named(config.stream, knob.path):
        return ""
    value: Any = config
    path = knob.path.split(".")
    if path[0] == "perturbers":
        value = parts[component]
        path = path[1:]
    for part in path:
        value = getattr(value, part, None)  # not every potential is flattened
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if knob.name == "sim_mass":
        return mass_label(value)
    if isinstance(value, (SkyProgenitor, tuple)):
        return listed_text(value)
    return number_text(value) if isinstance(value, float) else str(value)


def texts_of(config: EnsembleConfig, component: int = 0) -> dict[str, str]:
    """All knobs' texts for a configuration, those of perturbers for one component of its population."""
    texts = {knob.name: text_of(config, knob, component) for knob in KNOBS}
    return {NAMED: base_of(config.stream).name, **texts}


def _components(text: str) -> list[Perturbers]:
    try:
        return [parse_component(part) for part in text.split(";") if part.strip()]
    except ConfigError as error:
        raise ConfigError(f"{BY_NAME[MORE].label}: {error}") from None


def _value(knob: Knob, text: str) -> Any:
    if text == "":
        # Empty means "not given" where that is allowed, and is refused by the model elsewhere.
        return None
    if knob.name == "sim_hm" and text.casefold().endswith("kev"):
        return mass_of_kev(text[:-3])
    if knob.name == "sim_progenitor":
        return progenitor_of(text)
    if knob.name == "sim_times":
        return [part.strip() for part in text.split(",")]
    return text


def _labelled(sentence: str) -> str:
    """Begin a sentence about a field with what the page calls it."""
    for knob in KNOBS:
        if sentence.startswith((f"{knob.path}:", f"{knob.path}.")):
            return f"{knob.label}: {sentence.partition(': ')[2]}"
    many = sentence.partition("components: ")[2]
    if many:
        return f"{BY_NAME[MORE].label}: {many}"
    words = sentence.partition("configuration: ")[2]  # what several fields have to do with one another
    return f"{STREAM}: {words}" if words else sentence
