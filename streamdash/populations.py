"""Populations with names: the paper's, cold and warm dark matter, and an excess of clusters.

Cold dark matter over the whole 10³–10⁹ M☉ is two components that meet at 10⁵ M☉, as the paper's two
classes do. One component over that range would draw its masses from one power law, although
encounters with the lightest are counted out to half the stream's width, far beyond X · r_s: it would
put 90 instead of 63 of its impacts above 10⁵ M☉.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from streamdash.config import ConfigError, Perturbers, Population, mass_label

WDM_SCALE_MPC = 0.048 / 0.6774
"""Scale α of the transfer function of warm dark matter of 1 keV, Mpc."""
WDM_SLOPE = -1.11
"""α falls with the particle's mass to this power."""
WDM_NU = 1.12
WDM_DENSITY = 0.3089 * 1.27e11
"""Mean density of matter, M☉ Mpc⁻³."""
KEV_MIN, KEV_MAX = 0.5, 100.0
"""Lightest and heaviest warm dark matter particle accepted, keV."""
COMPONENT_WORDS = {
    "rate": "rate_factor",
    "rs": "rs_factor",
    "X": "X",
    "slope": "slope",
    "cutoff": "cutoff_mass",
    "mhm": "half_mode_mass",
    "profile": "profile",
    "sigma": "sigma_h",
    "length": "length_factor",
    "floor": "width_floor",
}
"""Fields of a component by their short names in commands and links; ``m_wdm`` (keV) stands for ``mhm``."""
LOW, HIGH = (1e3, 1e5), (1e5, 1e9)
"""Masses of clusters, and of subhalos, in M☉: the paper's two classes."""


def half_mode_mass(m_wdm_kev: float) -> float:
    """Half-mode mass M_hm in M☉ of a thermal relic of mass `m_wdm_kev` (keV).

    With α = (0.048 / h) m^-1.11 Mpc, ν = 1.12 and h = 0.6774, λ_hm = 2πα (2^(ν/5) - 1)^(-1/(2ν)) and
    M_hm = (4π/3) ρ̄ (λ_hm / 2)³ (Viel et al. 2005; Banik et al. 2021).

    Raises
    ------
    ConfigError
        When the mass is not between `KEV_MIN` and `KEV_MAX`.

    Examples
    --------
    >>> f"{half_mode_mass(5.0):.3g}"
    '9.3e+07'
    """
    if not KEV_MIN <= m_wdm_kev <= KEV_MAX:
        raise ConfigError(f"m_wdm: must lie between {KEV_MIN:g} and {KEV_MAX:g} keV (got {m_wdm_kev:g}).")
    return _mass_of_1_kev() * m_wdm_kev ** (3 * WDM_SLOPE)


def wdm_mass(half_mode_mass_msun: float) -> float:
    """Mass in keV of the thermal relic with a half-mode mass (M☉); inverse of `half_mode_mass`."""
    return (half_mode_mass_msun / _mass_of_1_kev()) ** (1 / (3 * WDM_SLOPE))


def _short(mass: float) -> float:
    """A half-mode mass to four digits, which people can read and write."""
    return float(f"{mass:.4g}")


def _mass_of_1_kev() -> float:
    wavelength = 2 * math.pi * WDM_SCALE_MPC * (2 ** (WDM_NU / 5) - 1) ** (-1 / (2 * WDM_NU))
    return 4 / 3 * math.pi * WDM_DENSITY * (wavelength / 2) ** 3


def cold() -> Population:
    """Cold dark matter, 10³–10⁹ M☉."""
    return Population(components=(Perturbers(mass_range=LOW), Perturbers(mass_range=HIGH)))


def with_excess(excess: float) -> Population:
    """Cold dark matter, and clusters of 10³–10⁵ M☉ besides: `excess` times what it has of those masses."""
    return Population(
        components=(Perturbers(mass_range=LOW, rate_factor=1 + excess), Perturbers(mass_range=HIGH))
    )


def warm(m_wdm_kev: float) -> Population:
    """Warm dark matter of thermal relics, 10³–10⁹ M☉."""
    mass = _short(half_mode_mass(m_wdm_kev))
    return Population(
        components=tuple(Perturbers(mass_range=masses, half_mode_mass=mass) for masses in (LOW, HIGH))
    )


def concentrated(rs_factor: float = 0.4) -> Population:
    """Cold dark matter of 10⁵–10⁹ M☉, and its clusters of 10³–10⁵ M☉ smaller than subhalos would be.

    X grows as they shrink: the same impact parameters in kpc.
    """
    clusters = Perturbers(mass_range=LOW, rs_factor=rs_factor, X=round(5 / rs_factor, 6))
    return Population(components=(clusters, Perturbers(mass_range=HIGH)))


