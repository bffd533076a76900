"""``streamdash estimator``: train what is shipped, and compare methods on the same streams."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from streamdash.cli.common import (
    CacheOption,
    InputError,
    StreamOption,
    make_cache,
    messages,
    progress_bar,
    wrong_input,
)
from streamdash.cli.infer import PRIOR_HELP, read_prior
from streamdash.streams import STREAM_NAMES, named_stream

estimator_app = typer.Typer(help="Train estimators of what hit a stream, and see what they are worth.")

HELD_OUT = 1000
HELD_OUT_SEED = 2026
TOLD_AGES, TOLD_ERRORS = (3.0, 5.0, 7.0, 9.0), (0.25, 2.0)
"""Ages (Gyr), and errors relative to the design's, that ``--told`` leaves open."""
TOLD_TRIED = (0.3, 1.0, 2.0)
"""Errors at which the coverage of an estimator that is told them is looked at."""


@estimator_app.command("train")
def train_command(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="ESTIMATOR.npz", help="Where to write it.")
    ],
    stream: StreamOption = None,
    prior: Annotated[str, typer.Option("--prior", metavar="NAME|JSON", help=PRIOR_HELP)] = "rate",
    streams: Annotated[int, typer.Option("--streams", min=500, help="Streams to learn from.")] = 40_000,
    members: Annotated[int, typer.Option("--members", min=1, max=20, help="Networks of a parameter.")] = 6,
    held_out: Annotated[int, typer.Option("--held-out", min=50, help="Fresh streams to test on.")] = HELD_OUT,
    told: Annotated[
        bool,
        typer.Option("--told", help="Leave age and errors open, so that either can be fixed when asked."),
    ] = False,
    cache: CacheOption = None,
) -> None:
    """Train the estimator of a named stream at its default design, and test it on fresh streams.

    Those are written as well, to the folder held-out beside it.
    """
    from dataclasses import replace

    from streamdash.inference.diagnostics import as_record, scores
    from streamdash.inference.estimator import Estimator
    from streamdash.inference.files import HELD_OUT as FOLDER
    from streamdash.inference.files import save
    from streamdash.inference.held_out import HeldOut
    from streamdash.inference.prior_ensemble import PriorEnsemble, default_design
    from streamdash.inference.training import Training
    from streamdash.simulation.geometry import load_geometry

    if not output.absolute().parent.is_dir():
        raise InputError(f"The folder of {output} does not exist; make it first.")
    place = make_cache(cache)
    with wrong_input(), progress_bar() as titled:
        asked = read_prior(prior)
        if told:
            asked = asked.model_copy(update={"ages_gyr": TOLD_AGES, "noise_factor": TOLD_ERRORS})
        model = named_stream(stream or STREAM_NAMES[0]).arm()
        ensemble = PriorEnsemble.load(
            asked, model, streams, place, progress=titled("Simulating streams of the prior"), nice=10
        )
        design = default_design(load_geometry(model, place))
        training = Training(members=members, told=("noise", "age") if told else ())
        estimator = replace(Estimator.fit(ensemble, design, training, titled("Training")), stream=model)
        fresh = HeldOut.fresh(estimator, held_out, HELD_OUT_SEED, place)
        record = as_record(
            scores(estimator.posterior(fresh.observed(estimator)), estimator.grid, fresh.truth)
        )
    folder = output.absolute().parent / FOLDER
    folder.mkdir(exist_ok=True)
    fresh.save(folder / output.name)
    save(replace(estimator, card={**estimator.card, "held_out": record}), output)
    for name, numbers in record.items():
        messages.print(f"{name}: " + ", ".join(f"{key} {value:g}" for key, value in numbers.items()))


