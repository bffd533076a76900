"""What the operator of a server allows those who simulate from their browsers."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from streamdash.config_environment import Settings

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
    max_disk_gb: Size = Field(2.0, description="disk for what people simulate; the least used goes first")

    @property
    def executor(self) -> str:
        """Who computes, as in `streamdash.workers.results`."""
        return "dask" if self.scheduler else "processes"
