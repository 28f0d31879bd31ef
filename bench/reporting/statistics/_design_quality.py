"""The quality of a campaign's design, and how its points spread over difficulty configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import polars as pl
from pydantic import ValidationError

from bench.difficulty import Feature, features_of, shipped_scale
from bench.errors import SetupError
from bench.realization import (
    Bases,
    Design,
    DesignPoint,
    DesignQuality,
    PlacementInfeasible,
    Rating,
    design_pairs,
    design_quality,
    place,
    situations,
)
from bench.scoring import configuration_of, difficulty_of, studied_key_attributes, tension_of
from bench.simspec import SimSpec
from decompositions import Decomposition

from .._campaign_data import ReportData

DesignPairs = Sequence[tuple[DesignPoint, int]]
# Chosen: among more configurations than this hardly any has two points, so they are counted by the tensions
# of their nodes.
MAX_NAMED_CONFIGURATIONS = 20


def difficulty_rating(decomposition: Decomposition, study: Sequence[str], design: Design) -> Rating:
    """The difficulties of the nodes under study in a situation, on the scale that the design is drawn by.

    A situation whose actors find no room has no measured difficulty. Raises SetupError where a node has no measured scale.
    """
    nodes = studied_key_attributes(decomposition, study)
    if "measured" in design.scales:
        return measured_rating(decomposition, nodes)

    def rate(simspec: SimSpec) -> Mapping[str, float | None]:
        difficulty = difficulty_of(decomposition, simspec)
        return {node: difficulty.of(node) for node in nodes}

    return rate


def measured_rating(decomposition: Decomposition, nodes: Sequence[str] = ()) -> Rating:
    """The measured difficulties of some nodes in a situation; of all that have a proved scale without any.

    The places are those of the situation's seed. Raises SetupError where a node has no such scale.
    """
    scale = shipped_scale(decomposition)
    where = "scale: measured"
    if scale is None:
        raise SetupError(where, f"no scale ships for {decomposition.name}", "write scale: published")
    if missing := [node for node in nodes if node not in scale.proved]:
        what = f"the scale was not shown to predict {missing[0]}, which is under study"
        raise SetupError(where, what, f"study some of: {', '.join(scale.proved)}")

    def rate(simspec: SimSpec) -> Mapping[str, float | None]:
        features = _placed_features(simspec.model_dump_json())
        return {
            node: scale.measure(node, features).difficulty if features else None
            for node in nodes or scale.proved
        }

    return rate


# Places are costly, and a campaign is planned several times in one process.
@lru_cache(maxsize=20_000)
def _placed_features(simspec: str) -> Mapping[str, Feature] | None:
    try:
        return features_of(place(SimSpec.model_validate_json(simspec)))
    except PlacementInfeasible:
        return None


def measure_design(
    base: Bases, design: Design, decomposition: Decomposition, study: Sequence[str] = ()
) -> DesignQuality:
    """A design over its bases, measured before anything is flown.

    Raises SetupError where the design does not fit them.
    """
    rate = difficulty_rating(decomposition, study, design)
    pairs = design_pairs(base, design, rate)
    flown = situations(base, design, _distinct_points(pairs))
    if "measured" in design.scales:
        measured = [rate(simspec) for simspec in flown]
        return _measure(
            design, pairs, [f"{_tensions(difficulties)} (tensions, measured)" for difficulties in measured]
        )
    published = [difficulty_of(decomposition, simspec) for simspec in flown]
    configurations = [configuration_of(decomposition, difficulty, study) for difficulty in published]
    if len(set(configurations)) > MAX_NAMED_CONFIGURATIONS:
        nodes = studied_key_attributes(decomposition, study)
        configurations = [
            f"{_tensions({node: difficulty.of(node) for node in nodes})} (tensions)"
            for difficulty in published
        ]
    return _measure(design, pairs, configurations)


def _tensions(difficulties: Mapping[str, float | None]) -> str:
    return " ".join(
        f"{node}={'none' if difficulty is None else tension_of(difficulty)}"
        for node, difficulty in difficulties.items()
    )


def campaign_design_points(data: ReportData) -> list[DesignPoint] | None:
    """The design points of a campaign; None if its design cannot be read, or cannot be drawn again."""
    drawn = _campaign_design(data)
    return _distinct_points(drawn[1]) if drawn else None


def campaign_design_quality(data: ReportData) -> DesignQuality | None:
    """The quality of a campaign's design; None if it varies nothing, or cannot be read.

    Configurations are named as in the report, and are those of points that were flown.
    """
    design = _campaign_design(data)
    if design is None or not design[0].factors:
        return None
    labels = {configuration.key: configuration.label for configuration in data.configurations}
    rated = (
        data.scores.select("design_point", "configuration")
        .filter(pl.col("configuration").is_in(list(labels)))
        .unique("design_point")
        .sort("design_point")
    )
    return _measure(*design, [labels[configuration] for configuration in rated["configuration"]])


def _measure(design: Design, pairs: DesignPairs, configurations: Sequence[str]) -> DesignQuality:
    return design_quality(
        design.space,
        _distinct_points(pairs),
        pairs=len(pairs),
        extendable=design.grows,
        configurations=configurations,
    )


def _distinct_points(pairs: DesignPairs) -> list[DesignPoint]:
    # Pairs are design point and replicate; the quality is that of the points.
    return list({point.id: point for point, _ in pairs}.values())


def _campaign_design(data: ReportData) -> tuple[Design, DesignPairs] | None:
    try:
        design = Design.model_validate(data.campaign.get("design") or {})
        # Only a design that is drawn by difficulty needs the base and the decomposition.
        if not design.rated:
            return design, design.pairs()
        if data.document is None:
            return None
        return design, design_pairs(
            _campaign_bases(data), design, difficulty_rating(data.document, data.study, design)
        )
    # A campaign of another version may state a design that this one cannot read. The rest of its report is
    # still good.
    except (ValidationError, SetupError):
        return None


def _campaign_bases(data: ReportData) -> Bases:
    """Raises ValidationError if the campaign states no base that can be read."""
    situations = data.campaign.get("situations") or ()
    if not situations:
        return SimSpec.model_validate(data.campaign.get("base"))
    return {situation["name"]: SimSpec.model_validate(situation["base"]) for situation in situations}
