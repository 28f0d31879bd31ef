"""Where a campaign stands, read from its folder while it runs or afterwards; nothing is changed by looking."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Literal

from pydantic import Field

from bench.contracts import Outcome
from bench.documents import Document, load_document

from .._document import Campaign
from ..storage._completeness import noted_completeness
from ..storage._folder import existing_campaign, writing_process
from ..storage._journal import RealizationState
from ..storage._journal_file import open_journal_to_read
from ..storage._pause import is_paused


class CampaignState(Document):
    """A campaign's folder at one moment."""

    format: Literal["rebar.campaign-state/1"] = "rebar.campaign-state/1"
    campaign: str
    folder: str
    process: str | None = Field(description="The process that runs it now; null if none does.")
    paused: bool
    complete: bool = Field(description="Whether every run counts, was not needed, or is accepted as missing.")
    total: int
    done: int
    outcomes: dict[str, int] = Field(description="Results by outcome.")
    missing: dict[str, int] = Field(description="Runs that do not count yet, by outcome or `not finished`.")
    running: tuple[str, ...] = Field(description="Realizations that are flown now.")
    retried: int = Field(description="Realizations that took more than one attempt.")
    left_s: float | None = Field(
        description="Host seconds until the end if sessions take as long as the median so far, at as many at a time "
        "as fly now. Null while nothing flies, and before the first result."
    )


def campaign_state(folder: Path) -> CampaignState:
    """Where the campaign of a folder stands. Raises SetupError for a folder that is no campaign's."""
    paths = existing_campaign(folder)
    campaign = load_document(paths.campaign, Campaign)
    process = writing_process(folder)
    with open_journal_to_read(paths.journal) as journal:
        entries = journal.entries()
        completeness = noted_completeness(journal)
    # A runner that was killed leaves what it flew as running.
    running = [entry.id for entry in entries if process and entry.state is RealizationState.RUNNING]
    waiting = sum(entry.state is RealizationState.PLANNED for entry in entries)
    return CampaignState(
        campaign=campaign.name,
        folder=str(folder),
        process=process,
        paused=is_paused(folder),
        complete=completeness.complete,
        total=len(entries),
        done=sum(entry.state is RealizationState.DONE for entry in entries),
        outcomes=dict(
            sorted(Counter(str(entry.outcome) for entry in entries if entry.outcome is not None).items())
        ),
        missing=dict(sorted(completeness.missing.items())),
        running=tuple(running),
        retried=sum(entry.attempts > 1 for entry in entries),
        left_s=_left_s(
            [entry.wall_s for entry in entries if entry.wall_s and entry.outcome is not Outcome.SETTLED],
            waiting,
            len(running),
        ),
    )


def _left_s(walls_s: list[float], waiting: int, running: int) -> float | None:
    """Of those that fly, half of the median is still to come, on average."""
    if not walls_s or not running:
        return None
    median_s = sorted(walls_s)[len(walls_s) // 2]
    return (waiting / running + 0.5) * median_s
