"""Runs a campaign: every realization gets one result, whatever happens to sessions, workers or the runner itself."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bench.contracts import Outcome
from bench.documents import load_document
from bench.errors import Fault
from bench.realization import RealizationPlan
from bench.simspec import AgentSpec, SimSpec

from ._document import Campaign
from ._events import CampaignPaused, CampaignPlanned, Observer, Observers, ResultLost, open_observers
from ._overhead import OVERHEAD, check_fidelity, flown_overhead
from ._versions import arithmetic, versions
from .early_stopping._decisions import check_stopping, outcome_name
from .early_stopping._early_stopping import EarlyStopping
from .execution._attempts import Attempts
from .execution._dispatcher import Deadline, Dispatcher, OpenCampaign, StartGate, no_gate
from .execution._event_loop import (
    HostClock,
    MonotonicClock,
    blocking,
    first_error_alone,
    open_stop_request,
)
from .execution._executor import FLIGHTS, Jobs, OpenExecutor, WorkerPlan
from .execution._local_pool import open_local_pool
from .execution._suspects import watch_suspects
from .planning._evidence_check import check_evidence
from .planning._plan import CheckTakeoff, finish_infeasible, plan_campaign
from .storage._completeness import Completeness, noted_completeness, parse_accepted_outcomes
from .storage._completeness import accept as accept_outcomes
from .storage._folder import CampaignFolder, open_lock
from .storage._journal import Journal
from .storage._journal_file import open_journal
from .storage._manifest import write_manifest
from .storage._pause import is_paused, take_retry_request
from .storage._recovery import parse_rerun_outcomes, reconcile, reset_for_rerun
from .storage._results import ResultStore

if TYPE_CHECKING:
    from decompositions import Decomposition

Finish = Callable[[CampaignFolder], object]
"""Writes scores and report of a campaign that has all its results. `manifest.json` is written after it, unless it returns
True: then it has written the manifest itself, at its end.
"""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the user asks of a run.

    `decomposition`: what measures the sessions (default: the campaign's own).
    `workers`: sessions at once; overrides the campaign's budget, which overrides the number of cores.
    `rerun`: outcomes that are flown again, what failed with its firmware included.
    `accept`: outcomes whose realizations stay as they are, for good; `rerun` takes that back.
    """

    decomposition: Decomposition | None = None
    workers: int | None = None
    rerun: Collection[Outcome] = ()
    accept: Collection[Outcome] = ()


@dataclass(frozen=True, slots=True)
class Collaborators:
    """What a run works with.

    `observers`: get each event.
    `finish`: writes scores and report once every realization has its result.
    `open_executor`: where sessions fly.
    `gate`: says whether a realization may start; it is asked again until it may, and the total budget runs meanwhile.
    `clock`: gives the host seconds by which the total budget and the pauses before retries are judged.
    `jobs`: what workers do; those of a campaign at overhead fidelity are its own.
    `memory_kills`: counts the processes that the kernel killed for want of memory (default: as this host knows).
    """

    observers: Sequence[Observer] = ()
    finish: Finish | None = None
    open_executor: OpenExecutor = open_local_pool
    gate: StartGate = no_gate
    clock: HostClock = field(default_factory=MonotonicClock)
    jobs: Jobs = FLIGHTS
    memory_kills: Callable[[], int] | None = None


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


# Of workers that fly what was not flown in batches, because it was taken up again later.
_OVERHEAD_JOBS = Jobs("bench.campaign._overhead:fly_one")
_NOTHING_ASKED, _DEFAULT_COLLABORATORS = RunOptions(), Collaborators()


