"""Campaigns: a folder in which every realization is flown once, however often the run is interrupted.

from bench.campaign import RunOptions, load_campaign, run_campaign_sync
campaign = load_campaign("campaigns/demo.yaml")
summary = run_campaign_sync(campaign, Path("out/demo"), RunOptions(workers=2))

In a notebook, or any other coroutine: `summary = await run_campaign(...)`.

Every name is imported at its first use: a worker needs neither planning nor journal, and `rebar --help` neither
the simulator nor the measures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.lazy import lazy_names

if TYPE_CHECKING:
    from ._document import Campaign as Campaign
    from ._document import CampaignAgent as CampaignAgent
    from ._document import CampaignBudgets as CampaignBudgets
    from ._document import FloorPlan as FloorPlan
    from ._document import Keep as Keep
    from ._document import Situation as Situation
    from ._document import Stopping as Stopping
    from ._document import load_campaign as load_campaign
    from ._document import parse_shard as parse_shard
    from ._document import question_sha256 as question_sha256
    from ._document import with_floor as with_floor
    from ._events import CampaignEvent as CampaignEvent
    from ._events import CampaignPaused as CampaignPaused
    from ._events import CampaignPlanned as CampaignPlanned
    from ._events import CampaignStopping as CampaignStopping
    from ._events import MissingRunsRetried as MissingRunsRetried
    from ._events import Observer as Observer
    from ._events import RealizationFinished as RealizationFinished
    from ._events import RealizationRetried as RealizationRetried
    from ._events import RealizationStarted as RealizationStarted
    from ._events import ResultLost as ResultLost
    from ._events import SessionProgressed as SessionProgressed
    from ._parallel import OnDone as OnDone
    from ._parallel import WorkersUnusable as WorkersUnusable
    from ._runner import CampaignSummary as CampaignSummary
    from ._runner import Collaborators as Collaborators
    from ._runner import Finish as Finish
    from ._runner import RunOptions as RunOptions
    from ._runner import run_campaign as run_campaign
    from ._runner import run_campaign_sync as run_campaign_sync
    from ._versions import versions as versions
    from .early_stopping._decisions import FLOWN_AFTER_STOP as FLOWN_AFTER_STOP
    from .early_stopping._decisions import EarlyStop as EarlyStop
    from .execution._dispatcher import StartGate as StartGate
    from .execution._dispatcher import no_gate as no_gate
    from .execution._event_loop import HostClock as HostClock
    from .execution._executor import BenchBroken as BenchBroken
    from .execution._executor import Executor as Executor
    from .execution._executor import Job as Job
    from .execution._executor import Jobs as Jobs
    from .execution._executor import OnStart as OnStart
    from .execution._executor import OpenExecutor as OpenExecutor
    from .execution._executor import Task as Task
    from .execution._executor import WorkerPlan as WorkerPlan
    from .execution._local_pool import fly_realization as fly_realization
    from .execution._local_pool import open_local_pool as open_local_pool
    from .next_campaign._proposal import CampaignProposal as CampaignProposal
    from .next_campaign._proposal import propose_next as propose_next
    from .planning._estimate import CampaignEstimate as CampaignEstimate
    from .planning._estimate import estimate_campaign as estimate_campaign
    from .planning._evidence_check import check_run as check_run
    from .planning._evidence_check import verify_folder as verify_folder
    from .planning._measures import check_options as check_options
    from .planning._measures import load_measurable_decomposition as load_measurable_decomposition
    from .planning._measures import measure_all as measure_all
    from .planning._measures import measures_of as measures_of
    from .planning._realizations import campaign_quality as campaign_quality
    from .planning._realizations import realizations as realizations
    from .planning._realizations import situation_difficulties as situation_difficulties
    from .planning._realizations import situation_tensions as situation_tensions
    from .planning._scenes import write_scenes as write_scenes
    from .planning._takeoff_faults import takeoff_faults as takeoff_faults
    from .results._finish import CampaignRuns as CampaignRuns
    from .results._finish import FinishedCampaign as FinishedCampaign
    from .results._finish import campaign_completeness as campaign_completeness
    from .results._finish import finish_campaign as finish_campaign
    from .results._finish import read_runs as read_runs
    from .results._finish import rescore_campaign as rescore_campaign
    from .results._merge import merge_shards as merge_shards
    from .results._refly import ReflownRun as ReflownRun
    from .results._refly import ReflownSample as ReflownSample
    from .results._refly import ReflownStatus as ReflownStatus
    from .results._refly import refly as refly
    from .results._rescore import rescore as rescore
    from .results._state import CampaignState as CampaignState
    from .results._state import campaign_state as campaign_state
    from .storage._completeness import Completeness as Completeness
    from .storage._completeness import parse_accepted_outcomes as parse_accepted_outcomes
    from .storage._file_system import check_file_system as check_file_system
    from .storage._files import digest_of as digest_of
    from .storage._files import write_whole as write_whole
    from .storage._folder import CampaignFolder as CampaignFolder
    from .storage._folder import is_campaign as is_campaign
    from .storage._journal import Journal as Journal
    from .storage._journal import JournalEntry as JournalEntry
    from .storage._journal import RealizationState as RealizationState
    from .storage._journal_file import open_journal as open_journal
    from .storage._journal_file import open_journal_to_read as open_journal_to_read
    from .storage._manifest import Manifest as Manifest
    from .storage._pause import pause_campaign as pause_campaign
    from .storage._pause import request_retry as request_retry
    from .storage._pause import resume_campaign as resume_campaign
    from .storage._recovery import parse_rerun_outcomes as parse_rerun_outcomes
    from .storage._results import read_result as read_result
    from .storage._results import write_result as write_result
    from .storage._signature import can_check_signatures as can_check_signatures
    from .storage._signature import fingerprint_of as fingerprint_of
    from .storage._signature import read_signature as read_signature
    from .storage._signature import sign_manifest as sign_manifest
    from .storage._signature import signature_faults as signature_faults

__getattr__ = lazy_names(__name__)
