"""Where an answer comes from: which file, which versions, which simulations, and whom to cite."""

from __future__ import annotations

import datetime
import hashlib
import platform
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

import streamdash
from streamdash.config import EnsembleConfig
from streamdash.observe.table import shown

PACKAGES = ("numpy", "scipy", "scikit-learn", "xgboost", "xgboost-cpu", "galpy", "astropy")
"""Libraries that an answer's numbers come from; of those that are installed, the version is kept."""
CITE = (
    "Montanari, F. & García-Bellido, J. 2022, Mass classification of dark matter perturbers of stellar tidal "
    "streams, Physics of the Dark Universe 35, 100978, doi:10.1016/j.dark.2022.100978",
    f"streamdash {streamdash.__version__} (CITATION.cff)",
)
"""What to cite with an answer: the method, and this software."""


@dataclass(frozen=True)
class Source:
    """A file that was read: what it was called, and a fingerprint of its bytes.

    Attributes
    ----------
    name : str
        As its owner calls it, without folders; cut and printable.
    sha256 : str
    n_bytes : int
    read : str
        Date and time (UTC) in ISO 8601.
    """

    name: str
    sha256: str
    n_bytes: int
    read: str

    @classmethod
    def of(cls, data: bytes, name: str = "") -> Source:
        """The source of these bytes, read now."""
        now = datetime.datetime.now(datetime.UTC)
        last = shown(name.replace("\\", "/").rpartition("/")[2]) or "table without a name"
        return cls(last, hashlib.sha256(data).hexdigest(), len(data), now.isoformat(timespec="seconds"))


def provenance(configs: tuple[EnsembleConfig, ...], n_impacts: tuple[Any, ...]) -> dict[str, Any]:
    """Versions, what was simulated and what to cite, for `streamdash.observe.report.report`.

    Parameters
    ----------
    configs : of the compared ensembles.
    n_impacts : tuple of ndarray (n_streams,)
        Subhalos that hit each stream; of none where that is not known.
    """
    classes = []
    for i, config in enumerate(configs):
        entry: dict[str, Any] = {
            "ensemble": config.key,
            "mass_range": config.label,
            "prior_probability": 1 / len(configs),
            "n_streams": config.n_streams,
            "perturbers": [c.model_dump(mode="json") for c in config.population.components],
        }
        if i < len(n_impacts):
            entry["mean_impacts"] = float(n_impacts[i].mean())
        classes.append(entry)
    return {
        "streamdash": streamdash.__version__,
        "python": platform.python_version(),
        "packages": _versions(),
        "stream": configs[0].stream.model_dump(mode="json"),
        "classes": classes,
        "cite": list(CITE),
    }


def signed(result: dict[str, Any], source: Source) -> dict[str, Any]:
    """A report with the file that it is about, and the date."""
    of_file = asdict(source)
    date = of_file.pop("read")
    return {**result, "provenance": {"file": of_file, "date": date, **result["provenance"]}}


def provenance_words(result: dict[str, Any]) -> list[str]:
    """Where an answer comes from, one sentence each."""
    known = result["provenance"]
    sentences = []
    if "file" in known:
        file = known["file"]
        sentences.append(
            f"File “{file['name']}”, {file['n_bytes']:,} bytes, SHA-256 {file['sha256']}, read "
            f"{known['date']}."
        )
    versions = ", ".join(f"{name} {version}" for name, version in known["packages"].items())
    sentences.append(f"streamdash {known['streamdash']} with Python {known['python']}, {versions}.")
    for entry in known["classes"]:
        rates = " + ".join(_rate(component) for component in entry["perturbers"])
        hits = f", {entry['mean_impacts']:.1f} hits per stream on average" if "mean_impacts" in entry else ""
        sentences.append(
            f"{entry['mass_range']}: prior probability {entry['prior_probability']:.2g}; {rates}{hits}; "
            f"{entry['n_streams']:,} streams (ensemble {entry['ensemble']})."
        )
    return [*sentences, *(f"Please cite: {work}." for work in known["cite"])]


def _rate(component: dict[str, Any]) -> str:
    masses = "–".join(f"{mass:.3g}" for mass in component["mass_range"])
    return f"{component['rate_factor']:g} × the rate of cold dark matter for {masses} M☉"


def _versions() -> dict[str, str]:
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions
