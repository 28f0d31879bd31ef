"""`rebar score --explain`: why a node has its score, as a tree."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.text import Text
from rich.tree import Tree

from ._tables import plain_console

if TYPE_CHECKING:
    from bench.scoring import AgentExplanation, Explanation, ObservableExplanation, RunExplanation

# Characters; more than any sentence or path has.
WHOLE_LINE = 10_000


def show_explanation(explanation: Explanation) -> None:
    """Print it."""
    # Only a terminal wraps: a path that is broken over two lines of a file cannot be searched or copied.
    console = plain_console()
    if not console.is_terminal:
        console = plain_console(width=WHOLE_LINE)
    for agent in explanation.agents:
        console.print(_tree_of_agent(explanation, agent))
    if not explanation.agents:
        print(f"{explanation.source}: no runs yet")


def _tree_of_agent(explanation: Explanation, agent: AgentExplanation) -> Tree:
    summary, essential = agent.summary, ", ".join(explanation.essential)
    tree = Tree(Text(f"{explanation.id} {explanation.title}, {summary.agent}: {explanation.asks}"))
    if essential:
        branch = tree.add(Text(f"verdict: {_verdict_text(agent)}; it rests on {essential}"))
        if explanation.essential_reason:
            branch.add(Text(explanation.essential_reason))
    elif summary.considered:
        interval = f"{100 * summary.passed_low:.0f} to {100 * summary.passed_high:.0f} %"
        tree.add(Text(f"passed {summary.passed} of {summary.considered} considered runs ({interval})"))
    for sentence in _sentences(agent):
        tree.add(Text(sentence))
    for run in agent.runs:
        _add_run(tree, run, of_principle=bool(essential))
    if agent.runs_left_out:
        rest = ", ".join(f"{count} {state}" for state, count in agent.runs_left_out.items())
        tree.add(Text(f"... and {rest} (--limit 0 shows all)"))
    return tree


def _sentences(agent: AgentExplanation) -> Iterator[str]:
    """What each number of a node is made of."""
    node = agent.summary
    if node.score is None:
        yield f"not scored in any of {node.considered} considered runs"
    else:
        made_of = ", ".join([*agent.scored_runs, *(["..."] if node.scored > len(agent.scored_runs) else [])])
        again = "flown again with new seeds"
        low, high = node.score_low, node.score_high
        ends = "" if low is None else f" ({again}: {low:.2f} to {high:.2f}, 95 %)"
        yield f"score {node.score:.2f}{ends}: the mean of the {node.scored} runs that have one ({made_of})"
    if node.raised_by_failure:
        yield "failures raised this score: it would be lower if every failed observable had passed"
    if node.confidence is not None:
        interval = f"95 % [{node.confidence_low:.1%}, {node.confidence_high:.1%}] {node.method}"
        yield f"confidence {node.confidence:.1%}, {interval}: the mean over {node.considered} considered runs"
    if node.competence_50 is not None:
        value = f"{'at least ' if node.competence_50_at_least else ''}{node.competence_50:.2f}"
        low = node.competence_50_low
        bound = "" if low is None else f", at least {low:.2f} with 95 % confidence"
        yield f"competence {value}{bound}: up to this difficulty half of such runs pass"
    yield (
        f"{node.runs} runs count: {node.considered} considered, "
        f"{node.runs - node.considered} not considered; {node.excluded} more are excluded"
    )


def _verdict_text(agent: AgentExplanation) -> str:
    """`passed 11 of 12 runs (62 to 100 %)`, or that no run has a verdict."""
    node = agent.summary
    if not node.verdict_considered:
        return "none, because no run considered anything essential"
    # They come with the count.
    assert node.verdict_low is not None
    assert node.verdict_high is not None
    return (
        f"passed {node.verdict_passed} of {node.verdict_considered} runs "
        f"({100 * node.verdict_low:.0f} to {100 * node.verdict_high:.0f} %)"
    )


_VERDICTS = {True: "passed the principle", False: "did not pass the principle", None: "no verdict"}


def _add_run(tree: Tree, run: RunExplanation, *, of_principle: bool) -> None:
    scored = "not scored" if run.score is None else f"score {run.score:.2f}"
    hard = "" if run.difficulty is None else f" at difficulty {run.difficulty:.2f}"
    counts = f"{run.achieved} of {run.considered} observables achieved"
    state = _VERDICTS[run.verdict].upper() if of_principle and run.outcome.counts else run.state.upper()
    branch = tree.add(Text(f"{run.run}: {state}, {scored}{hard}, {counts}"))
    if run.recording or run.reason:
        branch.add(Text(f"ended: {run.outcome}{f' ({_brief(run.reason)})' if run.reason else ''}"))
    if run.recording:
        branch.add(Text(f"recording: {run.recording}"))
    if run.ruled_by:
        branch.add(Text(f"ruled by: {' -> '.join(run.ruled_by)}"))
    for leaf in run.observables:
        _add_observable(branch, leaf)
    if run.observables_left_out:
        branch.add(Text(f"... and {run.observables_left_out} more observables"))


def _brief(reason: str) -> str:
    """First and last line of a reason.

    A traceback of an agent can be long, and the recording has all of it.
    """
    lines = [line.strip() for line in reason.splitlines() if line.strip(" )")]
    # A traceback says what went wrong in its last line, and what it is in its first.
    return reason.strip() if len(lines) < 3 else f"{lines[0]} ... {lines[-1]}"


def _add_observable(tree: Tree, leaf: ObservableExplanation) -> None:
    if leaf.state in ("not considered", "not exercisable"):
        branch = tree.add(Text(f"{leaf.id} {leaf.title}: {leaf.state}; {leaf.reason}"))
    else:
        sign = ">=" if leaf.state == "achieved" else "<"
        branch = tree.add(
            Text(
                f"{leaf.id} {leaf.title}: {leaf.state}, x {leaf.x:.4g} {sign} {leaf.threshold:g}{_points(leaf)}"
            )
        )
        if leaf.standing == "configured sensor":
            branch.add(Text("it describes the configured sensor, and enters no other node"))
        elif leaf.essential:
            branch.add(Text("essential: the verdict rests on it"))
        if leaf.factors:
            ratings = (
                f"{row.factor} = {row.value:g} {row.unit} rates {row.rating:.2f}" for row in leaf.factors
            )
            branch.add(Text("; ".join(ratings)))
    if leaf.row:
        branch.add(Text(f"row: {leaf.row}"))
    for moment in leaf.evidence:
        branch.add(Text(f"at {moment.time_s:.1f} s: {moment.text}"))
    if leaf.evidence_left_out:
        branch.add(Text(f"... and {leaf.evidence_left_out} more moments"))


def _points(leaf: ObservableExplanation) -> str:
    if leaf.score is None:
        return "" if leaf.difficulty is None else f"; difficulty {leaf.difficulty:.2f}, no score"
    credit = f" {'+' if leaf.credit >= 0 else '-'} {abs(leaf.credit):.2f} credit" if leaf.credit else ""
    return f"; score {leaf.score:.2f} = difficulty {leaf.difficulty:.2f}{credit}"
