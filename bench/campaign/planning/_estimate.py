"""What a campaign may come to, by surrogates, before anything is flown: outcomes, passes, cost, and whether it would settle it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import combinations
from typing import Annotated, Any

import polars as pl
from pydantic import Field

from bench.documents import Document
from bench.realization import PlacementInfeasible, RealizationPlan, place
from bench.scoring import ScoredRun, difficulty_of, score_table, studied_key_attributes
from bench.simspec import SimSpec
from bench.statistics import mcnemar_power, pairs_for_difference, runs_for_half_width

from .._document import Campaign
from .._overhead import check_surrogates, fly_overhead
from ..results._measures import load_asked
from ._realizations import realizations

MOST_SCENES = 200
"""With more scenes, so many spread evenly over the design stand for all."""

SIMULATED_S_PER_CPU_S = 45.0
"""README.md: whole sessions in lockstep, last measured. One session keeps about one core busy."""

HALF_WIDTH = 0.1


class NodeEstimate(Document):
    """What is to be expected of one agent at one studied node."""

    agent: str
    node: str
    considered: int
    pass_rate: Annotated[float | None, Field(description="Share of considered runs with confidence 1; null without any.")]
    score: Annotated[float | None, Field(description="Mean score over the runs that have one.")]
    runs_needed: Annotated[
        int | None, Field(description="Runs for a 95 % interval of the pass rate no wider than 10 points to either side.")
    ]


class PairEstimate(Document):
    """What is to be expected of two agents on the same scenes at one studied node."""

    node: str
    first: str
    second: str
    only_first: float
    only_second: float
    pairs: Annotated[int, Field(description="Scenes of the campaign that both are expected to be considered in.")]
    power: Annotated[float, Field(description="Chance that McNemar's exact test at 0.05 finds the difference with these.")]
    pairs_needed: Annotated[int | None, Field(description="Pairs for a power of 80 %; null where no number is of use.")]


class CampaignEstimate(Document):
    """By surrogates at the overhead fidelity; docs/fidelity.md says how well it foretells."""

    fidelity: str = "overhead"
    realizations: int
    flown: Annotated[int, Field(description="Realizations that were flown overhead for this.")]
    not_computed: tuple[str, ...]
    outcomes: dict[str, int]
    simulated_s: Annotated[float, Field(description="Of the whole campaign.")]
    session_s: Annotated[float, Field(description="Host seconds of one core for one session, stated or by docs.")]
    wall_s: Annotated[float, Field(description="Host seconds of the whole campaign on so many workers.")]
    workers: int
    nodes: tuple[NodeEstimate, ...]
    pairs: tuple[PairEstimate, ...]

    def lines(self) -> Iterator[str]:
        """The same in sentences."""
        ended = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self.outcomes.items()))
        of = "" if self.flown == self.realizations else f" of {self.realizations}"
        yield f"expected by surrogates at OVERHEAD FIDELITY ({self.flown}{of} realizations): {ended}"
        yield (
            f"cost: {self.simulated_s / 3600:.1f} simulated hours, {self.session_s:.1f} s a session, "
            f"about {_spoken(self.wall_s)} on {self.workers} worker(s)"
        )
        for one in self.nodes:
            rate = "never considered" if one.pass_rate is None else f"passes {one.pass_rate:.0%} of {one.considered}"
            score = "not scored" if one.score is None else f"score {one.score:.1f}"
            needed = f"; {one.runs_needed} runs would show the rate within 10 points" if one.runs_needed else ""
            yield f"  {one.agent} {one.node}: {rate}, {score}{needed}"
        for pair in self.pairs:
            if pair.only_first == pair.only_second:
                how = "no difference to be seen"
            else:
                needed = "no number of" if pair.pairs_needed is None else f"{pair.pairs_needed}"
                how = f"power {pair.power:.0%} with {pair.pairs} pairs; {needed} pairs give 80 %"
            yield f"  {pair.first} against {pair.second}, {pair.node}: {how}"
        if self.not_computed:
            yield f"  not computed at this fidelity: {', '.join(self.not_computed)}"


def estimate_campaign(campaign: Campaign, workers: int, session_s: float | None = None) -> CampaignEstimate:
    """Fly a campaign's scenes overhead and say what to expect of it.

    `session_s` is what one session costs in host seconds of a core; by README's speed when None. Raises SetupError for what no
    surrogate can fly, and as `realizations` does.
    """
    check_surrogates(campaign)
    asked = load_asked(campaign.decomposition)
    plans = realizations(campaign)
    scenes = _scenes(plans)
    names, simspecs, infeasible = _placed(scenes)
    results = fly_overhead(simspecs, [plan.id for plan in names], asked)
    rated = {}
    runs = []
    for plan, simspec, result in zip(names, simspecs, results, strict=True):
        scene = (plan.design_point, plan.replicate)
        if scene not in rated:
            rated[scene] = difficulty_of(asked, simspec)
        label = simspec.agent.label
        runs.append(ScoredRun(plan.id, *scene, label, result.outcome, rated[scene], result.observations))
    study = studied_key_attributes(asked, campaign.study)
    table = score_table(asked, runs, campaign.study)
    agents = list(dict.fromkeys(run.agent for run in runs))
    scale = len(plans) / max(len(names) + infeasible, 1)
    simulated_s = scale * sum(result.simulated_s for result in results)
    each_s = session_s or simulated_s / max(len(plans), 1) / SIMULATED_S_PER_CPU_S
    outcomes = Counter(str(result.outcome) for result in results)
    if infeasible:
        outcomes["placement_infeasible"] = infeasible
    return CampaignEstimate(
        realizations=len(plans),
        flown=len(names),
        not_computed=tuple(results[0].details["not_computed"]) if results else (),
        outcomes=dict(outcomes),
        simulated_s=round(simulated_s, 1),
        session_s=round(each_s, 3),
        wall_s=round(each_s * len(plans) / workers, 1),
        workers=workers,
        nodes=tuple(_node(table, agent, node) for agent in agents for node in study),
        pairs=tuple(_pair(table, node, *two, scale) for two in combinations(agents, 2) for node in study),
    )


def _spoken(time_s: float) -> str:
    return f"{time_s:.0f} s" if time_s < 120.0 else f"{time_s / 60.0:.0f} min" if time_s < 7200.0 else f"{time_s / 3600.0:.1f} h"


def _scenes(plans: list[RealizationPlan]) -> list[list[RealizationPlan]]:
    """The realizations by scene; of too many scenes, some that are spread evenly."""
    found: dict[tuple[str, int], list[RealizationPlan]] = {}
    for plan in plans:
        found.setdefault((plan.design_point, plan.replicate), []).append(plan)
    scenes = list(found.values())
    step = max(1.0, len(scenes) / MOST_SCENES)
    return [scenes[int(k * step)] for k in range(min(len(scenes), MOST_SCENES))]


def _placed(scenes: list[list[RealizationPlan]]) -> tuple[list[RealizationPlan], list[SimSpec], int]:
    """What has room, each scene placed once, and how many realizations have none."""
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
    own = table.filter((pl.col("agent") == agent) & (pl.col("node") == node))
    confidence, score = own["confidence"].drop_nulls(), own["score"].drop_nulls()
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
    def of(agent: str) -> dict[Any, bool]:
        own = table.filter((pl.col("agent") == agent) & (pl.col("node") == node)).drop_nulls(["confidence"])
        keys = zip(own["design_point"], own["replicate"], strict=True)
        return {key: sure >= 1.0 for key, sure in zip(keys, own["confidence"], strict=True)}

    one, other = of(first), of(second)
    both = sorted(set(one) & set(other))
    count = max(len(both), 1)
    only_first = sum(one[key] and not other[key] for key in both) / count
    only_second = sum(other[key] and not one[key] for key in both) / count
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
