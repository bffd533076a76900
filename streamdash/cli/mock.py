"""``streamdash mock``: a simulated observation with a known truth, to try things with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from streamdash.cli.common import (
    ArmOption,
    CacheOption,
    InputError,
    StreamOption,
    make_cache,
    messages,
    wrong_input,
)
from streamdash.streams import STREAM_NAMES, named_stream


def mock_command(
    mass: Annotated[str, typer.Option("--mass", help="Mass range of the perturbers, such as 1e5-1e9 (M☉).")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="TABLE.csv", help="The observation.")],
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH.json", help="Where to write what it really is.")
    ] = None,
    number: Annotated[int, typer.Option("--number", min=0, max=10**9, help="Which of the streams.")] = 0,
    stream: StreamOption = None,
    arm: ArmOption = None,
    coordinate: Annotated[
        str | None,
        typer.Option(
            show_default="the stream's own longitude", help="Coordinate of the bins: ell, or phi1 or xi."
        ),
    ] = None,
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
    from streamdash.config import Perturbers
    from streamdash.simulation.geometry import load_geometry
    from streamdash.store.entry import write_file
    from streamdash.survey.mock import mock_bins, mock_observation

    for path in filter(None, (output, truth)):
        if not path.absolute().parent.is_dir():
            raise InputError(f"The folder of {path} does not exist; make it first.")
    with wrong_input():
        perturbers = Perturbers.parse({"mass_range": mass})
        model = named_stream(stream or STREAM_NAMES[0]).arm(arm)
        geometry = load_geometry(model, make_cache(cache))
        where = coordinate or geometry.frame.longitude
        low, high = mock_bins(geometry, where, width, tuple(gap or ()))
        mock = mock_observation(geometry, perturbers, number, low, high, where, error, model)
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
