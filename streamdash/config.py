"""What is to be computed: frozen, validated, hashable models.

The content hash (`Config.key`) of a model names its cache entry, so two requests for
the same configuration are the same entry, whoever asks.

People's units are used here (kpc, Gyr, km/s, M☉); the engine converts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import Field, model_serializer, model_validator

from streamdash.population import Perturbers, Population, mass_label, parse_mass_range
from streamdash.prior import Prior
from streamdash.stream_model import (
    EquatorialProgenitor,
    GalacticProgenitor,
    LogarithmicHalo,
    MWPotential2014,
    StreamModel,
)
from streamdash.streams import angles_of
from streamdash.validation import Config, ConfigError, Finite

__all__ = [
    "Accuracy",
    "Config",
    "ConfigError",
    "EnsembleConfig",
    "Finite",
    "EquatorialProgenitor",
    "GalacticProgenitor",
    "LogarithmicHalo",
    "MWPotential2014",
    "Perturbers",
    "Population",
    "Prior",
    "SpectraConfig",
    "StreamModel",
    "mass_label",
    "parse_mass_range",
]

ENGINE_VERSION = 1
"""Version of the results: raised only when the same configuration gives other numbers than before.

Results of different engines are never mixed in one entry of the cache, nor is one begun by another
engine continued. The package's version, which changes for many other reasons, does not matter there.
"""


class Accuracy(Config):
    """Numerical settings of the engine; smaller is finer, slower and more exact."""

    frequency_step: Finite = Field(
        0.25, ge=0.005, le=0.5, description="coarsest spacing of frequencies, in units of their dispersion"
    )
    frequency_tolerance: Finite = Field(
        0.02, ge=1e-6, le=1, description="frequencies are refined where interpolation may err by more"
    )
    kick_spacing: Finite = Field(1.5e-4, ge=1e-5, le=0.01, description="finest spacing of kicks, rad")
    kick_tolerance: Finite = Field(
        3e-5, ge=1e-7, le=0.1, description="largest error of one kick, in units of the dispersion"
    )


class EnsembleConfig(Config):
    """Many streams: a stream model, the population that hits it, and how they are computed.

    ``perturbers=`` is short for a population of one component, and is how that is written and hashed.

    Angles that are not given are those of the named stream that `stream` is an arm of.

    Examples
    --------
    >>> small = EnsembleConfig(perturbers=Perturbers(mass_range="1e3-1e5"), n_streams=10)
    >>> small.key == EnsembleConfig.parse(small.model_dump_json()).key
    True
    >>> EnsembleConfig(n_streams=0)
    Traceback (most recent call last):
    streamdash.validation.ConfigError: n_streams: input should be greater than or equal to 1 (got 0).
    """

    stream: StreamModel = StreamModel()
    population: Population = Population()
    prior: Prior | None = Field(
        None, description="ranges that every stream's own population is drawn from; replaces population"
    )
    n_streams: int = Field(1000, ge=1, le=1_000_000)
    seed: int = Field(0, ge=0, le=2**63 - 1)
    theta_min: Finite = Field(0.03, gt=0, le=3, description="first parallel angle, rad")
    theta_max: Finite = Field(0.987, gt=0, le=3, description="last parallel angle, rad")
    n_theta: int = Field(400, ge=2, le=10_000, description="number of evenly spaced angles")
    accuracy: Accuracy = Accuracy()

    def __init__(self, **values: Any) -> None:  # says to type checkers that `perturbers` is allowed
        super().__init__(**values)

    @model_validator(mode="before")
    @classmethod
    def _read_perturbers(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "perturbers" not in data:
            return data
        if "population" in data:
            raise ConfigError("perturbers: leave it out where population is given.")
        given = {name: value for name, value in data.items() if name != "perturbers"}
        return given | {"population": _population_of_one(data["perturbers"])}

    @model_validator(mode="before")
    @classmethod
    def _read_prior(cls, data: Any) -> Any:
        prior = data.get("prior") if isinstance(data, dict) else None
        if prior is None:
            return data
        if "population" in data or "perturbers" in data:
            raise ConfigError("prior: leave population and perturbers out where a prior is given.")
        if isinstance(prior, dict):
            try:
                prior = Prior.parse(prior)
            except ConfigError as error:
                raise ConfigError(f"prior.{error}") from None
        if not isinstance(prior, Prior):
            return data  # the field's own check says so
        return {**data, "prior": prior.simulated, "population": prior.typical}

    @model_serializer(mode="wrap")
    def _write_perturbers(self, handler: Any) -> dict[str, Any]:
        data = handler(self)
        if self.prior is not None:
            data.pop("population", None)  # it follows from the prior
            return data
        data.pop("prior", None)  # keys of entries that are older than the field hold
        if "population" in data and len(self.population.components) == 1:
            data["perturbers"] = data.pop("population").get("components", [{}])[0]
        return data

    @model_validator(mode="before")
    @classmethod
    def _fill_angles(cls, data: Any) -> Any:
        stream = data.get("stream") if isinstance(data, dict) else None
        if isinstance(stream, dict):
            try:
                stream = StreamModel.parse(stream)
            except ConfigError:
                return data  # its field says so
        return {**angles_of(stream), **data} if isinstance(stream, StreamModel) else data

    @model_validator(mode="after")
    def _check_angles(self) -> Self:
        if not self.theta_min < self.theta_max:
            raise ValueError("theta_min must be smaller than theta_max")
        return self

    @property
    def perturbers(self) -> Perturbers:
        """The component of a population of one.

        Raises
        ------
        ConfigError
            When there are several.
        """
        if len(self.population.components) > 1:
            raise ConfigError(f"perturbers: this population has several components, {self.population.label}.")
        return self.population.components[0]

    @property
    def label(self) -> str:
        """The masses as text, for file names; of a prior, that it is one."""
        return self.population.label if self.prior is None else self.prior.label

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """As pydantic's; ``perturbers`` in `update` is short for a population of one component."""
        update = dict(update or {})
        if "perturbers" in update:
            update["population"] = _population_of_one(update.pop("perturbers"))
        return super().model_copy(update=update, deep=deep)


class SpectraConfig(Config):
    """Spectra over the streams of an ensemble, of which they can be kept without it."""

    ensemble: EnsembleConfig = EnsembleConfig()
    first: int | None = Field(None, ge=2, description="how many of its streams count, from the first; all")

    @model_validator(mode="after")
    def _check_first(self) -> Self:
        if self.first is not None and self.first >= self.ensemble.n_streams:
            raise ValueError("first must be smaller than n_streams, or not be given")
        return self

    @property
    def n_streams(self) -> int:
        """How many streams count."""
        return self.first or self.ensemble.n_streams


def _population_of_one(value: Any) -> Population:
    if not isinstance(value, (Perturbers, dict)):
        raise ConfigError(f"perturbers: must be Perturbers or a mapping of their fields (got {value!r:.60}).")
    try:
        return Population(components=(value if isinstance(value, Perturbers) else Perturbers.parse(value),))
    except ConfigError as error:
        raise ConfigError(f"perturbers.{error}") from None
