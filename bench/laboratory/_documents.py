"""The messages on a laboratory's bus, as JSON documents; docs/laboratory.md has the topics."""

from __future__ import annotations

import datetime as dt
from typing import Literal

from pydantic import Field

from bench.campaign import (
    CampaignEvent,
    CampaignPaused,
    CampaignPlanned,
    CampaignStopping,
    MissingRunsRetried,
    RealizationFinished,
    RealizationRetried,
    RealizationStarted,
    SessionProgressed,
)
from bench.contracts import Outcome
from bench.documents import Document

EventName = Literal[
    "planned",
    "waiting",
    "started",
    "progress",
    "retried",
    "finished",
    "result_lost",
    "retrying",
    "paused",
    "resumed",
    "stopping",
]
State = Literal["running", "waiting", "paused", "complete", "incomplete", "lost"]


class CampaignMessage(Document):
    """Something that happened in a campaign. Fields that an event does not have are null."""

    format: Literal["rebar.campaign-message/1"] = "rebar.campaign-message/1"
    campaign: str
    event: EventName
    number: int = Field(description="Counts the messages of one run from 1: a gap is a lost message.")
    sent_utc: dt.datetime
    realization: str | None = None
    worker: str | None = None
    attempt: int | None = None
    outcome: Outcome | None = None
    reason: str | None = None
    wall_s: float | None = Field(
        None, description="Host seconds that the session took, in `progress`: so far."
    )
    simulated_s: float | None = Field(None, description="Simulated seconds flown so far.")
    time_limit_s: float | None = Field(
        None, description="Simulated seconds after which the session ends; most end before."
    )
    speed: float | None = Field(
        None, description="Simulated seconds for each host second, since the progress before."
    )
    phase: str | None = Field(
        None, description="The phase that the agent stated last; null before the first."
    )
    pause_s: float | None = Field(None, description="Host seconds until the next attempt at the earliest.")
    done: int | None = Field(None, description="Realizations that have a result.")
    total: int | None = None


class CampaignStatus(Document):
    """Where a campaign stands. Retained: whoever subscribes gets the last one at once."""

    format: Literal["rebar.campaign-status/1"] = "rebar.campaign-status/1"
    campaign: str
    state: State = Field(
        description="`waiting`: for the test stand. `incomplete`: it ended with runs missing. `lost`: the broker "
        "lost the bench, which may fly on."
    )
    done: int = 0
    total: int = 0
    running: tuple[str, ...] = Field((), description="Realizations that are flown now.")
    outcomes: dict[str, int] = Field({}, description="Results of this run by outcome.")
    messages_dropped: int = Field(0, description="Messages that the broker could not be given in time.")
    sent_utc: dt.datetime | None = None


class StandMessage(Document):
    """What a test stand is told: that a session is about to start, or that one has ended."""

    format: Literal["rebar.stand-message/1"] = "rebar.stand-message/1"
    campaign: str
    session: Literal["next", "ended"]
    realization: str
    outcome: Outcome | None = None


def message_of(event: CampaignEvent, campaign: str, number: int, sent_utc: dt.datetime) -> CampaignMessage:
    """The message that tells an event of a campaign."""

    def message(name: EventName, **fields: object) -> CampaignMessage:
        return CampaignMessage.model_validate(
            {"campaign": campaign, "event": name, "number": number, "sent_utc": sent_utc, **fields}
        )

    match event:
        case CampaignPlanned(total, done):
            return message("planned", total=total, done=done)
        case RealizationStarted(realization, worker, attempt):
            return message("started", realization=realization, worker=worker, attempt=attempt)
        case SessionProgressed(realization, update):
            return message(
                "progress",
                realization=realization,
                wall_s=update.wall_s,
                simulated_s=update.simulated_s,
                time_limit_s=update.time_limit_s,
                speed=update.speed,
                phase=update.phase,
            )
        case RealizationRetried(realization, outcome, reason, pause_s):
            return message(
                "retried", realization=realization, outcome=outcome, reason=reason, pause_s=pause_s
            )
        case RealizationFinished(realization, outcome, reason, wall_s, done, total):
            return message(
                "finished",
                realization=realization,
                outcome=outcome,
                reason=reason,
                wall_s=wall_s,
                done=done,
                total=total,
            )
        case CampaignPaused(goes_on):
            return message("resumed" if goes_on else "paused")
        case MissingRunsRetried(_, done, total):
            return message("retrying", done=done, total=total)
        case CampaignStopping(reason):
            return message("stopping", reason=reason)
        case _:
            return message("result_lost", realization=event.realization)
