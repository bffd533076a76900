"""What is believed of a population before a stream is looked at: a range for each of its parameters.

Where an ensemble has a prior instead of a population, every stream has parameters of its own, drawn
uniformly from the ranges (of the logarithm, where the name says so) with the stream's own generator.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from streamdash.population import Perturbers, Population, mass_label, parse_mass_range
from streamdash.validation import Config, Finite

if TYPE_CHECKING:
    import numpy as np

Range = tuple[Finite, Finite]
PARAMETERS = ("log10_rate", "log10_half_mode_mass", "log10_excess", "log10_rs_factor", "slope")
"""Parameters that a prior can leave open, in the order in which they are drawn and inferred."""
BOUNDS: Mapping[str, tuple[float, float]] = {
    "log10_rate": (-3, 2),
    "log10_half_mode_mass": (3, 10),
    "log10_excess": (-3, 2),
    "log10_rs_factor": (-1, 1),
    "slope": (-3, -1),
}
"""Widest range of each."""


class Prior(Config):
    """Ranges of a population's parameters, and of what else is not known about a stream.

    A parameter without a range stays as in cold dark matter. Nuisances (age, background, errors) are
    drawn as well, but never inferred: what is inferred has them averaged over.

    Examples
    --------
    >>> Prior().names
    ('log10_rate',)
    >>> Prior(log10_rate=(1, -1))
    Traceback (most recent call last):
    streamdash.validation.ConfigError: log10_rate: the lower end must come first (got (1, -1)).
    """

    mass_range: tuple[Finite, Finite] = Field((1e6, 1e9), description="masses of the subhalos, M☉")
    cluster_range: tuple[Finite, Finite] = Field((1e3, 1e5), description="masses of the excess, M☉")
    log10_rate: Range | None = Field((-1.0, 1.0), description="number of subhalos relative to CDM")
    log10_half_mode_mass: Range | None = Field(None, description="warm dark matter's half-mode mass, M☉")
    log10_excess: Range | None = Field(
        None, description="number of further objects in cluster_range, relative to CDM's there"
    )
    log10_rs_factor: Range | None = Field(None, description="scale radius relative to the relation")
    slope: Range | None = Field(None, description="mass function dn/dM ∝ M^slope")
    X: Finite = Field(5.0, ge=0.1, le=50, description="largest impact parameter in units of r_s")
    ages_gyr: tuple[Finite, ...] = Field(
        (), max_length=12, description="ages of the stream that are thought equally likely; its own if none"
    )
    background: Finite = Field(
        0.0, ge=0, le=1, description="typical amplitude of a smooth unknown wave in the density"
    )
    background_deg: Finite = Field(20.0, gt=0.5, le=360, description="scale over which the wave changes, deg")
    noise_factor: Range = Field((1.0, 1.0), description="errors relative to those that are stated")

    @field_validator("mass_range", "cluster_range", mode="before")
    @classmethod
    def _read_range(cls, value: Any) -> Any:
        return parse_mass_range(value) if isinstance(value, str) else value

    @field_validator(*PARAMETERS)
    @classmethod
    def _check_range(cls, value: Any, info: ValidationInfo) -> Any:
        if value is None:
            return value
        (low, high), (least, most) = value, BOUNDS[str(info.field_name)]
        if not low < high:
            raise ValueError("the lower end must come first")
        if not least <= low < high <= most:
            raise ValueError(f"must lie between {least:g} and {most:g}")
        return value

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.names:
            raise ValueError(f"leave at least one of {', '.join(PARAMETERS)} open")
        low, high = self.noise_factor
        if not 0.1 <= low <= high <= 10:
            raise ValueError("noise_factor must be two numbers between 0.1 and 10, the lower one first")
        if len(set(self.ages_gyr)) < len(self.ages_gyr):
            raise ValueError("ages_gyr must not name an age twice")
        self.population(self.middle)  # masses that a population cannot have are refused here
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters that are open, in the order of `PARAMETERS`."""
        return tuple(name for name in PARAMETERS if getattr(self, name) is not None)

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of every open parameter."""
        return {name: getattr(self, name) for name in self.names}

    @property
    def label(self) -> str:
        """Masses as text, for file names: ``prior-1e6-1e9``."""
        clusters = f"{mass_label(self.cluster_range)}+" if self.log10_excess else ""
        return f"prior-{clusters}{mass_label(self.mass_range)}"

    @property
    def simulated(self) -> Prior:
        """What of it the simulation depends on: the nuisances of the observation are left out."""
        nuisances = ("ages_gyr", "background", "background_deg", "noise_factor")
        return Prior(**{name: value for name, value in self if name not in nuisances})

    @property
    def middle(self) -> dict[str, float]:
        """Middle of every range."""
        return {name: 0.5 * (low + high) for name, (low, high) in self.ranges.items()}

    @property
    def typical(self) -> Population:
        """A population that costs about as much as the average one: the mean rates, else the middle."""
        means = {
            name: math.log10((10**high - 10**low) / (math.log(10) * (high - low)))
            for name, (low, high) in self.ranges.items()
            if name in ("log10_rate", "log10_excess")
        }
        return self.population(self.middle | means)

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Parameters of one stream, one uniform number each, in the order of `names`."""
        return {name: low + (high - low) * rng.random() for name, (low, high) in self.ranges.items()}

    def population(self, values: Mapping[str, float]) -> Population:
        """The population with the given parameters; those not given are cold dark matter's."""
        shape = {"X": self.X, "rs_factor": 10 ** values.get("log10_rs_factor", 0.0)}
        halos: dict[str, Any] = {
            **shape,
            "mass_range": self.mass_range,
            "rate_factor": 10 ** values.get("log10_rate", 0.0),
            "slope": values.get("slope", -2.0),
        }
        if "log10_half_mode_mass" in values:
            halos["half_mode_mass"] = 10 ** values["log10_half_mode_mass"]
        components = [Perturbers(**halos)]
        if "log10_excess" in values:
            excess = 10 ** values["log10_excess"]
            components.append(Perturbers(mass_range=self.cluster_range, rate_factor=excess, **shape))
        return Population(components=tuple(components))

    def to_json(self) -> str:
        """As text that `parse` reads."""
        return json.dumps(self.model_dump(mode="json"), indent=1)


RATE = Prior()
"""The literature's: only the abundance of 10⁶–10⁹ M☉ is open, log-uniform between 0.1 and 10 × CDM."""
POPULATION = Prior(
    mass_range=(1e5, 1e9),
    log10_rate=(-1.0, 1.0),
    log10_half_mode_mass=(5.0, 9.0),
    log10_excess=(-2.0, 1.0),
)
"""Abundance of 10⁵–10⁹ M☉, half-mode mass, and an excess of 10³–10⁵ M☉."""
PRIORS: Mapping[str, Prior] = {"rate": RATE, "population": POPULATION}
"""Priors by name."""
