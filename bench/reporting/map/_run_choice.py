"""Which runs the report shows on a map."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

import polars as pl

from bench.contracts import Outcome

from .._campaign_data import ReportData, Run


def choose_runs(data: ReportData, count: int) -> tuple[Run, ...]:
    """The runs worth a look: scenes that every agent flew and on which the studied confidences differ most.

    Each scene comes with all its agents, the scenes from different configurations first; with one agent, the runs
    with the lowest confidence come first. Runs without a recording are left out.
    """
    recorded = [run for run in data.runs if run.recording is not None]
    scenes: dict[tuple[str, int], dict[str, Run]] = {}
    for run in recorded:
        scenes.setdefault(run.scene, {})[run.agent] = run
    # Where no scene has every agent, the scenes with most of them.
    flown_by = max((len(agents) for agents in scenes.values()), default=0)
    full = {scene: agents for scene, agents in scenes.items() if len(agents) == flown_by}
    confidences = _studied_confidences(data)
    ordered = sorted(full, key=lambda scene: (*_interest(confidences, full[scene].values()), scene))
    scenes_by_configuration: dict[str | None, int] = {}
    rounds = []
    for scene in ordered:
        configuration = next(iter(full[scene].values())).configuration
        rounds.append((scenes_by_configuration.get(configuration, 0), scene))
        scenes_by_configuration[configuration] = scenes_by_configuration.get(configuration, 0) + 1
    # A stable sort: the most telling scene of every configuration first, then the second of each.
    scenes_shown = [scene for _, scene in sorted(rounds, key=lambda pair: pair[0])][
        : max(1, count // max(1, flown_by))
    ]
    return tuple(
        full[scene][agent] for scene in scenes_shown for agent in data.agents if agent in full[scene]
    )


def _studied_confidences(data: ReportData) -> dict[str, list[tuple[str, float]]]:
    """Studied nodes and their confidences, by realization."""
    rows = data.scores.filter(pl.col("node").is_in(data.study)).drop_nulls("confidence")
    confidences: dict[str, list[tuple[str, float]]] = {}
    for realization, node, confidence in rows.select("realization", "node", "confidence").iter_rows():
        confidences.setdefault(realization, []).append((node, confidence))
    return confidences


def _interest(
    confidences: Mapping[str, Sequence[tuple[str, float]]], runs: Collection[Run]
) -> tuple[bool, float, float]:
    """Sorts first: all completed, one key attribute on which they differ widely, and otherwise alike."""
    by_node: dict[str, list[float]] = {}
    for run in runs:
        for node, confidence in confidences.get(run.realization, ()):
            by_node.setdefault(node, []).append(confidence)
    spreads = [
        (max(values) - min(values)) if len(runs) > 1 else 1.0 - min(values) for values in by_node.values()
    ]
    # One wide difference on a scene that is otherwise alike shows its cause; many differences at once do not.
    widest = max(spreads, default=0.0)
    incomplete = any(run.outcome is not Outcome.COMPLETED for run in runs)
    # Rounded, so that the last digits of a float do not choose between equal scenes; the id of the scene
    # does.
    return (incomplete, round(-widest, 9), round(math.fsum(spreads) - widest, 9))
