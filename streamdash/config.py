"""What is to be computed: frozen, validated, hashable models.

The content hash (`Config.key`) of a model names its cache entry, so two requests for
the same configuration are the same entry, whoever asks.

People's units are used here (kpc, Gyr, km/s, M☉); the engine converts.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

ENGINE_VERSION = 1
"""Version of the results: raised only when the same configuration gives other numbers than before.

Results of different engines are never mixed in one entry of the cache, nor is one begun by another
engine continued. The package's version, which changes for many other reasons, does not matter there.
"""
MASS_MIN, MASS_MAX = 1.0, 1e12
"""Lowest and highest subhalo mass accepted, in M☉."""
DECADES_MAX = 8.0
"""Widest mass range accepted, in decades."""

Finite = Annotated[float, Field(allow_inf_nan=False)]


class ConfigError(ValueError):
    """A configuration that cannot be used; the message names the field and the fix."""


class Config(BaseModel):
    """Base of all configurations: frozen, no unknown fields, hashed by content."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise ConfigError(_sentence(error)) from None

    @property
    def key(self) -> str:
        """Content hash: 16 hexadecimal digits that depend on every field's value."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @classmethod
    def parse(cls, data: Any):
        """Read a configuration from JSON text or a mapping.

        Raises
        ------
        ConfigError
            In one sentence: which field is wrong and what is allowed.
        """
        try:
            if isinstance(data, (str, bytes)):
                return cls.model_validate_json(data)
            return cls.model_validate(data)
        except ValidationError as error:
            raise ConfigError(_sentence(error)) from None


class LogarithmicHalo(Config):
    """galpy's ``LogarithmicHaloPotential(normalize=1, q=q)``."""

    q: Finite = Field(0.9, ge=0.5, le=1.5, description="flattening of the potential")


class StreamModel(Config):
    """The unperturbed stream and the times at which subhalos may hit it.

    The default is the GD-1-like model of Bovy, Erkal & Sanders (2017), leading arm.
    """

    potential: LogarithmicHalo = LogarithmicHalo()
    progenitor: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = Field(
        (1.56148083, 0.35081535, -1.15481504, 0.88719443, -0.47713334, 0.12019596),
        description="progenitor today: R, vR, vT, z, vz, phi in units of 8 kpc and 220 km/s",
    )
    isochrone_b: Finite = Field(0.8, gt=0.05, le=10, description="scale of actionAngleIsochroneApprox")
    age_gyr: Finite = Field(9.0, ge=0.5, le=13.8, description="time since disruption began, Gyr")
    sigma_v_kms: Finite | None = Field(
        None,
        gt=0.01,
        le=5.0,
        description="velocity dispersion, km/s; 0.1825 · 9 Gyr / age when not given",
    )
    arm: Literal["leading", "trailing"] = "leading"
    n_times: int = Field(64, ge=1, le=512, description="number of impact times, evenly spaced")
    times_gyr: tuple[Finite, ...] | None = Field(
        None, max_length=512, description="impact times before today, Gyr; replaces n_times"
    )

    @field_validator("progenitor")
    @classmethod
    def _check_progenitor(cls, value):
        if not 0.1 <= value[0] <= 12.5:
            raise ValueError("radius R (first number) must lie between 0.1 and 12.5 (units of 8 kpc)")
        if any(abs(v) > 12.5 for v in value):
            raise ValueError("no number may exceed 12.5 (units of 8 kpc and 220 km/s)")
        return value

    @model_validator(mode="after")
    def _check_times(self):
        times = self.times_gyr
        if times is None:
            return self
        if not times:
            raise ValueError("times_gyr must name at least one impact time")
        if any(not 0 < t < self.age_gyr for t in times):
            raise ValueError(f"times_gyr must lie between 0 and the age of the stream, {self.age_gyr:g} Gyr")
        if any(b <= a for a, b in zip(times, times[1:], strict=False)):
            raise ValueError("times_gyr must increase, without repeats")
        return self

    @property
    def impact_times_gyr(self) -> tuple[float, ...]:
        """Impact times before today in Gyr, increasing: t_k = k/(n+1) · age."""
        if self.times_gyr is not None:
            return self.times_gyr
        n = self.n_times
        return tuple(k / (n + 1) * self.age_gyr for k in range(1, n + 1))

    @property
    def dispersion_kms(self) -> float:
        """Velocity dispersion in km/s: as given, or 0.365/2 · (9 Gyr / age)."""
        return self.sigma_v_kms if self.sigma_v_kms is not None else 0.365 / 2 * 9.0 / self.age_gyr


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

    Examples
    --------
    >>> small = EnsembleConfig(perturbers=Perturbers(mass_range="1e3-1e5"), n_streams=10)
    >>> small.key == EnsembleConfig.parse(small.model_dump_json()).key
    True
    >>> EnsembleConfig(n_streams=0)
    Traceback (most recent call last):
    streamdash.config.ConfigError: n_streams: input should be greater than or equal to 1 (got 0).
    """

    stream: StreamModel = StreamModel()
    perturbers: Perturbers = Perturbers()
    n_streams: int = Field(1000, ge=1, le=1_000_000)
    seed: int = Field(0, ge=0, le=2**63 - 1)
    theta_min: Finite = Field(0.03, gt=0, le=3, description="first parallel angle, rad")
    theta_max: Finite = Field(0.987, gt=0, le=3, description="last parallel angle, rad")
    n_theta: int = Field(400, ge=2, le=10_000, description="number of evenly spaced angles")
    accuracy: Accuracy = Accuracy()

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


def _sentence(error: ValidationError) -> str:
    """One sentence a person can act on, from pydantic's first complaint."""
    first = error.errors(include_url=False)[0]
    # an unknown field's name is whatever was typed: keep it to one line
    field = ".".join(str(part) if str(part).isprintable() else repr(part) for part in first["loc"])
    inner = first.get("ctx", {}).get("error")
    if isinstance(inner, ConfigError):  # a model inside this one has said it already
        return f"{field}.{inner}" if field else str(inner)
    field = field or "configuration"
    message = first["msg"].removeprefix("Value error, ")
    value = repr(first.get("input"))
    shown = f" (got {value if len(value) <= 60 else value[:57] + '...'})" if first["loc"] else ""
    return f"{field}: {message[0].lower() + message[1:]}{shown}."
