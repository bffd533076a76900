"""Lines of Python that give what the Infer page shows, as it is shown now."""

from __future__ import annotations

from dataclasses import dataclass

from app.pages.infer.answers import Answer, Oracle, cell_ends
from streamdash.config import StreamModel
from streamdash.inference.cells import AGE
from streamdash.streams import stream_of

IMPORTS = """\
from pathlib import Path

import numpy as np

from streamdash.config import StreamModel
from streamdash.inference.files import load_estimator
from streamdash.inference.held_out import NOISE_SEED, load_streams, seen
from streamdash.inference.prior_ensemble import clean_streams, default_design
from streamdash.inference.words import sentences
from streamdash.observe.guess import Assumptions
from streamdash.observe.infer import learnt
from streamdash.observe.observation import cut, interpret
from streamdash.observe.table import read_table
from streamdash.plots.corner import layout
from streamdash.plots.live import export
from streamdash.prior import PRIORS
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey.mock import EXAMPLE

cache = Cache.default()
"""


@dataclass(frozen=True, eq=False)
class Asked:
    """What the listing must say again: the choices behind an answer."""

    found: Answer
    mocks: Oracle | None
    told: bool
    model: StreamModel
    prior: str
    source: str
    part: slice
    assumptions: str
    example: bool

    def stem(self, told: bool) -> str:
        """Arguments that name what is shipped."""
        return f'"{stream_of(self.model).name}", "{self.prior}", told={told}'


def head(asked: Asked) -> str:
    """Imports, the profile ``q``, the ``estimator`` and ``streams`` that it has not learnt from."""
    lines = [IMPORTS, f"model = StreamModel.parse('{asked.model.model_dump_json()}')"]
    if asked.source == "upload":
        file = "EXAMPLE" if asked.example else 'Path("profile.csv")  # your table'
        lines += [
            f"file = {file}",
            f"assumptions = Assumptions.parse({asked.assumptions!r})",
            "table = read_table(file.read_bytes())",
            "observation = interpret(table, assumptions, load_geometry(model, cache))",
        ]
        if asked.part != slice(None):
            lines.append(f"observation = cut(observation, slice({asked.part.start}, {asked.part.stop}))")
        lines.append("design, q = observation.design, observation.q")
    elif asked.mocks is not None:
        stem = asked.stem(asked.mocks.told)
        lines.append(f"whole, mocks = load_estimator({stem}).design, load_streams({stem})")
    else:
        lines.append("whole = default_design(load_geometry(model, cache))")
    if asked.found.oracle.shipped:
        stem = asked.stem(asked.found.oracle.told)
        lines.append(f"estimator, streams = load_estimator({stem}), load_streams({stem})")
    else:
        if asked.source != "upload":
            lines.append(f"design = whole.part(slice({asked.part.start}, {asked.part.stop}))")
        lines.append(f'estimator, streams = learnt(PRIORS["{asked.prior}"], model, design, cache)')
        if asked.mocks is None:
            lines.append("mocks = streams")
    return "\n".join([*lines, *asked.found.data.code]) + "\n"


def _factor(found: Answer) -> str:
    """The argument that tells an estimator how large the errors are, where it is told."""
    return f", {found.noise_factor:g}" if found.oracle.estimator.noise_told else ""


def _fixed(found: Answer) -> bool:
    """Whether an age that could be inferred is taken as known."""
    return found.age is not None and AGE in found.joint.grid


def answer_code(asked: Asked) -> str:
    """The answer in words, and its corner plot."""
    found = asked.found
    factor = _factor(found)
    age = f'.at("age_gyr", {found.age:g})' if _fixed(found) else ""
    return head(asked) + (
        f"posterior = estimator.posteriors(q[None]{factor})[0]{age}\n"
        'print(*sentences(posterior, estimator.prior), sep="\\n")\n'
        f"print(posterior.information, estimator.strangeness(q[None]{factor})[0])\n"
        'figure = layout(posterior, estimator.prior, "matplotlib")\n'
        'Path("posterior.png").write_bytes(export(figure, "png"))\n'
    )


def bands_code(asked: Asked) -> str:
    """The predictive bands over the data."""
    found = asked.found
    factor = _factor(found)
    given = ""
    if found.age is not None and _fixed(found):
        low, high = cell_ends(found.joint, found.age)
        given = f'.given("age_gyr", {low:.6g}, {high:.6g})'
    return head(asked) + (
        "from streamdash.inference.predictive import stream_weights, weighted_bands\n"
        "from streamdash.plots.infer import predictive\n\n"
        f"posterior = estimator.posteriors(q[None]{factor})[0]{given}\n"
        f"profiles = streams.observed(estimator{factor})\n"
        "bands = weighted_bands(profiles, stream_weights(posterior, streams.truth))\n"
        f"sigma = {found.noise_factor:g} * estimator.design.sigma\n"
        'figure = predictive(estimator.design, q, sigma, bands, "matplotlib")\n'
        'Path("predictive.png").write_bytes(export(figure, "png"))\n'
    )


def moves_code(asked: Asked) -> str:
    """The answer at each age that can be fixed."""
    found = asked.found
    if asked.told and found.oracle.shipped:
        lines = [
            f"told = load_estimator({asked.stem(True)})",
            f"posterior = told.posteriors(q[None], {found.noise_factor:g})[0]",
            "for age in sorted(told.prior.ages_gyr):",
            '    given = posterior.at("age_gyr", age)',
            '    print(age, given.median("log10_rate"), given.interval("log10_rate", 0.68))',
        ]
    else:
        lines = [f"posterior = estimator.posteriors(q[None]{_factor(found)})[0]"]
        lines += ['print(posterior.median("log10_rate"), posterior.interval("log10_rate", 0.68))']
    return head(asked) + "\n".join(lines) + "\n"


def calibration_code(asked: Asked) -> str:
    """Ranks and coverage on the held-out streams."""
    found = asked.found
    factor = _factor(found)
    lines = [
        "from streamdash.inference.diagnostics import scores",
        "from streamdash.inference.posterior import Posterior",
        "",
        f"p = estimator.posterior(streams.observed(estimator{factor}){factor})",
        "grid, truth = estimator.grid, streams.truth",
    ]
    if _fixed(found):
        lines += [
            f"there = (truth.age_gyr == {found.age:g}).to_numpy()",
            f'known = [Posterior(grid, one).at("age_gyr", {found.age:g}) for one in p[there]]',
            "p, grid, truth = np.array([one.p for one in known]), known[0].grid, truth[there]",
        ]
    return head(asked) + "\n".join([*lines, "print(scores(p, grid, truth))"]) + "\n"


JOIN_CODE = """\
from streamdash.inference.files import load_estimator

estimator = load_estimator("gd1-like")
truth, q = estimator.simulate(2, seed=1)  # profiles of two streams
one, other = estimator.posteriors(q)
print(one.joined(other).interval("log10_rate", 0.68))
"""
"""Answers that were put aside are in no link: two streams of one's own stand for them."""
