"""One realization, from its SimSpec to its result: place, fly, record, measure.

The job of a campaign's workers and of `rebar simulate`. Measures see exactly what the recording holds, so
scoring the recording again gives the same observations.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from bench.agents import (
    FilledCache,
    LocalProcess,
    load_manifest,
    open_agent,
    open_cache,
    program_faults,
    rung_of,
)
from bench.agents.confinement import wall_name
from bench.contracts import (
    AgentManifest,
    AgentPlan,
    AgentProcess,
    Arithmetic,
    Confinement,
    Fact,
    OnProgress,
    OpenAgent,
    Outcome,
    Record,
    SessionFailure,
    SessionResult,
    TruthGiven,
    ignore_progress,
)
from bench.documents import dump_json
from bench.errors import PlacementInfeasible, SetupError
from bench.network_namespace import namespace_fault
from bench.realization import check_placement, place
from bench.recording import TapeBuilder, open_recording
from bench.simspec import AgentSpec, Isolation, SimSpec
from bench.simulation import SessionPlan, open_forfeit, run_session
from bench.temporary_folders import temporary_folder
from bench.visible_text import visible
from decompositions import Decomposition

from .._versions import arithmetic, versions
from ..planning._honeypots import truth_sightings
from ..planning._measures import measure_all, measures_of
from ..planning._statements import report_statements
from ..storage._folder import RECORDING

SIMSPEC = "simspec.json"
AGENT_LOG = "agent.log"
# Of a real autopilot: its console, and its logs where the SimSpec asks for them.
AUTOPILOT_LOGS = "autopilot"


def fly_here(
    simspec: SimSpec,
    decomposition: Decomposition,
    folder: Path,
    realization: str,
    on_progress: OnProgress = ignore_progress,
) -> SessionResult:
    """Fly one realization in this process, and in its network.

    `fly_realization` says what is left in `folder`, and what a failure is.
    """
    return _fly(simspec, decomposition, folder, realization, open_agent, on_progress)


def fly_confined(
    simspec: SimSpec,
    decomposition: Decomposition,
    folder: Path,
    realization: str,
    on_progress: OnProgress = ignore_progress,
) -> SessionResult:
    """As `fly_here`, with the agent on the strongest rung that starts here, whatever its manifest asks for.

    SimSpec and recording stay those of the campaign; the rung stands in the result.
    """
    return _fly(simspec, decomposition, folder, realization, _open_confined, on_progress, isolation="auto")


def _open_confined(plan: AgentPlan) -> AbstractContextManager[AgentProcess]:
    agent = plan.simspec.agent.model_copy(update={"isolation": "auto"})
    return open_agent(replace(plan, simspec=plan.simspec.model_copy(update={"agent": agent})))


def forfeit_realization(
    simspec: SimSpec, decomposition: Decomposition, folder: Path, realization: str
) -> SessionResult:
    """Record and measure a realization whose agent broke the bench, without starting the agent again."""
    return _fly(simspec, decomposition, folder, realization, open_forfeit)


def _fly(
    simspec: SimSpec,
    decomposition: Decomposition,
    folder: Path,
    realization: str,
    open_agent: OpenAgent,
    on_progress: OnProgress = ignore_progress,
    *,
    isolation: Isolation | None = None,
) -> SessionResult:
    folder.mkdir(parents=True, exist_ok=True)
    stack = ExitStack()
    try:
        placed = place(simspec) if simspec.realized is None else _checked(simspec)
        manifest, manifest_folder = load_manifest(placed.agent.manifest)
        demanded = {} if isolation is None else {"isolation": isolation}
        host = _host(manifest, placed.agent.model_copy(update=demanded))
        cache = stack.enter_context(open_cache(manifest, manifest_folder, placed.agent))
    except (PlacementInfeasible, SetupError) as error:
        return SessionFailure.of(error).result(realization)
    (folder / SIMSPEC).write_text(dump_json(placed), encoding="utf-8")
    # The tape is built from the records while they are written: measures need not read the file back.
    tape = TapeBuilder(placed)
    starter = AgentStarter(open_agent, cache)
    with (
        stack,
        temporary_folder("agent") as scratch,
        open_recording(
            folder / RECORDING,
            simspec=placed,
            versions=versions(),
            # What sets the session of an oracle apart.
            metadata={"truth": f"given to {manifest.name}"} if manifest.truth else {},
        ) as recording,
    ):

        def tap(record: Record) -> None:
            recording(record)
            tape(record)

        plan = SessionPlan(
            placed,
            manifest,
            manifest_folder,
            starter.open,
            scratch,
            tap,
            hidden=(folder.resolve(),),
            artefacts=folder / AUTOPILOT_LOGS,
            on_progress=on_progress,
        )
        end = _without_host_faults(run_session(plan), plan)
    if starter.output is not None:
        (folder / AGENT_LOG).write_bytes(starter.output)
    flown = tape.tape()
    observations = measure_all(measures_of(decomposition), flown, placed) if end.outcome.counts else ()
    return end.with_facts(
        *starter.facts(host),
        *([TruthGiven(agent=manifest.name)] if manifest.truth else []),
        *truth_sightings(placed, flown),
        *report_statements(placed, flown),
        Arithmetic(**arithmetic()),
    ).model_copy(
        update={
            "realization": realization,
            "recording_sha256": recording.sha256,
            "observations": observations,
        }
    )


@dataclass(slots=True)
class AgentStarter:
    """Starts the agent, and keeps which walls its box leaves open, and what it wrote: known only once it has
    started, or has ended.
    """

    open_agent: OpenAgent
    cache: FilledCache | None = None
    open_walls: tuple[str, ...] | None = None
    output: bytes | None = None

    @contextmanager
    def open(self, plan: AgentPlan) -> Generator[AgentProcess]:
        """An `OpenAgent`."""
        if self.cache:
            plan = replace(plan, cache=self.cache.folder)
        with ExitStack() as stack:
            agent = stack.enter_context(self.open_agent(plan))
            if isinstance(agent, LocalProcess):
                self.open_walls = tuple(wall_name(wall) for wall in agent.open_walls)
            try:
                yield agent
            finally:
                # After its end: what it wrote last is in there too.
                stack.close()
                if isinstance(agent, LocalProcess):
                    self.output = agent.output()

    def facts(self, host: Confinement) -> list[Fact]:
        """What is known of the agent's start, on a host that confines it so."""
        confinement = host.model_copy(update={"open_walls": self.open_walls})
        return [confinement, self.cache.fact] if self.cache else [confinement]


