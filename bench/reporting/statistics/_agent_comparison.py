"""Two agents, two sources of perception or two autopilots, compared on the scenes that both flew, in one campaign or in two;
and one agent in two campaigns without a common scene.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from bench.errors import Fault, SetupError
from bench.scoring import EXCLUDED_OUTCOMES
from bench.simspec import SimSpec
from bench.statistics import NodeComparison, UnpairedNodeComparison, compare_nodes, compare_unpaired_nodes

from .._campaign_data import ReportData
from .._campaign_folder import load_scored
from ._sensor import perception_in_short


@dataclass(frozen=True, slots=True)
class ComparedAgent:
    """One agent of one campaign."""

    label: str
    agent: str
    data: ReportData


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two sides over the scenes that both flew and that count; `scenes` counts those, whether a node was considered
    in them or not. `perceptions` are those of the sides where the scenes are equal but for perception, else None;
    `autopilots` likewise, with the pace at which each can fly; `paces` are those of the sides where they differ and the
    autopilot does not. Where one agent flew other scenes in two campaigns,
    `scenes` is 0, and `unpaired` has the nodes in place of `nodes`.
    """

    first: str
    second: str
    scenes: int
    nodes: tuple[NodeComparison, ...]
    perceptions: tuple[str, str] | None = None
    autopilots: tuple[str, str] | None = None
    paces: tuple[str, str] | None = None
    unpaired: tuple[UnpairedNodeComparison, ...] = ()

    @property
    def pace_note(self) -> str:
        """What two sides that flew at different paces have to be read with; empty for the same pace."""
        if self.paces is None:
            return ""
        first, second = self.paces
        return (
            f"{self.first} flew at the pace {first}, {self.second} at {second}: what differs may be the pace"
        )

    def verdicts(self) -> list[str]:
        """A sentence for each node."""
        nodes: Sequence[NodeComparison | UnpairedNodeComparison] = self.nodes or self.unpaired
        return [node.verdict(self.first, self.second) for node in nodes]


def compare_campaigns(
    folders: Sequence[Path], agents: Sequence[str] = (), nodes: Sequence[str] = (), *, seed: int = 0
) -> Comparison:
    """Compare two agents of one campaign's folder, or one agent each of two folders.

    Without `agents`: the two of one folder, or each folder's only one (else the one that both have). Without
    `nodes`: those under study, of both campaigns; where the scenes differ in perception, autopilot or pace alone, also the observables under them. Raises SetupError with every reason for which they cannot be
    compared.
    """
    first, second = _compared_agents(folders, agents)
    faults = [*_decomposition_faults(first, second), *_unknown_node_faults(first.data, nodes)]
    if faults:
        raise SetupError(faults)
    comparison = _compared(first, second, nodes, seed)
    if not comparison.scenes and first.agent == second.agent:
        return _compared_unpaired(first, second, nodes, seed)
    if not comparison.scenes:
        # The scenes may be harder for one agent than for the other: nothing could be said about the agents.
        raise SetupError(
            f"{first.label} and {second.label}",
            "flew no scene in common",
            "compare agents of one campaign, or run the same campaign (base, design, seed) with the other agent; only one agent "
            "is compared with itself on other scenes",
        )
    return comparison


def compare_agents(data: ReportData, first: str, second: str, *, seed: int = 0) -> Comparison:
    """Two agents of one campaign at the nodes under study: the numbers of `rebar compare`."""
    return _compared(ComparedAgent(first, first, data), ComparedAgent(second, second, data), (), seed)


def _compared(first: ComparedAgent, second: ComparedAgent, nodes: Sequence[str], seed: int) -> Comparison:
    """The one computation behind the report and `rebar compare`."""
    shared: Mapping[str, str] | None = None
    if first.data is second.data:
        differences = _own_paces(first, second)
    else:
        shared, differences = _shared_scenes(first, second)
    # p values are adjusted over the nodes compared. Those under study were chosen before the flights; what the reader
    # of a result chooses is not.
    compared_nodes = nodes or tuple(dict.fromkeys((*first.data.study, *second.data.study)))
    if shared and differences and not nodes:
        compared_nodes = _with_observables(first.data, compared_nodes)
    count, first_rows, second_rows = _shared_scene_rows(first, second, shared, compared_nodes)
    return Comparison(
        first.label,
        second.label,
        count,
        compare_nodes(
            first_rows, second_rows, compared_nodes, excluded_outcomes=EXCLUDED_OUTCOMES, seed=seed
        ),
        **differences,
    )


def _own_paces(first: ComparedAgent, second: ComparedAgent) -> dict[str, Any]:
    """The `paces` of two agents of one campaign, nothing where they flew at the same."""
    # Read only where an agent has one of its own: it takes every SimSpec of both.
    if not any(agent.get("pace") for agent in first.data.campaign.get("agents", ())):
        return {}
    flown = [_rows_that_count(side, ["realization"])["realization"].unique() for side in (first, second)]
    paces = _descriptions(
        ((first, flown[0].to_list()), (second, flown[1].to_list())), lambda spec: spec.pace.mode
    )
    return {"paces": paces} if paces[0] != paces[1] else {}


