"""A posterior in sentences: intervals, limits, and what the data do not say."""

from __future__ import annotations

from collections.abc import Mapping

from streamdash.inference.cells import AGE
from streamdash.inference.posterior import UNINFORMED, Posterior
from streamdash.naming import SUPERSCRIPT, label_text
from streamdash.population import mass_label
from streamdash.populations import wdm_mass
from streamdash.prior import Prior

SUBJECTS: Mapping[str, str] = {
    "log10_rate": "abundance of {halos}",
    "log10_half_mode_mass": "half-mode mass of warm dark matter",
    "log10_excess": "number of further objects of {clusters}",
    "log10_rs_factor": "size of the subhalos",
    "slope": "slope of the mass function",
}
UNITS: Mapping[str, str] = {
    "log10_rate": " × CDM",
    "log10_half_mode_mass": " M☉",
    "log10_excess": " × CDM's there",
    "log10_rs_factor": " × the relation",
    "slope": "",
}


def sentences(posterior: Posterior, prior: Prior) -> list[str]:
    """What a posterior says of each parameter, a sentence or two each."""
    names = sorted(posterior.names, key=lambda name: name == AGE)  # the age is asked for last
    return [words for name in names for words in sentences_on(posterior, name, prior)]


def sentences_on(posterior: Posterior, name: str, prior: Prior) -> list[str]:
    """What it says of one parameter: an interval, a limit, or that the data do not constrain it."""
    if name == AGE:
        return [_of_age(posterior, prior)]
    subject = _subject(name, prior)
    if posterior.information_on(name) < UNINFORMED:
        return [f"The data do not constrain the {subject}."]
    if name == "log10_half_mode_mass":
        return _of_warm_dark_matter(posterior, name)
    reached = posterior.edges_reached(name)
    if reached == ("lower",):
        limit = _value(name, posterior.upper_limit(name))
        return [
            f"The {subject} is below {limit} at 95 %.",
            f"The answer lies at the edge of the prior, which ends at {_end(posterior, name, 0)}: "
            "the limit holds for this prior only.",
        ]
    if reached == ("upper",):
        limit = _value(name, posterior.lower_limit(name))
        return [
            f"The {subject} is above {limit} at 95 %.",
            f"The answer lies at the edge of the prior, which ends at {_end(posterior, name, -1)}: "
            "the truth may be beyond it.",
        ]
    low, high = posterior.interval(name)
    middle = _value(name, posterior.median(name))
    return [f"The {subject} is {middle} ({_value(name, low, unit=False)} to {_value(name, high)} at 68 %)."]


def _of_age(posterior: Posterior, prior: Prior) -> str:
    """The most probable age, or that the data do not tell."""
    if posterior.information_on(AGE) < UNINFORMED:
        return "The data do not constrain the stream's age."
    p = posterior.marginal(AGE)
    best = int(p.argmax())
    age = sorted(prior.ages_gyr)[best]
    return f"The stream's age is {age:g} Gyr with probability {p[best]:.0%}."


def _of_warm_dark_matter(posterior: Posterior, name: str) -> list[str]:
    """An upper limit: cold dark matter has a half-mode mass of 0, which no range of its logarithm holds."""
    limit = posterior.upper_limit(name)
    mass = wdm_mass(10**limit)
    return [
        f"The {SUBJECTS[name]} is below {_value(name, limit)} at 95 %: "
        f"the particle's mass is above {mass:.2g} keV."
    ]


def _subject(name: str, prior: Prior) -> str:
    return SUBJECTS[name].format(
        halos=label_text(mass_label(prior.mass_range)), clusters=label_text(mass_label(prior.cluster_range))
    )


def _end(posterior: Posterior, name: str, which: int) -> str:
    return _value(name, float(posterior.grid[name][which]))


def _value(name: str, value: float, unit: bool = True) -> str:
    if name == "log10_half_mode_mass":
        digits, power = f"{10**value:.1e}".split("e")
        shown = f"{digits} × 10{str(int(power)).translate(SUPERSCRIPT)}"
    else:
        shown = f"{10**value if name.startswith('log10_') else value:.2g}"
    return f"{shown}{UNITS[name] if unit else ''}"
