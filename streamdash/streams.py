"""The named streams: each one or two arms, every arm a `StreamModel`, and how people look at them.

Nothing else knows a particular stream: its frame on the sky, the stretch that is simulated, the bins
and the noise it is usually shown with, and what is to be kept in mind about it stand here.

Sources: Bovy, Erkal & Sanders (2017) for the GD-1-like stream and Palomar 5; Webb & Bovy (2019),
Banik et al. (2021) and Hermans et al. (2020) for GD-1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

from streamdash.stream_model import (
    EquatorialProgenitor,
    GalacticProgenitor,
    MWPotential2014,
    StreamModel,
)
from streamdash.validation import ConfigError

Arm = Literal["leading", "trailing"]
Row = tuple[float, float, float]

STREAM_NAMES = ("gd1-like", "gd1", "pal5")
"""Names that `named_stream` knows."""


@dataclass(frozen=True)
class SkyFrame:
    """Longitude and latitude in which a stream lies along the equator.

    Attributes
    ----------
    name : str
        For people, with its source.
    rotation : three rows of three numbers
        Takes equatorial (ICRS) unit vectors to the frame's.
    longitude, latitude : str
        Names of the coordinates in tables, options and links.
    longitude_symbol, latitude_symbol : str
        The same as symbols on axes.
    """

    name: str
    rotation: tuple[Row, Row, Row]
    longitude: str
    latitude: str
    longitude_symbol: str
    latitude_symbol: str


@dataclass(frozen=True)
class Window:
    """The stretch of an arm that is simulated: first and last parallel angle (rad), and how many."""

    theta_min: float
    theta_max: float
    n_theta: int

    @property
    def theta(self) -> tuple[float, float]:
        """First and last parallel angle (rad)."""
        return self.theta_min, self.theta_max


@dataclass(frozen=True)
class Bins:
    """How an arm is binned and how noisy it is, unless something else is asked for.

    Attributes
    ----------
    coordinate : str
        ``ell`` or the longitude of the stream's frame.
    width : float
        Width of a bin (deg).
    low, high : float or None
        The stretch that is analysed (deg); None for the whole window.
    noise : float
        Standard deviation σ_ε of Qρ in a bin.
    order : int or None
        Order of the polynomial that measured profiles of this arm are divided by; None for none.
    """

    coordinate: str
    width: float
    low: float | None
    high: float | None
    noise: float
    order: int | None


@dataclass(frozen=True)
class Stream:
    """A stream by name: its arms, and how it is looked at.

    Attributes
    ----------
    name, title : str
        The name in options, links and scripts; the name for people.
    arms : mapping of ``"leading"`` and ``"trailing"`` to StreamModel
        The arms it has; the first is the one shown unless asked otherwise.
    frame : SkyFrame
    windows, bins : mapping of arm to Window and to Bins
    caveats : tuple of str
        What the model leaves out, a sentence each.
    ages_gyr : tuple of float
        Ages that the literature considers; that of `arms` is the one it favours.
    """

    name: str
    title: str
    arms: Mapping[str, StreamModel]
    frame: SkyFrame
    windows: Mapping[str, Window]
    bins: Mapping[str, Bins]
    caveats: tuple[str, ...]
    ages_gyr: tuple[float, ...]

    @property
    def default_arm(self) -> str:
        """The arm shown unless asked otherwise."""
        return next(iter(self.arms))

    def arm(self, name: str | None = None) -> StreamModel:
        """The model of one arm, the default one when not given.

        Raises
        ------
        ConfigError
            When the stream has no such arm.
        """
        name = name or self.default_arm
        if name not in self.arms:
            there = " and a ".join(self.arms)
            raise ConfigError(f"arm: {self.name} has a {there} arm, and none that is {name[:40]!r}.")
        return self.arms[name]

    def at_age(self, age_gyr: float) -> Stream:
        """The same stream at another age; its velocity dispersion goes as 1/age, so it is as long.

        Raises
        ------
        ConfigError
            When the age is not one that a stream may have.
        """
        return replace(self, arms={name: _aged(model, age_gyr) for name, model in self.arms.items()})


def named_stream(name: str) -> Stream:
    """The stream of that name: ``gd1-like``, ``gd1`` or ``pal5``.

    Raises
    ------
    ConfigError
        When there is none.
    """
    found = _named().get(str(name))
    if found is None:
        raise ConfigError(f"stream: {str(name)[:40]!r} is none of {', '.join(STREAM_NAMES)}.")
    return found


def stream_of(model: StreamModel) -> Stream:
    """The named stream that `model` is an arm of, whatever its age, arm and impact times.

    A progenitor that no named stream has: seen on the sky, it is the origin of a frame of its own; else
    the model is taken as a variant of the default stream, whose frame and window it keeps.
    """
    for stream in _named().values():
        if any(model.progenitor == arm.progenitor for arm in stream.arms.values()):
            return stream
    if isinstance(model.progenitor, EquatorialProgenitor):
        return _own(model, *model.progenitor.place)
    if isinstance(model.progenitor, GalacticProgenitor):
        return _own(model, *_equatorial(*model.progenitor.place))
    return named_stream(STREAM_NAMES[0])


def window_of(model: StreamModel) -> Window:
    """The stretch of `model` that is simulated; an arm that its stream lacks has that of the other."""
    windows = stream_of(model).windows
    return windows.get(model.arm) or next(iter(windows.values()))


def bins_of(model: StreamModel) -> Bins:
    """How `model` is binned unless asked otherwise; an arm that its stream lacks like the other."""
    bins = stream_of(model).bins
    return bins.get(model.arm) or next(iter(bins.values()))


def angles_of(model: StreamModel) -> dict[str, Any]:
    """The fields of an `EnsembleConfig` that give the angles of `window_of`."""
    window = window_of(model)
    return {"theta_min": window.theta_min, "theta_max": window.theta_max, "n_theta": window.n_theta}


def bin_text(model: StreamModel) -> str:
    """A bin of `bins_of` for people: ``0.2° bin``, ``0.1° bin of ξ``."""
    bins = bins_of(model)
    return f"{bins.width:g}° bin" + (
        "" if bins.coordinate == "ell" else f" of {longitude_symbol(bins.coordinate)}"
    )


def stream_text(model: StreamModel) -> str:
    """Name of a model for people: its stream, its arm if there are two, and whatever else differs."""
    stream = stream_of(model)
    reference = stream.arms.get(model.arm) or stream.arm()
    words = [stream.title + (f", {model.arm} arm" if len(stream.arms) > 1 else "")]
    for name, value in model:
        if value != getattr(reference, name):
            words.append(f"{name} {value if isinstance(value, (int, float, str)) else 'changed'}")
    return " · ".join(words)


def both_arms_text(model: StreamModel) -> str:
    """Name for people of both arms of a stream, of which `model` is one."""
    named = f", {model.arm} arm"
    text = stream_text(model)
    return text.replace(named, ", both arms") if named in text else f"{text}, both arms"


def longitude_symbol(coordinate: str) -> str:
    """Symbol of the longitude of a stream's frame by its name, such as φ₁ for ``phi1``."""
    frames = [stream.frame for stream in _named().values()]
    return next((frame.longitude_symbol for frame in frames if frame.longitude == coordinate), coordinate)


