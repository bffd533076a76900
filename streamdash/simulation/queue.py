"""Entries of the queue of simulations: who may add one, whose turn it is, and why one ended."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass, field

from streamdash.config import EnsembleConfig
from streamdash.simulation.limits import Limits, Refused
from streamdash.simulation.status import Pace


@dataclass
class Job:
    """One entry of the queue. Written under the queue's lock."""

    config: EnsembleConfig
    title: str
    owners: set[str]
    place: str = ""
    """Network address of who asked first; empty when it is not known."""
    ended: str = ""
    """``done``, ``cancelled`` or ``failed``; empty until then."""
    error: str = ""
    took_s: float | None = None
    spent_s: float = 0.0
    """How long it has been computed, in the turns that are over."""
    too_long: bool = False
    stop: threading.Event = field(default_factory=threading.Event)
    pace: Pace = field(default_factory=Pace)
    times_pace: Pace = field(default_factory=Pace)


def paths(job: Job) -> tuple[tuple[str, ...], ...]:
    """Who takes turns: network addresses first, then those at one address."""
    who = min(job.owners, default="")
    return (job.place,), (job.place, who)


def check_room(jobs: Iterable[Job], owner: str, place: str, limits: Limits) -> None:
    """Refuse another job where there are enough: on this server, of this owner, of this network address.

    Raises
    ------
    Refused
    """
    active = [job for job in jobs if not job.ended]
    if len(active) >= limits.max_jobs:
        raise Refused(
            f"This server runs or queues {limits.max_jobs} simulations at most, and so many there are; "
            "try again when one has ended."
        )
    if sum(owner in job.owners for job in active) >= limits.max_jobs_per_session:
        raise Refused(
            f"{limits.max_jobs_per_session} simulations of yours are running or waiting, as many as "
            "this server allows; cancel one or wait for it."
        )
    if place and sum(job.place == place for job in active) >= limits.max_jobs_per_address:
        raise Refused(
            f"{limits.max_jobs_per_address} simulations from your network address are running or "
            "waiting, as many as this server allows; cancel one or wait for it."
        )


def why_stopped(job: Job, limits: Limits) -> tuple[str, str]:
    """How a job that was stopped has ended, and why; empty when only its turn is over."""
    if job.too_long:
        return "failed", (
            f"This took longer than the {limits.max_job_minutes:g} minutes that this server gives to one "
            "simulation; what is finished is kept. Ask for fewer streams, a narrower mass range or a stream "
            "closer to the examples."
        )
    return ("cancelled", "") if job.stop.is_set() else ("", "")
