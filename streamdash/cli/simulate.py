"""``streamdash simulate``: an ensemble from the command line, resumable."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from streamdash.cli.common import (
    BothArmsOption,
    CacheOption,
    ConfigOption,
    InputError,
    JsonOption,
    StreamOption,
    arms_of,
    duration,
    make_cache,
    messages,
    print_json,
    progress_bar,
    read_config,
    wrong_input,
)
from streamdash.config import Config, EnsembleConfig, LogarithmicHalo, Perturbers, Population, StreamModel
from streamdash.populations import PRESETS, component_text, parse_component, title_of
from streamdash.populations import preset as named_preset
from streamdash.streams import stream_text

if TYPE_CHECKING:
    from streamdash.engine.geometry import Geometry
    from streamdash.store.cache import Cache

PREVIEWED = 5
"""Streams of a coarse preview."""
PROBE_TIMES = 4
"""Impact times computed to estimate the cost of a geometry that is not in the cache."""


def _knob(name: str, model: type[Config], field: str, metavar: str | None = None) -> Any:
    """Option for one field of a configuration, described as the configuration describes it."""
    info = model.model_fields[field]
    text = info.description or field
    return typer.Option(
        name,
        help=text[0].upper() + text[1:] + ".",
        rich_help_panel="Angles" if model is EnsembleConfig else model.__name__,
        metavar=metavar,
        show_default=str(info.default) if isinstance(info.default, (int, float, str)) else False,
    )


def simulate_command(
    mass: Annotated[
        str | None,
        typer.Option("--mass", "-m", metavar="RANGE", help="Mass range in M☉, such as 1e3-1e5."),
    ] = None,
    component: Annotated[
        list[str] | None,
        typer.Option(
            "--component",
            metavar="RANGE[,rate=…]",
            help="Perturbers of one kind, as often as there are kinds: 1e3-1e5,rate=3,rs=0.4; also X, slope, "
            "cutoff, mhm, m_wdm (keV), profile, sigma, length.",
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option("--preset", metavar="NAME", help=f"Population with a name: {', '.join(PRESETS)}."),
    ] = None,
    stream: StreamOption = None,
    streams: Annotated[int | None, typer.Option("--streams", "-n", help="How many streams.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of all random numbers.")] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", "-w", min=1, help="Worker processes; one per core by default.")
    ] = None,
    executor: Annotated[
        Literal["inline", "processes", "dask"], typer.Option("--executor", help="Who computes.")
    ] = "processes",
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://…", help="Dask scheduler to compute on; implies dask."),
    ] = None,
    config: ConfigOption = None,
    cache: CacheOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print expected impacts and cost; write nothing.")
    ] = False,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="Compute a handful of streams from a coarse geometry of 8 impact times; write nothing.",
        ),
    ] = False,
    as_json: JsonOption = False,
    X: Annotated[float | None, _knob("--X", Perturbers, "X")] = None,
    rate_factor: Annotated[float | None, _knob("--rate-factor", Perturbers, "rate_factor")] = None,
    slope: Annotated[float | None, _knob("--slope", Perturbers, "slope")] = None,
    cutoff_mass: Annotated[float | None, _knob("--cutoff-mass", Perturbers, "cutoff_mass")] = None,
    profile: Annotated[
        Literal["hernquist", "plummer"] | None, _knob("--profile", Perturbers, "profile")
    ] = None,
    rs_factor: Annotated[float | None, _knob("--rs-factor", Perturbers, "rs_factor")] = None,
    sigma_h: Annotated[float | None, _knob("--sigma-h", Perturbers, "sigma_h")] = None,
    length_factor: Annotated[float | None, _knob("--length-factor", Perturbers, "length_factor")] = None,
    age: Annotated[float | None, _knob("--age", StreamModel, "age_gyr")] = None,
    sigma_v: Annotated[float | None, _knob("--sigma-v", StreamModel, "sigma_v_kms")] = None,
    arm: BothArmsOption = None,
    n_times: Annotated[int | None, _knob("--n-times", StreamModel, "n_times")] = None,
    times: Annotated[str | None, _knob("--times", StreamModel, "times_gyr", "T1,T2,…")] = None,
    flattening: Annotated[float | None, _knob("--q", LogarithmicHalo, "q")] = None,
    isochrone_b: Annotated[float | None, _knob("--isochrone-b", StreamModel, "isochrone_b")] = None,
    progenitor: Annotated[
        str | None, _knob("--progenitor", StreamModel, "progenitor", "R,vR,vT,z,vz,phi")
    ] = None,
    theta_min: Annotated[float | None, _knob("--theta-min", EnsembleConfig, "theta_min")] = None,
    theta_max: Annotated[float | None, _knob("--theta-max", EnsembleConfig, "theta_max")] = None,
    n_theta: Annotated[int | None, _knob("--n-theta", EnsembleConfig, "n_theta")] = None,
) -> None:
    """Simulate an ensemble of perturbed streams into the cache.

    What is in the cache already is not computed again: after Ctrl-C, a crash or a full disk the
    same command goes on where it ended. Accuracy settings are given through --config.
    """
    if mass is config is preset is None and not component:
        raise InputError("Say which mass range, for example --mass 1e3-1e5, or --component or --preset.")
    named = {
        "--mass": mass,
        "--X": X,
        "--rate-factor": rate_factor,
        "--slope": slope,
        "--cutoff-mass": cutoff_mass,
        "--profile": profile,
        "--rs-factor": rs_factor,
        "--sigma-h": sigma_h,
        "--length-factor": length_factor,
    }
    others = [option for option, value in named.items() if value is not None]
    changes = {
        "population": _population(component, preset, others),
        "perturbers.mass_range": mass,
        "n_streams": streams,
        "seed": seed,
        "perturbers.X": X,
        "perturbers.rate_factor": rate_factor,
        "perturbers.slope": slope,
        "perturbers.cutoff_mass": cutoff_mass,
        "perturbers.profile": profile,
        "perturbers.rs_factor": rs_factor,
        "perturbers.sigma_h": sigma_h,
        "perturbers.length_factor": length_factor,
        "stream.age_gyr": age,
        "stream.sigma_v_kms": sigma_v,
        "stream.n_times": n_times,
        "stream.times_gyr": _numbers("--times", times),
        "stream.potential.q": flattening,
        "stream.isochrone_b": isochrone_b,
        "stream.progenitor": _numbers("--progenitor", progenitor),
        "theta_min": theta_min,
        "theta_max": theta_max,
        "n_theta": n_theta,
    }
    wanted = [read_config(config, changes, stream, one) for one in arms_of(stream, arm, config)]
    where = make_cache(cache)
    results = []
    for one in wanted:
        if len(wanted) > 1 and not as_json:
            print(f"{stream_text(one.stream)}:")
        if preview:
            results.append(_preview(one, workers, as_json))
        elif dry_run:
            results.append(_estimate(one, where, workers, as_json))
        else:
            results.append(
                _simulate(one, where, "dask" if scheduler else executor, workers, scheduler, as_json)
            )
    if as_json:
        print_json(results if len(results) > 1 else results[0])


def _population(component: list[str] | None, preset: str | None, others: list[str]) -> Any:
    """The population of ``--component`` and ``--preset``; None without either."""
    if not component and preset is None:
        return None
    if component and preset is not None:
        raise InputError("--preset: leave it out where --component says what hits the stream.")
    name = "--component" if component else "--preset"
    if others:
        raise InputError(f"{others[0]}: leave it out where {name} says what hits the stream.")
    if component:
        population = Population(components=tuple(parse_component(text) for text in component))
    else:
        population = named_preset(preset or "").population
    for sentence in population.overlaps():
        messages.print(sentence, markup=False)
    return population.model_dump(mode="json")


def _numbers(option: str, text: str | None) -> list[float] | None:
    if text is None:
        return None
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option}: {text[:60]!r} is not a list of numbers joined by commas.") from None


def _simulate(
    config: EnsembleConfig,
    cache: Cache,
    executor: str,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
) -> dict[str, Any]:
    from streamdash.simulation.ensemble import Stopped, simulate
    from streamdash.simulation.workers import WorkerError

    # After Ctrl-C, Python's resource tracker would warn about semaphores of the workers that were ended.
    os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker:UserWarning")
    start = time.perf_counter()
    asked = threading.Event()
    try:
        with (
            _dask_client(executor, scheduler),
            progress_bar() as titled,
            _when_interrupted(asked.set),
            wrong_input(),
        ):
            simulate(
                config,
                executor,
                workers,
                cache,
                progress=titled(f"Streams {config.label}"),
                should_stop=asked.is_set,
                geometry_progress=titled("Geometry of the stream"),
                title=title_of(config.population) if len(config.population.components) > 1 else "",
            )
    except WorkerError as error:
        if not asked.is_set():  # else a worker that Ctrl-C reached all the same
            raise InputError(str(error)) from error
        _say_interrupted(config, cache)
        raise typer.Exit(130) from None
    except (KeyboardInterrupt, Stopped):
        _say_interrupted(config, cache)
        raise typer.Exit(130) from None
    entry = cache.covering(config) or cache.find(config.key)
    seconds = time.perf_counter() - start
    if not as_json:
        among = f" (the first of {entry.n_total})" if entry.key != config.key else ""
        print(f"{config.n_streams} streams of {entry.label} M☉{among} in {entry.path} ({duration(seconds)}).")
    return {
        "key": entry.key,
        "label": entry.label,
        "path": str(entry.path),
        "state": entry.state,
        "n_streams": entry.n_done,
        "size_bytes": entry.size_bytes,
        "cost_s": entry.cost_s,
        "seconds": seconds,
    }


def _preview(config: EnsembleConfig, workers: int | None, as_json: bool) -> dict[str, Any]:
    import numpy as np

    from streamdash.simulation.preview import coarse_preview, coarse_text
    from streamdash.simulation.workers import WorkerError

    start = time.perf_counter()
    try:
        with progress_bar() as titled, wrong_input():
            found = coarse_preview(config, PREVIEWED, workers, titled("Coarse geometry"))
    except WorkerError as error:
        raise InputError(str(error)) from error
    if found.streams is None:
        raise InputError(f"{found.impacts_per_stream:.3g} impacts a stream are too many for a preview.")
    spread = (found.streams.density / found.streams.smooth).std("theta").values
    result = {
        "preview": coarse_text(config),
        "impacts_per_stream": found.impacts_per_stream,
        "impacts": found.streams.n_impacts.values.tolist(),
        "std_q_rho": [float(f"{value:.4g}") for value in spread],
        "seconds": time.perf_counter() - start,
    }
    if not as_json:
        print(result["preview"])
        print(f"Expected impacts per stream: {found.impacts_per_stream:.2f}")
        for n, value in zip(result["impacts"], result["std_q_rho"], strict=True):
            print(f"  {n} impacts: Qρ spreads by {value:.3f} along the stream")
        print(
            f"Median spread of {len(spread)} streams: {np.median(spread):.3f} ({duration(result['seconds'])})"
        )
    return result


@contextlib.contextmanager
def _when_interrupted(ask: Callable[[], None]) -> Iterator[None]:
    """Have the first Ctrl-C call `ask`; a second one interrupts at once.

    An exception raised by a signal can come up where Python swallows it, as in a weak reference's
    callback; and a chunk that is nearly finished is worth waiting for.
    """

    def stop(*_: object) -> None:
        ask()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        messages.print("Stopping after the chunks that are being computed; Ctrl-C again stops at once.")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _say_interrupted(config: EnsembleConfig, cache: Cache) -> None:
    from streamdash.store.cache import CHUNK, StoreError

    done = 0
    with contextlib.suppress(StoreError):
        done = cache.find(config.key).n_done
    kept = f"{done} of {config.n_streams} streams ({-(-done // CHUNK)} chunks) are kept in the cache"
    messages.print(f"Interrupted: {kept}; the same command resumes there.", markup=False)


@contextlib.contextmanager
def _dask_client(executor: str, scheduler: str | None):
    from streamdash.simulation.limits import open_scheduler
    from streamdash.simulation.workers import cluster

    if executor != "dask":
        yield
        return
    if warning := open_scheduler(scheduler or ""):
        messages.print(warning, markup=False)
    with cluster(scheduler):
        yield


def _estimate(config: EnsembleConfig, cache: Cache, workers: int | None, as_json: bool) -> dict[str, Any]:
    from loky import cpu_count

    from streamdash.engine.impacts import expected_impacts
    from streamdash.simulation.ensemble import estimate
    from streamdash.store.cache import StoreError

    done = 0
    with contextlib.suppress(StoreError):
        done = cache.find(config.key).n_done
    workers = workers or cpu_count()
    with wrong_input():
        geometry, geometry_s = _probe(config.stream, cache, workers)
        cost = estimate(config, geometry)
    parts = [(component_text(p), expected_impacts(geometry, p)) for p in config.population.components]
    core_s = cost.seconds_per_stream * (config.n_streams - done)
    result = {
        "key": config.key,
        "impacts_per_stream": cost.impacts_per_stream,
        "components": [{"component": text, "impacts": n} for text, n in parts],
        "seconds_per_stream": cost.seconds_per_stream,
        "n_streams": config.n_streams,
        "n_done": done,
        "workers": workers,
        "geometry_seconds": geometry_s,
        "seconds": geometry_s + core_s / workers,
    }
    if as_json:
        return result
    print(f"Expected impacts per stream: {cost.impacts_per_stream:.2f}")
    for text, impacts in parts if len(parts) > 1 else ():
        print(f"  {text}: {impacts:.2f}")
    print(f"Time per stream on one core: {1e3 * cost.seconds_per_stream:.1f} ms")
    print(f"Streams to compute: {config.n_streams - done} of {config.n_streams}")
    if geometry_s:
        print(f"Geometry of this stream, not in the cache yet: about {duration(geometry_s)}")
    print(f"Estimated time with {workers} workers: {duration(geometry_s + core_s / workers)}")
    return result


def _probe(stream: StreamModel, cache: Cache, workers: int) -> tuple[Geometry, float]:
    """The stream's geometry, and how long it will take to compute: 0 when it is in the cache.

    Otherwise it is computed at a few of its impact times only, which gives the number of impacts
    to a few per mille, and is not stored.
    """
    from streamdash.engine.geometry import Geometry
    from streamdash.simulation.geometry import compute_geometry

    dataset = cache.open_geometry(stream)
    if dataset is not None:
        return Geometry.from_dataset(dataset, stream), 0.0
    times = stream.impact_times_gyr
    few = times[:: -(-len(times) // PROBE_TIMES)]
    messages.print(
        f"The stream's geometry is not in the cache: probing {len(few)} of its {len(times)} impact times."
    )
    start = time.perf_counter()
    geometry = compute_geometry(stream.model_copy(update={"times_gyr": few}), workers=workers)
    return geometry, (time.perf_counter() - start) * len(times) / len(few)
