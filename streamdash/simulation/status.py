"""What can be seen of a background job: a frozen picture, and the pace at which it gets on."""

from __future__ import annotations

from dataclasses import dataclass, field

from streamdash.config import EnsembleConfig

SETTLED_S = 1.0
ACTIVE = ("waiting", "elsewhere", "geometry", "running", "stopping")


@dataclass(frozen=True)
class JobStatus:
    """One job as it was last looked at.

    Attributes
    ----------
    key : of the ensemble's configuration.
    config, title : what is computed, and its name for people.
    state : str
        ``waiting`` for its turn, computed ``elsewhere`` by another process, computing the stream's
        ``geometry``, ``running``, ``stopping``; ``done``, ``cancelled`` or ``failed``.
    done : streams finished, in the cache.
    times_done : impact times of the geometry finished.
    per_second : streams, or while the geometry is computed impact times, a second; 0 when unknown.
    left_s : seconds until this step ends; None when unknown.
    error : why it failed, one sentence.
    owners : who waits for it.
    took_s : how long it took, once it is done.
    """

    key: str
    config: EnsembleConfig
    title: str
    state: str
    done: int
    times_done: int
    per_second: float = 0.0
    left_s: float | None = None
    error: str = ""
    owners: frozenset[str] = frozenset()
    took_s: float | None = None

    @property
    def active(self) -> bool:
        """Whether it has not ended."""
        return self.state in ACTIVE

    @property
    def n_streams(self) -> int:
        """Streams asked for."""
        return self.config.n_streams

    @property
    def n_times(self) -> int:
        """Impact times of the stream."""
        return len(self.config.stream.impact_times_gyr)

    @property
    def fraction(self) -> float:
        """How much of the step that it is in is done, 0 to 1."""
        if self.state == "geometry" or (self.active and self.times_done < self.n_times):
            return self.times_done / self.n_times
        return self.done / self.n_streams


@dataclass
class Pace:
    """How quickly a count rises.

    Until the first rise workers are only being started, and several finish at nearly the same time:
    the pace is measured from the first rise on, once `SETTLED_S` have passed since.
    """

    marks: list[tuple[float, int]] = field(default_factory=list)

    def note(self, now: float, count: int) -> None:
        """Look at the count at time `now` (s)."""
        if not self.marks or count < self.marks[-1][1]:
            self.marks = [(now, count)]
        elif count > self.marks[-1][1]:
            self.marks = [*self.marks[:2], (now, count)]

    @property
    def per_second(self) -> float:
        """Rises a second; 0 as long as that cannot be said."""
        if len(self.marks) < 3:
            return 0.0
        (start, before), (end, after) = self.marks[1], self.marks[2]
        return (after - before) / (end - start) if end - start >= SETTLED_S else 0.0

    def left(self, now: float, total: int) -> float | None:
        """Seconds until the count is `total`; None as long as that cannot be said."""
        if not self.per_second:
            return None
        end, count = self.marks[-1]
        return max((total - count) / self.per_second - (now - end), 0.0)
