"""What the operator of a server allows those who simulate from their browsers."""

from __future__ import annotations

import ipaddress
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import Field

from streamdash.config import EnsembleConfig
from streamdash.engine.geometry import Geometry
from streamdash.engine.impacts import expected_impacts
from streamdash.settings import Settings
from streamdash.store.keeping import room_for

Size = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Limits(Settings):
    """Limits and resources of background jobs."""

    workers: int | None = Field(None, ge=1, le=1024, description="worker processes; one per core by default")
    scheduler: str = Field("", max_length=200, description="Dask scheduler, tcp://…, to compute on instead")
    nice: int = Field(10, ge=0, le=19, description="how much workers stand back for the page itself")
    max_streams: int = Field(20_000, ge=1, le=1_000_000, description="streams of one job")
    max_impacts: Size = Field(5e7, description="impacts expected in all streams of one job")
    max_jobs: int = Field(20, ge=0, le=1000, description="jobs that wait or run at the same time")
    max_jobs_per_session: int = Field(3, ge=0, le=1000, description="those of one browser session")
    max_jobs_per_address: int = Field(10, ge=0, le=1000, description="those of one network address")
    max_job_minutes: Size = Field(120.0, description="computing time of one job, its geometry included")
    max_disk_gb: Size = Field(2.0, description="disk for what people simulate; the least used goes first")

    @property
    def executor(self) -> str:
        """Who computes, as in `streamdash.simulation.workers.results`."""
        return "dask" if self.scheduler else "processes"


class Refused(ValueError):
    """A job that is not begun; the message is one sentence that says what to change."""


def open_scheduler(address: str) -> str:
    """What to know before a Dask scheduler is used; empty when nothing.

    Dask sends pickles, and whoever can send one to a scheduler, a worker or a client has their code run
    there. Addresses of this machine alone, and connections by TLS, are no matter of the network.

    Parameters
    ----------
    address : str
        tcp://HOST:PORT, tls://HOST:PORT, …; empty for none.

    Returns
    -------
    sentence : str
    """
    parts = urlsplit(address if "://" in address else f"tcp://{address}")
    if not address or parts.scheme in ("tls", "wss", "inproc") or _is_here(parts.hostname or ""):
        return ""
    return (
        f"The Dask scheduler {address} is asked over the network without encryption or a check of who "
        "answers: everyone who reaches it can run programs on its workers and on this machine. Use tls:// "
        "(see docs/deployment.md), or a network that nobody else is in."
    )


def _is_here(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_size(config: EnsembleConfig, limits: Limits) -> None:
    """Refuse an ensemble of more streams, or more disk, than is allowed.

    Raises
    ------
    Refused
    """
    if config.n_streams > limits.max_streams:
        raise Refused(
            f"{config.n_streams} streams are more than the {limits.max_streams} that this server "
            "allows in one simulation; ask for fewer."
        )
    if room_for(config) > limits.max_disk_gb * 1e9:
        raise Refused(
            f"This ensemble needs up to {room_for(config) / 1e9:.2g} GB of disk, more than the "
            f"{limits.max_disk_gb:g} GB that this server allows; ask for fewer streams."
        )


def check_impacts(config: EnsembleConfig, geometry: Geometry, limits: Limits) -> None:
    """Refuse an ensemble that would take too long: the time grows with the impacts.

    Raises
    ------
    Refused
    """
    per_stream = expected_impacts(geometry, config.population)
    if per_stream * config.n_streams > limits.max_impacts:
        raise Refused(
            f"{config.n_streams} streams with {per_stream:.3g} impacts each are more than the "
            f"{limits.max_impacts:.3g} impacts that this server allows in one simulation; ask for "
            "fewer streams or a narrower mass range."
        )
