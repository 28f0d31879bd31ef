"""Events of a campaign while it runs, and the observer that progress displays are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.contracts import Outcome


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
class RealizationRetried:
    """An attempt ended in a way that the host may have caused. The realization is flown again, `pause_s` host
    seconds later at the earliest.
    """

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
    | RealizationRetried
    | RealizationFinished
    | ResultLost
    | CampaignPaused
    | CampaignStopping
)
Observer = Callable[[CampaignEvent], None]
"""Called with every event. May fail: its exceptions are counted and change nothing."""


class Observers:
    """The observers of a run. Their failures are counted in `faults` and never reach the run."""

    def __init__(self, *observers: Observer | None) -> None:
        self._observers = [observer for observer in observers if observer is not None]
        self.faults = 0

    def notify(self, event: CampaignEvent) -> None:
        """Call every observer with the event."""
        for observer in self._observers:
            # A display that fails must not cost hours of flights.
            try:
                observer(event)
            except Exception:
                self.faults += 1
