"""`rebar score`: recordings to observations and scores, again; tables from elsewhere; and why a number is what it is."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text
from rich.tree import Tree

from bench.errors import Fault, SetupError

if TYPE_CHECKING:
    import polars as pl

    from bench.scoring import (
        AgentExplanation,
        Explanation,
        ObservableExplanation,
        RunExplanation,
        RunReport,
        ScoredRun,
        ScoreReport,
        Sources,
    )
    from decompositions import Decomposition

MOST_TABLE_BYTES = 2 * 1024**3
WIDTH = 140  # of what is printed where nobody's terminal is


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(score)


def score(
    runs: Annotated[list[Path] | None, typer.Argument(help="Folders of runs, or of whole campaigns")] = None,
    decomposition: Annotated[str | None, typer.Option(help="Name or file; a campaign's own when not given")] = None,
    observations: Annotated[
        Path | None, typer.Option(help="Instead of folders: a table of observations from elsewhere (CSV or JSON records)")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="For a machine to read: the document `rebar schema score-report`")
    ] = False,
    per_run: Annotated[bool, typer.Option("--per-run", help="Every run's nodes too")] = False,
    explain: Annotated[str | None, typer.Option(metavar="NODE", help="Why this node has its score; changes nothing")] = None,
    limit: Annotated[
        int, typer.Option(min=0, help="With --explain: most runs an agent, observables a run, moments an observable; 0 is all")
    ] = 5,
) -> None:
    """Measure and score recordings again; nothing but the recording, its SimSpec and the decomposition decides.

    A run's folder is scored to the screen; a campaign's gets new result.json files, scores.parquet and report.html.

    Example: rebar score out/demo/runs/p000-r0-reference-naive

    Example: rebar score out/demo --explain KA-18

    Example: rebar score --observations table.csv --decomposition mine.yaml --json
    """
    for target in _targets(runs or [], decomposition, observations, reading=explain is not None):
        if explain is not None:
            _show_explanation(target.explained(explain, limit), as_json=as_json)
        elif as_json:
            print(target.report(per_run=per_run).model_dump_json(indent=1))
        else:
            target.show(per_run=per_run)


def known_node(option: str, asked: Decomposition, node: str) -> None:
    """Raises SetupError, with what was probably meant, for a node that the decomposition does not have."""
    if node not in asked.nodes:
        near = difflib.get_close_matches(node, asked.nodes, n=3)
        remedy = f"did you mean {' or '.join(near)}?" if near else f"key attributes: {', '.join(asked.key_attributes)}"
        raise SetupError(Fault(option, f"there is no node {node!r} in {asked.name}", remedy))


def campaign_report(folder: Path) -> ScoreReport:
    """The document of a campaign as it lies; nothing is measured anew."""
    return _of_campaign(folder, None, reading=True).report(per_run=False)


@dataclass(frozen=True, slots=True)
class Target:
    """What was named to be scored: its runs, and where they are from."""

    kind: Literal["campaign", "run", "observations"]
    source: str
    asked: Decomposition
    study: tuple[str, ...]
    runs: tuple[ScoredRun, ...]
    sources: Sources
    scores: pl.DataFrame
    summary: pl.DataFrame
    last_words: tuple[str, ...] = field(default=())
    fidelity: Literal["full", "overhead"] | None = None

    def report(self, *, per_run: bool) -> ScoreReport:
        """The document that `--json` prints."""
        from bench.scoring import absent_pairs, run_reports, score_report

        told = run_reports(self.scores, self.sources.recordings) if per_run or self.kind == "run" else None
        absent = absent_pairs(self.asked, self.runs)
        return score_report(
            self.kind, self.source, self.asked, self.study, self.scores, self.summary, absent, told, self.fidelity
        )

    def explained(self, node: str, limit: int) -> Explanation:
        """Why a node has its numbers. Raises SetupError for one that there is not."""
        from bench.scoring import explain, node_reports

        known_node("--explain", self.asked, node)
        summaries = node_reports(self.scores, self.summary.filter(node=node, configuration="all"))
        return explain(self.asked, node, self.runs, self.scores, summaries, self.sources, self.source, limit)

    def show(self, *, per_run: bool) -> None:
        """Tables for a person."""
        from bench.reporting import score_table
        from bench.scoring import absent_pairs, run_reports

        console = _console()
        if self.kind != "run":
            top = self.asked.level_of(next(iter(self.asked.nodes)))
            console.print(score_table(self.summary, self.study or self.asked.at_level(top)))
        if per_run or self.kind == "run":
            titles = {node.id: node.title for node in self.asked.nodes.values()}
            for run in run_reports(self.scores):
                console.print(_table_of_run(run, titles))
        if self.kind == "observations":
            absent = absent_pairs(self.asked, self.runs)
            print(f"{len(self.runs)} runs; {absent} pairs of run and observable have no row, and are not considered")
        for words in self.last_words:
            print(words)


def _targets(runs: Sequence[Path], decomposition: str | None, table: Path | None, *, reading: bool) -> list[Target]:
    """What the command line names, each scored. `reading` leaves the folders as they are."""
    from bench.campaign import is_campaign

    if table is not None:
        if runs:
            raise SetupError(Fault("--observations", "stands instead of folders", "drop the folders, or the table"))
        if decomposition is None:
            raise SetupError(
                Fault("--observations", "a table says nothing of its decomposition", "name it: --decomposition FILE")
            )
        return [_of_table(table, decomposition)]
    if not runs:
        raise SetupError(Fault("score", "nothing to score", "name the folder of a run or of a campaign, or give --observations"))
    return [
        _of_campaign(one, decomposition, reading=reading) if is_campaign(one) else _of_run(one, decomposition) for one in runs
    ]


def _of_campaign(folder: Path, decomposition: str | None, *, reading: bool) -> Target:
    from bench.campaign import read_runs, rescore_campaign
    from bench.scoring import Sources, score_table, summary_frame

    words: list[str] = []
    if reading:
        found = read_runs(folder, decomposition)
    else:
        finished = rescore_campaign(folder, decomposition)
        found = read_runs(folder)
        missing = finished.outcomes.get("not finished", 0)
        if missing:
            words.append(f"{missing} realizations have no result, or none that fits its recording: `rebar run` flies them again")
        words.append(str(finished.report))
    scores = score_table(found.decomposition, found.runs, found.study)
    recordings = {name: str(path) for name, path in found.recordings.items()}
    return Target(
        kind="campaign",
        source=str(folder),
        asked=found.decomposition,
        study=found.study,
        runs=found.runs,
        sources=Sources(recordings, found.reasons),
        scores=scores,
        summary=summary_frame(scores, found.decomposition),
        last_words=tuple(words),
        fidelity=found.fidelity,
    )


def _of_run(folder: Path, decomposition: str | None) -> Target:
    from bench.campaign import load_measurable_decomposition, rescore
    from bench.recording import read_simspec
    from bench.scoring import ScoredRun, Sources, difficulty_of, score_table, summary_frame

    asked = load_measurable_decomposition(decomposition or _decomposition_beside(folder))
    result = rescore(folder, asked)
    recording = folder / "recording.mcap"
    simspec = read_simspec(recording)
    run = ScoredRun(
        realization=result.realization,
        design_point=result.realization,
        replicate=0,
        agent=simspec.agent.label,
        outcome=result.outcome,
        difficulty=difficulty_of(asked, simspec),
        observations=result.observations,
    )
    scores = score_table(asked, [run])
    return Target(
        kind="run",
        source=str(folder),
        asked=asked,
        study=asked.study,
        runs=(run,),
        sources=Sources({run.realization: str(recording)}, {run.realization: result.reason}),
        scores=scores,
        summary=summary_frame(scores, asked),
        last_words=(f"{result.outcome}, {result.simulated_s:.1f} simulated s",),
        fidelity="full",
    )


def _decomposition_beside(folder: Path) -> str:
    """The decomposition of the campaign that a run's folder lies in; the house's own for one by itself."""
    kept = folder.resolve().parent.parent / "decomposition.yaml"
    return str(kept) if folder.resolve().parent.name == "runs" and kept.is_file() else "search-and-report"


def _of_table(path: Path, decomposition: str) -> Target:
    from bench.documents import read_text
    from bench.scoring import Sources, read_table, score_external, summary_frame
    from bench.simspec import FACTORS
    from decompositions import DecompositionVocabulary, load_decomposition

    units = {name: factor.unit for name, factor in FACTORS.items()}
    asked = load_decomposition(decomposition, DecompositionVocabulary(units, difficulty="given"))
    table = read_table(read_text(path, MOST_TABLE_BYTES), asked, str(path))
    scores = score_external(asked, table.runs)
    rows = {pair: f"{path}:{line}" for pair, line in table.lines.items()}
    return Target(
        kind="observations",
        source=str(path),
        asked=asked,
        study=asked.study,
        runs=table.runs,
        sources=Sources(rows=rows),
        scores=scores,
        summary=summary_frame(scores, asked),
    )


def _console() -> Console:
    return Console(width=None if Console().is_terminal else WIDTH, highlight=False)


def _table_of_run(run: RunReport, titles: Mapping[str, str]) -> Table:
    table = Table(title=Text(f"{run.run}: {run.agent}, {run.outcome}"), title_justify="left")
    for column in ("node", "title", "difficulty", "x", "score", "achieved", "considered", "confidence"):
        table.add_column(column, justify="left" if column in ("node", "title") else "right")
    for node in run.nodes:
        table.add_row(
            Text(node.id),
            Text(titles.get(node.id, "")),
            "" if node.difficulty is None else f"{node.difficulty:.1f}",
            "" if node.x is None else f"{node.x:.3g}",
            "not scored" if node.score is None else f"{node.score:.1f}",
            str(node.achieved),
            str(node.considered),
            "" if node.confidence is None else f"{node.confidence:.0%}",
        )
    return table


def _show_explanation(found: Explanation, *, as_json: bool) -> None:
    if as_json:
        print(found.model_dump_json(indent=1))
        return
    console = _console()
    for agent in found.agents:
        console.print(_tree_of_agent(found, agent))
    if not found.agents:
        print(f"{found.source}: there are no runs yet")


def _tree_of_agent(found: Explanation, told: AgentExplanation) -> Tree:
    one = told.summary
    tree = Tree(Text(f"{found.id} {found.title}, {one.agent}: {found.asks}"))
    if one.score is None:
        tree.add(Text(f"not scored in any of {one.considered} considered runs"))
    else:
        made_of = ", ".join(told.scored_runs) + (", ..." if one.scored > len(told.scored_runs) else "")
        ends = "" if one.score_low is None else f", 95 % [{one.score_low:.2f}, {one.score_high:.2f}]"
        tree.add(Text(f"score {one.score:.2f}{ends}: the mean of the {one.scored} runs that have one ({made_of})"))
    if one.raised_by_failure:
        tree.add(Text("failing raised this score: it exceeds what it would be had every failed observable passed"))
    if one.confidence is not None:
        interval = f"95 % [{one.confidence_low:.1%}, {one.confidence_high:.1%}] {one.method}"
        tree.add(Text(f"confidence {one.confidence:.1%}, {interval}: the mean over {one.considered} considered runs"))
    if one.competence_50 is not None:
        least = "at least " if one.competence_50_at_least else ""
        bound = "" if one.competence_50_low is None else f", at least {one.competence_50_low:.2f} with 95 % confidence"
        tree.add(Text(f"competence {least}{one.competence_50:.2f}{bound}: up to this difficulty half of such runs pass"))
    tree.add(
        Text(
            f"{one.runs} runs count: {one.passed} passed, {one.considered - one.passed} failed, "
            f"{one.runs - one.considered} not considered; {one.excluded} more were spoilt by the bench"
        )
    )
    for run in told.runs:
        _add_run(tree, run)
    if told.runs_left_out:
        rest = ", ".join(f"{count} {state}" for state, count in told.runs_left_out.items())
        tree.add(Text(f"... and {rest} (--limit 0 shows all)"))
    return tree


def _add_run(tree: Tree, run: RunExplanation) -> None:
    scored = "not scored" if run.score is None else f"score {run.score:.2f}"
    hard = "" if run.difficulty is None else f" at difficulty {run.difficulty:.2f}"
    counts = f"{run.achieved} of {run.considered} observables achieved"
    branch = tree.add(Text(f"{run.run}: {run.state.upper()}, {scored}{hard}, {counts}"))
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
    """First and last line: an agent's traceback is as long as it likes, and the recording has it."""
    lines = [line.strip() for line in reason.splitlines() if line.strip(" )")]
    return reason.strip() if len(lines) < 3 else f"{lines[0]} ... {lines[-1]}"


def _add_observable(tree: Tree, leaf: ObservableExplanation) -> None:
    if leaf.state == "not considered":
        branch = tree.add(Text(f"{leaf.id} {leaf.title}: not considered; {leaf.reason}"))
    else:
        sign = ">=" if leaf.state == "achieved" else "<"
        branch = tree.add(Text(f"{leaf.id} {leaf.title}: {leaf.state}, x {leaf.x:.4g} {sign} {leaf.threshold:g}{_points(leaf)}"))
        if leaf.factors:
            told = (f"{one.factor} = {one.value:g} {one.unit} rates {one.rating:.2f}" for one in leaf.factors)
            branch.add(Text("; ".join(told)))
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
