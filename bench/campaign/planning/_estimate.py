"""Estimates a campaign with surrogates before anything is flown: outcomes, pass rates, cost, and statistical power."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import polars as pl
from pydantic import Field

from bench.contracts import OverheadFidelity, SessionResult
from bench.documents import Document
from bench.realization import PlacementInfeasible, RealizationPlan, place
from bench.scoring import ScoredRun, difficulty_of, score_table, studied_key_attributes
from bench.simspec import SimSpec
from bench.statistics import mcnemar_power, pairs_for_difference, runs_for_half_width

from .._document import Campaign
from .._overhead import check_surrogates, fly_overhead
from ._measures import load_measurable_decomposition
from ._realizations import realizations

MAX_SCENES = 200
"""Of more scenes, this many are estimated, spread evenly over the design. Chosen, not measured."""

SIMULATED_S_PER_CPU_S = 45.0
"""Speed of whole sessions in lockstep, as measured in README.md. One session keeps about one core busy."""

RECORDED_BYTES_PER_SIMULATED_S = 8000.0
"""Of a recording without pictures: 26 sessions of two campaigns had 6.9 to 8.5 kB."""
RUN_BYTES = 60_000.0
"""Of result, both SimSpecs and log of a run, in the same sessions."""

HALF_WIDTH = 0.1
"""Half width of the interval that `runs_needed` is about: 10 points to either side."""


class NodeEstimate(Document):
    """Expected results of one agent at one studied node."""

    agent: str
    node: str
    considered: int
    pass_rate: float | None = Field(
        description="Share of considered runs with confidence 1; null without any."
    )
    score: float | None = Field(description="Mean score over the runs that have one.")
    runs_needed: int | None = Field(
        description="Runs for a 95 % interval of the pass rate no wider than 10 points to either side."
    )


class PairEstimate(Document):
    """Expected comparison of two agents on the same scenes at one studied node."""

    node: str
    first: str
    second: str
    only_first: float
    only_second: float
    pairs: int = Field(description="Scenes of the campaign in which both are expected to be considered.")
    power: float = Field(
        description="Chance that McNemar's exact test at 0.05 finds the difference with these."
    )
    pairs_needed: int | None = Field(
        description="Pairs for a power of 80 %; null if no number of pairs reaches it."
    )


class CampaignEstimate(Document):
    """Estimated by surrogates at the overhead fidelity; docs/fidelity.md says how well they predict."""

    fidelity: str = "overhead"
    realizations: int
    flown: int = Field(description="Realizations that surrogates flew for the estimate.")
    not_computed: tuple[str, ...]
    outcomes: dict[str, int]
    simulated_s: float = Field(description="Of the whole campaign.")
    session_s: float = Field(
        description="Host seconds of one core for one session: as given, or by the speed in README.md."
    )
    wall_s: float = Field(description="Host seconds of the whole campaign on `workers` workers.")
    disk_mb: float = Field(description="Of results and recordings, without recorded pictures.")
    records_pictures: bool = Field(
        description="Whether pictures, boxes, masks or depths are recorded, which come on top."
    )
    workers: int
    nodes: tuple[NodeEstimate, ...]
    pairs: tuple[PairEstimate, ...]

    def lines(self) -> Iterator[str]:
        """The estimate in sentences."""
        ended = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self.outcomes.items()))
        of = "" if self.flown == self.realizations else f" of {self.realizations}"
        yield f"expected by surrogates at OVERHEAD FIDELITY ({self.flown}{of} realizations): {ended}"
        yield (
            f"cost: {self.simulated_s / 3600:.1f} simulated hours, {self.session_s:.1f} s a session, "
            f"about {_span_text(self.wall_s)} on {self.workers} worker(s)"
        )
        on_top = "; recorded pictures come on top" if self.records_pictures else ""
        yield f"disk: about {self.disk_mb:.0f} MB{on_top}"
        for node in self.nodes:
            rate = (
                "never considered"
                if node.pass_rate is None
                else f"passes {node.pass_rate:.0%} of {node.considered}"
            )
            score = "not scored" if node.score is None else f"score {node.score:.1f}"
            needed = (
                f"; {node.runs_needed} runs would show the rate within 10 points" if node.runs_needed else ""
            )
            yield f"  {node.agent} {node.node}: {rate}, {score}{needed}"
        for pair in self.pairs:
            if pair.only_first == pair.only_second:
                power = "no difference expected"
            else:
                needed = "no number of" if pair.pairs_needed is None else f"{pair.pairs_needed}"
                power = f"power {pair.power:.0%} with {pair.pairs} pairs; {needed} pairs give 80 %"
            yield f"  {pair.first} against {pair.second}, {pair.node}: {power}"
        if self.not_computed:
            yield f"  not computed at this fidelity: {', '.join(self.not_computed)}"


def estimate_campaign(campaign: Campaign, workers: int, session_s: float | None = None) -> CampaignEstimate:
    """Let surrogates fly a campaign's scenes, and say what to expect of the campaign.

    `session_s` is the cost of one session in host seconds of a core; None takes the speed in README.md.
    Raises SetupError for a campaign that surrogates cannot fly, and as `realizations` does.
    """
    # Null agents have no surrogates, and nobody wants to know what to expect of them.
    campaign = campaign.model_copy(update={"floor": None})
    check_surrogates(campaign)
    decomposition = load_measurable_decomposition(campaign.decomposition)
    plans = realizations(campaign)
    scenes = _scenes(plans)
    placed, simspecs, infeasible = _placed(scenes)
    results = fly_overhead(simspecs, [plan.id for plan in placed], decomposition)
    rated = {}
    runs = []
    for plan, simspec, result in zip(placed, simspecs, results, strict=True):
        scene = (plan.design_point, plan.replicate)
        # Difficulty is a property of the scene, the same for every agent.
        if scene not in rated:
            rated[scene] = difficulty_of(decomposition, simspec)
        label = simspec.agent.label
        runs.append(ScoredRun(plan.id, *scene, label, result.outcome, rated[scene], result.observations))
    study = studied_key_attributes(decomposition, campaign.study)
    table = score_table(decomposition, runs, campaign.study)
    agents = list(dict.fromkeys(run.agent for run in runs))
    # What surrogates flew may be a sample: its sums stand for the whole campaign.
    scale = len(plans) / max(len(placed) + infeasible, 1)
    simulated_s = scale * sum(result.simulated_s for result in results)
    each_s = session_s or simulated_s / max(len(plans), 1) / SIMULATED_S_PER_CPU_S
    outcomes = Counter(str(result.outcome) for result in results)
    if infeasible:
        outcomes["placement_infeasible"] = infeasible
    return CampaignEstimate(
        realizations=len(plans),
        flown=len(placed),
        not_computed=_not_computed(results),
        outcomes=dict(outcomes),
        simulated_s=round(simulated_s, 1),
        session_s=round(each_s, 3),
        wall_s=round(each_s * len(plans) / workers, 1),
        disk_mb=round((simulated_s * RECORDED_BYTES_PER_SIMULATED_S + len(plans) * RUN_BYTES) / 1e6, 1),
        records_pictures=any(
            camera.draws_for_the_recording
            for plan in plans
            for camera in (plan.simspec.vehicle.camera, *plan.simspec.vehicle.more_cameras)
        ),
        workers=workers,
        nodes=tuple(_node(table, agent, node) for agent in agents for node in study),
        pairs=tuple(_pair(table, node, *pair, scale) for pair in combinations(agents, 2) for node in study),
    )


def _not_computed(results: Sequence[SessionResult]) -> tuple[str, ...]:
    """The same in all results: it depends on the decomposition."""
    fidelity = results[0].fact(OverheadFidelity) if results else None
    return fidelity.not_computed if fidelity else ()


def _span_text(time_s: float) -> str:
    return (
        f"{time_s:.0f} s"
        if time_s < 120.0
        else f"{time_s / 60.0:.0f} min"
        if time_s < 7200.0
        else f"{time_s / 3600.0:.1f} h"
    )


def _scenes(plans: list[RealizationPlan]) -> list[list[RealizationPlan]]:
    """The realizations by scene. Of more than MAX_SCENES scenes, that many are taken, spread evenly."""
    by_scene: dict[tuple[str, int], list[RealizationPlan]] = {}
    for plan in plans:
        by_scene.setdefault((plan.design_point, plan.replicate), []).append(plan)
    scenes = list(by_scene.values())
    step = max(1.0, len(scenes) / MAX_SCENES)
    return [scenes[int(k * step)] for k in range(min(len(scenes), MAX_SCENES))]


def _placed(scenes: list[list[RealizationPlan]]) -> tuple[list[RealizationPlan], list[SimSpec], int]:
    """The realizations that have room, their realized SimSpecs, and how many realizations have no room."""
    plans, simspecs, infeasible = [], [], 0
    for scene in scenes:
        try:
            realized = place(scene[0].simspec).realized
        except PlacementInfeasible:
            infeasible += len(scene)
            continue
        plans += scene
        simspecs += [plan.simspec.model_copy(update={"realized": realized}) for plan in scene]
    return plans, simspecs, infeasible


def _node(table: pl.DataFrame, agent: str, node: str) -> NodeEstimate:
    rows = table.filter((pl.col("agent") == agent) & (pl.col("node") == node))
    confidence, score = rows["confidence"].drop_nulls(), rows["score"].drop_nulls()
    rate = float((confidence >= 1.0).mean()) if len(confidence) else None  # type: ignore[arg-type]
    return NodeEstimate(
        agent=agent,
        node=node,
        considered=len(confidence),
        pass_rate=rate,
        score=round(float(score.mean()), 2) if len(score) else None,  # type: ignore[arg-type]
        runs_needed=None if rate is None else runs_for_half_width(rate, HALF_WIDTH),
    )


def _pair(table: pl.DataFrame, node: str, first: str, second: str, scale: float) -> PairEstimate:
    def passes(agent: str) -> dict[Any, bool]:
        rows = table.filter((pl.col("agent") == agent) & (pl.col("node") == node)).drop_nulls(["confidence"])
        scenes = zip(rows["design_point"], rows["replicate"], strict=True)
        return {
            scene: confidence >= 1.0 for scene, confidence in zip(scenes, rows["confidence"], strict=True)
        }

    first_passes, second_passes = passes(first), passes(second)
    both = sorted(set(first_passes) & set(second_passes))
    count = max(len(both), 1)
    only_first = sum(first_passes[scene] and not second_passes[scene] for scene in both) / count
    only_second = sum(second_passes[scene] and not first_passes[scene] for scene in both) / count
    pairs = round(len(both) * scale)
    return PairEstimate(
        node=node,
        first=first,
        second=second,
        only_first=round(only_first, 4),
        only_second=round(only_second, 4),
        pairs=pairs,
        power=round(mcnemar_power(pairs, only_first, only_second), 3) if pairs else 0.0,
        pairs_needed=pairs_for_difference(only_first, only_second),
    )
