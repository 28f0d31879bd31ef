"""A campaign: a folder in which every realization is flown once, however often it was interrupted.

from bench.campaign import load_asked, load_campaign, run_campaign
campaign = load_campaign("campaigns/demo.yaml")
summary = run_campaign(campaign, Path("out/demo"), load_asked(campaign.decomposition), workers=2)

What flies (`fly_realization`), measures (`load_asked`) and scores again (`rescore`) brings the simulator in and is
imported when first asked for; the documents, the journal and the runner are light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._design import campaign_quality as campaign_quality
from ._design import realizations as realizations
from ._document import Campaign as Campaign
from ._document import CampaignBudgets as CampaignBudgets
from ._document import Stopping as Stopping
from ._document import load_campaign as load_campaign
from ._events import CampaignEvent as CampaignEvent
from ._events import CampaignPlanned as CampaignPlanned
from ._events import CampaignStopping as CampaignStopping
from ._events import Observer as Observer
from ._events import RealizationFinished as RealizationFinished
from ._events import RealizationRetried as RealizationRetried
from ._events import RealizationStarted as RealizationStarted
from ._folder import CampaignFolder as CampaignFolder
from ._folder import Manifest as Manifest
from ._folder import digest_of as digest_of
from ._folder import read_result as read_result
from ._folder import verify_folder as verify_folder
from ._folder import write_manifest as write_manifest
from ._folder import write_result as write_result
from ._folder import write_whole as write_whole
from ._journal import Entry as Entry
from ._journal import Journal as Journal
from ._journal import State as State
from ._journal import open_journal as open_journal
from ._pool import Executor as Executor
from ._pool import OpenExecutor as OpenExecutor
from ._pool import open_local_pool as open_local_pool
from ._runner import CampaignSummary as CampaignSummary
from ._runner import Finish as Finish
from ._runner import outcomes_named as outcomes_named
from ._runner import run_campaign as run_campaign
from ._scenes import write_scenes as write_scenes
from ._settled import FLOWN_PAST as FLOWN_PAST
from ._settled import SettledPoint as SettledPoint
from ._task import BenchBroken as BenchBroken
from ._task import Ended as Ended
from ._task import Job as Job
from ._task import Task as Task
from ._task import WorkerPlan as WorkerPlan
from ._task import WorkersUnusable as WorkersUnusable
from ._versions import versions as versions

if TYPE_CHECKING:
    from ._estimate import CampaignEstimate as CampaignEstimate
    from ._estimate import estimate_campaign as estimate_campaign
    from ._finish import CampaignRuns as CampaignRuns
    from ._finish import Finished as Finished
    from ._finish import finish_campaign as finish_campaign
    from ._finish import is_campaign as is_campaign
    from ._finish import read_runs as read_runs
    from ._finish import rescore_campaign as rescore_campaign
    from ._fly import fly_realization as fly_realization
    from ._measuring import check_options as check_options
    from ._measuring import load_asked as load_asked
    from ._measuring import measure_all as measure_all
    from ._measuring import measures_of as measures_of
    from ._next import Proposal as Proposal
    from ._next import propose_next as propose_next
    from ._rescore import rescore as rescore

_HEAVY = {
    "CampaignEstimate": "_estimate",
    "CampaignRuns": "_finish",
    "Proposal": "_next",
    "Finished": "_finish",
    "estimate_campaign": "_estimate",
    "finish_campaign": "_finish",
    "fly_realization": "_fly",
    "is_campaign": "_finish",
    "check_options": "_measuring",
    "load_asked": "_measuring",
    "measure_all": "_measuring",
    "measures_of": "_measuring",
    "propose_next": "_next",
    "read_runs": "_finish",
    "rescore": "_rescore",
    "rescore_campaign": "_finish",
}


def __getattr__(name: str) -> Any:
    """What needs the simulator, imported when it is asked for."""
    if name not in _HEAVY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_HEAVY[name]}", __name__), name)
