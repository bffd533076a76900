"""The convergence laboratory: which knobs are turned, to what, and what the paper says of each.

The paper's five tests (appendix A, after BES17) for 10³–10⁵ M☉ perturbers; BES17's own test of the
largest impact parameter for 10⁵–10⁹ M☉, which the paper quotes; and what the paper lacks: the
engine's accuracy and the number of streams. A setting is the configuration of an ensemble, so each
can be computed anew by anybody (`streamdash.convergence.spectra`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from streamdash.config import Accuracy, EnsembleConfig, Perturbers, SpectraConfig, StreamModel
from streamdash.engine.galpy_streams import progenitor_radius

N_STREAMS = 1000
"""Streams per setting; the paper: at least 1000."""
N_TIMES = 32
"""Impact times of all settings but those of the time sampling (paper, appendix A)."""
LOW, HIGH = "1e3-1e5", "1e5-1e9"
NEAR_GYR = (1.0, 3.0)
TIMES = (1, 2, 4, 8, 16, 32, 64)
XS = (1.0, 3.0, 5.0, 7.0, 10.0)
LENGTHS = (0.75, 1.0, 1.25)
RS_FACTORS = (0.4, 1.0, 2.5)
GALPY_SPACING = 1 / 210
"""Spacing of kicks (rad) of galpy's streamgapdf on this stream."""


@dataclass(frozen=True)
class Setting:
    """One position of a knob.

    Attributes
    ----------
    label : what people read.
    config : what has to be simulated for it.
    reference : index of the setting of the same knob that it is compared with.
    beyond : where all impacts come at one time, another setting on the other side in time: the
        comparison is then with what lies between the two at this setting's time.
    """

    label: str
    config: SpectraConfig
    reference: int
    beyond: int | None = None


@dataclass(frozen=True)
class ConvergenceTest:
    """One test of convergence.

    Attributes
    ----------
    key, title : name in links; heading.
    question : what is tested, one sentence.
    paper : what the paper says, one sentence; empty where it has no such test.
    settings : positions of the knob.
    ordered : whether later settings are better, so that one may ask from which on it converges.
    claim : index of the first setting that the paper calls converged.
    scales : decades of scale of which the paper says so
        (`streamdash.convergence.verdicts.DECADES`).
    """

    key: str
    title: str
    question: str
    paper: str
    settings: tuple[Setting, ...]
    ordered: bool = False
    claim: int = 0
    scales: tuple[str, ...] = ("small", "large")

    def place_in_time(self, setting: int) -> float:
        """Where between those that it is compared with the impacts of a setting come: 0 to 1."""
        chosen = self.settings[setting]
        assert chosen.beyond is not None
        mine, first, second = (
            self.settings[i].config.ensemble.stream.impact_times_gyr[0]
            for i in (setting, chosen.reference, chosen.beyond)
        )
        return (mine - first) / (second - first)

    @property
    def mass_range(self) -> tuple[float, float]:
        """Mass range of the perturbers (M☉)."""
        return self.settings[0].config.ensemble.perturbers.mass_range


def knob(key: str, n_streams: int = N_STREAMS, seed: int = 0) -> ConvergenceTest:
    """One of `KNOBS`, for ensembles of that many streams and that seed.

    Raises
    ------
    KeyError
        When there is no such knob.
    """
    return KNOBS[key](n_streams, seed)


def _config(
    n_streams: int, seed: int, mass: str = LOW, n_times: int = N_TIMES, **parts: Any
) -> EnsembleConfig:
    stream = StreamModel(n_times=n_times)
    perturbers = Perturbers(mass_range=mass)
    return EnsembleConfig(
        **{"stream": stream, "perturbers": perturbers, **parts}, n_streams=n_streams, seed=seed
    )


def _setting(label: str, config: EnsembleConfig, reference: int) -> Setting:
    return Setting(label, SpectraConfig(ensemble=config), reference)


def _full_sampling(n_streams: int, seed: int) -> EnsembleConfig:
    """The main analysis: 64 times, and by default the shipped ensemble of twice as many streams."""
    return _config(2 * n_streams, seed, n_times=64)


