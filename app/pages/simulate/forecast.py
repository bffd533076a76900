"""What the Simulate page says of a configuration before, while and after it is computed. No Panel."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from loky import cpu_count

from app.services.results import Results, Unavailable
from streamdash.classifier.data import Cancelled
from streamdash.config import EnsembleConfig
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import expected_impacts
from streamdash.simulation.jobs import JobStatus
from streamdash.simulation.limits import Limits
from streamdash.simulation.preview import Preview, coarse_preview, coarse_text, expectation, preview
from streamdash.store.cache import Cache, Entry
from streamdash.survey.bands import Bands, bin_angles, compute
from streamdash.words import is_or_are, number_of

PREVIEWED = 5
"""Streams shown before the start, and highlighted afterwards."""
FEWEST_FOR_BAND = 30
"""Of fewer streams no band of 68 % is drawn: its ends would be single streams."""
SHOWN_MAX = 2000
"""Streams that the figure shows while more are being computed."""


@dataclass(frozen=True)
class Forecast:
    """What is known of a configuration without computing its ensemble.

    Attributes
    ----------
    geometry_s : estimated seconds for the stream's geometry; 0 when it is there, NaN when unknown.
    n_done : streams of its own entry that are finished.
    covering : entry that holds all its streams already.
    n_shown : how many finished streams the panel shows, at most `SHOWN_MAX`.
    panel : the streams there are, for the figure; None when there are none.
    impacts : expected per stream of every component; empty when the geometry is not there.
    measured : whether the streams were looked at; before that, only what stands in the cache is known.
    """

    config: EnsembleConfig
    preview: Preview
    geometry_s: float
    n_done: int
    covering: Entry | None
    n_shown: int
    panel: Bands | None
    impacts: tuple[float, ...] = ()
    measured: bool = True


def glance(results: Results, configs: Sequence[EnsembleConfig], workers: int) -> tuple[Forecast, ...]:
    """What is known of every arm without computing a stream: a tenth of a second."""
    found = []
    for config in configs:
        geometry = _geometry(results, config)
        impacts = _impacts(geometry, config)
        expected = Preview(sum(impacts) if geometry else float("nan"), float("nan"), None)
        found.append(_known(results, config, workers, expected, geometry, measured=False))
    return tuple(found)


def look_ahead(results: Results, configs: Sequence[EnsembleConfig], workers: int) -> tuple[Forecast, ...]:
    """Expected impacts, time and first streams of every arm; a second or so each.

    Raises
    ------
    ValueError
        When galpy cannot build the stream.
    """
    return tuple(_forecast(results, config, workers) for config in configs)


def _forecast(results: Results, config: EnsembleConfig, workers: int) -> Forecast:
    first = config.model_copy(update={"n_streams": PREVIEWED})
    geometry = _geometry(results, config)
    if geometry is None:
        impacts = results.shared(("expectation", first.key), lambda: expectation(first))
        glimpse = Preview(impacts, float("nan"), None)
    else:
        known = geometry
        glimpse = results.shared(("preview", first.key), lambda: preview(first, known, PREVIEWED))
    found = _known(results, config, workers, dataclasses.replace(glimpse, streams=None), geometry)
    covering = found.covering
    finished = results.cache.open_finished(covering.key if covering else config.key, SHOWN_MAX)
    if finished is not None:  # a larger ensemble may have more
        finished = finished.isel(stream=finished.stream.values < config.n_streams)
    return dataclasses.replace(
        found,
        n_shown=0 if finished is None else finished.sizes["stream"],
        panel=panel_of(config, glimpse.streams, finished),
    )


def _known(
    results: Results,
    config: EnsembleConfig,
    workers: int,
    glimpse: Preview,
    geometry: Geometry | None,
    measured: bool = True,
) -> Forecast:
    cache = results.cache
    return Forecast(
        config,
        glimpse,
        0.0 if geometry is not None else _geometry_seconds(cache, config, workers),
        cache.streams_done(config),
        cache.covering(config),
        0,
        None,
        _impacts(geometry, config),
        measured,
    )


def _geometry(results: Results, config: EnsembleConfig) -> Geometry | None:
    try:
        return results.geometry(config.stream)
    except Unavailable:
        return None


def _impacts(geometry: Geometry | None, config: EnsembleConfig) -> tuple[float, ...]:
    if geometry is None:
        return ()
    return tuple(expected_impacts(geometry, part) for part in config.population.components)


def n_workers(limits: Limits) -> int:
    """Worker processes of this server, as far as it knows."""
    return limits.workers or cpu_count()


def panel_of(config: EnsembleConfig, glimpse: xr.Dataset | None, finished: xr.Dataset | None) -> Bands | None:
    """The streams there are as one panel of the Profiles figure, the first few highlighted."""
    shown = finished if finished is not None else glimpse
    if shown is None:
        return None
    panel = compute(bin_angles(shown, config), 0, "theta", 0.0, 0, 0)
    if shown.sizes["stream"] < FEWEST_FOR_BAND:
        none = np.full_like(panel.median, np.nan)
        panel = dataclasses.replace(panel, low=none, high=none, median=none)
    if glimpse is None:
        return panel
    first = bin_angles(glimpse, config)
    few = first.values.T
    hits = first.n_impacts if len(first.n_impacts) else np.zeros(len(few), dtype=np.int32)
    return dataclasses.replace(panel, streams=np.arange(len(few)), highlighted=few, impacts=hits)


def coarse_previews(
    configs: Sequence[EnsembleConfig],
    limits: Limits,
    progress: Callable[[int, int], None],
    should_stop: Callable[[], bool],
) -> list[Preview]:
    """A coarse preview of every arm, one after the other, for `app.work.tasks.Work.ask`.

    Raises
    ------
    ValueError
        When galpy cannot build a stream.
    Cancelled
        When `should_stop` said so.
    """
    found: list[Preview] = []

    def report(done: int, total: int) -> None:
        progress(len(found) * total + done, len(configs) * total)
        if should_stop():
            raise Cancelled

    for config in configs:
        found.append(coarse_preview(config, PREVIEWED, limits.workers, report, limits.nice))
    return found


# ---------------------------------------------------------------- words


def words_coarse(config: EnsembleConfig, found: Sequence[Preview], panels: Sequence[Bands]) -> str:
    """What a coarse preview shows."""
    impacts = " and ".join(f"{one.impacts_per_stream:.4g}" for one in found)
    return (
        f"{coarse_text(config)} {impacts} impacts are expected per stream; density relative to the smooth "
        f"stream, Qρ, along the parallel angle θ∥, of {len(panels[0].streams)} streams."
    )


def words_before(forecast: Forecast, workers: int) -> str:
    """What starting would mean: impacts, time, what is there already."""
    config, glimpse = forecast.config, forecast.preview
    words = ["Counting the expected impacts …"]
    if np.isfinite(glimpse.impacts_per_stream):
        words = [f"{glimpse.impacts_per_stream:.4g} impacts are expected per stream."]
    if forecast.covering is not None:
        total = forecast.covering.n_total
        among = f", the first of {total}" if total != config.n_streams else ""
        every = "The one stream is" if config.n_streams == 1 else f"All {config.n_streams} streams are"
        return f"{words[0]} {every} in the cache{among}: nothing has to be computed."
    missing = config.n_streams - forecast.n_done
    if forecast.geometry_s:
        times = len(config.stream.impact_times_gyr)
        about = "" if np.isnan(forecast.geometry_s) else f", about {duration(forecast.geometry_s)}"
        words.append(
            f"The geometry of this stream is not in the cache: it is computed first, {times} impact "
            f"times{about}, and kept for every later simulation of this stream."
        )
    if np.isfinite(glimpse.seconds_per_stream):
        seconds = glimpse.seconds_per_stream * missing / workers
        words.append(
            f"{number_of(missing, 'stream')} {'takes' if missing == 1 else 'take'} about "
            f"{duration(seconds)} on {number_of(workers, 'worker')} "
            f"({1e3 * glimpse.seconds_per_stream:.0f} ms each)."
        )
    elif not forecast.measured:
        words.append("Measuring how long a stream takes …" if not forecast.geometry_s else "")
    elif not forecast.geometry_s:
        words.append("So many impacts make a stream too slow for a preview.")
    if forecast.n_done:
        done = f"{forecast.n_done} of {config.n_streams} {is_or_are(forecast.n_done)}"
        words.append(f"{done} finished already and kept.")
    return " ".join(word for word in words if word)


def words_curves(forecast: Forecast, panel: Bands) -> str:
    """What the figure shows now."""
    along = "density relative to the smooth stream, Qρ, along the parallel angle θ∥"
    if not forecast.n_shown:
        first = number_of(len(panel.streams), "stream")
        return f"The {along}, of the first {first}, as they will be simulated; too few for a band."
    count = forecast.n_shown
    if count < FEWEST_FOR_BAND:
        return (
            f"{number_of(count, 'finished stream')} of {forecast.config.n_streams}: {along}. Too few for a "
            f"band: it is drawn from {FEWEST_FOR_BAND} on."
        )
    half = float(np.mean(panel.high - panel.low)) / 2
    return (
        f"{number_of(count, 'finished stream')} of {forecast.config.n_streams}: {along}. The band that holds "
        f"68 % of them has a half-width of {half:.2g}, averaged along the stream."
    )


def words_state(status: JobStatus) -> str:
    """What a job is doing, for people and screen readers; changes rarely."""
    times = f"{status.n_times} impact times"
    return {
        "waiting": "Waiting for its turn: another simulation is being computed on this server.",
        "elsewhere": "Another process is computing this; its progress is shown.",
        "geometry": f"Computing the geometry of the stream: {times}, once for all simulations of it.",
        "running": "Computing the streams.",
        "stopping": "Stopping after what is being computed now …",
        "cancelled": f"Cancelled; {status.done} of {status.n_streams} streams are kept.",
        "failed": status.error,
        "done": f"Done: {status.n_streams} streams"
        + (f" in {duration(status.took_s)}." if status.took_s is not None else "."),
    }[status.state]


def words_numbers(status: JobStatus) -> str:
    """How far a job is, how quickly it gets on, and when it will be done."""
    if status.state == "geometry":
        words, rate = f"{status.times_done} of {status.n_times} impact times", "{:.2g} a second"
    else:
        words, rate = f"{status.done} of {status.n_streams} streams", "{:.0f} a second"
    if status.active and status.per_second:
        words += f" · {rate.format(status.per_second)}"
        if status.left_s is not None:
            words += f" · {duration(status.left_s)} left"
    return words


def words_row(status: JobStatus) -> str:
    """A job in the list of all."""
    state = {"running": "", "elsewhere": "elsewhere", "geometry": "geometry"}.get(status.state, status.state)
    return " · ".join(part for part in (words_numbers(status), state) if part)


def duration(seconds: float) -> str:
    """A time for people, without false precision: ``2 s``, ``45 s``, ``4 min``, ``3.5 h``."""
    if seconds < 100:
        return f"{max(round(seconds), 1)} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _geometry_seconds(cache: Cache, config: EnsembleConfig, workers: int) -> float:
    """Seconds that a geometry will take, from what those in the cache took per impact time."""
    costs = [
        entry.cost_s / len(entry.config.impact_times_gyr)
        for entry in cache.entries()
        if entry.kind == "geometry" and entry.state == "complete" and entry.cost_s
    ]
    missing = len(config.stream.impact_times_gyr) - cache.times_done(config.stream)
    return float(np.median(costs)) * missing / workers if costs else float("nan")