def _aged(model: StreamModel, age_gyr: float) -> StreamModel:
    values = model.model_dump() | {"age_gyr": age_gyr}
    if model.sigma_v_kms is not None:
        values["sigma_v_kms"] = model.sigma_v_kms * model.age_gyr / age_gyr if age_gyr > 0 else None
    return StreamModel.parse(values)


def _centred(ra: float, dec: float) -> tuple[Row, Row, Row]:
    """Rotation that takes a place on the sky (deg) to the origin and leaves north up."""
    a, d = math.radians(ra), math.radians(dec)
    return (
        (math.cos(d) * math.cos(a), math.cos(d) * math.sin(a), math.sin(d)),
        (-math.sin(a), math.cos(a), 0.0),
        (-math.sin(d) * math.cos(a), -math.sin(d) * math.sin(a), math.cos(d)),
    )


def _centred_frame(name: str, ra: float, dec: float) -> SkyFrame:
    return SkyFrame(name, _centred(ra, dec), "xi", "eta", "ξ", "η")


def _equatorial(ell: float, b: float) -> tuple[float, float]:
    """Right ascension and declination (deg) of Galactic coordinates."""
    from galpy.util import coords

    ra, dec = coords.lb_to_radec(ell, b, degree=True)
    return float(ra), float(dec)


def _own(model: StreamModel, ra: float, dec: float) -> Stream:
    default = named_stream(STREAM_NAMES[0])
    return Stream(
        name="own",
        title="Stream of one's own",
        arms={model.arm: model},
        frame=_centred_frame("centred on the progenitor", ra, dec),
        windows={model.arm: default.windows[default.default_arm]},
        bins={model.arm: Bins("xi", 0.2, None, None, noise=0.1, order=None)},
        caveats=(),
        ages_gyr=(model.age_gyr,),
    )


@cache
def _named() -> Mapping[str, Stream]:
    return {stream.name: stream for stream in (_gd1_like(), _gd1(), _pal5())}


