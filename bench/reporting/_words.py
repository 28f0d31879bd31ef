"""Numbers put into words: the same wording in the page and in the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from bench.contracts import Outcome

from ._data import ReportData, Run, Tally, until_settled
from ._pairs import Pairing

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

METHODS = {
    "clopper-pearson": "Clopper-Pearson where each run stands for itself",
    "korn-graubard": "Clopper-Pearson with the effective number of runs (Korn and Graubard) above observables and where runs share "
    "a design point",
    "anytime-valid (pass rate)": "Robbins' mixture, which holds however the number of runs came about, for observables of one design point",
    "anytime-valid (mean)": "a mixture of exponential bets, which holds however the number of runs came about, for the mean elsewhere",
}
PAST = "flown past the stop"

NO_INTERVAL = "none considered"

GLOSSARY = (
    ("ARL score", "How difficult a situation the agent has been shown to handle, on the scale of difficulty (0 to 100, a little "
     "more with partial credit). In one run, an observable that was achieved scores its difficulty; a node above scores the minimum "
     "of its children that have a score. Over runs it is the mean of the runs in which the node has a score: a failed run leaves "
     "this mean, it does not lower it. Read it only together with the confidence."),
    ("Confidence", "Of the observables under a node that a run considered, the share that was achieved; over runs, the plain mean "
     "over the runs that considered any. The interval is two-sided, 95 %."),
    ("Raised by failure (†)", "What failed has no score and leaves the mean, so failing at what is easy can raise it. The mark stands "
     "wherever the mean exceeds what it would be, had every failed observable passed exactly at its threshold."),
    ("Competence 50, 90", "The largest difficulty flown at which the pass rate, fitted so that it never rises with difficulty, is "
     "at least half, or nine tenths. A run passes a node when everything under it that was considered was achieved. "
     "Failing can never raise it. The bound is one-sided, 95 %. “≥” or “at least”: it is the hardest that was flown."),
    ("Difficulty-response curve", "A logistic curve of the pass rate over difficulty with a pointwise 95 % band, to be looked at and "
     "never the number: the difficulty at which it passes 50 % rises when easy runs fail."),
    ("Difficulty", "Rated before anything runs, from the configured situation: each key factor (fog, concealment, bystander density "
     "and so on) has a table from value to rating; an observable's difficulty is the lowest of its factors' ratings, a node's the "
     "lowest of all its observables."),
    ("Difficulty configuration", "The difficulties of the key attributes under study, taken together. Runs that share them are "
     "shown in one panel."),
    ("Considered", "The situation offered something that could exercise the observable, by the scenario and the ground truth. An "
     "agent that looks away is considered, and fails."),
    ("Scored", "At least one observable under the node was achieved (or came near enough, where the decomposition gives credit for "
     "that). “Not scored” is a state of its own, neither zero nor missing."),
    ("Key attribute (KA)", "A quality that a principle asks for. Below it stand verifiable attribute behaviours (VAB), below "
     "those observables: numbers measured in a run."),
    ("Partial credit", "Four points for each unit by which the measured value exceeds the threshold."),
    ("Scene", "One design point and replicate: the same places, motions, weather and random draws, whichever agent flies."),
    ("Realization", "One SimSpec that was flown: a scene and an agent."),
    ("Mark", "The agent designates a reported target for follow-up; the rules forbid it while a bystander is nearer to the target "
     "than the no-mark distance."),
)  # fmt: skip


def number(value: float | None, digits: int = 1) -> str:
    """A number with fixed digits, or an en dash where there is none."""
    if value is None:
        return "–"
    rounded = round(value, digits) or 0.0  # never a negative zero
    return f"{rounded:.{digits}f}".replace("-", "−")


def percent(value: float | None) -> str:
    """A share as a percentage, or an en dash."""
    return "–" if value is None else f"{100 * value:.1f} %"


def score(value: float | None) -> str:
    """A score, or that there is none."""
    return "not scored" if value is None else number(value)


def interval(tally: Tally | None) -> str:
    """The confidence's interval as `low to high %`."""
    if tally is None or tally.confidence_low is None or tally.confidence_high is None:
        return "–"
    return f"{100 * tally.confidence_low:.0f} to {100 * tally.confidence_high:.0f} %"


