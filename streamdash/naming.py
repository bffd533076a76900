"""Names and colours of classes for people: once, for every page, file and link.

A class is an ensemble's configuration. Its name is its masses; where classes of the same masses stand
side by side, the name also says what sets them apart: ``1e5-1e9, cutoff 1e7 Msun`` in files and code
(`class_names`), ``10⁵–10⁹ M☉, cutoff 10⁷ M☉`` for people (`class_labels`).
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from streamdash.config import Config, EnsembleConfig, Population, Prior, mass_label, parse_mass_range
from streamdash.populations import wdm_mass

COLOUR_WORDS = {
    "#0072B2": "blue",
    "#D55E00": "orange",
    "#009E73": "green",
    "#CC79A7": "pink",
    "#3D9BC4": "light blue",
    "#A6761D": "brown",
    "#7F6FC0": "violet",
    "#999933": "olive",
    "#882255": "wine",
}
"""Colours of classes, Okabe & Ito's first, and how people call them."""
CLASS_COLOURS = tuple(COLOUR_WORDS)
HOME_COLOURS = {
    "1e3-1e5": "#0072B2",
    "1e5-1e9": "#D55E00",
    "1e5-1e7": "#009E73",
    "1e7-1e9": "#CC79A7",
    "1e3-1e5+1e5-1e9": "#3D9BC4",
    "1e6-1e9": "#A6761D",
}
"""Colours of the usual mass ranges; others get what is left (`class_colours`)."""
ACCENT = "#6B7A89"
"""Colour of what belongs to no class: calibration, importance, scores of all classes."""

MASS_UNIT = "M☉"
PLAIN_UNIT = "Msun"
SUPERSCRIPT = str.maketrans("0123456789.", "⁰¹²³⁴⁵⁶⁷⁸⁹·")
MASS = re.compile(rf"(?<!\d)(\d+(?:\.\d+)?)e(\d+)( {PLAIN_UNIT})?")
RANGE = re.compile(r"(?<=e\d)-(?=\d)|(?<=e\d\d)-(?=\d)")


def class_colours(classes: Sequence[EnsembleConfig | str]) -> list[str]:
    """Colour of each of the classes that stand side by side, on every page and in every figure.

    A colour belongs to the class, not to its place: the usual mass ranges have colours of their own
    (`HOME_COLOURS`), any other one of those that are left, the same one every time unless two of them
    would have the same.

    Parameters
    ----------
    classes
        Configurations, or names from `class_names` or `class_labels`.
    """
    names = [_colour_name(one) for one in classes]
    taken = {HOME_COLOURS[name] for name in names if name in HOME_COLOURS}
    given: dict[int, str] = {}
    # By name, so that the order in which they stand does not matter.
    for index in sorted(range(len(names)), key=lambda i: (names[i], i)):
        home = HOME_COLOURS.get(names[index])
        if home is None or home in given.values():
            first = zlib.crc32(names[index].encode()) % len(CLASS_COLOURS)
            order = CLASS_COLOURS[first:] + CLASS_COLOURS[:first]
            # Of the colours that no usual range has, then of all.
            spare = [c for c in order if c not in HOME_COLOURS.values()] + list(order)
            home = next((c for c in spare if c not in taken and c not in given.values()), spare[0])
        given[index] = home
    return [given[index] for index in range(len(names))]


def _colour_name(one: EnsembleConfig | str) -> str:
    """What a class's colour goes by: its masses, and what sets it apart from the default ones."""
    if not isinstance(one, str):
        return ", ".join([one.population.label, *differences(one)])
    return next((name for name in HOME_COLOURS if one in (name, label_text(name))), one)


def class_colour(index: int, classes: Sequence[EnsembleConfig | str]) -> str:
    """Colour of one of the classes that stand side by side; see `class_colours`."""
    return class_colours(classes)[index]


# ---------------------------------------------------------------- masses


def mass_text(mass_range: tuple[float, float]) -> str:
    """A mass range for people, for example ``10³–10⁵ M☉``.

    Examples
    --------
    >>> mass_text((1e3, 1e5))
    '10³–10⁵ M☉'
    """
    return f"{_masses(mass_label(mass_range))} {MASS_UNIT}"


def population_text(population: Population) -> str:
    """The masses of a population for people, for example ``10³–10⁵ + 10⁵–10⁹ M☉``."""
    return label_text(population.label)


def _masses(label: str) -> str:
    return _power(mass_label(parse_mass_range(label)))


def _power(text: str) -> str:
    return MASS.sub(_as_power, RANGE.sub("–", text))


def _as_power(match: re.Match[str]) -> str:
    mantissa, exponent, unit = match.groups()
    power = "10" + exponent.translate(SUPERSCRIPT)
    return (power if mantissa == "1" else f"{mantissa}·{power}") + (f" {MASS_UNIT}" if unit else "")


# ---------------------------------------------------------------- classes


