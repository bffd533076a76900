"""The cells that a prior's parameters are inferred in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from streamdash.config import ConfigError
from streamdash.inference.posterior import make_grid
from streamdash.prior import Prior

CELLS, RATE_CELLS, FEWER_CELLS = 40, 20, 16
"""Cells of a parameter that is alone; of several, of the rate and of the others."""
AGE = "age_gyr"
"""Name of the age where it is inferred with the parameters."""


def grid_of(prior: Prior, with_age: bool = False) -> dict[str, np.ndarray]:
    """The cells that a prior's parameters are inferred in; with the age, that comes first, a cell for each.

    Raises
    ------
    ConfigError
        When the age is asked for and the prior's ages are not two or more, somewhat evenly apart.
    """
    several = len(prior.names) > 1
    cells = dict.fromkeys(prior.names, FEWER_CELLS if several else CELLS)
    grid = make_grid(prior.ranges, cells | ({"log10_rate": RATE_CELLS} if several else {}))
    return {AGE: age_edges(prior.ages_gyr), **grid} if with_age else grid


def age_edges(ages_gyr: tuple[float, ...]) -> np.ndarray:
    """Edges of even cells with an age in each; of all such, those whose ages lie farthest from them."""
    ages = np.sort(np.array(ages_gyr, float))
    if len(ages) < 2:
        raise ConfigError("ages_gyr: give two ages or more for the age to be inferred.")
    i = np.arange(len(ages))
    best = (0.0, 0.0, 0.0)
    for width in np.linspace(0.5 * np.diff(ages).min(), np.diff(ages).max(), 201):
        first, last = (ages - (i + 1) * width).max(), (ages - i * width).min()
        if last - first > best[0] + 1e-9:
            best = (last - first, width, 0.5 * (first + last))
    if best[0] <= 0:
        raise ConfigError("ages_gyr: choose ages that are more evenly apart for the age to be inferred.")
    return best[2] + best[1] * np.arange(len(ages) + 1)


def cell_of(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number of the cell that each value lies in; those beyond the ends count to the last ones."""
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def reflected(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Values beyond an end, as far within it."""
    values = np.where(values > edges[-1], 2 * edges[-1] - values, values)
    return np.where(values < edges[0], 2 * edges[0] - values, values)


def conditions(
    values: Mapping[str, np.ndarray], grid: Mapping[str, np.ndarray], names: list[str]
) -> np.ndarray:
    """Parameters (n, n_names) from -1 to 1 over their ranges."""
    n = len(next(iter(values.values())))
    columns = [unit(values[name], grid[name]) for name in names]
    return np.stack(columns, axis=1).astype(np.float32) if columns else np.zeros((n, 0), np.float32)


def all_conditions(grid: Mapping[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """The middles of all combinations of cells, as `conditions`."""
    middles = [unit(0.5 * (grid[name][1:] + grid[name][:-1]), grid[name]) for name in names]
    return np.stack([m.ravel() for m in np.meshgrid(*middles, indexing="ij")], axis=1).astype(np.float32)


def unit(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Values from -1 to 1 between the first and the last edge."""
    return 2 * (values - edges[0]) / (edges[-1] - edges[0]) - 1
