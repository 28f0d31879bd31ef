"""A campaign's folder, read once.

Whatever is missing or damaged becomes a note in the report; only a folder that holds no campaign is an error.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from bench.contracts import (
    Fact,
    SessionResult,
    TruthGiven,
    losses_of,
    parse_document,
    probes_of,
)
from bench.documents import open_file, parse_text, read_text
from bench.errors import Fault, SetupError, command_line
from bench.scoring import (
    EXCLUDED_OUTCOMES,
    NodeFloor,
    node_floors,
    summary_frame,
)
from bench.simspec import FACTORS, SimSpec, agent_name, factor_values
from decompositions import Decomposition, load_decomposition

from ._campaign_data import LEVEL_ORDER, Configuration, Node, ReportData, Run, stopped_early, tallies_of
from ._remarks import Remarks
from ._score_file import load_scores, scored_runs
from ._simspec_files import KEPT_SIMSPECS, SimSpecFiles, situations_of

# The substitution with which bench.realization makes an agent's label a part of realization ids.
UNSAFE_LABEL_CHARACTERS = re.compile(r"[^a-z0-9_-]+")

# Runs without scores and without a SimSpec have only their id to say what they were.
REALIZATION_ID = re.compile(r"^(?P<point>p\d+)-r(?P<replicate>\d+)-(?P<agent>.+)$")


def load_report_data(folder: Path) -> ReportData:
    """Read a campaign folder. Raises SetupError when `folder` holds no campaign."""
    if not (folder / "campaign.yaml").is_file():
        raise SetupError(folder, "holds no campaign.yaml", "give the folder that `rebar run` wrote")
    notes: list[str] = []
    campaign = _mapping(parse_text(read_text(folder / "campaign.yaml"), str(folder / "campaign.yaml"))[0])
    document = _decomposition(folder, str(campaign.get("decomposition", "")), notes)
    scores = load_scores(folder, notes)
    floor_labels = _floor_labels(campaign)
    all_simspecs = _simspecs(folder)
    # Null agents and the oracle are no agents under test: nothing but floor and ceiling is about them.
    all_runs, damaged = _runs(folder, scores, all_simspecs, _names_in_ids(campaign), notes)
    runs = tuple(run for run in all_runs if run.agent not in floor_labels)
    # A damaged SimSpec loses its run the description of the situation; the run itself is still listed.
    simspecs = all_simspecs.of(run.realization for run in runs if run.realization not in damaged)
    if informed := sorted({run.agent for run in runs if run.fact(TruthGiven)}):
        notes.append(
            f"Given the truth: {', '.join(informed)}. What is shown of it can be reached, and is no agent's result."
        )
    nodes, roots = _nodes(document, scores)
    study = _study(campaign, document, nodes)
    agents = _agents(campaign, runs)
    return ReportData(
        name=str(campaign.get("name", folder.name)),
        description=str(campaign.get("description") or ""),
        study=study,
        agents=agents,
        runs=runs,
        nodes=nodes,
        roots=roots,
        scores=scores,
        tallies=tallies_of(summary_frame(scores, document)),
        configurations=_configurations(scores, study, agents, simspecs),
        simspecs=simspecs,
        campaign=campaign,
        decomposition=str(campaign.get("decomposition", "")),
        decomposition_sha256=document.digest if document is not None else None,
        manifest=_manifest(folder, notes),
        notes=tuple(notes),
        document=document,
        floors=_floors(folder, campaign, notes) if floor_labels else {},
        floor_sessions=len(all_runs) - len(runs),
    )


def _mapping(value: object) -> dict[str, Any]:
    return dict(value) if isinstance(value, Mapping) else {}


def _decomposition(folder: Path, reference: str, notes: list[str]) -> Decomposition | None:
    """The copy in the folder, else the decomposition by path or name; None, with a note, if it is unreadable."""
    # The copy first: the file that the campaign names may have changed since.
    stored = folder / "decomposition.yaml"
    try:
        return load_decomposition(
            str(next((path for path in (stored, folder / reference) if path.is_file()), reference))
        )
    except SetupError as error:
        reasons = "; ".join(fault.what for fault in error.faults)
        notes.append(
            f"The decomposition {reference!r} could not be read, so nodes have no titles here: {reasons}."
        )
        return None


def _floor_labels(campaign: Mapping[str, Any]) -> frozenset[str]:
    floor = _mapping(campaign.get("floor"))
    return frozenset(_agent_names([*(floor.get("agents") or ()), floor.get("oracle")]))


def _agent_names(specs: Iterable[object]) -> list[str]:
    """The names of the agents that parts of a campaign state, as far as they do."""
    return [agent_name(str(manifest)) for spec in specs if (manifest := _mapping(spec).get("manifest"))]


def _floors(folder: Path, campaign: Mapping[str, Any], notes: list[str]) -> dict[str, NodeFloor]:
    """Floor and ceiling of every node, from the table that scoring wrote beside scores.parquet."""
    try:
        with open_file(folder / "floor.parquet") as file:
            scores = pl.read_parquet(file)
    except (SetupError, OSError, pl.exceptions.PolarsError):
        notes.append(
            f"floor.parquet cannot be read, so floor and ceiling are not shown. `{command_line('rebar', 'report', Path(folder.name))}` makes it."
        )
        return {}
    oracle = _agent_names([_mapping(campaign.get("floor")).get("oracle")])
    return node_floors(scores, oracle[0] if oracle else None)


def _simspecs(folder: Path) -> SimSpecFiles:
    files = sorted((name, path) for name, path in _entries(folder / "simspecs") if name.endswith(".json"))
    return SimSpecFiles({name.removesuffix(".json"): path for name, path in files})


def _entries(parent: Path) -> Iterator[tuple[str, str]]:
    """Name and path of what lies in runs/ or simspecs/, in the folders 00 to 99 of a large campaign too."""
    for entry in os.scandir(parent) if parent.is_dir() else ():
        if len(entry.name) == 2 and entry.name.isdecimal():
            yield from ((inner.name, inner.path) for inner in os.scandir(entry))
        else:
            yield entry.name, entry.path


def _names_in_ids(campaign: Mapping[str, Any]) -> dict[str, str]:
    """The names of the campaign's agents, by the form in which realization ids hold them."""
    names = [*_agent_names(campaign.get("agents") or ()), *_floor_labels(campaign)]
    return {UNSAFE_LABEL_CHARACTERS.sub("-", name.lower()): name for name in names}


