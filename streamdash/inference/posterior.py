"""What is known of a population's parameters: probabilities of the cells of a grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

EDGE = 0.6
"""A posterior whose density at an end of its prior is this share of its highest is at the edge."""
UNINFORMED = 0.15
"""With less information than this (bits) the data do not constrain a parameter."""

Grid = Mapping[str, np.ndarray]
"""Edges (n_cell + 1,) of the cells of every parameter, in the order of the axes."""


@dataclass(frozen=True, eq=False)
class Posterior:
    """Probability of every cell of a grid, for one stream.

    The prior is uniform over the grid's ranges.

    Attributes
    ----------
    grid : mapping of parameter to edges
    p : ndarray (*cells)
        Sums to 1.
    """

    grid: Grid
    p: np.ndarray

    def __post_init__(self) -> None:
        shape = tuple(len(edges) - 1 for edges in self.grid.values())
        if self.p.shape != shape:
            raise ValueError(f"p has shape {self.p.shape}, the grid's cells {shape}")

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters."""
        return tuple(self.grid)

    @cached_property
    def prior(self) -> np.ndarray:
        """Prior probability of every cell (*cells)."""
        shares = [np.diff(edges) / np.ptp(edges) for edges in self.grid.values()]
        return np.asarray(reduce(np.multiply.outer, shares))

    def marginal(self, *names: str) -> np.ndarray:
        """Probability of the cells of some parameters, the others summed over, axes in the order given."""
        axes = [self._axis(name) for name in names]
        others = tuple(i for i in range(self.p.ndim) if i not in axes)
        left = [i for i in range(self.p.ndim) if i in axes]
        kept: np.ndarray = np.asarray(self.p.sum(axis=others))
        return kept.transpose([left.index(axis) for axis in axes])

    def quantile(self, name: str, q: float | np.ndarray) -> np.ndarray:
        """Value below which a parameter lies with probability `q`; linear within cells."""
        return np.asarray(np.interp(q, cumulative(self.marginal(name)), self.grid[name]))

    def median(self, name: str) -> float:
        """Value above and below which the parameter lies with equal probability."""
        return float(self.quantile(name, 0.5))

    def interval(self, name: str, level: float = 0.68) -> tuple[float, float]:
        """Interval with probability `level`, and equal probabilities on either side."""
        low, high = self.quantile(name, np.array([0.5 - level / 2, 0.5 + level / 2]))
        return float(low), float(high)

    def upper_limit(self, name: str, level: float = 0.95) -> float:
        """Value below which the parameter lies with probability `level`."""
        return float(self.quantile(name, level))

    def lower_limit(self, name: str, level: float = 0.95) -> float:
        """Value above which the parameter lies with probability `level`."""
        return float(self.quantile(name, 1 - level))

    @cached_property
    def information(self) -> float:
        """Bits that the data have added to the prior: the mean log₂ of posterior over prior."""
        return _bits(self.p, self.prior)

    def information_on(self, *names: str) -> float:
        """The same on some of the parameters only."""
        flat = Posterior({name: self.grid[name] for name in names}, self.marginal(*names))
        return flat.information

    def edges_reached(self, name: str) -> tuple[str, ...]:
        """Ends of the prior, of "lower" and "upper", at which the posterior is still high."""
        density = self.marginal(name) / np.diff(self.grid[name])
        if self.information_on(name) < UNINFORMED:
            return ()
        top = density.max()
        ends = {"lower": density[0], "upper": density[-1]}
        return tuple(end for end, value in ends.items() if value >= EDGE * top)

    def cells_within(self, names: tuple[str, ...], level: float) -> np.ndarray:
        """Which cells of the marginal belong to its most probable region of that level."""
        p = self.marginal(*names)
        order = np.argsort(p, axis=None)[::-1]
        n = int(np.searchsorted(np.cumsum(p.flat[order]), level)) + 1
        inside = np.zeros(p.size, bool)
        inside[order[:n]] = True
        return inside.reshape(p.shape)

    def given(self, name: str, low: float, high: float) -> Posterior:
        """The posterior when a parameter is known to lie between two values.

        Raises
        ------
        ValueError
            When no cell's middle lies there.
        """
        middle = 0.5 * (self.grid[name][1:] + self.grid[name][:-1])
        inside = (middle >= low) & (middle <= high)
        shape = [-1 if i == self._axis(name) else 1 for i in range(self.p.ndim)]
        p = self.p * inside.reshape(shape)
        if not p.sum() > 0:
            raise ValueError(f"{name}: no cell of the posterior lies between {low:g} and {high:g}")
        return Posterior(self.grid, p / p.sum())

    def without(self, name: str) -> Posterior:
        """The posterior of the other parameters, whatever this one is; the same where it is none of them."""
        if name not in self.grid:
            return self
        names = [other for other in self.names if other != name]
        return Posterior({other: self.grid[other] for other in names}, self.marginal(*names))

    def at(self, name: str, value: float) -> Posterior:
        """The posterior of the other parameters when this one is known, to its cell.

        Raises
        ------
        ValueError
            When the value is outside the grid.
        """
        edges = self.grid[name]
        cell = int(np.searchsorted(edges, value, side="right")) - 1
        if not 0 <= cell < len(edges) - 1:
            raise ValueError(f"{name}: {value:g} is not between {edges[0]:g} and {edges[-1]:g}")
        return self.given(name, float(edges[cell]), float(edges[cell + 1])).without(name)

    def joined(self, *others: Posterior) -> Posterior:
        """The posterior of several streams that share the parameters: the product of their likelihoods.

        Raises
        ------
        ValueError
            When the grids differ.
        """
        logs = np.log(self.p + 1e-30)
        for other in others:
            same = other.names == self.names and all(
                np.array_equal(other.grid[name], self.grid[name]) for name in self.names
            )
            if not same:
                raise ValueError("only posteriors on the same grid can be joined")
            logs = logs + np.log(other.p + 1e-30) - np.log(self.prior)
        p = np.exp(logs - logs.max())
        return Posterior(self.grid, p / p.sum())

    def sample(self, n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        """Parameters drawn from the posterior, (n,) each; uniform within a cell."""
        cells = np.unravel_index(rng.choice(self.p.size, n, p=self.p.ravel()), self.p.shape)
        return {
            name: edges[cell] + rng.random(n) * np.diff(edges)[cell]
            for cell, (name, edges) in zip(cells, self.grid.items(), strict=True)
        }

    def _axis(self, name: str) -> int:
        if name not in self.grid:
            raise ValueError(f"{name!r} is none of the parameters {', '.join(self.grid)}")
        return self.names.index(name)


def cumulative(p: np.ndarray) -> np.ndarray:
    """Probability below each edge (…, n_cell + 1) of cells (…, n_cell)."""
    total = np.cumsum(p, axis=-1)
    return np.concatenate([np.zeros((*p.shape[:-1], 1)), total / total[..., -1:]], axis=-1)


def make_grid(ranges: Mapping[str, tuple[float, float]], n_cells: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Even edges over each parameter's range."""
    return {name: np.linspace(low, high, n_cells[name] + 1) for name, (low, high) in ranges.items()}


def _bits(p: np.ndarray, prior: np.ndarray) -> float:
    some = p > 0
    return float(np.sum(p[some] * np.log2(p[some] / prior[some])))