def parse_component(text: str) -> Perturbers:
    """Read a component as written in commands and links, such as ``1e3-1e5,rate=3,rs=0.4``.

    Raises
    ------
    ConfigError
        In one sentence that names the component, the field and the fix.

    Examples
    --------
    >>> parse_component("1e3-1e5,rate=3").rate_factor
    3.0
    """
    masses, *rest = (part.strip() for part in text.split(","))
    shown = f"component {text[:60]!r}"
    values: dict[str, Any] = {"mass_range": masses}
    for part in rest:
        word, equals, value = (piece.strip() for piece in part.partition("="))
        try:
            if word == "m_wdm" and equals:
                word, value = "mhm", str(_short(half_mode_mass(float(value))))
        except ConfigError as error:
            raise ConfigError(f"{shown}: {error}") from None
        except ValueError:
            raise ConfigError(f"{shown}: m_wdm must be a mass in keV (got {value[:20]!r}).") from None
        if word not in COMPONENT_WORDS or not equals:
            known = ", ".join([*COMPONENT_WORDS, "m_wdm"])
            raise ConfigError(f"{shown}: {part[:20]!r} is not one of {known}, followed by = and a value.")
        if COMPONENT_WORDS[word] in values:
            raise ConfigError(f"{shown}: {word} is given twice.")
        values[COMPONENT_WORDS[word]] = value
    try:
        return Perturbers.parse(values)
    except ConfigError as error:
        raise ConfigError(f"{shown}: {error}") from None


def component_text(component: Perturbers) -> str:
    """A component as `parse_component` reads it: its masses and what is not as by default.

    Examples
    --------
    >>> component_text(Perturbers(mass_range="1e3-1e5", rate_factor=3, profile="plummer"))
    '1e3-1e5,rate=3,profile=plummer'
    """
    plain = Perturbers()
    words = [mass_label(component.mass_range)]
    for word, field in COMPONENT_WORDS.items():
        value = getattr(component, field)
        if value != getattr(plain, field):
            exact = f"{value:g}" if isinstance(value, float) and float(f"{value:g}") == value else str(value)
            words.append(f"{word}={exact}")
    return ",".join(words)


@dataclass(frozen=True)
class Preset:
    """A population with a name (for commands and links) and a title (for people)."""

    name: str
    title: str
    population: Population


def _one(masses: tuple[float, float]) -> Population:
    return Population(components=(Perturbers(mass_range=masses),))


PRESETS = {
    preset.name: preset
    for preset in (
        Preset("paper-1e3-1e5", "Paper: 10³–10⁵ M☉", _one((1e3, 1e5))),
        Preset("paper-1e5-1e9", "Paper: 10⁵–10⁹ M☉", _one((1e5, 1e9))),
        Preset("paper-1e5-1e7", "Paper: 10⁵–10⁷ M☉", _one((1e5, 1e7))),
        Preset("paper-1e7-1e9", "Paper: 10⁷–10⁹ M☉", _one((1e7, 1e9))),
        Preset("cdm", "Cold dark matter, 10³–10⁹ M☉", cold()),
        *(
            Preset(f"clusters-{excess:g}", f"Cold dark matter + clusters × {excess:g}", with_excess(excess))
            for excess in (1.0, 3.0, 10.0, 30.0)
        ),
        *(
            Preset(f"wdm-{kev:g}kev", f"Warm dark matter, {kev:g} keV", warm(kev))
            for kev in (2.0, 3.0, 5.0, 6.5, 10.0)
        ),
        Preset("concentrated", "Cold dark matter, concentrated clusters", concentrated()),
    )
}
"""Every preset by its name."""


def preset(name: str) -> Preset:
    """The preset of a name; ``wdm-KEVkev`` and ``clusters-FACTOR`` take any number.

    Raises
    ------
    ConfigError
        In one sentence that names those there are.
    """
    if name in PRESETS:
        return PRESETS[name]
    for start, end, make, title in (
        ("wdm-", "kev", warm, "Warm dark matter, {:g} keV"),
        ("clusters-", "", with_excess, "Cold dark matter + clusters × {:g}"),
    ):
        try:
            number = float(name.removeprefix(start).removesuffix(end)) if name.startswith(start) else math.nan
        except ValueError:
            continue
        if math.isfinite(number):
            return Preset(name, title.format(number), make(number))
    raise ConfigError(f"preset: {name[:40]!r} is not one of {', '.join(PRESETS)}.")


def title_of(population: Population) -> str:
    """The title of the preset that a population is; empty when it is none."""
    return next((preset.title for preset in PRESETS.values() if preset.population == population), "")
