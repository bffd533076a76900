"""How often is an answer sure, wrong, and without a warning? Streams whose observer is mistaken.

    python -m tests.benchmarks.honest_answers
    python -m tests.benchmarks.honest_answers --streams 60 --only wave

Every row takes fresh streams (simulated once and kept in the cache) and breaks one assumption: a smooth wave
over the survey, errors larger than stated, bins that are off or run the other way, another abundance. A
stream counts where its probability is above 95 %, at the simulated abundance and with it free, for a class
that it is not of, and the report neither warns nor leaves the question open. Of profiles that run the other
way every sure answer counts, whatever the class. Below, the share of honest streams with a warning.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from streamdash.config import EnsembleConfig, Perturbers, Population
from streamdash.naming import label_text
from streamdash.observe.guess import Assumptions
from streamdash.observe.observation import Observation
from streamdash.observe.report import DECIDED_FOR, report
from streamdash.observe.verdict import Prepared, judge, prepare
from streamdash.simulation.ensemble import simulate
from streamdash.simulation.geometry import load_geometry
from streamdash.store.cache import Cache
from streamdash.survey.design import Design, measured, observe_as
from tests.shipped import of_default_stream

SEED = 977
"""Of the fresh streams: none of any shipped ensemble."""
TWO, THREE = ("1e3-1e5", "1e5-1e9"), ("1e3-1e5", "1e5-1e7", "1e7-1e9")
SURE = 0.95
N_BIN, WIDTH, LOW = 36, 2.0, -100.0
OFF_DEG = 5.0


@dataclass(frozen=True)
class Row:
    """One way of being mistaken: whose streams, at what rate, and what is done to them."""

    words: str
    label: str = "1e3-1e5"
    rate: float = 1.0
    error: float = 0.12
    factor: float = 1.0
    alter: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None
    off_deg: float = 0.0
    turned: bool = False


def wave(amplitude: float, periods: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    """A sine along the profile, its phase different for every stream."""

    def alter(clean: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        phase = 2 * np.pi * rng.random((len(clean), 1))
        along = np.arange(clean.shape[1]) / clean.shape[1]
        return clean * (1 + amplitude * np.sin(2 * np.pi * periods * along + phase)).astype(np.float32)

    return alter


ROWS = (
    Row("smooth wave of 30 %, 1.5 periods", alter=wave(0.3, 1.5)),
    Row("smooth wave of 15 %, 1.5 periods", alter=wave(0.15, 1.5)),
    Row("sine of 20 %, 3 periods", alter=wave(0.2, 3)),
    Row("sine of 20 %, 6 periods", alter=wave(0.2, 6)),
    Row("errors truly 2 × the stated 20 %", error=0.2, factor=2.0),
    Row("errors truly 1.5 × the stated 20 %", error=0.2, factor=1.5),
    Row("errors truly 2 × the stated 12 %", factor=2.0),
    Row("errors truly 1.5 × the stated 12 %", factor=1.5),
    Row("bins 5° off", off_deg=OFF_DEG),
    Row("reversed profile, light perturbers", turned=True),
    Row("reversed profile, heavy perturbers", label="1e5-1e9", turned=True),
    Row("clusters 10 × as many", rate=10.0),
    Row("clusters 3 × as many", rate=3.0),
    Row("clusters a tenth", rate=0.1),
    Row("subhalos a tenth", label="1e5-1e9", rate=0.1),
    Row("subhalos a third", label="1e5-1e9", rate=1 / 3),
    Row("subhalos 3 × as many", label="1e5-1e9", rate=3.0),
    Row("subhalos 10 × as many", label="1e5-1e9", rate=10.0),
)


class World:
    """Fresh streams, and what is learnt for each design, both made when they are first asked for."""

    def __init__(self, fresh: Cache, n_streams: int) -> None:
        cache = Cache.default()
        self.cache, self.fresh, self.n_streams = cache, fresh, n_streams
        found = {
            e.config.population.label: e.config
            for e in sorted(cache.entries(("ensembles",)), key=lambda e: e.config.n_streams)
            if of_default_stream(e)
            and e.state == "complete"
            and e.config.seed != SEED
            and all(part.rate_factor == 1 for part in e.config.population.components)
        }
        self.configs = {label: found[label] for label in (*TWO, *THREE)}
        self.geometry = load_geometry(EnsembleConfig().stream, cache)
        self._prepared: dict[tuple, Prepared] = {}

    def design(self, error: float, n_bin: int = N_BIN, off_deg: float = 0.0) -> Design:
        low = LOW + WIDTH * np.arange(n_bin) + off_deg
        return Design("phi1", low, low + WIDTH, np.full(n_bin, error), "density", 3)

    def prepared(self, labels: tuple[str, ...], error: float, n_bin: int) -> Prepared:
        key = (labels, error, n_bin)
        if key not in self._prepared:
            configs = [self.configs[label] for label in labels]
            self._prepared[key] = prepare(self.cache, configs, self.design(error, n_bin))
        return self._prepared[key]

    def streams(self, label: str, rate: float, design: Design) -> np.ndarray:
        population = Population(components=(Perturbers(mass_range=label, rate_factor=rate),))
        config = EnsembleConfig(population=population, n_streams=self.n_streams, seed=SEED)
        dataset = simulate(config, cache=self.fresh, workers=1, executor="inline", nice=15)
        return observe_as(self.geometry, dataset, design).astype(np.float32)[: self.n_streams]

    def told(self, prepared: Prepared, q: np.ndarray) -> dict:
        """The report on one profile."""
        assumptions = Assumptions(coordinate="phi1", position="phi1", value="density", kind="detrended")
        n_bin = prepared.design.n_bin
        observation = Observation(assumptions, assumptions, prepared.design, q, (), n_bin, 0, 0)
        return report(judge(prepared, observation), observation, prepared)


def seen(prepared: Prepared, clean: np.ndarray, factor: float, rng: np.random.Generator) -> np.ndarray:
    """Streams measured with errors that are `factor` times what the design says."""
    draws = (factor * rng.standard_normal(clean.shape)).astype(np.float32)
    return measured(clean, draws, prepared.design.sigma, prepared.design.fit).astype(np.float32)


def sure_and_wrong(world: World, row: Row) -> tuple[float, float]:
    """Shares of a row's streams that are sure and wrong, and those of them without a warning."""
    rng = np.random.default_rng(5)
    n_bin = N_BIN - 2 if row.off_deg else N_BIN  # what is off must still be simulated
    prepared = world.prepared(TWO, row.error, n_bin)
    clean = world.streams(row.label, row.rate, world.design(row.error, n_bin, row.off_deg))
    q = seen(prepared, row.alter(clean, rng) if row.alter else clean, row.factor, rng)
    q = q[:, ::-1].copy() if row.turned else q
    answers = prepared.answers(q).mean(axis=0)
    wrong = (answers.argmax(axis=1) != TWO.index(row.label)) | row.turned
    suspects = (answers.max(axis=1) > SURE) & wrong
    free = answers if prepared.free is None else prepared.free.predict_proba(q)
    doubtful = free[np.arange(len(q)), answers.argmax(axis=1)] <= SURE
    alone = 0
    for i in np.flatnonzero(suspects & ~doubtful):
        result = world.told(prepared, q[i])
        alone += result["verdict"] == DECIDED_FOR and not result["warnings"]
    return suspects.mean(), alone / len(q)


