"""What a campaign says of itself while it runs; progress displays listen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench.contracts import Outcome


@dataclass(frozen=True, slots=True)
class CampaignPlanned:
    """All realizations are known; `done` of them have a result from before."""

    total: int
    done: int


@dataclass(frozen=True, slots=True)
class RealizationStarted:
    """A worker begins a realization, for the `attempt`-th time."""

    realization: str
    worker: str
    attempt: int


@dataclass(frozen=True, slots=True)
class RealizationRetried:
    """A fault of the bench's own; the realization will be flown once more."""

    realization: str
    outcome: Outcome
    reason: str


@dataclass(frozen=True, slots=True)
class RealizationFinished:
    """A result stays; `done` of `total` have one."""

    realization: str
    outcome: Outcome
    reason: str
    wall_s: float
    done: int
    total: int


@dataclass(frozen=True, slots=True)
class CampaignStopping:
    """Nothing more is begun; running the campaign again goes on from here."""

    reason: str


CampaignEvent = CampaignPlanned | RealizationStarted | RealizationRetried | RealizationFinished | CampaignStopping
Observer = Callable[[CampaignEvent], None]
"""May fail: its exceptions are counted and change nothing."""
