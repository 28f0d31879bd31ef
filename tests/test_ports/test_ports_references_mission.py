"""Measures of the mission against references written as plain loops.

The references share no code with the measures: they go through samples, reports and actors one by one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
from references.agreement import assert_agreement
from references.flown_samples import Reference, Sample

from bench.contracts import Option, Tape
from bench.simspec import SimSpec


def sub_areas_reached(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    assert spec.realized is not None
    radius = {item.id: item.uncertainty_m for item in spec.intelligence}
    reached = [
        any(
            math.dist(sample.place[:2], (area.east_m, area.north_m)) <= radius[area.id]
            and math.dist(sample.place[:2], (spec.vehicle.home.east_m, spec.vehicle.home.north_m)) > 40.0
            for sample in samples
        )
        for area in spec.realized.reports
    ]
    return sum(reached) / len(reached)


def battery_reserve(spec: SimSpec, tape: Tape, samples: tuple[Sample, ...]) -> float | None:
    if any(state.value.crashed for state in tape.condition) or all(
        state.value.landed for state in tape.condition
    ):
        return 0.0
    return min(1.0, tape.condition[-1].value.battery_fraction / spec.rules.battery_reserve_fraction)


REFERENCES: Mapping[str, tuple[Reference, Mapping[str, Option]]] = {
    "sub_areas_reached": (sub_areas_reached, {}),
    "battery_reserve": (battery_reserve, {}),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_measure_agrees_with_its_reference(name: str) -> None:
    """On every random run the same value, and the same verdict on whether the run is considered."""
    reference, options = REFERENCES[name]
    assert_agreement(name, reference, options)
