"""What a simulation can be started from: populations by name, and a few streams."""

from __future__ import annotations

from app.pages.simulate.knobs import BY_NAME, KNOBS, SUBHALOS, text_of
from streamdash.config import EnsembleConfig, Population
from streamdash.populations import PRESETS as POPULATIONS


def _population_texts(population: Population) -> dict[str, str]:
    config = EnsembleConfig(population=population)
    texts = {knob.name: text_of(config, knob) for knob in KNOBS if knob.group == SUBHALOS}
    return {name: text for name, text in texts.items() if name == "sim_mass" or text != BY_NAME[name].default}


PRESETS: dict[str, dict[str, str]] = {
    **{one.title: _population_texts(one.population) for one in POPULATIONS.values()},
    "Three times as many": {"sim_mass": "1e5-1e9", "sim_rate": "3"},
    # The same impact parameters in kpc although Plummer's scale radius is larger.
    "Plummer spheres": {"sim_mass": "1e5-1e9", "sim_profile": "plummer", "sim_X": f"{5 * 1.05 / 1.62:.4g}"},
    "Age 4.5 Gyr": {"sim_mass": "1e5-1e9", "sim_age": "4.5"},
    "Trailing arm": {"sim_mass": "1e5-1e9", "sim_arm": "trailing"},
}
"""Values that differ from the defaults, by name; they say nothing about how many streams."""
