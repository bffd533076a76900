"""Is a posterior right, and what is it worth? Ranks, coverage, TARP and bits on streams it has not seen."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from streamdash.inference.posterior import Grid, cumulative

LEVELS = (0.68, 0.95)
POINTS = 5
"""Random points that the joint posterior of every stream is looked at from."""


@dataclass(frozen=True)
class Score:
    """How well posteriors of one parameter do on held-out streams.

    Attributes
    ----------
    information : mean log₂ of posterior over prior density at the truth (bits), and its standard error.
    width : median width of the 68 % interval, in the parameter's unit.
    coverage : share of streams whose truth is in the interval of each of `LEVELS`.
    n : streams.
    """

    information: float
    error: float
    width: float
    coverage: tuple[float, ...]
    n: int


def marginals(p: np.ndarray, grid: Grid, name: str) -> np.ndarray:
    """Marginal of one parameter, (n, n_cell), of posteriors (n, *cells)."""
    axis = list(grid).index(name) + 1
    return p.sum(axis=tuple(i for i in range(1, p.ndim) if i != axis))


def ranks(p: np.ndarray, edges: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Posterior probability (n,) below the truth: uniform from 0 to 1 where posteriors are calibrated.

    The ranks of simulation-based calibration (Talts et al. 2018, arXiv:1804.06788) without sampling.

    Parameters
    ----------
    p : ndarray (n, n_cell)
    edges : ndarray (n_cell + 1,)
    truth : ndarray (n,)
    """
    below = cumulative(p)
    cell = np.clip(np.searchsorted(edges, truth, side="right") - 1, 0, len(edges) - 2)
    rows = np.arange(len(p))
    share = np.clip((truth - edges[cell]) / np.diff(edges)[cell], 0, 1)
    return below[rows, cell] + share * (below[rows, cell + 1] - below[rows, cell])


def coverage(rank: np.ndarray, level: float) -> float:
    """Share of streams whose central interval of a level holds the truth."""
    return float(np.mean(np.abs(rank - 0.5) <= level / 2))


