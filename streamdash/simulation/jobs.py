"""Simulations in the background of a server: submit, watch, cancel, resume.

A job is an `EnsembleConfig`; its identity is the configuration's hash, and all its progress is the
chunks and impact times that are finished in the cache. The same configuration asked for by two
sessions, two servers or the command line is therefore one job: the cache's lock decides who computes,
everybody else looks on. What is kept here, in memory, is only the queue of this process.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Iterator

from cachetools import LRUCache
from loky import cpu_count

from streamdash.config import EnsembleConfig
from streamdash.simulation.ensemble import Stopped, complete, prepare_workers
from streamdash.simulation.geometry import load_geometry
from streamdash.simulation.limits import Limits, Refused, check_impacts, check_size
from streamdash.simulation.queue import Job, check_room, paths, why_stopped
from streamdash.simulation.status import JobStatus
from streamdash.simulation.workers import WorkerError, cluster, is_ending, kill_workers
from streamdash.store.cache import Cache, StoreError
from streamdash.store.keeping import make_room, mark_used, room_for
from streamdash.store.titles import check_title

__all__ = ["JobStatus", "Jobs", "Limits", "Refused"]

log = logging.getLogger(__name__)

LOOK_S = 0.25
"""How often the progress of active jobs is read off the cache."""
PREPARED_MAX = 16
"""Most workers that are started before there is a job."""
KEPT = 50
"""Ended jobs that are remembered."""
TURN_S = 60.0
"""A job that computes for this long lets others go first, where those of another visitor wait."""
FORCE_S = 30.0
"""Workers of a job that took too long and does not end are killed after this long."""
LOOK_WAITING_S = 2.0
"""How often jobs that wait for their turn are looked at."""
UNEXPECTED = "The simulation failed unexpectedly; the server's log has the details."


class Jobs:
    """The queue of one process: one job computes at a time, with all workers.

    Parameters
    ----------
    cache : where results go, and where all progress is read.
    limits : what is allowed.

    Attributes
    ----------
    statuses : tuple of JobStatus
        Frozen picture of all jobs, the oldest first, replaced as a whole; safe to read anywhere.
    version : int
        Rises whenever `statuses` is replaced.
    """

    def __init__(self, cache: Cache, limits: Limits | None = None) -> None:
        self.cache = cache
        self.limits = limits or Limits()
        self.statuses: tuple[JobStatus, ...] = ()
        self.version = 0
        self._jobs: dict[str, Job] = {}
        self._current: str | None = None
        self._began = 0.0
        self._killed = False
        self._served: LRUCache[tuple[str, ...], int] = LRUCache(4096)
        self._turns = 0
        self._looked_at_all = -math.inf
        self._changed = threading.Condition()
        self._looking = threading.Lock()
        self._threads: list[threading.Thread] = []
        self._closed = self._prepare = False

    # ------------------------------------------------------------ asking

    def submit(self, config: EnsembleConfig, owner: str = "", title: str = "", place: str = "") -> str:
        """Have an ensemble computed, or join those who wait for the same.

        Parameters
        ----------
        config : what to compute.
        owner : who asks, for example a browser session's id.
        title : name for people; an ensemble keeps the first it was given.
        place : network address of who asks, where it is known: places take turns.

        Returns
        -------
        str
            Key of the job: that of the configuration. Nothing is queued when its streams are in the
            cache already.

        Raises
        ------
        Refused
            When a limit is exceeded.
        """
        try:
            title = check_title(title)
        except ValueError as error:
            raise Refused(f"The name cannot be used: {error}.") from None
        key = config.key
        with self._changed:
            job = self._jobs.get(key)
            if job is not None and not job.ended and not job.stop.is_set():
                job.owners.add(owner)
                return key
        if self.cache.covering(config) is not None:
            return key
        check_size(config, self.limits)
        if self.cache.open_geometry(config.stream) is not None:  # else it is checked once that is there
            check_impacts(config, load_geometry(config.stream, self.cache), self.limits)
        with self._changed:
            job = self._jobs.get(key)
            if job is not None and not job.ended and job.stop.is_set():
                raise Refused("This simulation is just being stopped; start it again in a moment.")
            check_room(self._jobs.values(), owner, place, self.limits)
            self._jobs.pop(key, None)
            self._jobs[key] = Job(config, title, {owner}, place)
            self._forget()
            self._start()
        self.look()
        return key

    def cancel(self, key: str, owner: str = "") -> None:
        """Withdraw from a job; it stops, keeping what is finished, when nobody else wants it.

        A job whose owners have all gone may be cancelled by anybody.
        """
        with self._changed:
            job = self._jobs.get(key)
            if job is None or job.ended or (job.owners and owner not in job.owners):
                return
            job.owners.discard(owner)
            if not job.owners:
                job.stop.set()
                if key != self._current:
                    job.ended = "cancelled"
            self._changed.notify_all()
        self.look()

    def leave(self, owner: str) -> None:
        """Forget an owner; the jobs go on, for whoever comes back for them."""
        with self._changed:
            for job in self._jobs.values():
                job.owners.discard(owner)

    def prepare(self) -> None:
        """Start the workers of this machine, so that the first streams of the next job come at once."""
        limits = self.limits
        if limits.scheduler or not limits.max_jobs or (limits.workers or cpu_count()) > PREPARED_MAX:
            return
        with self._changed:
            self._prepare = True
            self._start()

    def find(self, key: str) -> JobStatus | None:
        """The status of a job of this process, as it was last looked at."""
        return next((status for status in self.statuses if status.key == key), None)

    def wait(self, key: str, timeout: float) -> JobStatus | None:
        """The status of a job once it has ended, or after `timeout` seconds."""
        deadline = time.monotonic() + timeout
        while (status := self.find(key)) is not None and status.active and time.monotonic() < deadline:
            time.sleep(0.02)
        return status

    def close(self, timeout: float = 10) -> None:
        """Stop everything, keeping what is finished, and wait for the threads to end."""
        with self._changed:
            self._closed = True
            for job in self._jobs.values():
                job.stop.set()
            self._changed.notify_all()
            threads = list(self._threads)
        for thread in threads:
            thread.join(timeout)

    # ------------------------------------------------------------ limits

    def _forget(self) -> None:
        ended = [key for key, job in self._jobs.items() if job.ended]
        for key in ended[: max(len(ended) - KEPT, 0)]:
            del self._jobs[key]

    # ------------------------------------------------------------ working, on threads of our own

    def _start(self) -> None:
        """Start the two threads, unless they run."""
        if not self._threads:
            for target in (self._run, self._watch):
                thread = threading.Thread(target=target, name=f"jobs{target.__name__}", daemon=True)
                self._threads.append(thread)
                thread.start()
        self._changed.notify_all()

    def _run(self) -> None:
        """Compute one job after the other."""
        while True:
            with self._changed:
                while (job := self._next()) is None and not self._prepare:
                    if self._closed:
                        return
                    self._changed.wait(LOOK_S if self._active() else None)
                self._current = job.config.key if job else None
                self._began, self._killed = time.monotonic(), False
                self._prepare = False
                if job is not None:
                    self._turns += 1
                    for path in paths(job):
                        self._served[path] = self._turns
            if job is None:
                prepare_workers(self.cache, self.limits.workers, self.limits.nice)
                continue
            start = time.monotonic()
            ended, error = self._outcome(job)
            with self._changed:
                self._current = None
                job.spent_s += time.monotonic() - start
                if ended:  # else its turn is over, and it waits for the next
                    self._end(job, ended, error, job.spent_s)
                self._changed.notify_all()

    def _next(self) -> Job | None:
        """Of the jobs that wait and that no other process computes: the one whose visitor waited longest."""
        waiting = [job for job in self._jobs.values() if not job.ended and not job.stop.is_set()]
        for job in sorted(waiting, key=lambda job: [self._served.get(path, 0) for path in paths(job)]):
            if not self._elsewhere(job.config.key, job.config):
                return job
        return None

    def _turn_is_over(self, job: Job) -> bool:
        """Whether a job that is computed makes room for what others wait for; called often."""
        if time.monotonic() - self._began < TURN_S:
            return False
        with self._changed:
            return any(
                other is not job
                and not other.ended
                and not other.stop.is_set()
                and paths(other) != paths(job)
                for other in self._jobs.values()
            )

    def _elsewhere(self, key: str, config: EnsembleConfig) -> bool:
        return self.cache.busy(key) or self.cache.busy(config.stream.key)

    def _outcome(self, job: Job) -> tuple[str, str]:
        """How a job ended, and why it failed."""
        try:
            self._compute(job)
        except Stopped:
            return why_stopped(job, self.limits)
        except (StoreError, WorkerError, ValueError) as error:
            return why_stopped(job, self.limits) if job.too_long else ("failed", str(error))
        except Exception:
            log.exception("job %s failed", job.config.key)
            return "failed", UNEXPECTED
        return "done", ""

    def _compute(self, job: Job) -> None:
        """Compute a job; workers that are lost are replaced as long as it gets on."""
        config, limits = job.config, self.limits
        self.cache.check_writable()
        with self._changed:
            active = [key for key, other in self._jobs.items() if not other.ended]
        make_room(self.cache, room_for(config), int(limits.max_disk_gb * 1e9), keep=active)
        while True:
            before = self._progress(config)
            try:
                with self._workers():
                    self._attempt(job)
            except WorkerError as error:
                if self._progress(config) == before or job.stop.is_set() or is_ending():
                    raise
                log.warning("job %s goes on after: %s", config.key, error)
            else:
                mark_used(self.cache, config.key)
                return

    def _attempt(self, job: Job) -> None:
        config, limits = job.config, self.limits

        def should_stop() -> bool:
            return job.stop.is_set() or self._turn_is_over(job)

        def report(_done: int, _total: int) -> None:
            if should_stop():
                raise Stopped(0, config.n_streams)

        geometry = load_geometry(
            config.stream, self.cache, limits.workers, report, limits.executor, limits.nice
        )
        check_impacts(config, geometry, limits)
        complete(
            config,
            self.cache,
            limits.executor,
            limits.workers,
            should_stop=should_stop,
            nice=limits.nice,
            title=job.title,
        )

    def _progress(self, config: EnsembleConfig) -> tuple[int, int]:
        return self.cache.times_done(config.stream), self.cache.streams_done(config)

    @contextlib.contextmanager
    def _workers(self) -> Iterator[None]:
        if not self.limits.scheduler:
            yield
            return
        with cluster(self.limits.scheduler):
            yield

    # ------------------------------------------------------------ looking

    def _watch(self) -> None:
        """Replace `statuses` while jobs are active."""
        while True:
            self.look()
            self._end_what_takes_too_long()
            with self._changed:
                if self._closed:
                    return
                self._changed.wait(LOOK_S if self._active() else None)

    def _end_what_takes_too_long(self) -> None:
        """Stop the current job after its time; kill its workers when it does not listen."""
        with self._changed:
            job = self._jobs.get(self._current or "")
            if job is None:
                return
            now = time.monotonic()
            over = job.spent_s + now - self._began - 60 * self.limits.max_job_minutes
            if over > 0 and not job.stop.is_set():
                job.too_long = True
                job.stop.set()
            kill = (
                job.too_long and over > FORCE_S and not self._killed and self.limits.executor == "processes"
            )
            self._killed |= kill
        if kill:
            kill_workers()

    def look(self) -> None:
        """Read the progress of all active jobs off the cache, now."""
        with self._looking:
            with self._changed:
                jobs = list(self._jobs.values())
            before = {status.key: status for status in self.statuses}
            all_of_them = time.monotonic() - self._looked_at_all > LOOK_WAITING_S
            if all_of_them:
                self._looked_at_all = time.monotonic()
            statuses = tuple(self._picture(job, before.get(job.config.key), all_of_them) for job in jobs)
            if statuses != self.statuses:
                self.statuses = statuses
                self.version += 1

    def _picture(self, job: Job, before: JobStatus | None, thorough: bool) -> JobStatus:
        if job.ended and before is not None and before.state == job.ended:
            return before
        waits = before is not None and before.state == "waiting" and job.config.key != self._current
        if before is not None and waits and not job.ended and not thorough and before.owners == job.owners:
            return before  # its files need not be looked at this often
        config, key = job.config, job.config.key
        times, done = self._progress(config)
        if done == config.n_streams and key != self._current:
            with self._changed:  # another process has done it
                self._end(job, "done", "", None)
        state = job.ended or self._state(job, times)
        pace = job.times_pace if state == "geometry" else job.pace
        count = times if state == "geometry" else done
        now = time.monotonic()
        if state in ("geometry", "running", "elsewhere"):
            pace.note(now, count)
        total = len(config.stream.impact_times_gyr) if state == "geometry" else config.n_streams
        return JobStatus(
            key,
            config,
            job.title,
            state,
            done,
            times,
            0.0 if job.ended else pace.per_second,
            None if job.ended else pace.left(now, total),
            job.error,
            frozenset(job.owners),
            job.took_s,
        )

    def _state(self, job: Job, times: int) -> str:
        key = job.config.key
        if key == self._current:
            if job.stop.is_set():
                return "stopping"
            return "geometry" if times < len(job.config.stream.impact_times_gyr) else "running"
        return "elsewhere" if self._elsewhere(key, job.config) else "waiting"

    def _end(self, job: Job, ended: str, error: str, took_s: float | None) -> None:
        if not job.ended:
            job.ended, job.error, job.took_s = ended, error, took_s if ended == "done" else None

    def _active(self) -> bool:
        return any(not job.ended for job in self._jobs.values())
