"""The campaign as a whole in sentences: what flew, what differs, and what the report does not claim."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from bench.contracts import Outcome

from .._campaign_data import ReportData, Tally, until_settled
from ..statistics._pairings import Pairing
from ._format import p_value, percent, plural
from ._outcomes import outcome_name


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
