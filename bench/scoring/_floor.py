"""What can be had without merit, and what can be had at all: floor and ceiling of every node (ruling 24)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import polars as pl
from pydantic import Field

from bench.documents import Document

from ._difficulty import Standing
from ._table import EXCLUDED_OUTCOMES

# Ruling 24: an observable does not discriminate where its floor is above a half, or above nine tenths of its
# ceiling.
MAX_FLOOR = 0.5
MAX_FLOOR_OF_CEILING = 0.9

SCENE = ["design_point", "replicate"]

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class NodeFloor(Document):
    """Floor and ceiling of one node, over the scenes that every agent of the floor has flown."""

    id: str
    level: Literal["principle", "ka", "vab", "observable"]
    floor: Share | None = Field(description="Best confidence of a null agent. Null: never considered.")
    floor_agents: tuple[str, ...] = Field(description="The null agents that reach it.")
    ceiling: Share | None = Field(
        description="Confidence of the agent that is given the truth. Null: never considered, or not flown."
    )
    scenes: int = Field(
        ge=0, description="Scenes in which the node was considered for some agent of the floor."
    )
    configured_sensor: bool = Field(
        False, description="It describes the sensor that the bench simulates, so it is never flagged."
    )
    verdict_passed: int | None = Field(
        None,
        ge=0,
        description="Of a principle: runs that the null agent with the best verdict passed; null where none has a verdict.",
    )
    verdict_considered: int | None = Field(None, ge=0, description="Runs of that agent that have a verdict.")

    @property
    def discrimination(self) -> float | None:
        """Ceiling minus floor, -1 to 1; None where one of them is not known."""
        return None if self.floor is None or self.ceiling is None else self.ceiling - self.floor

    @property
    def flaw(self) -> str:
        """Why this observable does not discriminate; empty where it does, and for any other node."""
        if self.level != "observable" or self.floor is None or self.configured_sensor:
            return ""
        if self.floor > MAX_FLOOR:
            return f"{_named(self.floor_agents)} without merit: {self.floor:.0%}"
        if self.ceiling is not None and self.floor > MAX_FLOOR_OF_CEILING * self.ceiling:
            return f"{_named(self.floor_agents)}: {self.floor:.0%} of at most {self.ceiling:.0%}"
        return ""


def _named(agents: Sequence[str]) -> str:
    return agents[0] if len(agents) == 1 else f"{agents[0]} and {len(agents) - 1} more"


def node_floors(scores: pl.DataFrame, oracle: str | None) -> dict[str, NodeFloor]:
    """Floor and ceiling of every node in a score table of null agents and of the agent named `oracle`.

    Confidences are means over considered runs (ruling 13) in the scenes that all of these agents have flown
    with an outcome that counts: on other scenes one agent could be lucky alone. A node that was never
    considered has neither. `oracle` is None where none was flown.
    """
    considered = common_runs(scores).filter(pl.col("confidence").is_not_null())
    means = considered.group_by("node", "agent").agg(pl.col("confidence").mean())
    by_node: dict[str, dict[str, float]] = {}
    # Sorted, because Polars returns groups in no fixed order.
    for node, agent, confidence in means.sort("node", "agent").iter_rows():
        by_node.setdefault(node, {})[agent] = confidence
    counts = considered.select("node", *SCENE).unique().group_by("node").len()
    scenes: Mapping[str, int] = dict(counts.iter_rows())
    sensor = set(scores.filter(pl.col("standing") == str(Standing.CONFIGURED_SENSOR))["node"])
    nodes = scores.select("node", "level").unique(maintain_order=True).iter_rows()
    verdicts = _best_verdicts(considered, oracle)
    return {
        node: _node_floor(node, level, by_node.get(node, {}), oracle, scenes.get(node, 0)).model_copy(
            update={"configured_sensor": node in sensor} | verdicts.get(node, {})
        )
        for node, level in nodes
    }


def common_runs(scores: pl.DataFrame) -> pl.DataFrame:
    """The rows of a score table in the scenes that all of its agents have flown with an outcome that counts."""
    flown = scores.filter(~pl.col("outcome").is_in(EXCLUDED_OUTCOMES))
    by_scene = flown.group_by(SCENE).agg(pl.col("agent").n_unique().alias("flown"))
    common = by_scene.filter(pl.col("flown") == scores["agent"].n_unique())
    return flown.join(common, on=SCENE, how="semi")


def _best_verdicts(scores: pl.DataFrame, oracle: str | None) -> dict[str, dict[str, int]]:
    """The verdict of the null agent that passes the greatest share of its runs, by principle (ruling 27)."""
    best: dict[str, dict[str, int]] = {}
    has_verdict = scores.filter(
        pl.col("verdict").is_not_null(), pl.col("agent").cast(pl.String) != (oracle or "")
    )
    counts = (
        has_verdict.group_by("node", "agent").agg(pl.col("verdict").sum(), pl.len()).sort("node", "agent")
    )
    for node, _, passed, considered in counts.iter_rows():
        known = best.get(node)
        if known is None or passed * known["verdict_considered"] > known["verdict_passed"] * considered:
            best[node] = {"verdict_passed": passed, "verdict_considered": considered}
    return best


def _node_floor(
    node: str,
    level: Literal["principle", "ka", "vab", "observable"],
    confidences: Mapping[str, float],
    oracle: str | None,
    scenes: int,
) -> NodeFloor:
    null = {agent: confidence for agent, confidence in confidences.items() if agent != oracle}
    floor = max(null.values(), default=None)
    # Means of the same runs in another order may differ in the last digit.
    reached = (
        agent for agent, confidence in null.items() if floor is not None and confidence >= floor - 1e-12
    )
    ceiling = confidences.get(oracle) if oracle is not None else None
    return NodeFloor(
        id=node, level=level, floor=floor, floor_agents=tuple(reached), ceiling=ceiling, scenes=scenes
    )


def worst_first(floors: Mapping[str, NodeFloor]) -> list[NodeFloor]:
    """The least discriminating nodes first; by floor where there is no ceiling; the never considered last."""

    def key(node: NodeFloor) -> tuple[bool, float, str]:
        apart = node.discrimination
        distance = apart if apart is not None else 1.0 - (node.floor or 0.0)
        return (node.floor is None, distance, node.id)

    return sorted(floors.values(), key=key)
