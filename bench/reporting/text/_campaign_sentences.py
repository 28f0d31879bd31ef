"""The campaign as a whole in sentences: what flew, what differs, and what the report does not claim."""

from __future__ import annotations

from collections import Counter

from bench.contracts import Outcome

from .._campaign_data import ReportData, stopped_early
from ..statistics._agent_comparison import Comparison
from ._format import p_value, plural
from ._outcomes import outcome_name


def sessions_sentence(data: ReportData) -> str:
    """The first sentence of the report."""
    if not data.runs:
        return "Nothing has been run yet."
    scenes = len({run.scene for run in data.runs})
    ends = Counter(outcome_name(run) for run in data.runs)
    rest = ", ".join(f"{count} {name}" for name, count in sorted(ends.items()) if name != "completed")
    agents = plural(len(data.agents), "agent")
    return missing_sentence(data) + (
        f"{plural(len(data.runs), 'session')} of {plural(scenes, 'scene')} by {agents}: {ends['completed']} completed"
        + (f", {rest}." if rest else ".")
    )


def missing_sentence(data: ReportData) -> str:
    """What comes before everything else while the campaign lacks runs; empty when it has all."""
    accepted = frozenset(data.manifest.get("accepted") or ())
    missing = Counter(
        outcome_name(run)
        for run in data.runs
        if run.outcome is None
        or not (run.outcome.counts or run.outcome is Outcome.SETTLED or run.realization in accepted)
    )
    if not missing:
        return ""
    kinds = ", ".join(f"{count} {name}" for name, count in sorted(missing.items()))
    return (
        f"INCOMPLETE: {missing.total()} of {plural(len(data.runs), 'run')} are missing ({kinds}), so the numbers will change. "
        "Run the campaign again to fly them. "
    )


def difference_sentences(data: ReportData, comparison: Comparison) -> list[str]:
    """A sentence for each studied node on which the agents differ by more than chance explains."""
    return [
        f"On the same {plural(node.counts.pairs, 'scene')}, {comparison.second} passed {node.node} ({data.title(node.node)}) in "
        f"{node.counts.only_second} where {comparison.first} did not, the reverse in {node.counts.only_first} "
        f"({p_value(node.p_adjusted)}, adjusted for the number of key attributes)."
        for node in comparison.nodes
        if node.settled
    ]


def disclaimers(data: ReportData) -> list[str]:
    """What a reader must not take from this report."""
    sentences = [
        "Everything here was simulated. The numbers hold for the situations of this campaign, not for situations outside its "
        "factors. For real flight they hold only as far as the simulation models do.",
        "A score is no evidence for difficulties above those that were tested.",
        "The score is the mean over the runs in which something was achieved; failed runs do not count in it. An agent that "
        "fails often can have a high score and a low confidence, so read both.",
        "Confidence is an observed share; its interval shows how far the true share may differ. Intervals and tests are not "
        "corrected for multiple nodes, except where p is called adjusted.",
    ]
    unscored = [
        f"{node} for {agent}"
        for agent in data.agents
        for node in data.study
        if (t := data.tally(agent, node)) is None or not t.scored
    ]
    if unscored:
        sentences.append(f"Not scored in any run: {', '.join(unscored)}.")
    if stopped_early(data.scores):
        sentences.append(
            "Design points stopped early once their question was decided, so their number of runs depends on the results. The "
            "intervals of confidence and the bounds of competence allow for this. The intervals of scores, the claims from "
            "counts of passes, the comparisons of agents and the tests of factors do not."
        )
    # Runs that were not flown because the question was decided are not lost.
    lost = [
        r
        for r in data.runs
        if r.outcome is not None and r.outcome is not Outcome.SETTLED and not r.outcome.counts
    ]
    if lost:
        sentences.append(
            f"Not counted in any number, because the cause was not the agent: {plural(len(lost), 'run')}, listed under “Every run”."
        )
    waiting = [run for run in data.runs if run.outcome is None]
    if waiting:
        sentences.append(f"Not finished: {plural(len(waiting), 'run')}. The numbers will change.")
    return sentences