def _compared_unpaired(
    first: ComparedAgent, second: ComparedAgent, nodes: Sequence[str], seed: int
) -> Comparison:
    compared_nodes = nodes or tuple(dict.fromkeys((*first.data.study, *second.data.study)))
    first_rows, second_rows = (
        _rows_that_count(side, _COMPARED_COLUMNS, *compared_nodes) for side in (first, second)
    )
    unpaired = compare_unpaired_nodes(
        first_rows, second_rows, compared_nodes, excluded_outcomes=EXCLUDED_OUTCOMES, seed=seed
    )
    return Comparison(first.label, second.label, 0, (), unpaired=unpaired)


def _with_observables(data: ReportData, nodes: Sequence[str]) -> tuple[str, ...]:
    """Each node and the observables under it, once each; the nodes alone where the decomposition cannot be read."""
    tree = data.document
    if tree is None:
        return tuple(nodes)
    return tuple(dict.fromkeys(name for node in nodes for name in (node, *tree.observables_under(node))))


def _compared_agents(folders: Sequence[Path], agents: Sequence[str]) -> tuple[ComparedAgent, ComparedAgent]:
    if len(folders) not in (1, 2) or len(agents) not in (0, 2):
        raise SetupError(
            "compare", "two sides are compared", "name one folder or two, and two agents or none"
        )
    data = load_scored(folders)
    # One folder is both sides: its first and its last entry are the same.
    places = [(folders[0], data[0]), (folders[-1], data[-1])]
    known_agents = [_agents(campaign) for _, campaign in places]
    chosen = tuple(agents) or _default_agents(folders, known_agents)
    if faults := [
        Fault("--agents", f"{agent!r} is not in {place[0]}", f"agents there: {', '.join(flown)}")
        for agent, place, flown in zip(chosen, places, known_agents, strict=True)
        if agent not in flown
    ]:
        raise SetupError(faults)
    if chosen[0] == chosen[1] and len(folders) == 1:
        raise SetupError("--agents", "both sides are the same agent of the same campaign", "name two agents")
    labels = _labels(chosen, folders)
    first, second = (
        ComparedAgent(label, agent, campaign)
        for label, (_, campaign), agent in zip(labels, places, chosen, strict=True)
    )
    return first, second


def _agents(data: ReportData) -> list[str]:
    flown = set(data.scores["agent"])
    return [agent for agent in data.agents if agent in flown]


def _default_agents(folders: Sequence[Path], known_agents: Sequence[Sequence[str]]) -> tuple[str, ...]:
    if len(folders) == 1:
        if len(known_agents[0]) == 2:
            return tuple(known_agents[0])
    elif len(known_agents[0]) == len(known_agents[1]) == 1:
        return known_agents[0][0], known_agents[1][0]
    elif len(shared := [agent for agent in known_agents[0] if agent in known_agents[1]]) == 1:
        return shared[0], shared[0]
    # Not strict: with one folder, `known_agents` has it twice.
    agents_by_folder = "; ".join(
        f"{folder} has {', '.join(agents)}" for folder, agents in zip(folders, known_agents, strict=False)
    )
    what = f"it is not plain which two are meant: {agents_by_folder}"
    raise SetupError("--agents", what, "name them: --agents FIRST SECOND")


def _labels(agents: Sequence[str], folders: Sequence[Path]) -> tuple[str, str]:
    if agents[0] != agents[1]:
        return agents[0], agents[1]
    names = [folder.resolve().name for folder in folders]
    return (names[0], names[1]) if names[0] != names[1] else (str(folders[0]), str(folders[1]))


def _decomposition_faults(first: ComparedAgent, second: ComparedAgent) -> list[Fault]:
    digests = first.data.decomposition_sha256, second.data.decomposition_sha256
    # Two unreadable decompositions are not the same one.
    if digests[0] is not None and digests[0] == digests[1]:
        return []
    return [
        Fault(
            f"{first.label} and {second.label}",
            "were scored over different decompositions, or one that cannot be read",
            "`rebar score FOLDER --decomposition NAME` scores both over one",
        )
    ]


def _unknown_node_faults(data: ReportData, nodes: Iterable[str]) -> list[Fault]:
    return [
        Fault("--node", f"there is no node {node!r}", f"for example {', '.join(data.study)}")
        for node in nodes
        if node not in data.nodes
    ]


# What may differ between two campaigns, in the order in which it is tried: the fields of `Comparison` and of the SimSpec,
# and what a side flew with, in words.
_DIFFERENCES: dict[str, tuple[tuple[str, ...], Callable[[SimSpec], str]]] = {
    "": ((), lambda spec: ""),
    "perceptions": (("perception",), lambda spec: perception_in_short(spec.perception)),
    "paces": (("pace",), lambda spec: spec.pace.mode),
    # A board keeps real time, and firmware takes more of the host's: neither changes what is asked of the agent.
    "autopilots": (
        ("vehicle.autopilot", "pace", "budgets"),
        lambda spec: f"{spec.vehicle.autopilot}, {spec.pace.mode}",
    ),
}


