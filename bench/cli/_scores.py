"""`rebar score`: scores recordings again, scores tables from other sources, and explains a score."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table
from rich.text import Text

from bench.errors import Fault, SetupError

from ._explanation import show_explanation
from ._missing_runs import completeness_report, exit_if_incomplete, print_missing, print_rewritten
from ._tables import add_plain_row, plain_console, plain_table

if TYPE_CHECKING:
    import polars as pl

    from bench.campaign import Completeness
    from bench.scoring import (
        Explanation,
        NodeFloor,
        RunReport,
        ScoredRun,
        ScoreReport,
        Sources,
    )
    from decompositions import Decomposition

# Chosen, not measured: a larger table is more likely a wrong file than observations.
MAX_TABLE_BYTES = 2 * 1024**3


def score(
    runs: Annotated[list[Path] | None, typer.Argument(help="Folders of runs or of campaigns")] = None,
    decomposition: Annotated[
        str | None, typer.Option(help="Name or file of a decomposition. Default: the campaign's")
    ] = None,
    observations: Annotated[
        Path | None,
        typer.Option(help="Score a table of observations instead of folders (CSV)"),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help="Print JSON (`rebar schema score-report`): an array of such documents for several folders",
        ),
    ] = False,
    per_run: Annotated[bool, typer.Option("--per-run", help="Show the nodes of every run as well")] = False,
    explain: Annotated[
        str | None, typer.Option(metavar="NODE", help="Explain the score of this node. Writes nothing")
    ] = None,
    limit: Annotated[
        int,
        typer.Option(
            min=0,
            help="With --explain: maximum of runs per agent, observables per run and moments per observable; 0 for all",
        ),
    ] = 5,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, help="Processes that measure the recordings of a campaign. Default: the number of cores"
        ),
    ] = None,
) -> None:
    """Measure and score recordings again, from nothing but the recording, its SimSpec and the decomposition.

    For the folder of a run, the scores are printed. For a campaign, result.json files, scores.parquet and
    report.html are written again, once every recording is measured. Ends with code 3 if a campaign lacks runs that its agents did not cause.

    Example: rebar score out/demo/runs/p001-r1-reference-naive

    Example: rebar score out/demo --explain KA-18

    Example: rebar score --observations table.csv --decomposition mine.yaml --json
    """
    sources = _score_sources(
        runs or [], decomposition, observations, reading=explain is not None, workers=workers
    )
    for source in sources:
        # Also of complete ones: somebody may be at work in the folder.
        if source.completeness is not None:
            print_missing(source.completeness, Path(source.source), as_json=as_json)
    if as_json:
        documents = [
            source.report(per_run=per_run) if explain is None else source.explained(explain, limit)
            for source in sources
        ]
        texts = [document.model_dump_json(indent=1, ensure_ascii=True) for document in documents]
        # One document: that of the only target, or an array of them in the order of the command line.
        print(texts[0] if len(texts) == 1 else "[\n" + ",\n".join(texts) + "\n]")
    else:
        for source in sources:
            if explain is None:
                source.show(per_run=per_run)
            else:
                show_explanation(source.explained(explain, limit))
    exit_if_incomplete([source.completeness for source in sources])


def check_node(option: str, decomposition: Decomposition, node: str) -> None:
    """Raises SetupError, with the nodes of similar names, if the decomposition has no such node."""
    if node not in decomposition.nodes:
        similar = difflib.get_close_matches(node, decomposition.nodes, n=3)
        attributes = ", ".join(decomposition.key_attributes)
        remedy = f"did you mean {' or '.join(similar)}?" if similar else f"key attributes: {attributes}"
        raise SetupError(option, f"there is no node {node!r} in {decomposition.name}", remedy)


def rated_decomposition(named: str, difficulty: Literal["tables", "given"] = "tables") -> Decomposition:
    """A decomposition by its name or file. Raises SetupError unless it suits the factors that SimSpecs have."""
    from bench.simspec import FACTORS
    from decompositions import DecompositionVocabulary, load_decomposition

    units = {name: factor.unit for name, factor in FACTORS.items()}
    return load_decomposition(named, DecompositionVocabulary(units, difficulty=difficulty))


def campaign_report(folder: Path) -> ScoreReport:
    """The score report of a campaign. Nothing is measured again."""
    return _of_campaign(folder, None, reading=True).report(per_run=False)


@dataclass(frozen=True, slots=True)
class ScoreSource:
    """A campaign, a run or a table to be scored: its runs, and where they come from."""

    kind: Literal["campaign", "run", "observations"]
    source: str
    decomposition: Decomposition
    study: tuple[str, ...]
    runs: tuple[ScoredRun, ...]
    sources: Sources
    scores: pl.DataFrame
    summary: pl.DataFrame
    closing_lines: tuple[str, ...] = field(default=())
    fidelity: Literal["full", "overhead"] | None = None
    floors: Mapping[str, NodeFloor] = field(default_factory=dict)
    completeness: Completeness | None = None

    def report(self, *, per_run: bool) -> ScoreReport:
        """The document for `--json`."""
        from bench.scoring import ScoreReport, absent_pairs, node_reports, run_reports, statement_reports

        shows_runs = per_run or self.kind == "run"
        counted = (run for run in self.runs if run.outcome.counts)
        return ScoreReport(
            kind=self.kind,
            source=self.source,
            fidelity=self.fidelity,
            completeness=completeness_report(self.completeness, Path(self.source))
            if self.completeness
            else None,
            decomposition=self.decomposition.name,
            decomposition_sha256=self.decomposition.digest,
            study=self.study,
            absent=absent_pairs(self.decomposition, self.runs),
            nodes=node_reports(self.scores, self.summary, self.floors),
            runs=run_reports(self.scores, self.sources.recordings) if shows_runs else None,
            statements=statement_reports(
                (run.agent, (run.design_point, run.replicate), run.statements) for run in counted
            ),
        )

    def explained(self, node: str, limit: int) -> Explanation:
        """Why a node has its scores. Raises SetupError for an unknown node."""
        from bench.scoring import explain, node_reports

        check_node("--explain", self.decomposition, node)
        summaries = node_reports(self.scores, self.summary.filter(node=node, configuration="all"))
        return explain(
            self.decomposition, node, self.runs, self.scores, summaries, self.sources, self.source, limit
        )

    def show(self, *, per_run: bool) -> None:
        """Print the scores as tables."""
        from bench.reporting import score_tables
        from bench.scoring import absent_pairs, run_reports

        console = plain_console()
        if self.kind != "run":
            top = self.decomposition.level_of(next(iter(self.decomposition.nodes)))
            nodes = self.study or self.decomposition.at_level(top)
            for part in score_tables(self.summary, nodes, self.floors):
                console.print(part)
        if per_run or self.kind == "run":
            titles = {node.id: node.title for node in self.decomposition.nodes.values()}
            for run in run_reports(self.scores):
                console.print(_tablesource_of_run(run, titles))
        if self.kind == "observations":
            absent = absent_pairs(self.decomposition, self.runs)
            print(
                f"{len(self.runs)} runs; {absent} pairs of run and observable have no row and are not considered"
            )
        for line in self.closing_lines:
            print(line)


def _score_sources(
    runs: Sequence[Path], decomposition: str | None, table: Path | None, *, reading: bool, workers: int | None
) -> list[ScoreSource]:
    """Everything that the command line names, scored. `reading` writes nothing."""
    from bench.campaign import is_campaign

    if table is not None:
        if runs:
            raise SetupError("--observations", "cannot be given together with folders", "give either")
        if decomposition is None:
            raise SetupError(
                "--observations", "a table does not name its decomposition", "give --decomposition FILE"
            )
        return [_of_table(table, decomposition)]
    if not runs:
        what = "there is nothing to score"
        raise SetupError("score", what, "name the folder of a run or of a campaign, or give --observations")
    faults = [
        Fault(str(path), "is a file", f"name the folder that holds it: {path.parent}")
        for path in runs
        if path.is_file()
    ]
    if faults:
        raise SetupError(faults)
    return [
        _of_campaign(folder, decomposition, reading=reading, workers=workers)
        if is_campaign(folder)
        else source_of_run(folder, decomposition)
        for folder in runs
    ]


def _of_campaign(
    folder: Path, decomposition: str | None, *, reading: bool, workers: int | None = None
) -> ScoreSource:
    from bench.campaign import read_runs, rescore_campaign
    from bench.scoring import Sources, score_table, summary_frame

    from ._progress import open_counter

    lines: tuple[str, ...] = ()
    if reading:
        campaign = read_runs(folder, decomposition)
    else:
        with open_counter(f"measure {folder.name}") as counter:
            finished = rescore_campaign(folder, decomposition, workers=workers, on_measured=counter)
        print_rewritten(finished.rewritten)
        # Without the argument: scoring again has stored the decomposition in the folder.
        campaign = read_runs(folder)
        lines = (str(finished.report),)
    scores = score_table(campaign.decomposition, campaign.runs, campaign.study)
    recordings = {name: str(path) for name, path in campaign.recordings.items()}
    return ScoreSource(
        kind="campaign",
        source=str(folder),
        decomposition=campaign.decomposition,
        study=campaign.study,
        runs=campaign.runs,
        sources=Sources(recordings, campaign.reasons),
        scores=scores,
        summary=summary_frame(scores, campaign.decomposition),
        closing_lines=lines,
        fidelity=campaign.fidelity,
        completeness=campaign.completeness,
        floors=campaign.floors(),
    )


def source_of_run(folder: Path, named: str | None) -> ScoreSource:
    from bench.campaign import check_run, load_measurable_decomposition, rescore
    from bench.contracts import ReportStatements
    from bench.recording import read_simspec
    from bench.scoring import ScoredRun, Sources, difficulty_of, score_table, summary_frame

    check_run(folder)
    decomposition = load_measurable_decomposition(named or _campaign_decomposition(folder))
    recording = folder / "recording.mcap"
    result = rescore(folder, decomposition)
    simspec = read_simspec(recording)
    run = ScoredRun(
        realization=result.realization,
        # A run by itself has no design: it is a design point of its own.
        design_point=result.realization,
        replicate=0,
        agent=simspec.agent.label,
        outcome=result.outcome,
        difficulty=difficulty_of(decomposition, simspec),
        observations=result.observations,
        statements=result.fact(ReportStatements),
    )
    scores = score_table(decomposition, [run])
    return ScoreSource(
        kind="run",
        source=str(folder),
        decomposition=decomposition,
        study=decomposition.study,
        runs=(run,),
        sources=Sources({run.realization: str(recording)}, {run.realization: result.reason}),
        scores=scores,
        summary=summary_frame(scores, decomposition),
        closing_lines=(f"{result.outcome}, {result.simulated_s:.1f} simulated s",),
        # Surrogates leave no recording, so a run that has one was flown.
        fidelity="full",
    )


def _campaign_decomposition(run: Path) -> str:
    """The decomposition of the campaign that a run belongs to.

    The default one for a run outside a campaign.
    """
    # In a large campaign a run lies in one of the folders 00 to 99 of runs/.
    for runs in run.resolve().parents[:2]:
        path = runs.parent / "decomposition.yaml"
        if runs.name == "runs" and path.is_file():
            return str(path)
    return "search-and-report"


def _of_table(path: Path, named: str) -> ScoreSource:
    from bench.documents import read_text
    from bench.scoring import Sources, read_table, score_table, summary_frame

    decomposition = rated_decomposition(named, difficulty="given")
    table = read_table(read_text(path, MAX_TABLE_BYTES), decomposition, str(path))
    scores = score_table(decomposition, table.runs)
    rows = {pair: f"{path}:{line}" for pair, line in table.lines.items()}
    return ScoreSource(
        kind="observations",
        source=str(path),
        decomposition=decomposition,
        study=decomposition.study,
        runs=table.runs,
        sources=Sources(rows=rows),
        scores=scores,
        summary=summary_frame(scores, decomposition),
    )


_STANDING_NOTES = {
    "configured sensor": " (configured sensor)",
    "not exercisable": " (not exercisable)",
    "overruled": " (not exercisable; its measure is overruled)",
}


def _tablesource_of_run(run: RunReport, titles: Mapping[str, str]) -> Table:
    table = plain_table(("node", "title", "difficulty", "x", "score", "achieved"), texts=("title",))
    table.title, table.title_justify = Text(f"{run.run}: {run.agent}, {run.outcome}"), "left"
    for node in run.nodes:
        cells = (
            node.id,
            titles.get(node.id, "") + _STANDING_NOTES.get(node.standing or "", ""),
            "none" if node.difficulty is None else f"{node.difficulty:.1f}",
            "" if node.x is None else f"{node.x:.3g}",
            "not scored" if node.score is None else f"{node.score:.1f}",
            f"{node.achieved} of {node.considered}" if node.considered else "not considered",
        )
        add_plain_row(table, cells)
    return table
