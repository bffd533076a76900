"""``streamdash convergence``: the tests of the paper's appendix A and more, their verdicts and cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from streamdash.cli.common import (
    CacheOption,
    InputError,
    JsonOption,
    make_cache,
    messages,
    print_json,
    progress_bar,
    wrong_input,
)

if TYPE_CHECKING:
    from streamdash.store.cache import Cache


def convergence_command(
    knobs: Annotated[
        list[str] | None, typer.Argument(metavar="[TEST]…", help="Which tests; all by default.")
    ] = None,
    compute: Annotated[
        bool, typer.Option("--compute", help="First simulate what the cache lacks of them.")
    ] = False,
    streams: Annotated[int, typer.Option("--streams", "-n", min=20, help="Streams per setting.")] = 1000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of all random numbers.")] = 0,
    workers: Annotated[
        int | None, typer.Option("--workers", "-w", min=1, help="Worker processes; one per core by default.")
    ] = None,
    text: Annotated[
        Path | None, typer.Option("--text", metavar="FILE.md", help="Write tables and verdicts there.")
    ] = None,
    answers: Annotated[
        Path | None,
        typer.Option(
            "--answers",
            metavar="DIR",
            help="Instead: do classifier and evidence change with rate, age and settings? Simulates some "
            "hundred streams of each, and writes them, table and numbers there.",
        ),
    ] = None,
    cache: CacheOption = None,
    as_json: JsonOption = False,
) -> None:
    """Have the simulations converged? Verdicts from the spectra in the cache, and what they cost.

    After Ctrl-C the same command goes on where it ended. Only spectra are kept, not the ensembles.
    """
    if answers is not None:
        _answers(answers, make_cache(cache), workers)
        return
    from streamdash.convergence.knobs import KNOBS, knob
    from streamdash.convergence.spectra import compute_missing
    from streamdash.convergence.text import as_numbers, convergence_markdown, cost, cost_sentence, measure
    from streamdash.convergence.verdicts import verdict_sentence
    from streamdash.simulation.workers import WorkerError

    keys = knobs or list(KNOBS)
    for key in keys:
        if key not in KNOBS:
            raise InputError(f"There is no test {key[:40]!r}; there are {', '.join(KNOBS)}.")
    where = make_cache(cache)
    if compute:
        configs = [setting.config for key in keys for setting in knob(key, streams, seed).settings]
        try:
            with progress_bar() as titled, wrong_input():
                compute_missing(configs, where, workers, titled("Spectra"))
        except WorkerError as error:
            raise InputError(str(error)) from error
        except KeyboardInterrupt:
            messages.print("Interrupted: what is finished is kept; the same command resumes there.")
            raise typer.Exit(130) from None
    found, lacking = measure(where, keys, streams, seed)
    if lacking and not found:
        raise InputError(
            f"The cache lacks spectra for {', '.join(one.key for one in lacking)} with {streams} streams and "
            f"seed {seed}; --compute simulates them."
        )
    spent = cost(where, found)
    if as_json:
        print_json(as_numbers(found, spent))
    else:
        for one in found:
            print(f"{one.knob.title}: {verdict_sentence(one.knob, one.verdict)}")
        print(f"\n{cost_sentence(spent)}")
    for absent in lacking:
        messages.print(f"{absent.title}: not in the cache; --compute simulates it.", markup=False)
    if text is not None:
        try:
            text.write_text(convergence_markdown(found, spent), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{text} cannot be written ({error.strerror}).") from None


def _answers(folder: Path, cache: Cache, workers: int | None) -> None:
    """Whether classifier and evidence change with the simulations: printed, and written into a folder."""
    from streamdash.classifier.other_streams import (
        other_streams_markdown,
        other_streams_results,
        simulate_missing,
    )
    from streamdash.cli.reproduce import keep, make_folder
    from streamdash.simulation.workers import WorkerError
    from streamdash.store.cache import Cache

    make_folder(folder)
    # Beside the cache and not in it: nobody wants to choose these streams on the page.
    workshop = Cache((*cache.roots, folder / "streams"), folder / "streams")
    try:
        with progress_bar() as titled, wrong_input():
            simulate_missing(workshop, workers=workers, progress=titled("Streams made otherwise"))
    except WorkerError as error:
        raise InputError(str(error)) from error
    except KeyboardInterrupt:
        messages.print("Interrupted: what is finished is kept; the same command resumes there.")
        raise typer.Exit(130) from None
    results = other_streams_results(workshop)
    markdown = other_streams_markdown(results)
    print(markdown, end="")
    keep(folder, {"other_streams.json": results, "other_streams.md": markdown})