def bits(p: np.ndarray, edges: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """log₂ of posterior over (uniform) prior density at the truth, (n,)."""
    cell = np.clip(np.searchsorted(edges, truth, side="right") - 1, 0, len(edges) - 2)
    prior = np.diff(edges)[cell] / np.ptp(edges)
    return np.log2(np.maximum(p[np.arange(len(p)), cell], 1e-12) / prior)


def score(p: np.ndarray, edges: np.ndarray, truth: np.ndarray) -> Score:
    """All of it for posteriors (n, n_cell) of one parameter."""
    gained = bits(p, edges, truth)
    rank = ranks(p, edges, truth)
    ends = [np.interp([0.16, 0.84], row, edges) for row in cumulative(p)]
    return Score(
        float(gained.mean()),
        float(gained.std() / np.sqrt(len(gained))),
        float(np.median([high - low for low, high in ends])),
        tuple(coverage(rank, level) for level in LEVELS),
        len(gained),
    )


def scores(p: np.ndarray, grid: Grid, truth: pd.DataFrame) -> dict[str, Score]:
    """`score` of every parameter's marginal."""
    return {
        name: score(marginals(p, grid, name), np.asarray(grid[name]), truth[name].to_numpy()) for name in grid
    }


def joint_bits(p: np.ndarray, grid: Grid, truth: pd.DataFrame) -> np.ndarray:
    """log₂ of posterior over prior probability of the true cell of all parameters together, (n,)."""
    flat, size = np.zeros(len(p), int), 1
    for name, edges in grid.items():
        cell = np.clip(np.searchsorted(edges, truth[name], side="right") - 1, 0, len(edges) - 2)
        flat = flat * (len(edges) - 1) + cell
        size *= len(edges) - 1
    return np.log2(np.maximum(p.reshape(len(p), -1)[np.arange(len(p)), flat], 1e-12) * size)


def tarp(
    p: np.ndarray,
    grid: Grid,
    truth: pd.DataFrame,
    names: tuple[str, str],
    rng: np.random.Generator,
    n_draws: int = 500,
) -> np.ndarray:
    """Ranks (n,) of joint posteriors of two parameters: uniform from 0 to 1 where they are calibrated.

    Tests of accuracy with random points (Lemos et al. 2023, arXiv:2302.03026): the share of posterior
    draws that are nearer than the truth to a random reference point, over the unit square.
    """
    others = tuple(i + 1 for i, name in enumerate(grid) if name not in names)
    joint = p.sum(axis=others)
    order = [name for name in grid if name in names]
    edges = [np.asarray(grid[name]) for name in order]
    lows, spans = np.array([e[0] for e in edges]), np.array([np.ptp(e) for e in edges])
    points = (truth[order].to_numpy() - lows) / spans
    found = np.empty(len(p))
    for i, cells in enumerate(joint):
        flat = cells.ravel() / cells.sum()
        index = np.unravel_index(rng.choice(flat.size, n_draws, p=flat), cells.shape)
        draws = np.stack(
            [e[k] + rng.random(n_draws) * np.diff(e)[k] for e, k in zip(edges, index, strict=True)], axis=1
        )
        draws = (draws - lows) / spans
        reference = rng.random(2)
        far = np.linalg.norm(points[i] - reference)
        found[i] = np.mean(np.linalg.norm(draws - reference, axis=1) < far)
    return found


@dataclass(frozen=True)
class PairScore:
    """How well joint posteriors of two parameters do on held-out streams.

    Attributes
    ----------
    information : mean log₂ of joint posterior over prior density at the truth (bits), and its standard error.
    coverage : share of streams whose `tarp` rank is below each of `LEVELS`: what a calibrated posterior has.
    n : streams.
    """

    information: float
    error: float
    coverage: tuple[float, ...]
    n: int


def pair_scores(
    p: np.ndarray, grid: Grid, truth: pd.DataFrame, without: tuple[str, ...] = (), seed: int = 0
) -> dict[tuple[str, str], PairScore]:
    """Information and expected coverage (`tarp`) of every two parameters, those in `without` left out."""
    rng = np.random.default_rng(seed)
    found = {}
    for names in itertools.combinations([name for name in grid if name not in without], 2):
        others = tuple(i + 1 for i, name in enumerate(grid) if name not in names)
        gained = joint_bits(p.sum(axis=others), {name: grid[name] for name in names}, truth)
        rank = np.concatenate([tarp(p, grid, truth, names, rng, 200) for _ in range(POINTS)])
        found[names] = PairScore(
            float(gained.mean()),
            float(gained.std() / np.sqrt(len(gained))),
            tuple(float(np.mean(rank < level)) for level in LEVELS),
            len(gained),
        )
    return found


def as_record(found: Mapping[str, Score]) -> dict[str, dict[str, float]]:
    """Scores as plain numbers, for cards and tables."""
    return {
        name: {
            "bits": round(s.information, 3),
            "error": round(s.error, 3),
            "width": round(s.width, 3),
            "coverage68": round(s.coverage[0], 3),
            "coverage95": round(s.coverage[1], 3),
            "streams": s.n,
        }
        for name, s in found.items()
    }


def table_of_pairs(single: Mapping[str, Score], pairs: Mapping[tuple[str, str], PairScore]) -> str:
    """Scores of parameters and of pairs of them as a table in Markdown."""
    n = next(iter(single.values())).n
    lines = [
        f"| parameter ({n} streams) | information (bits) | 68 % width | coverage of 68 % | of 95 % |",
        "|---|---|---|---|---|",
    ]
    for name, s in single.items():
        shares = " | ".join(f"{share:.3f}" for share in s.coverage)
        lines.append(f"| {name} | {s.information:.2f} ± {s.error:.2f} | {s.width:.2f} | {shares} |")
    for names, pair in pairs.items():
        shares = " | ".join(f"{share:.3f}" for share in pair.coverage)
        lines.append(
            f"| {' with '.join(names)}, by TARP | {pair.information:.2f} ± {pair.error:.2f} | | {shares} |"
        )
    return "\n".join(lines)