async def run_campaign(
    campaign: Campaign,
    folder: Path,
    options: RunOptions = _NOTHING_ASKED,
    collaborators: Collaborators = _DEFAULT_COLLABORATORS,
) -> CampaignSummary:
    """Fly every realization that has no result in `folder` yet. Returns when all have one or a stop was requested.

    Call it again on the same folder to resume. Sessions are tasks of the running event loop; planning and scoring keep
    the loop busy. Cancelled, it kills the sessions and their agents. Realizations that may have failed because of the host
    are flown again, with at least two attempts in every run; their earlier results are kept in aside/. What failed with its
    firmware in flight is flown once more alone, over all runs.

    Raises SetupError for a campaign that cannot be realized and for a folder that is in use, belongs to
    another campaign or holds files that were changed since they were written, WorkersUnusable if no worker
    process can be started, BenchBroken if the first sessions all end with bench errors. Sessions that fail are results, never exceptions.
    """
    clock = collaborators.clock
    started = clock()
    parse_rerun_outcomes(options.rerun)
    parse_accepted_outcomes(options.accept)
    decomposition = options.decomposition
    if decomposition is None:
        # Imported here: decompositions and measures are of no use to a caller that brings one.
        from .planning._measures import load_measurable_decomposition

        decomposition = load_measurable_decomposition(campaign.decomposition)
    if campaign.stopping is not None:
        check_stopping(campaign.stopping, decomposition)
    paths = CampaignFolder(folder)
    with (
        open_lock(folder),
        open_journal(paths.journal) as journal,
        open_observers(*collaborators.observers) as events,
    ):
        opened = OpenCampaign(paths, journal, events)
        run = _Run(opened, campaign, decomposition, options, collaborators)
        dispatcher = run.dispatcher()
        if dispatcher.waiting:
            budget_s = campaign.budgets.total_wall_s
            await run.fly(dispatcher, None if budget_s is None else Deadline(clock, started + budget_s))
        if dispatcher.done == dispatcher.total:
            run.finish()
        events.close()
        return CampaignSummary(
            folder=folder,
            total=dispatcher.total,
            flown=dispatcher.flown,
            outcomes=dict(Counter(entry.outcome for entry in journal.entries() if entry.outcome is not None)),
            completeness=noted_completeness(journal),
            stopped=dispatcher.stopped,
            observer_faults=events.faults,
            events_dropped=events.dropped,
            wall_s=clock() - started,
        )


run_campaign_sync = blocking(run_campaign, "run_campaign_sync")
"""`run_campaign` as a plain function. Ctrl-C ends it; inside a running event loop, it runs in a thread of its own."""


