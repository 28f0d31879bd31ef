"""Sessions that ended as an agent could have made them end: marked, flown again, and charged to the agent when it happens
again to it and to no neighbour. docs/running-campaigns.md states the rule and what it cannot tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from bench.contracts import FIRMWARE_FAILED, Confinement, Outcome, SessionResult, SuspectEnds
from bench.errors import SetupError
from bench.realization import RealizationPlan

from ._executor import FLIGHTS, Jobs

UNCONFINED = "none"
ATTEMPTS_TO_CHARGE = 2

MAX_REASON_CHARACTERS = 300
"""Characters that stay of the reason of an attempt, in the result and in the journal. Chosen."""


class SuspectWatch:
    """Follows the attempts at every realization in one run of a campaign.

    `memory_kills` counts the processes that the kernel killed for want of memory: such an end is the host's.
    `confined_job` is the job that flies an agent confined although it asks for no rung; None where the host cannot.
    `is_unconfined` tells whether the agent of a realization asks for no rung here. `scenes` has the scene of each
    realization: realizations of one scene are neighbours.
    """

    def __init__(
        self,
        memory_kills: Callable[[], int],
        confined_job: Callable[[], str | None] = lambda: None,
        is_unconfined: Callable[[str], bool] = lambda realization: True,
        scenes: Mapping[str, str] | None = None,
    ) -> None:
        self._memory_kills = memory_kills
        self._confined_job = confined_job
        self._is_unconfined = is_unconfined
        self._scenes = scenes or {}
        self._kills_at_start: dict[str, int] = {}
        self._ends: dict[str, list[SessionResult]] = {}
        self._forfeited: set[str] = set()

    def start(self, realization: str) -> None:
        """An attempt begins."""
        self._kills_at_start[realization] = self._memory_kills()

    def record(self, result: SessionResult) -> None:
        """An attempt has ended."""
        realization = result.realization
        killed = self._memory_kills() > self._kills_at_start.get(realization, 0)
        if not killed and realization not in self._forfeited and is_suspect(result):
            self._ends.setdefault(realization, []).append(result)

    def forfeits(self, result: SessionResult, bench_works: bool) -> bool:
        """Whether the agent is charged with an end that would be final: each time the bench failed under it, while it
        flew other sessions, and did not fail so under another agent in the same scene. From then on the realization is
        forfeited. A real autopilot that fails is judged by `FirmwareWatch`.
        """
        realization = result.realization
        charged = (
            bench_works
            and realization not in self._forfeited
            and is_suspect(result)
            and len(self._ends.get(realization, ())) >= ATTEMPTS_TO_CHARGE
            and not self._kinds(realization) & (self._kinds_of_neighbours(realization) | {FIRMWARE_FAILED})
        )
        if charged:
            self._forfeited.add(realization)
        return charged

    def confined_job(self, realization: str) -> str | None:
        """The confined job of the next attempt after a suspect one of an agent that asks for no rung, if this host can."""
        if realization not in self._ends or not self._is_unconfined(realization):
            return None
        return self._confined_job()

    def is_forfeited(self, realization: str) -> bool:
        """Whether the next attempt is one without the agent."""
        return realization in self._forfeited

    def marked(self, result: SessionResult) -> SessionResult:
        """The result with what its attempts are suspected of; also one that went well in the end."""
        if not (ends := self._ends.get(result.realization)):
            return result
        texts = (f"{end.outcome}: {end.reason}"[:MAX_REASON_CHARACTERS] for end in ends)
        return result.with_facts(SuspectEnds(texts=tuple(texts)))

    def _kinds(self, realization: str) -> set[str]:
        return {_kind(end) for end in self._ends.get(realization, ())}

    def _kinds_of_neighbours(self, realization: str) -> set[str]:
        scene = self._scenes.get(realization)
        others = [
            name for name in self._ends if name != realization and self._scenes.get(name, name) == scene
        ]
        return {kind for name in others for kind in self._kinds(name)}


def is_suspect(result: SessionResult) -> bool:
    """Whether the bench failed while the agent was there, so that the agent may have had a part in it."""
    if result.outcome is Outcome.WORKER_LOST:
        return True
    # What is known of the walls of an agent is known once it has started. Without any facts the worker could not say.
    confinement = result.fact(Confinement)
    never_started = confinement is not None and confinement.open_walls is None
    return result.outcome is Outcome.BENCH_ERROR and not never_started


def _kind(result: SessionResult) -> str:
    """What two faults have in common that have one cause: the kind of exception, or the first words of the bench."""
    if result.outcome is Outcome.WORKER_LOST:
        return str(result.outcome)
    return result.reason.partition(":")[0]


def watch_suspects(
    plans: Sequence[RealizationPlan], jobs: Jobs, memory_kills: Callable[[], int] | None
) -> SuspectWatch:
    """The watch of a campaign: over its flights with what this host knows of memory and confinement, over jobs that start
    no agent with what is handed in.
    """
    scenes = {plan.id: f"{plan.design_point} {plan.replicate}" for plan in plans}
    if jobs != FLIGHTS:
        return SuspectWatch(memory_kills or (lambda: 0), lambda: jobs.confined, scenes=scenes)
    # Here, because importing the simulation takes half a second.
    from bench.simulation import count_memory_kills

    return SuspectWatch(memory_kills or count_memory_kills, _confined_job, _is_unconfined(plans), scenes)


def _confined_job() -> str | None:
    """The job that confines an agent that asks for no rung; None where it cannot."""
    from bench.agents.confinement import rungs

    return FLIGHTS.confined if rungs()["landlock"].trial() is None else None


def _is_unconfined(plans: Iterable[RealizationPlan]) -> Callable[[str], bool]:
    """Whether the agent of a realization gets no rung here; no where none can be told."""
    agents = {plan.id: plan.agent_spec for plan in plans}

    def is_unconfined(realization: str) -> bool:
        from bench.agents import load_manifest, rung_of

        try:
            manifest, _ = load_manifest(agents[realization].manifest)
            return rung_of(manifest, agents[realization]).name == UNCONFINED
        except SetupError:
            return False

    return is_unconfined
