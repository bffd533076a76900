"""``streamdash geometry``: the geometry of a named stream, computed once and kept in the cache."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from streamdash.cli.common import (
    BothArmsOption,
    CacheOption,
    JsonOption,
    StreamOption,
    arms_of,
    duration,
    make_cache,
    print_json,
    progress_bar,
    wrong_input,
)
from streamdash.streams import STREAM_NAMES, named_stream, stream_text


def geometry_command(
    stream: StreamOption = None,
    arm: BothArmsOption = None,
    age: Annotated[
        float | None, typer.Option("--age", show_default="the stream's own", help="Age of the stream, Gyr.")
    ] = None,
    n_times: Annotated[
        int | None,
        typer.Option("--n-times", show_default="64", help="Impact times; 8 make a coarse preview."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", "-w", min=1, help="Worker processes; one per core by default.")
    ] = None,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute what an arm of a stream looks like at its impact times, and keep it in the cache.

    Simulations do so by themselves when they need it. What is finished is kept: after Ctrl-C the same
    command goes on where it ended.
    """
    from streamdash.config import StreamModel
    from streamdash.simulation.geometry import load_geometry

    named = named_stream(stream or STREAM_NAMES[0])
    results = []
    for one in arms_of(stream, arm):
        model = (named if age is None else named.at_age(age)).arm(one)
        if n_times is not None:
            model = StreamModel.parse(model.model_dump() | {"n_times": n_times})
        start = time.perf_counter()
        with progress_bar() as titled, wrong_input():
            title = f"Geometry of {stream_text(model)}"
            geometry = load_geometry(model, make_cache(cache), workers, titled(title))
        took = time.perf_counter() - start
        results.append({"key": model.key, "length_rad": geometry.length, "seconds": took})
        if not as_json:
            found = f"{geometry.length:.3f} rad long, {len(geometry.times)} impact times"
            print(f"{stream_text(model)}: {found} ({duration(took)}).")
    if as_json:
        print_json(results if len(results) > 1 else results[0])
