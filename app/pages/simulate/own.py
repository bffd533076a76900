"""What the knobs of a simulation take from elsewhere: a named stream's own values, and masses in keV."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from streamdash.config import ConfigError
from streamdash.populations import half_mode_mass
from streamdash.stream_model import SkyProgenitor, StreamModel
from streamdash.streams import STREAM_NAMES, Stream, named_stream

Q_LABEL, HM_LABEL, PROGENITOR_LABEL = "Flattening of the halo", "Half-mode mass", "Progenitor today"
"""Labels of the knobs that are refused here."""
OWN = ("sim_age", "sim_sigma_v", "sim_q", "sim_b", "sim_progenitor")
"""Knobs whose empty text is the named stream's own value."""


def on_named(stream: Stream, given: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of the stream model: those of a named stream where nothing else is given."""
    given = {name: value for name, value in given.items() if value is not None}
    arm = given.get("arm", "leading")
    base = stream.arms.get(arm, stream.arm()).model_dump(mode="json", exclude_none=True) | {"arm": arm}
    q = given.pop("potential", {}).get("q")
    if q is not None and "name" in base["potential"]:
        raise ConfigError(
            f"{Q_LABEL}: {stream.title} lies in {base['potential']['name']}, which has no q; "
            "leave this empty."
        )
    if q is not None:
        base["potential"] = {"q": q}
    if "age_gyr" in given and "sigma_v_kms" in base and "sigma_v_kms" not in given:
        try:  # a wrong age is refused as such
            base["sigma_v_kms"] = stream.at_age(float(given["age_gyr"])).arms[arm].sigma_v_kms
        except (ValueError, KeyError):
            base.pop("sigma_v_kms")
    return base | given


def base_of(model: StreamModel) -> Stream:
    """The named stream that the knobs of a model start from: its own, or one in the same potential."""
    named = [named_stream(name) for name in STREAM_NAMES]
    alike = [s for s in named if type(s.arm().potential) is type(model.potential)]
    return next((s for s in alike if s.arm().progenitor == model.progenitor), alike[0])


def of_named(model: StreamModel, path: str) -> bool:
    """Whether a model's value of a field is that of its named stream, whose dispersion follows the age."""
    stream = base_of(model)
    if path == "stream.sigma_v_kms":
        stream = stream.at_age(model.age_gyr)
    own = stream.arms.get(model.arm, stream.arm())
    ours: Any = model
    theirs: Any = own
    for part in path.split(".")[1:]:
        ours, theirs = getattr(ours, part, None), getattr(theirs, part, None)
    return ours == theirs


def mass_of_kev(text: str) -> float:
    """Half-mode mass of warm dark matter of a mass in keV."""
    try:
        return float(f"{half_mode_mass(float(text)):.4g}")
    except ConfigError as error:
        raise ConfigError(f"{HM_LABEL}: {str(error).partition(': ')[2]}") from None
    except ValueError:
        raise ConfigError(f"{HM_LABEL}: {text[:20].strip()!r} is no mass in keV.") from None


def progenitor_of(text: str) -> dict[str, str] | list[str]:
    """A progenitor as it was typed: six numbers, or as it is seen on the sky, ``ra=229, dec=-0.1, …``."""
    if "=" in text:
        pairs = [part.partition("=") for part in text.split(",")]
        return {name.strip(): value.strip() for name, _, value in pairs}
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 6:
        raise ConfigError(f"{PROGENITOR_LABEL}: must be six numbers joined by commas (got {len(parts)}).")
    return parts


def listed_text(value: SkyProgenitor | tuple[float, ...]) -> str:
    """Several numbers as text, those of a progenitor on the sky with their names."""
    if isinstance(value, SkyProgenitor):
        seen = value.model_dump(exclude_defaults=True)
        return ", ".join(f"{name}={number_text(number)}" for name, number in seen.items())
    return ", ".join(number_text(number) for number in value)


def number_text(value: Any) -> str:
    """A number as short as it can be without being another."""
    if not isinstance(value, (int, float)):
        return str(value)
    short = f"{value:g}"
    return short if float(short) == value else repr(value)
