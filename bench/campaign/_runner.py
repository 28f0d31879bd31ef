"""Runs a campaign: every realization gets one result, whatever happens to sessions, workers or the runner
itself.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench.contracts import Outcome
from bench.documents import load_document

from ._document import Campaign
from ._events import CampaignPaused, CampaignPlanned, Observer, Observers, ResultLost, open_observers
from ._overhead import OVERHEAD, check_fidelity, flown_overhead, job_at
from ._versions import arithmetic, versions
from .early_stopping._decisions import check_stopping, outcome_name
from .early_stopping._early_stopping import EarlyStopping
from .execution._blocking import blocking, first_error_alone
from .execution._dispatcher import Deadline, Dispatcher, StartGate, no_gate
from .execution._executor import OpenExecutor
from .execution._pool import open_local_pool
from .execution._retention import Retention
from .execution._retries import Retries
from .execution._run_clock import HostClock, MonotonicClock
from .execution._stop_request import open_stop_request
from .execution._suspects import SuspectWatch, no_memory_kills, scenes_of, watch_for_agents
from .execution._task import FLIGHT_JOB, FORFEIT_JOB, WorkerPlan
from .planning._evidence_check import check_evidence
from .planning._plan import CheckTakeoff, finish_infeasible, plan_campaign
from .storage._completeness import (
    Completeness,
    accepted_realizations,
    completeness_of,
    parse_accepted_outcomes,
)
from .storage._completeness import accept as accept_outcomes
from .storage._firmware_ends import drawn_out_realizations
from .storage._folder import CampaignFolder, open_lock
from .storage._journal import Journal, open_journal
from .storage._manifest import write_manifest
from .storage._pause import is_paused, take_retry_request
from .storage._recovery import parse_rerun_outcomes, reconcile, reset_for_rerun

if TYPE_CHECKING:
    from decompositions import Decomposition

Finish = Callable[[CampaignFolder], object]
"""Writes scores and report of a campaign that has all its results. `manifest.json` is written after it, unless it returns
True: then it has written the manifest itself, at its end.
"""


@dataclass(frozen=True, slots=True)
class CampaignSummary:
    """How a run of a campaign ended.

    `flown` counts the results of this run, `outcomes` all results in the folder. `completeness` says which
    runs are missing. `observer_faults` counts the calls of observers that raised, `events_dropped` the events that an
    observer was too slow for.
    """

    folder: Path
    total: int
    flown: int
    outcomes: Mapping[Outcome, int]
    completeness: Completeness
    stopped: str | None
    observer_faults: int
    events_dropped: int
    wall_s: float

    @property
    def done(self) -> int:
        """Realizations that have a result."""
        return sum(self.outcomes.values())

    @property
    def complete(self) -> bool:
        """Whether every realization has a result that counts, was not needed, or is accepted as missing."""
        return self.completeness.complete


async def run_campaign(
    campaign: Campaign,
    folder: Path,
    decomposition: Decomposition,
    *,
    workers: int | None = None,
    observers: Sequence[Observer] = (),
    finish: Finish | None = None,
    rerun: Collection[Outcome] = (),
    accept: Collection[Outcome] = (),
    job: str = FLIGHT_JOB,
    forfeit_job: str | None = None,
    confined_job: str | None = None,
    memory_kills: Callable[[], int] | None = None,
    open_executor: OpenExecutor = open_local_pool,
    clock: HostClock | None = None,
    gate: StartGate = no_gate,
) -> CampaignSummary:
    """Fly every realization that has no result in `folder` yet. Returns when all have one or a stop was
    requested.

    Call it again on the same folder to resume. Sessions are tasks of the running event loop; planning and scoring keep
    the loop busy. Cancelled, it kills the sessions and their agents. Realizations that may have failed because of the host
    are flown again, with at least two attempts in every run; their earlier results are kept in aside/. What failed with its
    firmware in flight is flown once more alone, over all runs.

    `workers`: overrides the campaign's budget, which overrides the number of cores.
    `observers`: get each event.
    `rerun`: outcomes that are flown again, what failed with its firmware included.
    `accept`: outcomes whose realizations stay as they are, for good; `rerun` takes that back.
    `forfeit_job`: takes the place of `job` for a realization whose agent broke the bench.
    `confined_job`: takes it after an attempt that an unconfined agent may have broken.
    `memory_kills`: counts the processes that the kernel killed for want of memory.
    `clock`: gives the host seconds by which the total budget and the pauses before retries are judged (default: the host's
    monotonic clock).
    `gate`: says whether a realization may start now; it is asked again until it may, and the total budget runs meanwhile.

    Raises SetupError for a campaign that cannot be realized and for a folder that is in use, belongs to
    another campaign or holds files that were changed since they were written, WorkersUnusable if no worker
    process can be started, BenchBroken if the first sessions all end with bench errors. Sessions that fail are results, never exceptions.
    """
    paths = CampaignFolder(folder)
    clock = clock or MonotonicClock()
    started = clock()
    parse_rerun_outcomes(rerun)
    parse_accepted_outcomes(accept)
    if campaign.stopping is not None:
        check_stopping(campaign.stopping, decomposition)
    with open_lock(folder), open_journal(paths.journal) as journal, open_observers(*observers) as events:
        # Before anything is changed: what was edited since it was written is refused, and left as it is.
        check_evidence(paths, journal)
        campaign = _with_options_of_folder(campaign, paths)
        journal.release()
        check_fidelity(campaign, journal)
        # Cores that this process may use: a container often grants fewer than the machine has.
        limit = workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
        plans = plan_campaign(campaign, paths, journal, decomposition, _takeoff_check(campaign, job), limit)
        # First what the disk holds, then what the user wants: both options are about results, not about stale
        # entries.
        for realization in reconcile(paths, journal):
            events.notify(ResultLost(realization))
        accept_outcomes(journal, accept, withdrawn=rerun)
        reset_for_rerun(paths, journal, rerun)
        # Whoever asked for the missing runs gets them with this run.
        take_retry_request(folder)
        early_stopping = EarlyStopping(
            campaign.stopping, decomposition, paths, journal, campaign.floor_labels
        )
        retries = Retries(campaign.budgets.retry_s)
        # Other jobs than the bench's own start no agent that could break it, unless they say so.
        starts_agents = job_at(campaign.fidelity, job) == FLIGHT_JOB
        forfeit_job = forfeit_job or (FORFEIT_JOB if starts_agents else None)
        dispatcher = Dispatcher(
            paths,
            journal,
            events,
            early_stopping,
            plans,
            retries,
            clock,
            watch_for_agents(plans, memory_kills)
            if starts_agents
            else SuspectWatch(memory_kills or no_memory_kills, lambda: confined_job, scenes=scenes_of(plans)),
            forfeit_job,
            _unless_paused(gate, folder, events),
            Retention(campaign.keep, decomposition, campaign.study, campaign.design.seed),
        )
        events.notify(CampaignPlanned(dispatcher.total, dispatcher.done))
        for result in finish_infeasible(plans, paths, journal):
            dispatcher.finish(result)
        for result in flown_overhead(paths, journal, decomposition) if campaign.fidelity == OVERHEAD else ():
            dispatcher.finish(result)
        dispatcher.stop_decided_points()
        if dispatcher.waiting:
            plan = WorkerPlan(job_at(campaign.fidelity, job), decomposition)
            with first_error_alone():
                async with (
                    open_stop_request() as stop,
                    open_executor(plan, min(limit, len(dispatcher.waiting)), folder) as executor,
                ):
                    await dispatcher.fly(executor, stop, _deadline(campaign, started, clock))
            # Sessions that were killed with the executor are planned again.
            journal.release()
        if dispatcher.done == dispatcher.total:
            sealed = finish is not None and finish(paths) is True
            if not sealed:
                write_manifest(
                    paths,
                    campaign.name,
                    decomposition.digest,
                    _outcome_counts(journal),
                    versions() | arithmetic(),
                    _completeness(journal),
                    campaign.pace,
                )
        events.close()
        return CampaignSummary(
            folder=folder,
            total=dispatcher.total,
            flown=dispatcher.flown,
            outcomes=_outcomes(journal),
            completeness=_completeness(journal),
            stopped=dispatcher.stopped,
            observer_faults=events.faults,
            events_dropped=events.dropped,
            wall_s=clock() - started,
        )


run_campaign_sync = blocking(run_campaign, "run_campaign_sync")
"""`run_campaign` as a plain function. Ctrl-C ends it; inside a running event loop, it runs in a thread of its own."""


def _unless_paused(gate: StartGate, folder: Path, events: Observers) -> StartGate:
    """A gate that is also closed while the campaign is paused; the observers hear of it once."""
    paused = False

    def may_start(realization: str) -> bool:
        nonlocal paused
        if paused != is_paused(folder):
            paused = not paused
            events.notify(CampaignPaused(goes_on=not paused))
        return not paused and gate(realization)

    return may_start


def _with_options_of_folder(campaign: Campaign, folder: CampaignFolder) -> Campaign:
    """The campaign with the floor, the pace, the isolation and the shard that its folder was flown with: resuming
    without --floor, --pace, --isolation or --shard changes nothing.
    """
    if not folder.campaign.is_file():
        return campaign
    flown = load_document(folder.campaign, Campaign)
    kept = ("floor", "pace", "isolation", "shard")
    return campaign.model_copy(
        update={name: getattr(flown, name) for name in kept if getattr(campaign, name) is None}
    )


def _takeoff_check(campaign: Campaign, job: str) -> CheckTakeoff:
    """What looks at the sessions before they fly. Surrogates are asked by themselves, and other jobs fly
    nothing that could be looked at.
    """
    if campaign.fidelity == OVERHEAD or job != FLIGHT_JOB:
        return lambda simspecs: []
    # Imported here: it brings the simulator along, and a finished campaign does without.
    from .planning._takeoff_faults import takeoff_faults

    return takeoff_faults


def _deadline(campaign: Campaign, started: float, clock: HostClock) -> Deadline | None:
    budget_s = campaign.budgets.total_wall_s
    return None if budget_s is None else Deadline(clock, started + budget_s)


def _outcomes(journal: Journal) -> dict[Outcome, int]:
    return dict(Counter(entry.outcome for entry in journal.entries() if entry.outcome is not None))


def _completeness(journal: Journal) -> Completeness:
    return completeness_of(
        ((entry, entry.outcome) for entry in journal.entries()),
        accepted_realizations(journal),
        drawn_out_realizations(journal),
    )


def _outcome_counts(journal: Journal) -> dict[str, int]:
    """Realizations by the name of their outcome, as the manifest has them."""
    stops = journal.stops()
    ended = [(entry, entry.outcome) for entry in journal.entries() if entry.outcome is not None]
    return dict(Counter(outcome_name(entry, outcome, stops) for entry, outcome in ended))