@estimator_app.command("table")
def table_command(
    stream: StreamOption = None,
    prior: Annotated[str, typer.Option("--prior", metavar="NAME", help="Prior of the estimator.")] = "rate",
    streams: Annotated[int, typer.Option("--streams", min=500, help="Streams to learn from.")] = 20_000,
    held_out: Annotated[int, typer.Option("--held-out", min=50, help="Fresh streams to test on.")] = HELD_OUT,
    cache: CacheOption = None,
) -> None:
    """Compare ABC, networks on power spectra, and the shipped estimator on the same held-out streams.

    Of a prior of several parameters, score the shipped estimator on the streams that are shipped with it:
    every parameter, and every two of them by TARP.
    """
    from streamdash.inference.diagnostics import pair_scores, scores, table_of_pairs
    from streamdash.inference.files import load_estimator
    from streamdash.inference.held_out import load_streams
    from streamdash.inference.methods import compare, table
    from streamdash.inference.prior_ensemble import PriorEnsemble
    from streamdash.streams import stream_text

    place = make_cache(cache)
    with wrong_input(), progress_bar() as titled:
        estimator = load_estimator(stream or STREAM_NAMES[0], prior)
        if len(estimator.names) > 1:
            known = load_streams(stream or STREAM_NAMES[0], prior)
            p = estimator.posterior(known.observed(estimator))
            single = scores(p, estimator.grid, known.truth)
            print(table_of_pairs(single, pair_scores(p, estimator.grid, known.truth)))
            return
        ensemble = PriorEnsemble.load(
            estimator.prior,
            estimator.stream,
            streams,
            place,
            progress=titled("Simulating streams of the prior"),
        )
        fresh = estimator.simulate(held_out, HELD_OUT_SEED + 1, place)
        found = compare(ensemble, estimator, fresh, titled("Training networks"))
    design = estimator.design
    words = f"{stream_text(estimator.stream)}: bins of {design.step:.3g}°, σ = {design.noise:g}, "
    print(table({words + f"divided by a polynomial of order {design.order}; {held_out} streams": found}))


@estimator_app.command("coverage")
def coverage_command(
    stream: Annotated[
        str | None, typer.Option("--stream", metavar="NAME", help="Of this stream.", show_default="all")
    ] = None,
    streams: Annotated[
        int, typer.Option("--streams", min=100, help="Fresh streams of each prior.")
    ] = HELD_OUT,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the fresh streams.")] = HELD_OUT_SEED + 2,
    cache: CacheOption = None,
) -> None:
    """See how often the intervals of every shipped estimator hold the truth, on fresh streams of its prior.

    Ends with code 1 when a coverage is not as asked, 0.68 ± 0.03 and 0.95 ± 0.015, by more than two standard
    errors of so many streams.
    """
    from streamdash.inference.coverage import rows, shipped_names, table
    from streamdash.inference.files import load_estimator
    from streamdash.inference.held_out import HeldOut

    place = make_cache(cache)
    found = []
    with wrong_input():
        only = named_stream(stream).name if stream is not None else None
        names = [name for name in shipped_names() if only in (None, name[0])]
        for name, prior, told in names:
            estimator = load_estimator(name, prior, told)
            fresh = HeldOut.fresh(estimator, streams, seed, place)
            title = f"{name}, {prior}" + (", told" if told else "")
            found += [(title, row) for row in rows(estimator, fresh, TOLD_TRIED)]
            messages.print(f"{title}: {streams} fresh streams", markup=False)
    print(table(found))
    if not all(row.right for _, row in found):
        raise typer.Exit(1)


@estimator_app.command("streams")
def streams_command(
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Where to write them.")],
    stream: StreamOption = None,
    prior: Annotated[str, typer.Option("--prior", metavar="NAME|JSON", help=PRIOR_HELP)] = "rate",
    streams: Annotated[int, typer.Option("--streams", min=500, help="How many.")] = 15_000,
    cache: CacheOption = None,
) -> None:
    """Write streams of a prior as they are shipped: what estimators for anybody's bins learn from."""
    from streamdash.inference.prior_ensemble import PriorEnsemble
    from streamdash.inference.shipped_streams import save_streams

    if not output.is_dir():
        raise InputError(f"The folder {output} does not exist; make it first.")
    place = make_cache(cache)
    with wrong_input(), progress_bar() as titled:
        asked = read_prior(prior)
        if asked.ages_gyr:
            raise InputError("--prior: leave ages_gyr out; streams are shipped of one age.")
        model = named_stream(stream or STREAM_NAMES[0]).arm()
        ensemble = PriorEnsemble.load(
            asked, model, streams, place, progress=titled("Simulating streams of the prior"), nice=10
        )
        (member,) = ensemble.members
        path = save_streams(member.config, member.streams, output)
    messages.print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