class _Run:
    """One run over a folder that is open: planned when it is made, then flown, then finished."""

    def __init__(
        self,
        opened: OpenCampaign,
        campaign: Campaign,
        decomposition: Decomposition,
        options: RunOptions,
        collaborators: Collaborators,
    ) -> None:
        self._opened, self._decomposition, self._collaborators = opened, decomposition, collaborators
        folder, journal = opened.folder, opened.journal
        # Before anything is changed: what was edited since it was written is refused, and left as it is.
        check_evidence(folder, journal)
        self._campaign = campaign = _with_options_of_folder(campaign, folder)
        journal.release()
        check_fidelity(campaign, journal)
        self._jobs = _OVERHEAD_JOBS if campaign.fidelity == OVERHEAD else collaborators.jobs
        # Cores that this process may use: a container often grants fewer than the machine has.
        self._workers = options.workers or campaign.budgets.workers or len(os.sched_getaffinity(0))
        self._plans: list[RealizationPlan] = plan_campaign(
            campaign, folder, journal, decomposition, _takeoff_check(self._jobs), self._workers
        )
        # First what the disk holds, then what the user wants: both options are about results, not about stale
        # entries.
        for realization in reconcile(folder, journal):
            opened.observers.notify(ResultLost(realization))
        accept_outcomes(journal, options.accept, withdrawn=options.rerun)
        reset_for_rerun(folder, journal, options.rerun)
        # Whoever asked for the missing runs gets them with this run.
        take_retry_request(folder.path)

    def dispatcher(self) -> Dispatcher:
        """What hands out the realizations that need a session; all others have their results."""
        campaign, folder, journal = self._campaign, self._opened.folder, self._opened.journal
        dispatcher = Dispatcher(
            self._opened,
            self._plans,
            EarlyStopping(campaign.stopping, self._decomposition, folder, journal, campaign.floor_labels),
            Attempts(
                journal,
                watch_suspects(self._plans, self._jobs, self._collaborators.memory_kills),
                self._jobs,
                campaign.budgets.retry_s,
            ),
            ResultStore(campaign, self._decomposition, folder, journal),
            self._collaborators.clock,
            _unless_paused(self._collaborators.gate, folder.path, self._opened.observers),
        )
        self._opened.observers.notify(CampaignPlanned(dispatcher.total, dispatcher.done))
        for result in finish_infeasible(self._plans, folder, journal):
            dispatcher.finish(result)
        if campaign.fidelity == OVERHEAD:
            for result in flown_overhead(folder, journal, self._decomposition):
                dispatcher.finish(result)
        dispatcher.stop_decided_points()
        return dispatcher

    async def fly(self, dispatcher: Dispatcher, deadline: Deadline | None) -> None:
        """Fly what waits, until it has results, a stop is requested or the deadline has passed."""
        plan = WorkerPlan(self._jobs.flight, self._decomposition)
        workers = min(self._workers, len(dispatcher.waiting))
        with first_error_alone():
            async with (
                open_stop_request() as stop,
                self._collaborators.open_executor(plan, workers, self._opened.folder.path) as executor,
            ):
                await dispatcher.fly(executor, workers, stop, deadline)
        # Sessions that were killed with the executor are planned again.
        self._opened.journal.release()

    def finish(self) -> None:
        """Write scores and report, if somebody does, and the manifest."""
        folder, journal, finish = self._opened.folder, self._opened.journal, self._collaborators.finish
        if finish is not None and finish(folder) is True:
            return
        write_manifest(
            folder,
            self._campaign.name,
            self._decomposition.digest,
            _outcome_counts(journal),
            versions() | arithmetic(),
            noted_completeness(journal),
            self._campaign.pace,
        )


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
    without --floor, --pace, --isolation or --shard changes nothing. With the folder's pace come those of its agents.
    """
    if not folder.campaign.is_file():
        return campaign
    flown = load_document(folder.campaign, Campaign)
    if campaign.pace is None and flown.pace is not None:
        # --pace had taken theirs away.
        paces = {agent.label: agent.pace for agent in flown.agents}
        agents = [agent.model_copy(update={"pace": paces.get(agent.label)}) for agent in campaign.agents]
        campaign = campaign.model_copy(update={"agents": tuple(agents)})
    kept = ("floor", "pace", "isolation", "shard")
    return campaign.model_copy(
        update={name: getattr(flown, name) for name in kept if getattr(campaign, name) is None}
    )


def _takeoff_check(jobs: Jobs) -> CheckTakeoff:
    """What looks at the sessions before they fly. Surrogates are asked by themselves, other jobs have none to look at."""
    if jobs.flight != FLIGHTS.flight:
        return lambda simspecs: []
    # Imported here: it brings the simulator along, and a finished campaign does without.
    from bench.agents import cache_faults

    from .planning._takeoff_faults import takeoff_faults

    def faults(simspecs: Iterable[SimSpec]) -> list[Fault]:
        agents: dict[str, AgentSpec] = {}

        def noted() -> Iterator[SimSpec]:
            for simspec in simspecs:
                agents[simspec.agent.label] = simspec.agent
                yield simspec

        # Caches last: filling one takes longer than all the rest.
        return takeoff_faults(noted()) or [
            fault for agent in agents.values() for fault in cache_faults(agent)
        ]

    return faults


def _outcome_counts(journal: Journal) -> dict[str, int]:
    """Realizations by the name of their outcome, as the manifest has them."""
    stops = journal.stops()
    ended = [(entry, entry.outcome) for entry in journal.entries() if entry.outcome is not None]
    return dict(Counter(outcome_name(entry, outcome, stops) for entry, outcome in ended))
