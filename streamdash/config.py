"""What is to be computed: frozen, validated, hashable models.

The content hash (`Config.key`) of a model names its cache entry, so two requests for
the same configuration are the same entry, whoever asks.

People's units are used here (kpc, Gyr, km/s, M☉); the engine converts.
"""

from __future__ import annotations

import math
import re
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

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
    "EquatorialProgenitor",
    "GalacticProgenitor",
    "LogarithmicHalo",
    "MWPotential2014",
    "Perturbers",
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
MASS_MIN, MASS_MAX = 1.0, 1e12
"""Lowest and highest subhalo mass accepted, in M☉."""
DECADES_MAX = 8.0
"""Widest mass range accepted, in decades."""


class Perturbers(Config):
    """The subhalos that hit the stream (paper §2; Bovy, Erkal & Sanders 2017 §2.3)."""

    mass_range: tuple[Finite, Finite] = Field((1e5, 1e9), description="lowest and highest mass, M☉")
    X: Finite = Field(5.0, ge=0.1, le=50, description="largest impact parameter in units of r_s")
    rate_factor: Finite = Field(1.0, ge=0, le=100, description="number of subhalos relative to CDM")
    slope: Finite = Field(-2.0, ge=-4, le=0, description="mass function dn/dM ∝ M^slope")
    cutoff_mass: Finite | None = Field(
        None, ge=1, le=1e12, description="mass function times exp(-cutoff_mass / M), M☉"
    )
    profile: Literal["hernquist", "plummer"] = "hernquist"
    rs_factor: Finite = Field(1.0, ge=0.01, le=100, description="scale radius relative to the relation")
    sigma_h: Finite = Field(120.0, ge=1, le=1000, description="velocity dispersion of subhalos, km/s")
    length_factor: Finite = Field(
        1.0, ge=0.1, le=1.4, description="impacts reach out to this times the stream's length"
    )

    @field_validator("mass_range", mode="before")
    @classmethod
    def _read_range(cls, value):
        return parse_mass_range(value) if isinstance(value, str) else value

    @field_validator("mass_range")
    @classmethod
    def _check_range(cls, value):
        low, high = value
        if not (MASS_MIN <= low <= MASS_MAX and MASS_MIN <= high <= MASS_MAX):
            raise ValueError(f"masses must lie between {MASS_MIN:g} and {MASS_MAX:g} M☉")
        if not low < high:
            raise ValueError(f"the lower mass must come first and be smaller, as in {mass_label((1e5, 1e9))}")
        if math.log10(high / low) > DECADES_MAX + 1e-9:
            raise ValueError(f"the range may span at most {DECADES_MAX:g} decades")
        return value

    @property
    def label(self) -> str:
        """The mass range as text, for example ``1e3-1e5``."""
        return mass_label(self.mass_range)


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
    """Many streams: a stream model, its perturbers, and how they are computed.

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
    perturbers: Perturbers = Perturbers()
    n_streams: int = Field(1000, ge=1, le=1_000_000)
    seed: int = Field(0, ge=0, le=2**63 - 1)
    theta_min: Finite = Field(0.03, gt=0, le=3, description="first parallel angle, rad")
    theta_max: Finite = Field(0.987, gt=0, le=3, description="last parallel angle, rad")
    n_theta: int = Field(400, ge=2, le=10_000, description="number of evenly spaced angles")
    accuracy: Accuracy = Accuracy()

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
    def _check_angles(self):
        if not self.theta_min < self.theta_max:
            raise ValueError("theta_min must be smaller than theta_max")
        return self


class SpectraConfig(Config):
    """Spectra over the streams of an ensemble, of which they can be kept without it."""

    ensemble: EnsembleConfig = EnsembleConfig()
    first: int | None = Field(None, ge=2, description="how many of its streams count, from the first; all")

    @model_validator(mode="after")
    def _check_first(self):
        if self.first is not None and self.first >= self.ensemble.n_streams:
            raise ValueError("first must be smaller than n_streams, or not be given")
        return self

    @property
    def n_streams(self) -> int:
        """How many streams count."""
        return self.first or self.ensemble.n_streams


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
    number = r"(\d+(?:\.\d*)?(?:[eE]\+?\d+)?)"
    match = re.fullmatch(rf"\s*{number}\s*[-–]\s*{number}\s*", text)
    if match is None:
        raise ValueError(f"mass range {text[:40]!r} is not of the form 1e3-1e5 (two masses in M☉)")
    return float(match[1]), float(match[2])
