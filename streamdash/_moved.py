"""Where modules lived, and what things were called: code that names the old places and names still runs.

Scripts that people copied from the pages import, for example, ``streamdash.ensemble``. The finder below
answers for such a name with the module that took its place, and a `DeprecationWarning` that names it.
Functions that went away answer through `renamed`.
"""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType, SimpleNamespace
from typing import Any

MOVED = {
    "config_environment": "settings",
    "geometry_galpy": "engine.galpy_streams",
    "geometry": "simulation.geometry",
    "impacts": "engine.impacts",
    "kicks_impulse": "engine.impulse",
    "kicks": "engine.kicks",
    "density_march": "engine.march",
    "density": "engine.density",
    "flyby": "engine.flyby",
    "store_bundle": "store.bundle",
    "store_codec": "store.codec",
    "store_entry": "store.entry",
    "store_keep": "store.keeping",
    "store_parts": "store.parts",
    "store_read": "store.reading",
    "store_title": "store.titles",
    "store_writer": "store.writer",
    "ensemble": "simulation.ensemble",
    "ensemble_preview": "simulation.preview",
    "workers": "simulation.workers",
    "jobs": "simulation.jobs",
    "jobs_limits": "simulation.limits",
    "jobs_status": "simulation.status",
    "survey_bands": "survey.bands",
    "survey_flyby": "survey.flyby",
    "survey_mock": "survey.mock",
    "survey_observed": "survey.design",
    "survey_story": "survey.story",
    "pdf": "statistics.pdf",
    "evidence": "statistics.evidence",
    "evidence_overlap": "statistics.overlap",
    "evidence_joint": "statistics.joint",
    "evidence_checks": "statistics.evidence_growth",
    "evidence_table": "statistics.cumulative",
    "spectrum": "statistics.spectrum",
    "spectrum_bispectrum": "statistics.bispectrum",
    "spectrum_shown": "statistics.spectra_in_noise",
    "features": "statistics.features",
    "scores": "statistics.scores",
    "spectrum_lab": "convergence.knobs",
    "spectrum_ensembles": "convergence.spectra",
    "spectrum_theta": "convergence.theta_spectra",
    "spectrum_text": "convergence.text",
    "spectrum_verdicts": "convergence.verdicts",
    "classifier_data": "classifier.data",
    "classifier_model": "classifier.model",
    "classifier_quiz": "classifier.quiz",
    "classifier_studies": "classifier.studies",
    "classifier_store": "classifier.store",
    "classifier_results": "paper.classifier",
    "observation": "observe.observation",
    "observation_checks": "observe.checks",
    "observation_guess": "observe.guess",
    "observation_table": "observe.table",
    "verdict": "observe.verdict",
    "verdict_evidence": "observe.evidence",
    "verdict_noise": "observe.replicas",
    "verdict_resemblance": "observe.resemblance",
    "report": "observe.report",
    "report_html": "plots.report_html",
    "reproduce": "paper.evidence",
    "reproduce_choices": "paper.choices",
    "reproduce_differences": "paper.differences",
    "reproduce_statistics": "paper.statistics",
    "reproduce_text": "paper.tables",
}
"""New place of each old module, both below ``streamdash``."""


class _Moved(MetaPathFinder, Loader):
    """Finds modules under their old names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, name = fullname.partition(".")
        return ModuleSpec(fullname, self) if package == "streamdash" and name in MOVED else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        new = f"streamdash.{MOVED[spec.name.partition('.')[2]]}"
        warnings.warn(f"{spec.name} is now {new}", DeprecationWarning, stacklevel=2)
        module = ModuleType(spec.name, f"`{new}` under its old name.")
        found = importlib.import_module(new)
        module.__dict__.update({k: v for k, v in vars(found).items() if not k.startswith("__")})
        if new in RENAMED:
            module.__dict__["__getattr__"] = renamed(new)
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Nothing: the module is filled where it is made."""


def read_streams(cache: Any, ensembles: Any) -> Any:
    """`ObservedStreams.read` under its old name."""
    # By name: the walls between the packages are not for what only forwards.
    return importlib.import_module("streamdash.survey.observed").ObservedStreams.read(cache, ensembles)


def collect(cache: Any, ensemble: Any) -> Any:
    """One ensemble as ``plots.pdf.collect`` gave it: ``config``, ``q``, ``draws`` and ``noisy(noise)``."""
    streams = read_streams(cache, [ensemble])

    def noisy(noise: float, number: int = 0) -> Any:
        return streams.noisy(noise, number)[0]

    return SimpleNamespace(config=streams.configs[0], q=streams.q[0], draws=streams.draws[0], noisy=noisy)


RENAMED: dict[str, dict[str, Callable[..., Any]]] = {
    "streamdash.classifier.data": {"read_streams": read_streams},
    "streamdash.plots.pdf": {"collect": collect},
}
"""By module, what listings used to name; all of it is `ObservedStreams.read` now."""


def renamed(module: str) -> Callable[[str], Any]:
    """``__getattr__`` of a module of `RENAMED` (PEP 562)."""

    def find(name: str) -> Any:
        if name not in RENAMED[module]:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        new = "streamdash.survey.observed.ObservedStreams.read"
        warnings.warn(f"{module}.{name} is now {new}", DeprecationWarning, stacklevel=2)
        return RENAMED[module][name]

    return find


def install() -> None:
    """Answer for the old names, after all that is really there."""
    if not any(isinstance(finder, _Moved) for finder in sys.meta_path):
        sys.meta_path.append(_Moved())