def _phase(n_streams: int, seed: int) -> ConvergenceTest:
    settings: list[Setting] = []
    for near in NEAR_GYR:
        first = len(settings)
        phases = orbital_phases(StreamModel(), near)
        for place, (phase, time) in enumerate(phases.items()):
            config = SpectraConfig(ensemble=_config(n_streams, seed, stream=StreamModel(times_gyr=(time,))))
            ends = place in (0, len(phases) - 1)
            reference = first + place if ends else first
            beyond = None if ends else first + len(phases) - 1
            settings.append(Setting(f"{time:g} Gyr, {phase}", config, reference, beyond))
    return ConvergenceTest(
        "phase",
        "Orbital phase of the impacts",
        "All impacts at one time, near 1 or near 3 Gyr ago: with the stream at its pericentre, at its "
        "apocentre or between. Compared with what the pericentres before and after would give at the same "
        "time, as gaps grow with time.",
        "The dependence on the orbital phase is not relevant; impacts 3 Gyr ago leave more power.",
        tuple(settings),
    )


def _times(n_streams: int, seed: int) -> ConvergenceTest:
    last = len(TIMES) - 1
    settings = [
        _setting(f"{n} time{'s' if n > 1 else ''}", _config(n_streams, seed, n_times=n), last)
        for n in TIMES[:-1]
    ]
    settings.append(_setting(f"{TIMES[-1]} times", _full_sampling(n_streams, seed), last))
    return ConvergenceTest(
        "times",
        "Number of impact times",
        "The same impacts gathered at 1 to 64 moments of the 9 Gyr.",
        "Well converged with 16 impact times.",
        tuple(settings),
        ordered=True,
        claim=TIMES.index(16),
    )


def _impact_parameter(mass: str, key: str, title: str, paper: str) -> Callable[[int, int], ConvergenceTest]:
    def make(n_streams: int, seed: int) -> ConvergenceTest:
        settings = tuple(
            _setting(
                f"X = {x:g}",
                _config(n_streams, seed, mass, perturbers=Perturbers(mass_range=mass, X=x)),
                len(XS) - 1,
            )
            for x in XS
        )
        question = (
            "How far away subhalos may pass and still count: impact parameters up to X times r_s, but never "
            "less than half the width of the stream (galpy's floor), below which X changes nothing: the "
            "smallest masses are hardly fewer at X = 1."
        )
        return ConvergenceTest(
            key, title, question, paper, settings, ordered=True, claim=XS.index(3.0), scales=("small",)
        )

    return make


def _length(n_streams: int, seed: int) -> ConvergenceTest:
    settings = tuple(
        _setting(
            f"{factor:g} × length",
            _config(n_streams, seed, perturbers=Perturbers(mass_range=LOW, length_factor=factor)),
            LENGTHS.index(1.0),
        )
        for factor in LENGTHS
    )
    return ConvergenceTest(
        "length",
        "How far along the stream impacts reach",
        "Impacts up to 0.75, 1 or 1.25 times the stream's length, as many per length in each.",
        "Good convergence.",
        settings,
    )


def _profile(n_streams: int, seed: int) -> ConvergenceTest:
    fiducial = Perturbers(mass_range=LOW)
    plummer = fiducial.model_copy(update={"profile": "plummer", "X": round(fiducial.X * 1.05 / 1.62, 4)})
    choices = {
        f"Hernquist, {f:g} × r_s": Perturbers(mass_range=LOW, rs_factor=f, X=fiducial.X / f)
        for f in RS_FACTORS
    }
    reference = RS_FACTORS.index(1.0)
    settings = tuple(
        _setting(label, _config(n_streams, seed, perturbers=perturbers), reference)
        for label, perturbers in {**choices, "Plummer": plummer}.items()
    )
    return ConvergenceTest(
        "profile",
        "Size and profile of the perturbers",
        "Scale radii 2.5 times smaller or larger, and Plummer spheres, all with the same largest impact "
        "parameter in kpc.",
        "Compact perturbers give more power on the smallest scales; differences are negligible.",
        settings,
    )


