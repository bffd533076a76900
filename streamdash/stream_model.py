"""The unperturbed stream, as it is asked for: potential, progenitor, age, arm, impact times.

People's units are used here (kpc, Gyr, km/s, deg); the engine converts.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from streamdash.validation import CHOICE, Config, Finite


class LogarithmicHalo(Config):
    """galpy's ``LogarithmicHaloPotential(normalize=1, q=q)``."""

    q: Finite = Field(0.9, ge=0.5, le=1.5, description="flattening of the potential")


class MWPotential2014(Config):
    """galpy's ``MWPotential2014``: bulge, disc and halo fitted to the Milky Way (Bovy 2015)."""

    name: Literal["MWPotential2014"] = "MWPotential2014"


class SkyProgenitor(Config):
    """A progenitor as it is seen on the sky, and from where: the Sun's place and motion.

    The potential is normalised to 220 km/s at 8 kpc whatever the Sun's place.
    """

    distance_kpc: Finite = Field(gt=0, le=100, description="distance from the Sun, kpc")
    v_los_kms: Finite = Field(ge=-1000, le=1000, description="line-of-sight velocity, heliocentric, km/s")
    r0_kpc: Finite = Field(8.0, ge=6, le=10, description="distance of the Sun from the centre, kpc")
    v0_kms: Finite = Field(220.0, ge=150, le=300, description="circular velocity at the Sun, km/s")
    z_sun_kpc: Finite = Field(0.0208, ge=-0.1, le=0.1, description="height of the Sun above the plane, kpc")
    solar_motion_kms: tuple[Finite, Finite, Finite] = Field(
        (-11.1, 24.0, 7.25),
        description="the Sun's motion beyond the circular one: outwards, with rotation, upwards, km/s",
    )

    @field_validator("solar_motion_kms")
    @classmethod
    def _check_motion(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if any(abs(v) > 100 for v in value):
            raise ValueError("no component of the Sun's own motion exceeds 100 km/s")
        return value


class EquatorialProgenitor(SkyProgenitor):
    """A progenitor in equatorial coordinates (ICRS)."""

    ra: Finite = Field(ge=-360, le=360, description="right ascension, deg")
    dec: Finite = Field(ge=-90, le=90, description="declination, deg")
    pm_ra: Finite = Field(ge=-100, le=100, description="proper motion μ_α cos δ, mas/yr")
    pm_dec: Finite = Field(ge=-100, le=100, description="proper motion μ_δ, mas/yr")

    @property
    def place(self) -> tuple[float, float]:
        """Right ascension and declination (deg)."""
        return self.ra, self.dec

    @property
    def proper_motion(self) -> tuple[float, float]:
        """Along right ascension and declination (mas/yr)."""
        return self.pm_ra, self.pm_dec


class GalacticProgenitor(SkyProgenitor):
    """A progenitor in Galactic coordinates."""

    ell: Finite = Field(ge=-360, le=360, description="Galactic longitude, deg")
    b: Finite = Field(ge=-90, le=90, description="Galactic latitude, deg")
    pm_ell: Finite = Field(ge=-100, le=100, description="proper motion μ_l cos b, mas/yr")
    pm_b: Finite = Field(ge=-100, le=100, description="proper motion μ_b, mas/yr")

    @property
    def place(self) -> tuple[float, float]:
        """Galactic longitude and latitude (deg)."""
        return self.ell, self.b

    @property
    def proper_motion(self) -> tuple[float, float]:
        """Along Galactic longitude and latitude (mas/yr)."""
        return self.pm_ell, self.pm_b


def _potential_tag(value: Any) -> str:
    named = "name" in value if isinstance(value, dict) else isinstance(value, MWPotential2014)
    return CHOICE + ("MWPotential2014" if named else "LogarithmicHalo")


def _progenitor_tag(value: Any) -> str:
    if isinstance(value, EquatorialProgenitor) or (isinstance(value, dict) and {"ra", "dec"} & set(value)):
        return f"{CHOICE}equatorial"
    if isinstance(value, (GalacticProgenitor, dict)):
        return f"{CHOICE}galactic"
    return f"{CHOICE}cylindrical"


SkyPlace = EquatorialProgenitor | GalacticProgenitor
Six = tuple[Finite, Finite, Finite, Finite, Finite, Finite]
Potential = Annotated[
    # A logarithmic halo has no name in its JSON: keys of entries that are older than the choice hold.
    Annotated[LogarithmicHalo, Tag(f"{CHOICE}LogarithmicHalo")]
    | Annotated[MWPotential2014, Tag(f"{CHOICE}MWPotential2014")],
    Discriminator(_potential_tag),
]
Progenitor = Annotated[
    Annotated[Six, Tag(f"{CHOICE}cylindrical")]
    | Annotated[EquatorialProgenitor, Tag(f"{CHOICE}equatorial")]
    | Annotated[GalacticProgenitor, Tag(f"{CHOICE}galactic")],
    Discriminator(_progenitor_tag),
]


class StreamModel(Config):
    """The unperturbed stream and the times at which subhalos may hit it.

    The default is the GD-1-like model of Bovy, Erkal & Sanders (2017), leading arm.
    """

    potential: Potential = LogarithmicHalo()
    progenitor: Progenitor = Field(
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
    def _check_progenitor(cls, value: Any) -> Any:
        if isinstance(value, SkyProgenitor):
            return value
        if not 0.1 <= value[0] <= 12.5:
            raise ValueError("radius R (first number) must lie between 0.1 and 12.5 (units of 8 kpc)")
        if any(abs(v) > 12.5 for v in value):
            raise ValueError("no number may exceed 12.5 (units of 8 kpc and 220 km/s)")
        return value

    @model_validator(mode="after")
    def _check_times(self) -> Self:
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
