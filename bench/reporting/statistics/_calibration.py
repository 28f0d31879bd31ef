"""Difficulty against outcomes, over several agents: what `rebar calibrate` shows, and fits.

Trials are considered runs of a key attribute, as those of competence (docs/rulings.md, 17): a trial passes when every
considered observable under the node is achieved.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from bench.agents import installed_agents
from bench.arrays import Floats
from bench.difficulty import (
    MIN_OUTCOMES,
    POINTS_PER_LOG_ODDS,
    DifficultyScale,
    Feature,
    FlownFolder,
    ScaleTrials,
    features_of,
    fit_scale,
    shipped_scale,
)
from bench.errors import Fault, SetupError, command_line
from bench.scoring import EXCLUDED_OUTCOMES, Standing
from bench.simspec import SimSpec
from bench.statistics import DifficultySlope, ScaleProof, difficulty_slope, prove_scale
from decompositions import Decomposition, Level

from .._campaign_data import ReportData
from .._campaign_folder import load_scored, require_distinct
from ._agent_comparison import scene_digest


@dataclass(frozen=True, slots=True)
class NodeCalibration:
    """How failure at a key attribute depends on its published rating, and on its measured difficulty.

    `rated` is the test of the published rating as a scale; `measured` is None where there is no scale of the node.
    """

    node: str
    title: str
    rated: ScaleProof
    measured: ScaleProof | None


@dataclass(frozen=True, slots=True)
class Calibration:
    """Difficulty against outcomes. `overall` pools all observables; `excluded` are agents left out."""

    folders: tuple[Path, ...]
    agents: tuple[str, ...]
    excluded: tuple[str, ...]
    runs: int
    design_points: int
    decomposition: Decomposition
    overall: DifficultySlope
    nodes: tuple[NodeCalibration, ...]
    scale: DifficultyScale | None
    """With what these runs show of each node."""
    dependence: str
    """Why these runs cannot show that the scale holds; empty where they can."""
    notes: tuple[str, ...] = ()


def fit_difficulty(folders: Sequence[Path]) -> DifficultyScale:
    """Fit a scale of measured difficulty to the runs of a panel. Raises SetupError as `calibrate`, and where no node has a model."""
    source = _Source.of(folders)
    source = source.of_agents(_chosen_agents(source, ()))
    trials = {}
    for node in source.decomposition.key_attributes:
        rows = source.attribute(node)
        trials[node] = ScaleTrials(tuple(rows["agent"]), tuple(rows["scene"]), tuple(rows["failed"]))
    scale = fit_scale(source.decomposition, trials, source.features(), source.flown())
    if not scale.nodes:
        what = f"no key attribute has {MIN_OUTCOMES} failures and {MIN_OUTCOMES} passes, so there is no scale to fit"
        raise SetupError(", ".join(map(str, folders)), what, "add folders of more agents or scenes")
    return scale


def calibrate(
    folders: Sequence[Path],
    agents: Sequence[str] = (),
    *,
    scale: DifficultyScale | None = None,
    seed: int = 0,
) -> Calibration:
    """Check the difficulty of the runs in campaign folders against their outcomes.

    Without `agents`: all but null agents and the oracle. An agent of the same name in several folders is one
    agent. Without `scale`: the one that ships for the decomposition, if any. Raises SetupError with every reason
    for which nothing can be checked.
    """
    source = _Source.of(folders)
    flown = source.flown().agents
    source = source.of_agents(chosen := _chosen_agents(source, agents))
    scale = scale or shipped_scale(source.decomposition)
    if scale is not None and scale.decomposition_sha256 != source.decomposition.digest:
        what = f"is scored over another version of {scale.decomposition} than the scale"
        raise SetupError(folders[0], what, f"`{command_line('rebar', 'score', folders[0])}` scores it again")
    features = source.features() if scale else {}
    nodes = tuple(
        _node(source.attribute(node), node, source.decomposition.nodes[node].title, scale, features, seed)
        for node in source.decomposition.key_attributes
    )
    counted = source.trials.filter(level=str(Level.OBSERVABLE), standing=str(Standing.COUNTED))
    dependence = _dependence(scale, source.flown()) if scale else ""
    calibration = Calibration(
        folders=tuple(folders),
        agents=chosen,
        excluded=tuple(agent for agent in flown if agent not in chosen),
        runs=source.trials.select("folder", "realization").n_unique(),
        design_points=source.trials["point"].n_unique(),
        decomposition=source.decomposition,
        overall=difficulty_slope(
            counted["difficulty"].to_numpy(),
            counted["failed"].to_numpy(),
            counted["agent"].to_list(),
            counted["point"].to_list(),
        ),
        nodes=nodes,
        scale=_proved(scale, nodes, source.flown()) if scale and not dependence else scale,
        dependence=dependence,
        notes=source.notes,
    )
    _require_difficulties(calibration)
    return calibration


def _node(
    trials: pl.DataFrame,
    node: str,
    title: str,
    scale: DifficultyScale | None,
    features: Mapping[str, Mapping[str, Feature]],
    seed: int,
) -> NodeCalibration:
    rated = trials["difficulty"].to_numpy()
    # The published rating as if 10 points were a unit of log odds, as the measured scale has it.
    proof = _proof(trials, rated, rated / POINTS_PER_LOG_ODDS, seed)
    if scale is None or node not in scale.nodes:
        return NodeCalibration(node, title, proof, None)
    scenes = trials["scene"].to_list()
    log_odds = {scene: scale.log_odds(node, features[scene]) for scene in set(scenes)}
    difficulty = {scene: scale.measure(node, features[scene]).difficulty for scene in set(scenes)}
    measured = _proof(
        trials,
        np.array([difficulty[scene] for scene in scenes]),
        np.array([log_odds[scene] for scene in scenes]),
        seed,
    )
    return NodeCalibration(node, title, proof, measured)


def _proof(trials: pl.DataFrame, difficulty: Floats, log_odds: Floats, seed: int) -> ScaleProof:
    agents, points = trials["agent"].to_list(), trials["point"].to_list()
    return prove_scale(difficulty, log_odds, trials["failed"].to_numpy(), agents, points, seed=seed)


def _dependence(scale: DifficultyScale, flown: FlownFolder) -> str:
    panel = {agent for fitted in scale.fitted_to for agent in fitted.agents}
    if members := sorted(panel & set(flown.agents)):
        return f"No verdict on the scale: it was fitted to runs of {', '.join(members)}."
    if flown.scenes_sha256 in {fitted.scenes_sha256 for fitted in scale.fitted_to}:
        return "No verdict on the scale: it was fitted to these scenes."
    return ""


def _proved(scale: DifficultyScale, nodes: Sequence[NodeCalibration], flown: FlownFolder) -> DifficultyScale:
    """The scale, with what the runs show of each node."""
    proofs = {node.node: node.measured for node in nodes}
    proved = {
        name: node.model_copy(update={"unproved": proof.reason})
        for name, node in scale.nodes.items()
        if (proof := proofs[name]) is not None
    }
    return scale.model_copy(update={"nodes": scale.nodes | proved, "tested_on": (flown,)})


@dataclass(frozen=True, slots=True)
class _Source:
    """The considered trials of campaigns that share a decomposition.

    `trials` has the columns folder, realization, point, scene, agent, node, level, standing, difficulty and
    failed. A point is a design point; those of two campaigns are one if they have a scene in common.
    """

    decomposition: Decomposition
    names: tuple[str, ...]
    trials: pl.DataFrame
    simspecs: Mapping[str, SimSpec]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, folders: Sequence[Path]) -> _Source:
        require_distinct(folders)
        data = load_scored(folders)
        _require_one_decomposition(folders, data)
        frames: list[pl.DataFrame] = []
        simspecs: dict[str, SimSpec] = {}
        faults: list[Fault] = []
        for folder, campaign in zip(folders, data, strict=True):
            scenes = {name: scene_digest(simspec) for name, simspec in campaign.simspecs.items()}
            simspecs |= {scene: campaign.simspecs[name] for name, scene in scenes.items()}
            considered = _considered(campaign.scores)
            if missing := sorted(set(considered["realization"]) - set(scenes)):
                faults.append(
                    Fault(
                        str(folder / "simspecs" / f"{missing[0]}.json"),
                        f"is missing or damaged, as for {len(missing)} runs with scores",
                        "restore the file, or delete scores.parquet and run `rebar score`",
                    )
                )
                continue
            frames.append(
                considered.with_columns(
                    folder=pl.lit(str(folder)),
                    scene=pl.col("realization").replace_strict(scenes, return_dtype=pl.String),
                )
            )
        if faults:
            raise SetupError(faults)
        document = data[0].document
        assert document is not None  # _require_one_decomposition
        # In an order of their content: the same runs give the same numbers in one folder or in two.
        trials = pl.concat(frames).sort("scene", "agent", "node", "failed")
        return cls(
            document,
            tuple(campaign.name for campaign in data),
            _with_points(trials),
            simspecs,
            _notes(folders, data),
        )

    def features(self) -> dict[str, Mapping[str, Feature]]:
        """Of every scene that an agent flew."""
        return {scene: features_of(self.simspecs[scene]) for scene in sorted(set(self.trials["scene"]))}

    def of_agents(self, agents: Sequence[str]) -> _Source:
        """Only the trials of these agents."""
        return replace(self, trials=self.trials.filter(pl.col("agent").is_in(agents)))

    def attribute(self, node: str) -> pl.DataFrame:
        """The trials of one key attribute."""
        return self.trials.filter(node=node, level=str(Level.KEY_ATTRIBUTE))

    def flown(self) -> FlownFolder:
        """What was flown, as a scale states it: the digest is that of all scenes."""
        scenes = sorted(set(self.trials["scene"]))
        return FlownFolder(
            name=", ".join(dict.fromkeys(self.names)),
            scenes=len(scenes),
            scenes_sha256=hashlib.sha256("\n".join(scenes).encode()).hexdigest(),
            runs=self.trials.select("folder", "realization").n_unique(),
            agents=tuple(sorted(set(self.trials["agent"]))),
        )


def _considered(scores: pl.DataFrame) -> pl.DataFrame:
    """The trials in a score table: considered, with a difficulty, and not spoilt by the bench."""
    rows = scores.filter(
        ~pl.col("outcome").is_in(EXCLUDED_OUTCOMES),
        pl.col("considered") > 0,
        pl.col("difficulty").is_not_null(),
    )
    # Where results decided how many replicates there are, only the first of a design point is a fair sample.
    first = pl.col("replicate") == pl.col("replicate").min().over("design_point", "agent")
    return rows.filter(~pl.col("until_settled") | first).select(
        "realization",
        "design_point",
        "agent",
        "node",
        "level",
        "standing",
        "difficulty",
        failed=pl.col("achieved") < pl.col("considered"),
    )


def _with_points(trials: pl.DataFrame) -> pl.DataFrame:
    """Names the design points across folders: two that share a scene are one, and their runs not independent."""
    # Imported here: every page says whether competence is measured, and few calibrate.
    import networkx as nx

    places = trials.select("folder", "design_point", "scene").unique(maintain_order=True)
    graph: nx.Graph[tuple[str, ...]] = nx.Graph()
    graph.add_edges_from(((folder, point), (scene,)) for folder, point, scene in places.iter_rows())
    point_of = {
        member[0]: f"point {number}"
        for number, component in enumerate(nx.connected_components(graph))
        for member in component
        if len(member) == 1
    }
    return trials.with_columns(point=pl.col("scene").replace_strict(point_of, return_dtype=pl.String))


def _chosen_agents(source: _Source, agents: Sequence[str]) -> tuple[str, ...]:
    flown = source.flown().agents
    faults = [
        Fault("--agent", f"{agent!r} has no considered run here", f"agents: {', '.join(flown)}")
        for agent in agents
        if agent not in flown
    ]
    if faults:
        raise SetupError(faults)
    # Null agents and the oracle are left out unless they are named: the first fail for want of trying and the
    # other knows the truth, so neither shows how hard a situation is.
    others = {*installed_agents("floor"), *installed_agents("ceiling")}
    chosen = tuple(dict.fromkeys(agents)) or tuple(agent for agent in flown if agent not in others)
    if len(chosen) < 2:
        only = f"only {chosen[0]!r}" if chosen else "none"
        raise SetupError(
            "calibrate",
            f"needs two agents or more, and there is {only} (null agents and the oracle do not count)",
            "a single agent cannot tell a hard situation from its own weakness; "
            "add folders of other agents over the same decomposition",
        )
    return chosen


def _require_one_decomposition(folders: Sequence[Path], data: Sequence[ReportData]) -> None:
    digests = [campaign.decomposition_sha256 for campaign in data]
    faults = [
        Fault(
            str(folder),
            "has no readable decomposition"
            if digest is None
            else f"has another decomposition than {folders[0]}",
            f"`{command_line('rebar', 'score', folder)} --decomposition NAME` scores it over the one that you mean",
        )
        for folder, digest in zip(folders, digests, strict=True)
        # Two unreadable decompositions are not the same one.
        if digest is None or digest != digests[0]
    ]
    if faults:
        raise SetupError(faults)


def _require_difficulties(calibration: Calibration) -> None:
    # Observables differ in difficulty in a single scene, too, but that says nothing about a situation.
    slopes = [proof.slope for node in calibration.nodes for proof in (node.rated, node.measured) if proof]
    if max((slope.difficulties for slope in slopes), default=0) < 2:
        what = "every node has one difficulty in all of these runs, so there is nothing to compare"
        remedy = "vary the key factors in the campaign's design; `rebar difficulty` shows them"
        raise SetupError(", ".join(map(str, calibration.folders)), what, remedy)


def _notes(folders: Sequence[Path], data: Sequence[ReportData]) -> tuple[str, ...]:
    notes = []
    for folder, campaign in zip(folders, data, strict=True):
        if campaign.campaign.get("fidelity") == "overhead":
            notes.append(f"{folder} was flown by surrogates, which show no difficulty of the real agent.")
        if campaign.scores["until_settled"].any():
            notes.append(f"{folder} ended design points early: only the first replicate of each counts here.")
    return tuple(notes)
