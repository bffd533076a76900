"""What all browser sessions of one server process share. Passed in; never imported as a global."""

from __future__ import annotations

import functools
from typing import Any
from weakref import WeakSet

from loky import cpu_count

from app.services.bell import Bell
from app.services.cache_watch import CacheWatch
from app.services.classrooms import Classrooms
from app.services.results import MEMORY_BYTES, Results, Unavailable
from app.session.catalog import SHOWN, Catalog, read_catalog
from app.work.pool import Pool
from app.work.tasks import Work
from streamdash.observe.table import UploadLimit
from streamdash.simulation.jobs import Jobs, Limits
from streamdash.store.cache import Cache

__all__ = ["Services", "Unavailable", "process_services"]

WORKERS = (3, 8)
"""Fewest and most processes that train, classify and look ahead; else one a core."""
LABORATORY_S = 1800.0
"""Longest that one convergence test may take; by the clock ten times as long, as others do its work."""


class Services(Results):
    """Cache, geometries, ensembles and shared results of one server process.

    Parameters
    ----------
    cache
        The cache that sessions read.
    memory
        Bytes that shared results may keep.
    limits
        What may be simulated from a browser.
    uploads
        How large a table may be uploaded.

    Attributes
    ----------
    pool : Pool
        Worker processes for all that takes longer than a figure.
    work : Work
        Long computations with progress and cancel.
    quick : Work
        Those of about a second, for `app.work.later`.
    here : Work
        The same on a thread of this process: for what takes a fraction of a second and asks its session.
    laboratory : Work
        The same for simulations of convergence tests, which nothing else should wait for.
    jobs : Jobs
        Simulations in the background.
    bell : Bell
        Tells sessions of changes.
    sessions : WeakSet of Session
        Sessions that are open now.
    classrooms : Classrooms
        Classes that play the quiz together.
    watch : CacheWatch
        Notices new ensembles, once it is started.
    """

    def __init__(
        self,
        cache: Cache,
        memory: int = MEMORY_BYTES,
        limits: Limits | None = None,
        uploads: UploadLimit | None = None,
    ) -> None:
        super().__init__(cache, memory)
        self.jobs = Jobs(cache, limits)
        nice = self.jobs.limits.nice
        self.pool = Pool(min(max(cpu_count(), WORKERS[0]), WORKERS[1]), nice=nice)
        self.work = Work(self.pool)
        self.quick = Work(self.pool)
        self.here = Work()
        self.laboratory = Work(Pool(1, long_s=LABORATORY_S, nice=nice))
        self.uploads = uploads or UploadLimit()
        self.watch = CacheWatch(cache)
        self.bell = Bell()
        self.classrooms = Classrooms()
        self.sessions: WeakSet[Any] = WeakSet()

    def leave(self, session: Any) -> None:
        """A session has ended; its visitor's simulations are nobody's unless the same tab was loaded anew."""
        self.sessions.discard(session)
        if all(other.visitor != session.visitor for other in self.sessions):
            self.jobs.leave(session.visitor)

    def catalog(self) -> Catalog:
        """Streams and ensembles there are now."""
        return self.watch.catalog or read_catalog(self.cache.entries(SHOWN))


@functools.cache
def process_services() -> Services:
    """The one `Services` of this server process; only ``main.py`` calls this."""
    return Services(Cache.default(), limits=Limits(), uploads=UploadLimit())
