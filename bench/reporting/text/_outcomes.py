"""The outcome of a run in words."""

from __future__ import annotations

from collections import Counter

from bench.contracts import Outcome

from .._campaign_data import ReportData, Run

OUTCOME_MEANINGS = {
    Outcome.COMPLETED: "the agent declared its mission complete or aborted, and the vehicle has landed",
    Outcome.TIME_LIMIT: "the mission reached its time limit (simulated time)",
    Outcome.VEHICLE_CRASHED: "the vehicle hit something or turned over",
    Outcome.AGENT_CRASHED: "the process of the agent ended before the mission did",
    Outcome.AGENT_TIMEOUT: "the agent did not reply within its time budget",
    Outcome.AGENT_NEVER_CONNECTED: "the agent never connected to the session",
    Outcome.AGENT_PROTOCOL: "the agent violated the tick protocol",
    Outcome.AGENT_FLOODED: "the agent sent far more than is recorded of it",
    Outcome.AGENT_BROKE_BENCH: "the bench was lost under the unconfined agent, and again when the run was repeated",
    Outcome.PLACEMENT_INFEASIBLE: "no positions satisfy the constraints of the scene; nothing flew",
    Outcome.SETUP_INVALID: "the SimSpec names something that does not exist; nothing flew",
    Outcome.WALL_BUDGET: "the session exceeded its budget of host time",
    Outcome.BENCH_TOO_SLOW: "in real time, too many steps of the bench came late for the run to count",
    Outcome.WORKER_LOST: "the worker process died during the session",
    Outcome.BENCH_ERROR: "an error of the bench",
    Outcome.SETTLED: "not flown: the earlier replicates had decided the question",
}


AFTER_STOP = "flown after the stop"


def outcome_name(run: Run) -> str:
    """The outcome as people read it."""
    if run.after_stop:
        return AFTER_STOP
    return run.outcome.value.replace("_", " ") if run.outcome else "not finished"


def outcome_text(run: Run) -> str:
    """What the outcome means."""
    if run.after_stop:
        return "the earlier replicates had decided the question; this run counts in no number here"
    return OUTCOME_MEANINGS[run.outcome] if run.outcome else "this run has no result yet"


def endings(data: ReportData) -> list[tuple[str, str, int]]:
    """How runs ended other than completed: name, what it means, and how many."""
    counts = Counter((outcome_name(run), outcome_text(run)) for run in data.runs)
    return [(*ending, count) for ending, count in sorted(counts.items()) if ending[0] != "completed"]