def _runs(
    folder: Path,
    scores: pl.DataFrame,
    simspecs: Mapping[str, SimSpec],
    names_in_ids: Mapping[str, str],
    notes: list[str],
) -> tuple[tuple[Run, ...], frozenset[str]]:
    """Every realization with scores, a SimSpec or a folder, by id; and those whose SimSpec is damaged."""
    scored = scored_runs(scores)
    folders = {name: path for name, path in _entries(folder / "runs") if Path(path).is_dir()}
    early_stopping = stopped_early(scores)
    runs, damaged, remarks = [], [], Remarks()
    # Most facts are the same in thousands of runs: they are in memory once.
    known: dict[Fact, Fact] = {}
    # A session that waits has only its SimSpec; one that was killed has a folder without a result. One result and one
    # SimSpec at a time: all of them would not fit into memory.
    for name in sorted({*scored, *simspecs, *folders}):
        run_folder = Path(folders[name]) if name in folders else None
        result = _result(run_folder / "result.json", notes) if run_folder is not None else None
        simspec = simspecs.get(name)
        if simspec is None:
            damaged.append(name)
        if result is not None:
            remarks.add(name, result)
            facts = {key: known.setdefault(fact, fact) for key, fact in result.facts.items()}
            result = result.model_copy(update={"facts": facts})
        row = scored.get(name, {})
        runs.append(_run(run_folder, name, result, row, simspec, names_in_ids, early_stopping))
    remarks.write(notes)
    return tuple(runs), frozenset(damaged)


def _result(path: Path, notes: list[str]) -> SessionResult | None:
    if not path.is_file():
        return None
    result = parse_document(SessionResult, path.read_bytes())
    if result is None:
        notes.append(f"runs/{path.parent.name}/result.json is damaged; the run is shown as not finished.")
    return result


def _run(
    folder: Path | None,
    name: str,
    result: SessionResult | None,
    row: Mapping[str, Any],
    simspec: SimSpec | None,
    names_in_ids: Mapping[str, str],
    early_stopping: bool,
) -> Run:
    parts = REALIZATION_ID.match(name)
    recording = None if folder is None else folder / "recording.mcap"
    part = parts["agent"] if parts else "unknown"
    agent = row.get("agent") or (simspec.agent.label if simspec else names_in_ids.get(part, part))
    run = Run(
        realization=name,
        design_point=str(row.get("design_point") or (parts["point"] if parts else name)),
        replicate=int(row.get("replicate") or (parts["replicate"] if parts else 0)),
        agent=str(agent),
        configuration=row.get("configuration"),
        outcome=None,
        recording=recording if recording is not None and recording.is_file() else None,
        root_seed=simspec.seeds.root if simspec else None,
    )
    if result is None:
        return run
    return replace(
        run,
        outcome=result.outcome,
        reason=result.reason,
        simulated_s=result.simulated_s,
        cpu_s=result.cpu_s + result.agent_cpu_s,
        recording_sha256=result.recording_sha256,
        # It flew and counts, yet scoring left it out: that happens only to replicates after the stop.
        after_stop=early_stopping and not row and result.outcome.counts,
        facts=result.facts,
        probes=probes_of(result.counters),
        losses=losses_of(result.counters),
    )


def _agents(campaign: Mapping[str, Any], runs: Iterable[Run]) -> tuple[str, ...]:
    """In the order in which the campaign names them; agents that flew without being named come last."""
    flown = {run.agent for run in runs}
    named = dict.fromkeys(_agent_names(campaign.get("agents") or ()))
    # Before the first run, all agents are listed; afterwards only those that flew.
    ordered = [name for name in named if name in flown or not flown]
    return (*ordered, *sorted(flown - set(ordered)))


