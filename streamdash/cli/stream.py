"""``streamdash stream``: one stream for a table of impacts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from streamdash.cli.common import (
    ArmOption,
    CacheOption,
    ConfigOption,
    InputError,
    StreamOption,
    make_cache,
    progress_bar,
    read_config,
    wrong_input,
)

if TYPE_CHECKING:
    import pandas as pd

    from streamdash.config import EnsembleConfig
    from streamdash.store.cache import Cache

COLUMNS = ("theta", "ell", "density", "smooth", "q_rho", "omega")


def stream_command(
    impacts: Annotated[
        Path,
        typer.Argument(
            metavar="IMPACTS.csv",
            help="Columns time_gyr, theta, b_kpc, vx_kms, vy_kms, vz_kms, mass_msun, r_s_kpc (, profile).",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="PROFILE.csv", help=f"Columns {', '.join(COLUMNS)}.")
    ],
    profile: Annotated[
        Literal["hernquist", "plummer"] | None,
        typer.Option("--profile", show_default="hernquist", help="Profile of the subhalos if not a column."),
    ] = None,
    theta_min: Annotated[
        float | None, typer.Option(show_default="the stream's", help="First angle, rad.")
    ] = None,
    theta_max: Annotated[
        float | None, typer.Option(show_default="the stream's", help="Last angle, rad.")
    ] = None,
    n_theta: Annotated[
        int | None, typer.Option(show_default="the stream's", help="Number of angles.")
    ] = None,
    stream: StreamOption = None,
    arm: ArmOption = None,
    config: ConfigOption = None,
    cache: CacheOption = None,
) -> None:
    """Compute density and mean frequency of one stream hit by the given subhalos.

    Impacts at other times than the stream's 64 need its geometry then: seconds a time, once.
    """
    wanted = read_config(
        config,
        {
            "perturbers.profile": profile,
            "theta_min": theta_min,
            "theta_max": theta_max,
            "n_theta": n_theta,
        },
        stream,
        arm,
    )
    if not output.absolute().parent.is_dir():
        raise InputError(f"The folder of {output} does not exist; make it first.")
    if not impacts.is_file():
        raise InputError(f"{impacts} is not a file.")
    write_table(output, compute_profile(impacts, wanted, make_cache(cache)))


def compute_profile(impacts: Path, config: EnsembleConfig, cache: Cache) -> pd.DataFrame:
    """Profile table with the columns `COLUMNS` for a table of impacts at any times."""
    from streamdash.engine.density import perturbed_stream
    from streamdash.engine.impacts import Impacts, stream_with_times
    from streamdash.simulation.ensemble import theta_grid
    from streamdash.simulation.geometry import load_geometry
    from streamdash.survey import sky

    with wrong_input():
        profile = config.perturbers.profile
        # Wrong tables are refused before minutes are spent.
        stream = stream_with_times(config.stream, Impacts.read_csv(impacts, profile=profile))
        if cache.open_geometry(stream) is None:
            cache.check_writable()
        with progress_bar() as titled:
            geometry = load_geometry(stream, cache, progress=titled("Geometry of the stream"))
        table = Impacts.read_csv(impacts, geometry, profile)
        theta = theta_grid(config)
        ell = sky.theta_to_ell(geometry, theta)
        result = perturbed_stream(geometry, table, theta, config.accuracy)
    return result.assign(ell=("theta", ell)).to_dataframe().reset_index()[list(COLUMNS)]


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a CSV whole or not at all."""
    from streamdash.store.entry import write_file

    try:
        write_file(path, table.to_csv(index=False, float_format="%.9g").encode())
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}).") from None