def class_names(configs: Sequence[EnsembleConfig]) -> list[str]:
    """Name of each class in files and code: its masses, and what sets it apart from others of the same.

    Classes that differ in something are named differently; the same configuration twice is not.
    """
    masses = [config.population.label for config in configs]
    names = []
    for config, own in zip(configs, masses, strict=True):
        same = [other for other, label in zip(configs, masses, strict=True) if label == own]
        names.append(", ".join([own, *_set_apart(config, same)]))
    return names


def class_labels(configs: Sequence[EnsembleConfig]) -> list[str]:
    """Name of each class for people, for example ``10⁵–10⁹ M☉, cutoff 10⁷ M☉``; see `class_names`."""
    return [label_text(name) for name in class_names(configs)]


def model_labels(configs: Sequence[EnsembleConfig]) -> list[str]:
    """Name of each class with its number, for example ``M0 · 10³–10⁵ M☉``; see `class_labels`."""
    return [f"M{index} · {label}" for index, label in enumerate(class_labels(configs))]


def label_text(name: str) -> str:
    """A name made by `class_names` as people read it; any other text as it is."""
    masses, comma, words = name.partition(", ")
    many = re.fullmatch(r"(.+)-(\d+)components", masses)
    try:
        ranges = [_masses(label) for label in (many[1] if many else masses).split("+")]
    except ValueError:
        return name
    counted = f" ({many[2]} components)" if many else ""
    return f"{' + '.join(ranges)} {MASS_UNIT}{counted}{comma}{_power(words)}"


def differences(config: EnsembleConfig) -> list[str]:
    """What sets an ensemble apart from the default one of its stream and masses, in words for people.

    Neither the number of streams nor the numerical accuracy: they do not change what is simulated.
    """
    return [_power(words) for (path, _), words in _words(config) if not path.startswith(UNSEEN)]


def _set_apart(config: EnsembleConfig, same: Sequence[EnsembleConfig]) -> list[str]:
    """Words for what is not as by default and differs among ensembles of the same masses."""
    if len(same) < 2:
        return []
    others = [dict(_leaves(other)) for other in same]
    differing = {leaf for leaf, value in _leaves(config) if any(o.get(leaf) != value for o in others)}
    return [words for leaf, words in _words(config) if leaf in differing]


def _words(config: EnsembleConfig) -> Iterator[tuple[tuple[str, int], str]]:
    """Leaf and words of everything that is not as by default, masses aside."""
    plain = dict(_leaves(EnsembleConfig(stream=config.stream)))
    components = config.population.components
    for (path, number), value in _leaves(config):
        if config.prior is not None and path.startswith("perturbers."):
            continue  # of a typical stream; every one has its own
        if path != "perturbers.mass_range" and value != plain.get((path, 0)):
            say = WORDS.get(path)
            words = say(value) if say else f"{path.rpartition('.')[2]} {_number(value)}"
            shared = {getattr(part, path.rpartition(".")[2], None) for part in components} == {value}
            if path.startswith("perturbers.") and not shared:
                yield (path, number), f"{words} in {components[number].label}"
            elif not number:  # what all components have is said once
                yield (path, number), words


def _leaves(config: Config, above: str = "", number: int = 0) -> Iterator[tuple[tuple[str, int], Any]]:
    """Path, number of the component, and value of every field, those of configurations inside one by one."""
    for name, value in config:
        if isinstance(value, Population):
            for i, component in enumerate(value.components):
                yield from _leaves(component, f"{above}perturbers.", i)
        elif isinstance(value, Prior):
            yield (above + name, number), value.label
        elif isinstance(value, Config):
            yield from _leaves(value, f"{above}{name}.", number)
        else:
            yield (above + name, number), value


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)


def _mass(value: float) -> str:
    return f"{mass_label((value, value)).split('-')[0]} {PLAIN_UNIT}"


WORDS: Mapping[str, Callable[[Any], str]] = {
    "perturbers.X": lambda value: f"X = {_number(value)}",
    "perturbers.rate_factor": lambda value: f"rate × {_number(value)}",
    "perturbers.slope": lambda value: f"slope {_number(value)}",
    "perturbers.cutoff_mass": lambda value: f"cutoff {_mass(value)}",
    "perturbers.half_mode_mass": lambda value: (
        f"warm, half-mode mass {_mass(value)} ({wdm_mass(value):.3g} keV)"
    ),
    "perturbers.profile": lambda value: f"{value.capitalize()} spheres",
    "perturbers.rs_factor": lambda value: f"scale radius × {_number(value)}",
    "perturbers.sigma_h": lambda value: f"velocity dispersion {_number(value)} km/s",
    "perturbers.length_factor": lambda value: f"length × {_number(value)}",
    "perturbers.width_floor": lambda value: "without the width floor" if not value else "width floor",
    "prior": lambda value: "every stream with a population of its own",
    "n_streams": lambda value: f"{value} streams",
    "seed": lambda value: f"seed {value}",
}
"""How people say what differs from the default."""
UNSEEN = ("stream.", "accuracy.", "n_streams")
"""Beginnings of the paths that are not told of an ensemble on its own."""