def _nodes(document: Decomposition | None, scores: pl.DataFrame) -> tuple[dict[str, Node], tuple[str, ...]]:
    """The nodes of the decomposition and those without parents; without it, the bare ids of the scored nodes."""
    if document is not None:
        nodes = {
            node.id: Node(node.id, str(node.level), node.title, node.asks, node.children)
            for node in document.nodes.values()
        }
        return nodes, tuple(name for name in nodes if not document.parents[name])
    rows = scores.unique(["node", "level"]).sort("node").select("node", "level").iter_rows()
    bare = {
        name: Node(name, level, name)
        for name, level in sorted(rows, key=lambda row: (LEVEL_ORDER.index(row[1]), row[0]))
    }
    return bare, tuple(bare)


def _study(
    campaign: Mapping[str, Any], document: Decomposition | None, nodes: Mapping[str, Node]
) -> tuple[str, ...]:
    """The nodes under study of the campaign, else those of the decomposition, else every key attribute."""
    stated = campaign.get("study")
    if isinstance(stated, list) and stated:
        return tuple(map(str, stated))
    if document is not None:
        return document.study
    return tuple(node.id for node in nodes.values() if node.level == "ka")


def _configurations(
    scores: pl.DataFrame, study: Sequence[str], agents: Sequence[str], simspecs: Mapping[str, SimSpec]
) -> tuple[Configuration, ...]:
    """Easiest first: by the lowest studied difficulty, then by all of them."""
    keyed = scores.select("realization", "agent", "configuration", "node", "difficulty", "outcome").filter(
        pl.col("configuration").is_not_null(), ~pl.col("outcome").is_in(EXCLUDED_OUTCOMES)
    )
    varied = _varied_factors(simspecs)
    configurations = []
    # Sorted, because Polars returns groups in no fixed order.
    for (key,), rows in sorted(keyed.group_by("configuration"), key=lambda pair: str(pair[0][0])):
        # Any row of a node will do: a configuration is the set of runs with the same difficulties
        # (docs/rulings.md 14).
        rated = dict(
            rows.filter(pl.col("node").is_in(study)).select("node", "difficulty").drop_nulls().iter_rows()
        )
        difficulty = {node: float(rated[node]) for node in study if node in rated}
        counted = rows.unique("realization")
        runs = {agent: counted.filter(pl.col("agent") == agent).height for agent in agents}
        levels = {
            factor: tuple(sorted({values[name] for name in counted["realization"] if name in values}))
            for factor, values in varied.items()
        }
        configurations.append(Configuration("", str(key), difficulty, runs, levels))
    # The label is given after this, so C1 is the easiest. The key breaks ties, for the same order every time.
    configurations.sort(
        key=lambda row: (min(row.difficulty.values(), default=0.0), sum(row.difficulty.values()), row.key)
    )
    return tuple(
        replace(configuration, label=f"C{place}")
        for place, configuration in enumerate(configurations, start=1)
    )


def _varied_factors(simspecs: Mapping[str, SimSpec]) -> dict[str, dict[str, float]]:
    """For each key factor that varies: its value in every realization."""
    # Replicates share their situation: its values are one object, however many runs have it.
    situations: dict[tuple[float | None, ...], dict[str, float]] = {}
    values: dict[str, dict[str, float]] = {}
    rated: dict[int, tuple[SimSpec, dict[str, float]]] = {}
    for name, simspec in situations_of(simspecs):
        # With the SimSpec itself: its identity is that of another one once it is gone.
        _, row = rated.get(id(simspec)) or (simspec, factor_values(simspec))
        if len(rated) < KEPT_SIMSPECS:
            rated[id(simspec)] = simspec, row
        values[name] = situations.setdefault(tuple(row.get(factor) for factor in FACTORS), row)
    varied = [
        factor for factor in FACTORS if len({row[factor] for row in situations.values() if factor in row}) > 1
    ]
    return {factor: {name: row[factor] for name, row in values.items() if factor in row} for factor in varied}


def _manifest(folder: Path, notes: list[str]) -> dict[str, Any]:
    path = folder / "manifest.json"
    if not path.is_file():
        notes.append("There is no manifest.json: digests and versions are not on record.")
        return {}
    try:
        return _mapping(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        notes.append("manifest.json is damaged: digests and versions are not on record.")
        return {}


def load_scored(folders: Sequence[Path]) -> list[ReportData]:
    """Read campaign folders. Raises SetupError for each that holds no campaign or no scores."""
    data = [load_report_data(folder) for folder in folders]
    if faults := [
        Fault(str(folder), "holds no scores", f"`{command_line('rebar', 'score', folder)}` makes them")
        for folder, campaign in zip(folders, data, strict=True)
        if not campaign.scores.height
    ]:
        raise SetupError(faults)
    return data


def require_distinct(folders: Sequence[Path]) -> None:
    """Raises SetupError where a folder is named twice, however it is spelt: its runs would count twice."""
    paths = [folder.resolve() for folder in folders]
    if twice := [folder for number, folder in enumerate(folders) if paths[number] in paths[:number]]:
        raise SetupError(twice[0], "is named twice", "name each folder once")
