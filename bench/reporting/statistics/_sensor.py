"""The configured sensor: what observables about the simulated detector measured (docs/rulings.md, 25)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from bench.scoring import EXCLUDED_OUTCOMES, Standing
from bench.simspec import Perception

from .._campaign_data import Node, ReportData


@dataclass(frozen=True, slots=True)
class SensorObservable:
    """One observable about the detector. `threshold` is None without the decomposition.

    Each of the `readings` is what it measured on the flights of an `agent`: the numbers of `runs`, of those that
    `considered` it, and of those that `reached` the threshold; and over the considered ones `mean`, `least` and `most`,
    shares in [0, 1], None without any.
    """

    node: Node
    threshold: float | None
    readings: tuple[Mapping[str, Any], ...]


def sensor_observables(data: ReportData) -> list[SensorObservable]:
    """Every observable that measured the simulated detector in some run, in the order of the decomposition,
    with the readings of every agent in the report's order.
    """
    readings = _readings(data.scores, data.agents)
    observables = data.document.observables if data.document is not None else {}
    thresholds = {name: observable.threshold for name, observable in observables.items()}
    ordered = [*(name for name in data.nodes if name in readings), *sorted(set(readings) - set(data.nodes))]
    return [
        SensorObservable(
            data.nodes.get(name, Node(name, "observable", name)), thresholds.get(name), tuple(readings[name])
        )
        for name in ordered
    ]


def _readings(scores: pl.DataFrame, agents: Sequence[str]) -> dict[str, list[dict[str, Any]]]:
    about_sensor = scores.select(
        "agent", "node", "outcome", "standing", "considered", "achieved", "x"
    ).filter(
        (pl.col("standing") == str(Standing.CONFIGURED_SENSOR))
        & ~pl.col("outcome").is_in(EXCLUDED_OUTCOMES)
        & pl.col("agent").is_in(agents)
    )
    considered = pl.col("considered") > 0
    x = pl.col("x").filter(considered)
    rows = about_sensor.group_by("node", "agent").agg(
        runs=pl.len(),
        considered=considered.sum(),
        reached=pl.col("achieved").sum(),
        mean=x.mean(),
        least=x.min(),
        most=x.max(),
    )
    readings: dict[str, list[dict[str, Any]]] = {}
    # Polars returns groups in no fixed order, and the page must have the same bytes each time.
    for row in sorted(rows.iter_rows(named=True), key=lambda row: agents.index(row["agent"])):
        readings.setdefault(row.pop("node"), []).append(row)
    return readings


def only_about_sensor(scores: pl.DataFrame) -> set[tuple[str, str]]:
    """Agents and observables whose every exercisable run is about the detector: their numbers describe no agent."""
    exercisable = scores.select("agent", "node", "standing").filter(
        pl.col("standing").is_not_null(), pl.col("standing") != str(Standing.NOT_EXERCISABLE)
    )
    whole = exercisable.group_by("agent", "node").agg(
        (pl.col("standing") == str(Standing.CONFIGURED_SENSOR)).all().alias("about_sensor")
    )
    return set(whole.filter("about_sensor").select("agent", "node").iter_rows())


def detector_sentences(perceptions: Iterable[Perception]) -> list[str]:
    """The settings of the detector in words, one sentence for each that was flown."""
    return sorted({_detector_sentence(perception) for perception in perceptions})


def perception_in_short(perception: Perception) -> str:
    """The source of the detections in a few words."""
    if perception.source == "simulated":
        return f"simulated, {perception.mode}"
    return f"{perception.source} {perception.detector_name if perception.on_pixels else ''}".strip()


def _detector_sentence(perception: Perception) -> str:
    model = perception.model
    if perception.source == "agent":
        return "None: the agent has a perception of its own, which its tracks show."
    if perception.source == "detector":
        return f"The detector {perception.detector_name} on the pictures, {perception.model.latency_s:g} s after the exposure."
    if perception.error_free:
        return "Without errors: it detects every object in view with the right class, and nothing else."
    if model.size_curve:
        return (
            f"With errors as fitted by size at {len(model.size_curve)} points, {100 * model.mislabel:g} % wrong classes, "
            f"{model.false_per_frame:g} false detections a frame; it answers {model.latency_s:g} s after the exposure."
        )
    return (
        f"With errors: it detects at most {100 * model.ceiling:g} % of the clear views of a large object, and half as many "
        f"of one {model.half_height_px:g} pixels high; {100 * model.mislabel:g} % of the latter get a wrong class. "
        f"It makes {model.false_per_frame:g} false detections a frame and answers {model.latency_s:g} s after the exposure."
    )