def warned(world: World, labels: tuple[str, ...], label: str, error: float) -> tuple[float, float, float]:
    """Of honest streams of a class: those put right and sure, and those of them warned about, by kind.

    Returns
    -------
    sure and right, warned that the answer hangs on data or is unlike, warned of anything (shares of all).
    """
    rng = np.random.default_rng(6)
    prepared = world.prepared(labels, error, N_BIN)
    q = seen(prepared, world.streams(label, 1.0, prepared.design), 1.0, rng)
    answers = prepared.answers(q).mean(axis=0)
    sure = misfit = anything = 0
    right = (answers.argmax(axis=1) == labels.index(label)) & (answers.max(axis=1) > SURE)
    for profile in q[right]:
        result = world.told(prepared, profile)
        sure += 1
        misfit += not result["resembles"] or bool(result["hangs_on"]["kind"])
        anything += bool(result["warnings"])
    return sure / len(q), misfit / len(q), anything / len(q)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--streams", type=int, default=200, help="fresh streams a row")
    parser.add_argument("--cache", type=Path, help="where they are kept; the user's cache by default")
    parser.add_argument("--only", default="", help="only rows with this word")
    parser.add_argument("--text", type=Path, metavar="FILE.md", help="write the tables there")
    arguments = parser.parse_args()
    os.nice(15)
    world = World(Cache.default(arguments.cache), arguments.streams)
    mistaken, honest = [], []
    print(f"{'sure and wrong':45} {'all':>8} {'unwarned':>9}", flush=True)
    for row in ROWS:
        if arguments.only in row.words:
            mistaken.append((row.words, *sure_and_wrong(world, row)))
            print(f"{row.words:45} {_percents(mistaken[-1][1:])}", flush=True)
    if arguments.only in "honest streams":
        print(f"{'honest streams':45} {'sure':>10} {'misfit':>10} {'any warning':>10}", flush=True)
        for labels in (TWO, THREE):
            for label in labels:
                words = f"{len(labels)} classes, {label_text(label)}"
                honest.append((words, *warned(world, labels, label, 0.12)))
                print(f"{words:45} {_percents(honest[-1][1:])}", flush=True)
    if arguments.text is not None:
        arguments.text.write_text(markdown(mistaken, honest, arguments.streams), encoding="utf-8")


def _percents(shares: tuple[float, ...]) -> str:
    return " ".join(f"{100 * share:8.1f} %" for share in shares)


def markdown(mistaken: list[tuple], honest: list[tuple], n_streams: int) -> str:
    """The tables as they stand in the documentation."""
    lines = [
        "# Sure, wrong and unwarned\n",
        f"How often an answer misleads: {n_streams} fresh streams a row, seen in {N_BIN} bins of {WIDTH:g}° "
        "with errors of 12 % (20 % where it is said) and divided by a cubic, of which one assumption does not"
        f" hold. An answer is sure above {100 * SURE:g} %; it is unwarned where it is as sure with the "
        "abundance free, the verdict is “decided” and there is no warning. Written by "
        "`python -m tests.benchmarks.honest_answers --text FILE`.\n",
        "| what is wrong, two classes | sure and wrong | of all, unwarned |",
        "|---|---|---|",
        *(f"| {words} | {100 * share:.1f} % | {100 * alone:.1f} % |" for words, share, alone in mistaken),
        "\nOf profiles that run the other way every sure answer counts as wrong. And of streams of which all "
        "is true, seen in the same way, the shares put right and surely, and of all the false warnings on "
        "these:\n",
        "| honest streams | sure and right | unlike, or hangs on the data | any warning |",
        "|---|---|---|---|",
        *(
            f"| {words} | {' | '.join(f'{100 * share:.1f} %' for share in shares)} |"
            for words, *shares in honest
        ),
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
