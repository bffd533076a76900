"""One simulated stream as an observer would publish it: a table of bins, densities and errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from streamdash.config import EnsembleConfig, Perturbers, StreamModel
from streamdash.engine.geometry import Geometry
from streamdash.simulation.ensemble import background, compute_stream
from streamdash.survey.design import AS_IS, Design, observe_as, smooth_as, window
from streamdash.survey.sky import Coordinate

EXAMPLE = Path(__file__).parent.parent / "examples" / "gd1-like.csv"
"""A mock observation that comes with the package; what it is stands in `EXAMPLE_TRUTH`.

Made by ``streamdash mock --mass 1e5-1e9 --number 1 --gap -61 -o gd1-like.csv --truth gd1-like.truth.json``.
"""
EXAMPLE_TRUTH = EXAMPLE.with_suffix(".truth.json")
MOCK_SEED = 20_170_605
"""Seed of all mock streams, so that none of them is in an ensemble somebody trained on."""
STARS_PER_DEGREE = 100.0
"""Mean number of stars per degree in the tables; only ratios matter."""


@dataclass(frozen=True, eq=False)
class Mock:
    """A mock observation.

    Attributes
    ----------
    table : DataFrame
        ``phi1`` or ``ell`` (deg, middle of the bin), ``density`` and ``density_error`` (stars/deg).
    smooth : ndarray (n_bin,)
        The unperturbed stream in the same bins and unit.
    n_impacts : int
        Perturbers that hit the stream.
    """

    table: pd.DataFrame
    smooth: np.ndarray
    n_impacts: int

    def text(self) -> str:
        """The table as CSV."""
        return self.table.to_csv(index=False, float_format="%.6g")


def mock_bins(
    geometry: Geometry, coordinate: Coordinate, width: float, gaps: tuple[float, ...] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of whole bins within the simulated stretch, but for those that hold a position in `gaps`.

    Raises
    ------
    ValueError
        When fewer than two bins fit.
    """
    low, high = window(geometry, coordinate)
    edges = np.arange(np.ceil(low / width), np.floor(high / width) + 0.5) * width
    if len(edges) < 3:
        raise ValueError(f"bins of {width:g}° are too wide: the stream spans {high - low:.0f}°")
    covered = [not any(a <= gap < b for gap in gaps) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return edges[:-1][covered], edges[1:][covered]


def mock_observation(
    geometry: Geometry,
    perturbers: Perturbers,
    number: int,
    low: np.ndarray,
    high: np.ndarray,
    coordinate: Coordinate = "phi1",
    error: float = 0.1,
    stream: StreamModel | None = None,
) -> Mock:
    """Simulate a stream and observe it with shot noise in every bin.

    Parameters
    ----------
    perturbers : what hits the stream.
    number : which of the streams; the same number is the same stream and the same noise.
    low, high : (n_bin,) ends of the bins (deg).
    error : relative error of a bin of average density; it grows as density^-½ where fewer stars are.
    """
    config = EnsembleConfig(stream=stream or StreamModel(), perturbers=perturbers, seed=MOCK_SEED)
    density, _, n_impacts = compute_stream(geometry, config, number)
    ensemble = background(geometry, config)
    ensemble["density"] = xr.DataArray(density[None], dims=("stream", "theta"))
    design = Design(coordinate, low, high, np.ones(len(low)), "density", AS_IS)
    smooth = smooth_as(geometry, ensemble, design)
    unit = STARS_PER_DEGREE / smooth.mean()
    smooth = unit * smooth
    sigma = error * np.sqrt(smooth * STARS_PER_DEGREE)
    draws = np.random.default_rng([MOCK_SEED, number]).standard_normal(len(low))
    values = unit * observe_as(geometry, ensemble, design)[0] + sigma * draws
    columns = {coordinate: 0.5 * (low + high), "density": values, "density_error": sigma}
    return Mock(pd.DataFrame(columns), smooth, n_impacts)
