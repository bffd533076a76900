"""What the gaps in a cold stellar stream say about the masses of the dark objects that made them.

The names below are what a script or notebook needs; each is imported when it is first used.
"""

from streamdash import _moved
from streamdash._public import offer

_moved.install()

__version__ = "0.1.0"
"""The one place that says it; the package's metadata and the manifests of the cache take it from here."""

PUBLIC = {
    "Cache": "streamdash.store.cache",
    "ConfigError": "streamdash.config",
    "EnsembleConfig": "streamdash.config",
    "Perturbers": "streamdash.config",
    "Population": "streamdash.config",
    "StreamModel": "streamdash.config",
    "named_stream": "streamdash.streams",
    "infer": "streamdash.observe.infer",
    "load_geometry": "streamdash.simulation.geometry",
    "simulate": "streamdash.simulation.ensemble",
}
"""Module of each public name."""

__all__ = list(PUBLIC)

__getattr__, __dir__ = offer(__name__, PUBLIC)