# Host files are looked at only for agents that ended so early, in simulated seconds: later an agent knows its
# situation, and could remove its own files to be rid of a session that goes badly. Chosen, not measured.
_STARTING_S = 5.0


def _without_host_faults(end: SessionResult, plan: SessionPlan) -> SessionResult:
    """The end as it was, or SETUP_INVALID where the agent could not start because its files are gone."""
    if end.outcome not in (Outcome.AGENT_CRASHED, Outcome.AGENT_NEVER_CONNECTED):
        return end
    if end.simulated_s > _STARTING_S:
        return end
    faults = program_faults(plan.manifest, plan.manifest_folder, plan.simspec.agent.options)
    if not faults:
        return end
    reason = visible(f"{SetupError(faults)}; {end.reason}")
    return end.model_copy(update={"outcome": Outcome.SETUP_INVALID, "reason": reason})


def _host(manifest: AgentManifest, agent: AgentSpec) -> Confinement:
    """How this host confines the agent, for the result alone: the recording is the same on every host. Raises
    SetupError when the agent cannot be confined as it asks.
    """
    shared = namespace_fault()
    network = "own" if shared is None else f"the host's: {shared}"
    return Confinement(isolation=rung_of(manifest, agent).name, network=network)


def _checked(simspec: SimSpec) -> SimSpec:
    if faults := check_placement(simspec):
        raise SetupError(faults)
    return simspec
