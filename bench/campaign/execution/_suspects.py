"""Sessions that ended as an unconfined agent could have made them end: marked, flown again, and charged to the agent when
it happens again. docs/campaigns.md states the rule and what it cannot tell.
"""

from __future__ import annotations

import builtins
from collections.abc import Callable, Iterable

from bench.contracts import SUSPECT, Outcome, SessionResult
from bench.errors import SetupError
from bench.realization import RealizationPlan

from ._task import CONFINED_JOB

UNCONFINED = "none"
ISOLATION = "isolation"
"""In `SessionResult.details`: the rung that confined the agent."""
ATTEMPTS_TO_CHARGE = 2

_REASON_CHARACTERS = 300


class SuspectWatch:
    """Follows the attempts at every realization in one run of a campaign.

    `memory_kills` counts the processes that the kernel killed for want of memory: such an end is the host's.
    `isolation` is the rung that confines the agent of a realization here: a worker that is gone cannot say it.
    `confined_job` is the job that flies an agent confined although it asks for no rung; None where the host cannot.
    """

    def __init__(
        self,
        memory_kills: Callable[[], int],
        isolation: Callable[[str], str] = lambda realization: UNCONFINED,
        confined_job: Callable[[], str | None] = lambda: None,
    ) -> None:
        self._memory_kills = memory_kills
        self._isolation = isolation
        self._confined_job = confined_job
        self._confined: set[str] = set()
        self._kills_at_start: dict[str, int] = {}
        self._suspicions: dict[str, list[str]] = {}
        self._chargeable: dict[str, int] = {}
        self._forfeited: set[str] = set()

    def start(self, realization: str) -> None:
        """An attempt begins."""
        self._kills_at_start[realization] = self._memory_kills()

    def record(self, result: SessionResult) -> None:
        """An attempt has ended."""
        realization = result.realization
        killed = self._memory_kills() > self._kills_at_start.get(realization, 0)
        if killed or realization in self._forfeited or not is_suspect(result):
            return
        if ISOLATION not in result.details and self._isolation(realization) != UNCONFINED:
            return
        # The agent of that attempt was confined, so it was not the agent.
        if realization in self._confined:
            return
        ends = self._suspicions.setdefault(realization, [])
        ends.append(f"{result.outcome}: {result.reason}"[:_REASON_CHARACTERS])
        self._chargeable[realization] = self._chargeable.get(realization, 0) + is_chargeable(result)

    def forfeits(self, result: SessionResult, bench_works: bool) -> bool:
        """Whether the agent is charged with an end that would be final: each time the bench was lost, while it flew
        other sessions. From then on the realization is forfeited.
        """
        realization = result.realization
        charged = (
            bench_works
            and realization not in self._forfeited
            and is_chargeable(result)
            and realization in self._suspicions
            and self._chargeable.get(realization, 0) >= ATTEMPTS_TO_CHARGE
            and self._chargeable[realization] == len(self._suspicions[realization])
        )
        if charged:
            self._forfeited.add(realization)
        return charged

    def confined_job(self, realization: str) -> str | None:
        """The job of the next attempt where the agent is to be confined: after a suspect one, if this host can."""
        if realization not in self._suspicions or (job := self._confined_job()) is None:
            return None
        self._confined.add(realization)
        return job

    def is_forfeited(self, realization: str) -> bool:
        """Whether the next attempt is one without the agent."""
        return realization in self._forfeited

    def marked(self, result: SessionResult) -> SessionResult:
        """The result with what its attempts are suspected of; also one that went well in the end."""
        ends = self._suspicions.get(result.realization)
        return result.model_copy(update={"details": {**result.details, SUSPECT: ends}}) if ends else result


def is_suspect(result: SessionResult) -> bool:
    """Whether the session ended as somebody who may kill or rob the bench's process can make it end."""
    unconfined = result.details.get(ISOLATION, UNCONFINED) == UNCONFINED
    return unconfined and result.outcome in (Outcome.WORKER_LOST, Outcome.BENCH_ERROR)


def is_chargeable(result: SessionResult) -> bool:
    """Whether such an end is evidence enough: a lost worker, or a fault of the operating system.

    Any other exception is a fault in the bench's own code, which an agent cannot plant and a scene can meet each time.
    """
    if not is_suspect(result):
        return False
    kind = getattr(builtins, result.reason.partition(":")[0], None)
    from_outside = isinstance(kind, type) and issubclass(kind, OSError)
    return result.outcome is Outcome.WORKER_LOST or from_outside


def watch_for_agents(
    plans: Iterable[RealizationPlan], memory_kills: Callable[[], int] | None = None
) -> SuspectWatch:
    """The watch of a campaign whose sessions start agents, with what this host knows of memory and confinement."""
    # Here, because importing the simulation takes half a second.
    from bench.simulation import count_memory_kills

    return SuspectWatch(memory_kills or count_memory_kills, _isolation_of(plans), _confined_job)


def no_memory_kills() -> int:
    """For sessions that use no memory worth counting."""
    return 0


def _confined_job() -> str | None:
    """The job that confines an agent that asks for no rung; None where no rung starts."""
    from bench.agents.confinement import rungs

    names = ("bwrap", "landlock")
    return CONFINED_JOB if any(rungs()[name].trial() is None for name in names) else None


def _isolation_of(plans: Iterable[RealizationPlan]) -> Callable[[str], str]:
    """The rung that confines the agent of a realization here; empty where none can be told."""
    agents = {plan.id: plan.agent_spec for plan in plans}

    def isolation(realization: str) -> str:
        from bench.agents import load_manifest, rung_of

        try:
            manifest, _ = load_manifest(agents[realization].manifest)
            return rung_of(manifest, agents[realization]).name
        # Without its manifest nothing is known of the agent, so nothing is laid on it.
        except SetupError:
            return ""

    return isolation