GD1_FRAME = SkyFrame(
    "GD-1 (Koposov, Rix & Hogg 2010, appendix)",
    (
        (-0.4776303088, -0.1738432154, 0.8611897727),
        (0.510844589, -0.8524449229, 0.111245042),
        (0.7147776536, 0.4930681392, 0.4959603976),
    ),
    "phi1",
    "phi2",
    "φ₁",
    "φ₂",
)


def _gd1_like() -> Stream:
    """The stream of the paper: Bovy, Erkal & Sanders (2017), leading arm."""
    return Stream(
        name="gd1-like",
        title="GD-1-like",
        arms={"leading": StreamModel()},
        frame=GD1_FRAME,
        windows={"leading": Window(0.03, 0.987, 400)},
        bins={"leading": Bins("ell", 0.2, None, None, noise=0.1, order=None)},
        caveats=(
            "The model is a GD-1-like stream, not GD-1: a smooth logarithmic halo, a progenitor at one "
            "end, one age.",
        ),
        ages_gyr=(9.0,),
    )


def _gd1() -> Stream:
    """GD-1 as fitted by Webb & Bovy (2019), progenitor at φ1 = −40°, binned as by Banik et al. (2021)."""
    age = 3.4
    leading = StreamModel(
        potential=MWPotential2014(),
        progenitor=GalacticProgenitor(
            ell=188.04928416766532,
            b=51.848594007807456,
            distance_kpc=7.559027173643999,
            pm_ell=12.260258757214746,
            pm_b=-5.140630283489461,
            v_los_kms=7.162732847549563,
        ),
        isochrone_b=0.45,
        age_gyr=age,
        sigma_v_kms=0.3 * 3.2 / age,
    )
    return Stream(
        name="gd1",
        title="GD-1",
        arms={"leading": leading, "trailing": leading.model_copy(update={"arm": "trailing"})},
        frame=GD1_FRAME,
        windows={"leading": Window(0.03, 0.79, 400), "trailing": Window(0.03, 0.78, 400)},
        bins={
            "leading": Bins("phi1", 2.0, -60.0, -46.0, noise=0.11, order=3),
            "trailing": Bins("phi1", 2.0, -34.0, -4.0, noise=0.11, order=3),
        },
        caveats=(
            "Where GD-1's progenitor was is not known: the model puts it at φ1 = −40°.",
            "GD-1's age is not known: 3.4 Gyr is the literature's favourite, and an older stream was hit "
            "more often.",
            "Bar, spiral arms and molecular clouds, which the model leaves out, matter little: GD-1 is "
            "retrograde and comes no closer to the centre than 13.5 kpc.",
            "Nobody knows GD-1's smooth density: measured profiles are divided by a cubic, one an arm, and "
            "so are the simulated ones that are put beside them.",
        ),
        ages_gyr=(3.0, 3.4, 4.0, 5.0, 6.0, 7.0),
    )


def _pal5() -> Stream:
    """Palomar 5 as in Bovy, Erkal & Sanders (2017), §5."""
    trailing = StreamModel(
        potential=MWPotential2014(),
        progenitor=EquatorialProgenitor(
            ra=229.018, dec=-0.124, distance_kpc=23.2, pm_ra=-2.296, pm_dec=-2.257, v_los_kms=-58.7
        ),
        isochrone_b=0.8,
        age_gyr=5.0,
        sigma_v_kms=0.5,
        arm="trailing",
    )
    # The paper's noise of 0.1 in a bin of 0.2°, in bins of half that width.
    noise = round(0.1 * math.sqrt(2), 2)
    return Stream(
        name="pal5",
        title="Palomar 5",
        arms={"trailing": trailing, "leading": trailing.model_copy(update={"arm": "leading"})},
        frame=_centred_frame("centred on Palomar 5, north up", 229.018, -0.124),
        windows={"trailing": Window(0.03, 2.94, 600), "leading": Window(0.03, 2.94, 600)},
        bins={
            "trailing": Bins("xi", 0.1, 0.25, 14.35, noise=noise, order=3),
            "leading": Bins("xi", 0.1, None, None, noise=noise, order=3),
        },
        caveats=(
            "The Galaxy's bar and spiral arms, giant molecular clouds and globular clusters make gaps in "
            "Palomar 5 (pericentre 7.3 kpc) as subhalos do, and are not in the model: what it says of "
            "subhalos is an upper limit.",
            "The age decides the answer: between 10 and 3 Gyr the abundance that fits best goes from 0.2 to "
            "4 times that of cold dark matter.",
            "Surveys see the trailing arm farther than the leading one.",
            "Measured profiles hold background stars and an unknown smooth density: they are divided by a "
            "cubic, and so are the simulated ones that are put beside them.",
        ),
        ages_gyr=(3.0, 5.0, 10.0),
    )