def _shared_scenes(first: ComparedAgent, second: ComparedAgent) -> tuple[dict[str, str], dict[str, Any]]:
    """The realizations of the first side that flew the same scene, by those of the second, and what differs.

    Scenes are equal in all but name and agent; if none are, in all but one of _DIFFERENCES.
    """
    # By content and not by id: two campaigns may number the same scenes differently.
    for name, (ignored, describe) in _DIFFERENCES.items():
        first_scenes, second_scenes = (_realizations_by_scene(side, ignored) for side in (first, second))
        shared = {
            second_scenes[scene]: first_scenes[scene] for scene in first_scenes if scene in second_scenes
        }
        if shared:
            sides = ((first, tuple(shared.values())), (second, tuple(shared)))
            return shared, {name: _descriptions(sides, describe)} if name else {}
    return {}, {}


def _descriptions(
    sides: tuple[tuple[ComparedAgent, Sequence[str]], tuple[ComparedAgent, Sequence[str]]],
    describe: Callable[[SimSpec], str],
) -> tuple[str, str]:
    """What each side flew the shared scenes with, in words."""
    first, second = (
        " or ".join(
            sorted(
                {describe(side.data.simspecs[name]) for name in realizations if name in side.data.simspecs}
            )
        )
        for side, realizations in sides
    )
    return first, second


_SCENE = ["design_point", "replicate"]
_COMPARED_COLUMNS = ["realization", *_SCENE, "node", "level", "score", "confidence", "outcome"]


def _rows_that_count(side: ComparedAgent, columns: Sequence[str], *nodes: str) -> pl.DataFrame:
    """Some columns of the runs of one side, over these nodes: a table of all would be in memory once more."""
    of_side = pl.col("agent") == side.agent, ~pl.col("outcome").is_in(list(EXCLUDED_OUTCOMES))
    of_nodes = [pl.col("node").is_in(list(nodes))] if nodes else []
    filtered = [*columns, "agent", "outcome", "node"]
    return side.data.scores.select(list(dict.fromkeys(filtered))).filter(*of_side, *of_nodes).select(columns)


def _shared_scene_rows(
    first: ComparedAgent, second: ComparedAgent, shared: Mapping[str, str] | None, nodes: Sequence[str]
) -> tuple[int, pl.DataFrame, pl.DataFrame]:
    """The number of scenes that both sides flew, and the rows of both in them over `nodes`, with the realizations and
    design points of the first side; `shared` is None within one campaign.
    """
    first_rows, second_rows = (_rows_that_count(side, _COMPARED_COLUMNS, *nodes) for side in (first, second))
    first_runs, second_runs = (
        _rows_that_count(side, ["realization", *_SCENE]).unique("realization") for side in (first, second)
    )
    if shared is None:
        # A campaign gives all its agents the same scene at each design point and replicate, also where the SimSpecs are
        # lost.
        return (
            first_runs.join(second_runs, on=_SCENE, how="semi").height,
            first_rows.join(second_runs, on=_SCENE, how="semi"),
            second_rows.join(first_runs, on=_SCENE, how="semi"),
        )
    key = pl.col("realization")
    named = first_runs.filter(key.is_in(list(shared.values())))
    renamed = second_rows.with_columns(
        key.cast(pl.String)
        .replace_strict(shared, default=None, return_dtype=pl.String)
        .cast(first_rows.schema["realization"])
    ).drop_nulls("realization")
    return (
        named.height,
        first_rows.filter(key.is_in(list(shared.values()))),
        renamed.drop(_SCENE).join(named, on="realization", how="inner"),
    )


def _realizations_by_scene(side: ComparedAgent, ignored: Sequence[str] = ()) -> dict[str, str]:
    """The realization that flew each scene, by a digest of its SimSpec without name, agent and what is `ignored`.

    A scene that this leaves with several realizations is left out: which of them is meant cannot be known.
    """
    flown = _rows_that_count(side, ["realization"])["realization"].unique(maintain_order=True)
    realizations: dict[str, list[str]] = {}
    for realization in flown:
        if realization in side.data.simspecs:
            digest = scene_digest(side.data.simspecs[realization], ignored)
            realizations.setdefault(digest, []).append(realization)
    return {scene: names[-1] for scene, names in realizations.items() if not ignored or len(names) == 1}


def scene_digest(simspec: SimSpec, ignored: Sequence[str] = ()) -> str:
    """A digest of what is flown, whichever agent flies it, without the parts of the SimSpec that are `ignored`."""
    # The name holds the agent, and the agent is what differs between the two runs of a scene.
    excluded: dict[str, Any] = {"name": True, "agent": True}
    for path in ignored:
        part, _, field = path.partition(".")
        excluded[part] = {field: True} if field else True
    return hashlib.sha256(simspec.model_dump_json(exclude=excluded).encode()).hexdigest()
