"""The end of a campaign: scores and report, and what they need loaded while the last sessions fly."""

from __future__ import annotations

import os
from collections.abc import Callable
from threading import Lock
from typing import TYPE_CHECKING

from bench.campaign import (
    CampaignEvent,
    CampaignPlanned,
    MissingRunsRetried,
    RealizationFinished,
    RealizationStarted,
)

if TYPE_CHECKING:
    from bench.campaign import CampaignFolder, FinishedCampaign


class CampaignEnd:
    """Scores and report of a campaign, once all have flown.

    Statistics, figures and their libraries take longer to load than the first session to start, so they are loaded late:
    as soon as a core has nothing left to fly. `finished` is None until scores and report are written.
    """

    def __init__(self, cores: int | None = None, load: Callable[[], None] | None = None) -> None:
        """`cores` are those that sessions share (default: those that this process may use). `load` imports what the end
        needs, each time that it is called.
        """
        self.finished: FinishedCampaign | None = None
        self._cores = cores or len(os.sched_getaffinity(0))
        self._load_parts = load or _load_parts
        self._remaining: int | None = None
        # A thread may get half of a module that another one is importing, where modules import each other.
        self._loading = Lock()

    def observe(self, event: CampaignEvent) -> None:
        """An observer of the campaign. It may take a second: each observer has a thread of its own."""
        if isinstance(event, CampaignPlanned | MissingRunsRetried | RealizationFinished):
            self._remaining = event.total - event.done
        # Not when the campaign is planned: until a session starts, the runner imports as well.
        if (
            isinstance(event, RealizationStarted | RealizationFinished)
            and self._remaining
            and self._remaining < self._cores
        ):
            self._load()

    def finish(self, folder: CampaignFolder) -> bool:
        """Write scores, report and manifest. True, as the runner is to know that the manifest is written."""
        self._load()
        from bench.campaign import finish_campaign

        self.finished = finish_campaign(folder.path)
        return True

    def _load(self) -> None:
        with self._loading:
            self._load_parts()


def _load_parts() -> None:
    from bench.campaign import finish_campaign  # noqa: F401
    from bench.reporting import load_page_parts

    load_page_parts()