def span(low: float | None, high: float | None) -> str:
    """A range of difficulty, one number where both ends are the same."""
    if low is None or high is None:
        return "–"
    return number(low) if abs(high - low) < 5e-7 else f"{number(low)} to {number(high)}"


def plural(count: int, one: str, many: str = "") -> str:
    """`1 run`, `2 runs`."""
    return f"{count} {one if count == 1 else many or one + 's'}"


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


def what_was_flown(data: ReportData) -> str:
    """The first sentence of the report."""
    if not data.runs:
        return "Nothing has been run yet."
    scenes = len({run.scene for run in data.runs})
    ends = Counter(outcome_name(run) for run in data.runs)
    rest = ", ".join(f"{count} {name}" for name, count in sorted(ends.items()) if name != "completed")
    agents = plural(len(data.agents), "agent")
    return f"{plural(len(data.runs), 'session')} of {plural(scenes, 'scene')} by {agents}: {ends['completed']} completed" + (
        f", {rest}." if rest else ", none ended otherwise."
    )


def extremes(data: ReportData, agent: str) -> str:
    """In which studied key attribute the agent is surest and in which least, in a sentence."""
    known = [t for node in data.study if (t := data.tally(agent, node)) is not None and t.confidence is not None]
    if not known:
        return "No run considered any of the key attributes under study, so nothing can be said."
    best = max(known, key=lambda one: (one.confidence or 0.0, one.node))
    worst = min(known, key=lambda one: (one.confidence or 0.0, one.node))
    return (
        f"Lowest confidence in {_named(data, worst)}; highest in {_named(data, best)}."
        if best.node != worst.node
        else f"Confidence in {_named(data, best)}."
    )


def _named(data: ReportData, tally: Tally) -> str:
    return (
        f"{tally.node} ({data.title(tally.node)}): {percent(tally.confidence)} over {plural(tally.considered, 'considered run')}"
    )


def differences(data: ReportData, pairings: Iterable[Pairing]) -> list[str]:
    """A sentence for each studied node on which one agent passed scenes that the other did not, by more than chance explains."""
    return [
        f"On the same {plural(one.scenes, 'scene')}, {one.second} passed {one.node} ({data.title(one.node)}) in "
        f"{one.only_second} where {one.first} did not, the reverse in {one.only_first} (McNemar's exact test, {p_value(one.p_value)})."
        for one in pairings
        if one.p_value is not None and one.p_value < 0.05
    ]


def p_value(value: float | None) -> str:
    """A p value with no more digits than it deserves."""
    if value is None:
        return "–"
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"


def not_claimed(data: ReportData) -> list[str]:
    """What a reader must not take from this report."""
    said = [
        "Everything here was simulated. The numbers hold for the situations of this campaign, not for situations outside its "
        "factors, and for real flight only as far as the models do.",
        "A score certifies nothing above the difficulties that were tested.",
        "The score is the mean over runs in which something was achieved; failed runs leave it. An agent that fails often can have "
        "a high score and a low confidence: read both.",
        "Confidence is what was observed, not a promise; its interval says how far the truth may lie from it. The intervals and "
        "tests are not corrected for looking at several nodes, unless a p is said to be adjusted.",
    ]
    unscored = [
        f"{node} for {agent}"
        for agent in data.agents
        for node in data.study
        if (t := data.tally(agent, node)) is None or not t.scored
    ]
    if unscored:
        said.append(f"Not scored in any run: {', '.join(unscored)}.")
    if until_settled(data.scores):
        said.append(
            "Design points ended once their question was settled, so how many runs they have hangs on how these went. The intervals of "
            "confidence and the bounds of competence allow for that; the intervals of scores, what straight passes claim, the comparisons of agents and "
            "the tests of factors do not."
        )
    lost = [r for r in data.runs if r.outcome is not None and r.outcome is not Outcome.SETTLED and not r.outcome.counts]
    if lost:
        said.append(
            f"Ended by no doing of the agent, hence without a say in any number here: {plural(len(lost), 'run')}, listed under Outcomes."
        )
    waiting = [run for run in data.runs if run.outcome is None]
    if waiting:
        said.append(f"Not finished: {plural(len(waiting), 'run')}. The numbers will change.")
    return said


def listed(values: Sequence[str]) -> str:
    """`a, b and c`."""
    return values[0] if len(values) == 1 else f"{', '.join(values[:-1])} and {values[-1]}" if values else ""
