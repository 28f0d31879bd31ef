"""`rebar simulate`: flies one session, from a SimSpec to its observations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.padding import Padding
from rich.text import Text

from bench.errors import command_line

from ._run_request import IsolationOption, Pace
from ._tables import add_plain_row, plain_console, plain_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bench.contracts import Observation, SessionResult
    from decompositions import Decomposition


DEFAULT_DECOMPOSITION = "search-and-report"


def simulate(
    simspec: Annotated[Path, typer.Argument(help="SimSpec file, base or realized (YAML or JSON)")],
    out: Annotated[Path, typer.Option(help="Folder for recording.mcap and result.json")] = Path("out"),
    decomposition: Annotated[
        str, typer.Option(help="Name or file of a decomposition")
    ] = DEFAULT_DECOMPOSITION,
    pace: Annotated[Pace | None, typer.Option(help="Pace, in place of the SimSpec's")] = None,
    isolation: IsolationOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json")] = False,
) -> None:
    """Fly one session. Example: rebar simulate examples/search.yaml --out out/first"""
    from bench.campaign import check_file_system, fly_realization, load_measurable_decomposition, write_result
    from bench.contracts import Outcome
    from bench.simspec import load_simspec

    situation = load_simspec(simspec)
    if pace is not None:
        situation = situation.model_copy(update={"pace": situation.pace.model_copy(update={"mode": pace})})
    if isolation is not None:
        agent = situation.agent.model_copy(update={"isolation": isolation})
        situation = situation.model_copy(update={"agent": agent})
    nodes = load_measurable_decomposition(decomposition)
    # Before the flight, which takes a while: a path that cannot be is told at once.
    out.mkdir(parents=True, exist_ok=True)
    check_file_system(out, with_locks=False)
    result = fly_realization(situation, nodes, out, out.name)
    # The flight does not write its result: in a campaign the runner does.
    write_result(out, result)
    if as_json:
        print(result.model_dump_json(indent=1, ensure_ascii=True))
    else:
        _print_result(result, simspec, out, decomposition, nodes)
    if not result.outcome.counts:
        # A SimSpec that cannot be flown is a wrong input, as any other fault in a file.
        raise typer.Exit(2 if result.outcome is Outcome.SETUP_INVALID else 1)


def _print_result(
    result: SessionResult, simspec: Path, out: Path, decomposition: str, nodes: Decomposition
) -> None:
    """Print how the session was confined and ended, what it achieved, and what to ask next."""
    from bench.contracts import ReportStatements

    console = plain_console()
    if result.observations and not result.fact(ReportStatements):
        console.print("REPORTED NOTHING: what follows holds nothing that the agent found", soft_wrap=True)
    for line in _fact_lines(result):
        console.print(line, soft_wrap=True)
    ended = f"{result.outcome} after {result.simulated_s:.1f} simulated s ({result.wall_s:.1f} s): {result.reason}"
    if strangers := result.counters.get("tick_strangers", 0):
        console.print(f"connections of strangers to the tick socket, refused: {strangers}")
    # Nothing was flown, so the reason is about the file.
    if not result.simulated_s:
        ended = f"{simspec}: {ended}"
    # Indented: no line of what an agent printed is to be taken for one of ours.
    console.print(ended.replace("\n", "\n    "), soft_wrap=True)
    if result.observations:
        first = _show_observations(console, nodes, result.observations)
    for name, text in (("recording.mcap", "recording"), ("agent.log", "what the agent printed")):
        if (out / name).is_file():
            console.print(f"{text}: {out / name}", soft_wrap=True)
    if result.observations:
        named = () if decomposition == DEFAULT_DECOMPOSITION else ("--decomposition", Path(decomposition))
        # Quoted, because people copy these lines into a shell.
        explain = command_line("rebar", "score", out, *named, "--explain", str(first))
        difficulty = command_line("rebar", "difficulty", simspec, *named)
        for line in (f"why: {explain}", f"how hard it was: {difficulty}"):
            console.print(line, soft_wrap=True)
        console.print(_study_table(nodes, result.observations))


def _fact_lines(result: SessionResult) -> Iterator[str]:
    """What a user must know of the session before its observations."""
    from bench.agents.confinement import wall_text
    from bench.contracts import Confinement, ServicesLetIn, TruthGiven, UnmatchedTopics, UnreadTopics

    if truth := result.fact(TruthGiven):
        yield f"the truth was given to {truth.agent}: its results are no agent's"
    if confinement := result.fact(Confinement):
        if confinement.isolation == "none":
            yield "isolation: none. The agent was NOT CONFINED: it had the rights of the bench (docs/agents-confinement.md)"
        else:
            own = confinement.network == "own"
            network = "a network of its own" if own else f"the network is {confinement.network}"
            gaps = "; ".join(map(wall_text, confinement.open_walls or ()))
            yield f"isolation: {confinement.isolation}, {network}{'; leaves open: ' if gaps else ''}{gaps}"
    if unmatched := result.fact(UnmatchedTopics):
        yield from (f"announced, never matched: {sentence}" for sentence in unmatched.sentences)
    if unread := result.fact(UnreadTopics):
        topics = ", ".join(unread.topics)
        yield f"never subscribed to: {topics} (a wrong type or hash is no subscription: rebar schema --keys)"
    if services := result.fact(ServicesLetIn):
        yield from (f"let in from outside: {use}" for use in services.uses)


def _study_table(decomposition: Decomposition, observations: Sequence[Observation]) -> Table:
    """How many of the considered observables under each node of the study were achieved."""
    measured = {item.observable: item.x for item in observations if item.x is not None}
    table = plain_table(["node", "title", "achieved"], texts=["title"])
    for node in decomposition.study:
        found = [name for name in decomposition.observables_under(node) if name in measured]
        achieved = sum(measured[name] >= decomposition.observables[name].threshold for name in found)
        title = decomposition.nodes[node].title
        add_plain_row(table, [node, title, f"{achieved} of {len(found)}" if found else "not considered"])
    return table


def _show_observations(
    console: Console, decomposition: Decomposition, observations: Sequence[Observation]
) -> str:
    """Print what was not achieved and why, what was, and what had no occasion. Return the first id to ask about."""
    achieved, failed, absent = [], [], []
    ids_failed = []
    for observation in observations:
        observable = decomposition.observables[observation.observable]
        name = f"{observation.observable} {observable.title}"
        if observation.x is None:
            absent.append(name)
        elif observation.x >= observable.threshold:
            achieved.append(name)
        else:
            ids_failed.append(observation.observable)
            failed.append(f"{name}: {observation.x:.3g}, asked {observable.threshold:g}")
            failed += [f"    {moment.time_s:.1f} s {moment.text}" for moment in observation.evidence[:1]]
    considered = len(observations) - len(absent)
    console.print(f"not achieved: {len(ids_failed)} of {considered}")
    for line in failed:
        console.print(Padding(Text(line.strip()), (0, 0, 0, 6 if line.startswith(" ") else 2)))
    for heading, names in (
        (f"achieved: {len(achieved)} of {considered}", achieved),
        ("not considered", absent),
    ):
        if names:
            console.print(heading)
            console.print(Padding(Text("; ".join(names)), (0, 0, 0, 2)))
    return (ids_failed or [observations[0].observable])[0]