def _frequencies(n_streams: int, seed: int) -> ConvergenceTest:
    return _accuracy(
        "frequencies",
        "Engine: frequencies per angle",
        "How finely the engine samples the frequencies of stars at each angle; the same impacts in all.",
        HIGH,
        n_streams,
        seed,
        coarse={"frequency_step": 0.5, "frequency_tolerance": 0.5},
        finer={"frequency_step": 4, "frequency_tolerance": 20},
    )


def _kicks(n_streams: int, seed: int) -> ConvergenceTest:
    return _accuracy(
        "kicks",
        "Engine: spacing of kick points",
        "How finely the engine tabulates kicks along the stream, from galpy's 210 points per radian on; "
        "the same impacts in all.",
        LOW,
        n_streams,
        seed,
        coarse={"kick_spacing": GALPY_SPACING, "kick_tolerance": 0.1},
        finer={"kick_spacing": 4, "kick_tolerance": 10},
    )


def _accuracy(
    key: str,
    title: str,
    question: str,
    mass: str,
    n_streams: int,
    seed: int,
    coarse: dict[str, float],
    finer: dict[str, float],
) -> ConvergenceTest:
    default = Accuracy()
    fine = default.model_copy(update={name: getattr(default, name) / by for name, by in finer.items()})
    name = next(iter(coarse))
    settings = tuple(
        _setting(
            f"{word} ({name} {getattr(accuracy, name):.2g})",
            _config(n_streams, seed, mass, accuracy=accuracy),
            2,
        )
        for word, accuracy in (
            ("coarse", default.model_copy(update=coarse)),
            ("default", default),
            ("fine", fine),
        )
    )
    return ConvergenceTest(key, title, question, "", settings, ordered=True, claim=1)


def _streams(n_streams: int, seed: int) -> ConvergenceTest:
    ensemble = _full_sampling(n_streams, seed)
    counts = [max(2, ensemble.n_streams // part) for part in (16, 8, 4, 2)]
    settings = [
        Setting(f"{count} streams", SpectraConfig(ensemble=ensemble, first=count), len(counts))
        for count in counts
    ]
    settings.append(_setting(f"{ensemble.n_streams} streams", ensemble, len(counts)))
    return ConvergenceTest(
        "streams",
        "Number of simulated streams",
        "Medians and bands from the first streams of the main analysis' ensemble, and from all.",
        "",
        tuple(settings),
        ordered=True,
        claim=3,
    )


KNOBS: dict[str, Callable[[int, int], ConvergenceTest]] = {
    "phase": _phase,
    "times": _times,
    "x": _impact_parameter(
        LOW, "x", "Largest impact parameter", "Small scales converge for X of about 3 and more."
    ),
    "length": _length,
    "profile": _profile,
    "x-high": _impact_parameter(
        HIGH,
        "x-high",
        "Largest impact parameter, 10⁵–10⁹ M☉",
        "Not fully converged at the largest scales, about 30° and more.",
    ),
    "frequencies": _frequencies,
    "kicks": _kicks,
    "streams": _streams,
}
"""The knobs by key, the paper's five first."""


@lru_cache(maxsize=8)
def orbital_phases(stream: StreamModel, near_gyr: float) -> dict[str, float]:
    """Times before today (Gyr, to 10 Myr) of the progenitor's pericentre and apocentre nearest to a time.

    Returns
    -------
    dict
        ``pericentre``, ``between`` (half-way in time), ``apocentre`` and ``next pericentre``, which is on
        the other side of the apocentre.
    """
    times = np.arange(0.0, near_gyr + 2.0, 1e-3)
    radius = progenitor_radius(stream, times)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(radius)))) + 1
    rising = radius[turns + 1] > radius[turns]

    def nearest(candidates: np.ndarray) -> float:
        return float(candidates[np.abs(candidates - near_gyr).argmin()])

    low, high = nearest(times[turns[rising]]), nearest(times[turns[~rising]])
    across = times[turns[rising]]
    across = across[(across - high) * (low - high) < 0]
    phases = {
        "pericentre": low,
        "between": 0.5 * (low + high),
        "apocentre": high,
        "next pericentre": float(across[np.abs(across - high).argmin()]),
    }
    return {name: round(time, 2) for name, time in phases.items()}
