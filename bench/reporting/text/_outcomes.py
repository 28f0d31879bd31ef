"""The outcome of a run in words."""

from __future__ import annotations

from bench.contracts import Outcome

from .._campaign_data import Run

OUTCOMES = {
    Outcome.COMPLETED: "the agent declared its mission complete, or aborted it, and the vehicle is down",
    Outcome.TIME_LIMIT: "the mission's simulated time ran out",
    Outcome.VEHICLE_CRASHED: "the vehicle hit something or turned over",
    Outcome.AGENT_CRASHED: "the agent's process ended before its mission did",
    Outcome.AGENT_TIMEOUT: "the agent did not answer within its budget",
    Outcome.AGENT_NEVER_CONNECTED: "the agent never said hello",
    Outcome.AGENT_PROTOCOL: "the agent broke the tick protocol",
    Outcome.PLACEMENT_INFEASIBLE: "the scene's constraints leave no place for somebody; nothing flew",
    Outcome.SETUP_INVALID: "the SimSpec names something that does not exist; nothing flew",
    Outcome.WALL_BUDGET: "the session took longer than its budget of host time",
    Outcome.WORKER_LOST: "the worker process died under the session",
    Outcome.BENCH_ERROR: "a fault of the bench's own",
    Outcome.SETTLED: "not flown: the replicates before it had settled the question",
}


PAST = "flown past the stop"


def outcome_name(run: Run) -> str:
    """The outcome as people read it."""
    if run.past:
        return PAST
    return run.outcome.value.replace("_", " ") if run.outcome else "not finished"


def outcome_text(run: Run) -> str:
    """What the outcome means."""
    if run.past:
        return "the replicates before it had settled the question; it has no say in any number here"
    return OUTCOMES[run.outcome] if run.outcome else "there is no result of this run yet"
