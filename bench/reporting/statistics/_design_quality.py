"""How good a campaign's design is: its points measured, and how they fall over difficulty configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import polars as pl
from pydantic import ValidationError

from bench.errors import SetupError
from bench.realization import Design, DesignPoint, DesignQuality, Rating, design_pairs, design_quality, situations
from bench.scoring import configuration_of, difficulty_of, studied_key_attributes, tension_of
from bench.simspec import SimSpec
from decompositions import Decomposition

from .._campaign_data import ReportData

Pairs = Sequence[tuple[DesignPoint, int]]
MOST_NAMED = 20
"""Of more configurations than this hardly any has two points; they are counted by the tensions of their nodes instead."""


def rating(decomposition: Decomposition, study: Sequence[str] = ()) -> Rating:
    """The difficulties of the nodes under study in a situation, for a design that is drawn by difficulty."""
    nodes = studied_key_attributes(decomposition, study)

    def rate(simspec: SimSpec) -> Mapping[str, float]:
        found = difficulty_of(decomposition, simspec)
        return {node: found.of(node) for node in nodes}

    return rate


def measure_design(base: SimSpec, design: Design, decomposition: Decomposition, study: Sequence[str] = ()) -> DesignQuality:
    """A design over a base SimSpec, measured before anything is flown. Raises SetupError where the design does not fit the base."""
    pairs = design_pairs(base, design, rating(decomposition, study))
    rated = [difficulty_of(decomposition, one) for one in situations(base, design, _flown(pairs))]
    configurations = [configuration_of(decomposition, one, study) for one in rated]
    if len(set(configurations)) > MOST_NAMED:
        nodes = studied_key_attributes(decomposition, study)
        configurations = [" ".join(f"{node}={tension_of(one.of(node))}" for node in nodes) + " (tensions)" for one in rated]
    return _measured(design, pairs, configurations)


def points_of(data: ReportData) -> list[DesignPoint] | None:
    """The design points of a campaign's folder; None where its design cannot be read, or drawn as it was."""
    drawn = _drawn(data)
    return _flown(drawn[1]) if drawn else None


def quality_of(data: ReportData) -> DesignQuality | None:
    """The design of a campaign's folder, measured; None where it varies nothing, or cannot be read.

    Configurations are named as in the report, and are those of points that were flown.
    """
    drawn = _drawn(data)
    if drawn is None or not drawn[0].factors:
        return None
    labels = {one.key: one.label for one in data.configurations}
    rated = data.scores.filter(pl.col("configuration").is_in(list(labels))).unique("design_point").sort("design_point")
    return _measured(*drawn, [labels[one] for one in rated["configuration"]])


def _measured(design: Design, pairs: Pairs, configurations: Sequence[str]) -> DesignQuality:
    return design_quality(
        design.space,
        _flown(pairs),
        pairs=len(pairs),
        extendable=design.methods[-1].grows,
        configurations=configurations,
    )


def _flown(pairs: Pairs) -> list[DesignPoint]:
    return list({point.id: point for point, _ in pairs}.values())


def _drawn(data: ReportData) -> tuple[Design, Pairs] | None:
    try:
        design = Design.model_validate(data.campaign.get("design") or {})
        if not design.rated:
            return design, design.pairs()
        if data.document is None:
            return None
        base = SimSpec.model_validate(data.campaign.get("base"))
        return design, design_pairs(base, design, rating(data.document, data.study))
    except (ValidationError, SetupError):
        return None
