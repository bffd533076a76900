"""What hits a stream: one or several populations of perturbers, frozen, validated and hashable."""

from __future__ import annotations

import math
import re
from itertools import combinations
from typing import Any, Literal

from pydantic import Field, field_validator, model_serializer

from streamdash.validation import Config, Finite

MASS_MIN, MASS_MAX = 1.0, 1e12
"""Lowest and highest subhalo mass accepted, in M☉."""
DECADES_MAX = 8.0
"""Widest mass range accepted, in decades."""
COMPONENTS_MAX = 8
"""Most components of a population."""
LISTED = 3
"""A population of more components is named by the masses that they span."""


class Perturbers(Config):
    """Subhalos of one kind that hit the stream (paper §2; Bovy, Erkal & Sanders 2017 §2.3)."""

    mass_range: tuple[Finite, Finite] = Field((1e5, 1e9), description="lowest and highest mass, M☉")
    X: Finite = Field(5.0, ge=0.1, le=50, description="largest impact parameter in units of r_s")
    rate_factor: Finite = Field(1.0, ge=0, le=100, description="number of subhalos relative to CDM")
    slope: Finite = Field(-2.0, ge=-4, le=0, description="mass function dn/dM ∝ M^slope")
    cutoff_mass: Finite | None = Field(
        None, ge=1, le=1e12, description="mass function times exp(-cutoff_mass / M), M☉"
    )
    half_mode_mass: Finite | None = Field(
        None,
        ge=1,
        le=1e12,
        description="warm dark matter: mass function times (1 + 2.7 half_mode_mass / M)^-0.99, M☉",
    )
    profile: Literal["hernquist", "plummer"] = "hernquist"
    rs_factor: Finite = Field(1.0, ge=0.01, le=100, description="scale radius relative to the relation")
    sigma_h: Finite = Field(120.0, ge=1, le=1000, description="velocity dispersion of subhalos, km/s")
    length_factor: Finite = Field(
        1.0, ge=0.1, le=1.4, description="impacts reach out to this times the stream's length"
    )
    width_floor: bool = Field(
        True,
        description="count impacts as galpy and the paper do, as if none passed within less than half the "
        "stream's width; without it small subhalos are as many as X says",
    )

    @field_validator("mass_range", mode="before")
    @classmethod
    def _read_range(cls, value: Any) -> Any:
        return parse_mass_range(value) if isinstance(value, str) else value

    @field_validator("mass_range")
    @classmethod
    def _check_range(cls, value: Any) -> Any:
        low, high = value
        if not (MASS_MIN <= low <= MASS_MAX and MASS_MIN <= high <= MASS_MAX):
            raise ValueError(f"masses must lie between {MASS_MIN:g} and {MASS_MAX:g} M☉")
        if not low < high:
            raise ValueError(f"the lower mass must come first and be smaller, as in {mass_label((1e5, 1e9))}")
        if math.log10(high / low) > DECADES_MAX + 1e-9:
            raise ValueError(f"the range may span at most {DECADES_MAX:g} decades")
        return value

    @model_serializer(mode="wrap")
    def _without_newer_fields(self, handler: Any) -> dict[str, Any]:
        """Keys of entries that are older than a field hold: it is written only where it is given."""
        data = handler(self)
        for name, default in (("half_mode_mass", None), ("width_floor", True)):
            if getattr(self, name) == default:
                data.pop(name, None)
        return data

    @property
    def label(self) -> str:
        """The mass range as text, for example ``1e3-1e5``."""
        return mass_label(self.mass_range)


class Population(Config):
    """Everything that hits a stream: the impacts of all components together.

    The components' order says nothing: they are kept by their masses. Where two share masses, their
    numbers add up (`overlaps`).
    """

    components: tuple[Perturbers, ...] = Field(
        (Perturbers(),), description="kinds of perturbers that hit the stream together"
    )

    @field_validator("components", mode="before")
    @classmethod
    def _count_components(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)) and not value:
            raise ValueError("a population needs at least one component; set rate_factor to 0 for no impacts")
        if isinstance(value, (list, tuple)) and len(value) > COMPONENTS_MAX:
            raise ValueError(f"a population has at most {COMPONENTS_MAX} components, this one {len(value)}")
        return value

    @field_validator("components")
    @classmethod
    def _sort_components(cls, value: Any) -> Any:
        return tuple(sorted(value, key=lambda component: (component.mass_range, component.key)))

    @property
    def key(self) -> str:
        """Content hash; of a population of one component, that component's."""
        return self.components[0].key if len(self.components) == 1 else super().key

    @property
    def mass_range(self) -> tuple[float, float]:
        """Lowest and highest mass of all components, M☉."""
        return (
            min(component.mass_range[0] for component in self.components),
            max(component.mass_range[1] for component in self.components),
        )

    @property
    def label(self) -> str:
        """The components' mass ranges as text, for example ``1e3-1e5+1e5-1e9``; of many, how many."""
        if len(self.components) > LISTED:
            return f"{mass_label(self.mass_range)}-{len(self.components)}components"
        return "+".join(component.label for component in self.components)

    def overlaps(self) -> list[str]:
        """Sentences that name components which share masses: allowed, but their numbers add up."""
        return [
            f"{a.label} and {b.label} overlap in mass: there, their numbers add up."
            for a, b in combinations(self.components, 2)
            if max(a.mass_range[0], b.mass_range[0]) < min(a.mass_range[1], b.mass_range[1])
        ]


def mass_label(mass_range: tuple[float, float]) -> str:
    """Write a mass range as text: ``(1e3, 1e5)`` becomes ``1e3-1e5``.

    Examples
    --------
    >>> mass_label((1e3, 1e5))
    '1e3-1e5'
    """

    def one(mass: float) -> str:
        mantissa, exponent = f"{mass:.12e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"

    return f"{one(mass_range[0])}-{one(mass_range[1])}"


_MASS = r"(\d+(?:\.\d*)?(?:[eE]\+?\d+)?)"


def parse_mass_range(text: str) -> tuple[float, float]:
    """Read a mass range such as ``1e3-1e5`` (M☉).

    Raises
    ------
    ValueError
        When the text is not two positive numbers joined by a hyphen.

    Examples
    --------
    >>> parse_mass_range("1e3-1e5")
    (1000.0, 100000.0)
    """
    match = re.fullmatch(rf"\s*{_MASS}\s*[-–]\s*{_MASS}\s*", text)
    if match is None:
        raise ValueError(f"mass range {text[:40]!r} is not of the form 1e3-1e5 (two masses in M☉)")
    return float(match[1]), float(match[2])
