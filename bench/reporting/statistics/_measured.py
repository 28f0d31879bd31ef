"""Competence on the scale of measured difficulty, where one ships for the decomposition (docs/calibration.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from bench.difficulty import Feature, features_of, shipped_scale
from bench.scoring import summary_frame

from .._campaign_data import ALL_CONFIGURATIONS, ReportData, Tallies, Tally, tallies_of
from ._agent_comparison import scene_digest


@dataclass(frozen=True, slots=True)
class MeasuredCompetence:
    """Key attributes over their measured difficulty: difficulties and competence of a tally are on that scale.

    `tallies` are those of key attributes whose scale was shown to predict. `doubts` are by key attribute of the decomposition: why
    the others have none. Both are empty where no scale ships.
    """

    tallies: Tallies = field(default_factory=dict)
    doubts: Mapping[str, str] = field(default_factory=dict)

    def tally(self, agent: str, node: str) -> Tally | None:
        """Over all runs of an agent, or None where the node has no scale."""
        return self.tallies.get((agent, ALL_CONFIGURATIONS, node))


def measured_competence(data: ReportData) -> MeasuredCompetence:
    """What the runs of a campaign show on the measured scale. Runs whose situation is missing are left out."""
    scale = shipped_scale(data.document) if data.document else None
    if scale is None or data.document is None:
        return MeasuredCompetence()
    nodes = {name: node for name, node in scale.nodes.items() if not node.unproved}
    doubts = {
        name: scale.nodes[name].unproved if name in scale.nodes else "too few failures or passes of the panel"
        for name in data.document.key_attributes
        if name not in nodes
    }
    # Agents share a scene, and its features are the costly part: people walk through it.
    features: dict[str, Mapping[str, Feature]] = {}
    difficulty = []
    for run, simspec in data.simspecs.items():
        if simspec.realized is None:
            continue
        scene = scene_digest(simspec)
        if scene not in features:
            features[scene] = features_of(simspec)
        difficulty += [(run, node, scale.measure(node, features[scene]).difficulty) for node in nodes]
    measured = pl.DataFrame(
        difficulty, {"realization": pl.String, "node": pl.String, "measured": pl.Float64}, orient="row"
    )
    scores = (
        data.scores.filter(pl.col("node").cast(pl.String).is_in(list(nodes)))
        .with_columns(pl.col("realization", "node").cast(pl.String))
        .join(measured, on=["realization", "node"], maintain_order="left")
        .with_columns(difficulty="measured")
        .drop("measured")
    )
    return MeasuredCompetence(tallies_of(summary_frame(scores, data.document)), doubts)
