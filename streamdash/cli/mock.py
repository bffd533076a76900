"""``streamdash mock``: a simulated observation with a known truth, to try things with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from streamdash.cli.common import CacheOption, InputError, make_cache, messages, wrong_input


def mock_command(
    mass: Annotated[str, typer.Option("--mass", help="Mass range of the perturbers, such as 1e5-1e9 (M☉).")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="TABLE.csv", help="The observation.")],
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Where to write what it really is.")
    ] = None,
    number: Annotated[int, typer.Option("--number", min=0, max=10**9, help="Which of the streams.")] = 0,
    coordinate: Annotated[Literal["phi1", "ell"], typer.Option(help="Coordinate of the bins.")] = "phi1",
    width: Annotated[float, typer.Option(min=0.1, max=8, help="Width of the bins (deg).")] = 2.0,
    error: Annotated[
        float, typer.Option(min=1e-3, max=1, help="Relative error of a bin of average density.")
    ] = 0.1,
    gap: Annotated[list[float] | None, typer.Option(help="Leave out the bin here (deg); repeatable.")] = None,
    cache: CacheOption = None,
) -> None:
    """Simulate one stream and write it as an observer would: bins, densities, errors.

    Mock streams have a seed of their own: none of them is in an ensemble that is trained on.
    """
    from streamdash.config import Perturbers, StreamModel
    from streamdash.simulation.geometry import load_geometry
    from streamdash.store.entry import write_file
    from streamdash.survey.mock import mock_bins, mock_observation

    for path in filter(None, (output, truth)):
        if not path.absolute().parent.is_dir():
            raise InputError(f"The folder of {path} does not exist; make it first.")
    with wrong_input():
        perturbers = Perturbers.parse({"mass_range": mass})
        geometry = load_geometry(StreamModel(), make_cache(cache))
        low, high = mock_bins(geometry, coordinate, width, tuple(gap or ()))
        mock = mock_observation(geometry, perturbers, number, low, high, coordinate, error)
    known = {
        "mass_range": perturbers.label,
        "n_impacts": mock.n_impacts,
        "number": number,
        "relative_error": error,
    }
    try:
        write_file(output, mock.text().encode())
        if truth is not None:
            write_file(truth, (json.dumps(known, indent=1) + "\n").encode())
    except OSError as failure:
        raise InputError(f"{failure.filename} cannot be written ({failure.strerror}).") from None
    messages.print(f"Wrote {output}: {len(mock.table)} bins.", markup=False)
