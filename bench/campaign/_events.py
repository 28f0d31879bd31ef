"""Events of a campaign while it runs, and their streams to observers such as progress displays."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from bench.contracts import Outcome, ProgressUpdate


@dataclass(frozen=True, slots=True)
class CampaignPlanned:
    """All realizations are known. `done` of `total` have a result from an earlier run."""

    total: int
    done: int


@dataclass(frozen=True, slots=True)
class RealizationStarted:
    """A worker starts a realization, for the `attempt`-th time."""

    realization: str
    worker: str
    attempt: int


@dataclass(frozen=True, slots=True)
class SessionProgressed:
    """How far the session of a running realization is, every two host seconds at most.

    An observer that is slow gets the newest one alone, and none once the attempt has ended.
    """

    realization: str
    update: ProgressUpdate


@dataclass(frozen=True, slots=True)
class RealizationRetried:
    """An attempt ended in a way that the host may have caused: flown again in `pause_s` host seconds or later."""

    realization: str
    outcome: Outcome
    reason: str
    pause_s: float


@dataclass(frozen=True, slots=True)
class RealizationFinished:
    """A realization has its lasting result. `done` of `total` have one."""

    realization: str
    outcome: Outcome
    reason: str
    wall_s: float
    done: int
    total: int


@dataclass(frozen=True, slots=True)
class ResultLost:
    """A realization had a result whose files are gone. It is flown again."""

    realization: str


@dataclass(frozen=True, slots=True)
class MissingRunsRetried:
    """Somebody asked for the missing runs while the campaign runs: the results of these realizations are set aside,
    and `done` of `total` are left. What waited for a retry waits no longer.
    """

    realizations: tuple[str, ...]
    done: int
    total: int


@dataclass(frozen=True, slots=True)
class CampaignPaused:
    """Somebody has paused the campaign, or, with `goes_on`, lets it go on."""

    goes_on: bool


@dataclass(frozen=True, slots=True)
class CampaignStopping:
    """Nothing more is started. Running the campaign again resumes it."""

    reason: str


CampaignEvent = (
    CampaignPlanned
    | RealizationStarted
    | SessionProgressed
    | RealizationRetried
    | RealizationFinished
    | ResultLost
    | MissingRunsRetried
    | CampaignPaused
    | CampaignStopping
)
Observer = Callable[[CampaignEvent], None]
"""Called with every event, from a thread of its own. May fail, and take as long as it likes."""

MAX_WAITING_EVENTS = 10_000
"""Events that wait for an observer that is slow: some 2 MB. Chosen."""
CLOSING_S = 5.0
"""Host seconds that all observers together have for the last events. Chosen: a person waits for them."""


class _EventStream:
    """The events on their way to one observer. Of too many the oldest is dropped and counted: a display needs the newest."""

    def __init__(self, observer: Observer, limit: int) -> None:
        self._observer, self._limit = observer, limit
        self._waiting: deque[CampaignEvent] = deque()
        # Apart from the others, which it must never push out, and delivered after them.
        self._progress: dict[str, SessionProgressed] = {}
        self._changed = threading.Condition()
        self._closed = False
        self.faults = self.dropped = 0
        # A thread, not a task of the runner's event loop: planning and scoring have events too, and a display that
        # blocks would block the loop.
        self.thread = threading.Thread(target=self._deliver, name="campaign-observer", daemon=True)
        self.thread.start()

    def put(self, event: CampaignEvent) -> None:
        with self._changed:
            if isinstance(event, SessionProgressed):
                self._progress[event.realization] = event
            else:
                self._append(event)
            self._changed.notify()

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify()

    def abandon(self) -> None:
        """Drop what waits: the observer did not take it in time."""
        with self._changed:
            self.dropped += len(self._waiting)
            self._waiting.clear()

    def _append(self, event: CampaignEvent) -> None:
        if isinstance(event, RealizationFinished | RealizationRetried):
            self._progress.pop(event.realization, None)
        if len(self._waiting) >= self._limit:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(event)

    def _deliver(self) -> None:
        while (event := self._next()) is not None:
            # A display that fails must not cost hours of flights.
            try:
                self._observer(event)
            except Exception:
                self.faults += 1

    def _next(self) -> CampaignEvent | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._progress or self._closed)
            if self._waiting:
                return self._waiting.popleft()
            if self._closed:
                return None
            return self._progress.pop(next(iter(self._progress)))


class Observers:
    """The observers of a run. None of them can slow or fail it, or keep an event from another."""

    def __init__(self, streams: list[_EventStream]) -> None:
        self._streams = streams

    @property
    def faults(self) -> int:
        """Calls of observers that raised."""
        return sum(stream.faults for stream in self._streams)

    @property
    def dropped(self) -> int:
        """Events that an observer did not get, because it was too slow."""
        return sum(stream.dropped for stream in self._streams)

    def notify(self, event: CampaignEvent) -> None:
        """Send an event to every observer. Returns at once."""
        for stream in self._streams:
            stream.put(event)

    def close(self, span_s: float = CLOSING_S) -> None:
        """Wait until every observer has every event, for `span_s` host seconds at most. Doing it again does nothing."""
        for stream in self._streams:
            stream.close()
        end = time.monotonic() + span_s
        for stream in self._streams:
            stream.thread.join(max(0.0, end - time.monotonic()))
            stream.abandon()


@contextmanager
def open_observers(*observers: Observer, limit: int = MAX_WAITING_EVENTS) -> Iterator[Observers]:
    """Yield streams to these observers, each with room for `limit` events. Leaving the block delivers what waits."""
    opened = Observers([_EventStream(observer, limit) for observer in observers])
    try:
        yield opened
    finally:
        opened.close()
