"""Where key factors are read from: fields that exist, and that change the factor when they change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from bench.realization.design._spec_paths import find_path
from bench.simspec import FACTORS, SimSpec, factor_paths, load_simspec

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "search.yaml"
ESCORT = ROOT / "campaigns" / "standard" / "escort-1.yaml"
ESCORT_FACTORS = {"convoy_speed_mps", "convoy_departure_s", "escort_within_m"}


@pytest.fixture(scope="module")
def situation() -> SimSpec:
    return load_simspec(EXAMPLE)


@pytest.mark.parametrize(
    ("path", "factor", "expected"),
    [
        # Groups of the role, by id.
        (EXAMPLE, "target_concealment", ("actors[radar].concealment", "actors[truck].concealment")),
        (EXAMPLE, "bystander_density_per_km2", ("actors[civilians].density_per_km2",)),
        # The escorted group, and nobody else's motion.
        (ESCORT, "convoy_speed_mps", ("actors[convoy].motion.speed_mps",)),
        (ESCORT, "escort_within_m", ("mission.escort.within_m",)),
        # Without an escort or orders: the field that there would be.
        (EXAMPLE, "convoy_departure_s", ("actors[escorted].motion.depart_s",)),
        (EXAMPLE, "order_urgency_per_min", ("orders[*].within_s",)),
    ],
)
def test_factor_paths_name_the_fields_of_the_situation(
    path: Path, factor: str, expected: tuple[str, ...]
) -> None:
    assert factor_paths(load_simspec(path), factor) == expected


def test_of_two_fields_for_one_number_the_path_is_the_one_in_use(situation: SimSpec) -> None:
    counted = tuple(group for group in situation.actors if group.id != "civilians")
    situation = situation.model_copy(update={"actors": counted})
    assert factor_paths(situation, "bystander_density_per_km2") == ("actors[neighbours].count",)


@pytest.mark.parametrize("factor", FACTORS)
def test_changing_a_factor_path_changes_the_factor(situation: SimSpec, factor: str) -> None:
    """Every path leads to a field, and every number there has another value that changes the factor."""
    if factor in ESCORT_FACTORS:
        situation = load_simspec(ESCORT)
    paths = factor_paths(situation, factor)
    assert all(paths)
    if paths == (FACTORS[factor].path,) and "[" in paths[0]:
        return  # the situation has no such thing
    document = situation.model_dump(mode="json")
    for path in paths:
        if path.endswith("motion.kind"):  # who stands still has no speed
            find_path(situation, path).set(document, "wander")
    moving = SimSpec.model_validate(document)
    for path in paths:
        place = find_path(moving, path)
        value: Any = document
        for step in place.steps:
            value = value[step]
        if isinstance(value, int | float) and not isinstance(value, bool):
            assert any(_becomes_another(moving, factor, path, other) for other in _others(value)), path


def _others(value: float) -> list[float]:
    return [value + 1, value - 1] if isinstance(value, int) else [value * 4 + 0.05, value * 0.9]


def _becomes_another(situation: SimSpec, factor: str, path: str, value: float) -> bool:
    document = situation.model_dump(mode="json")
    find_path(situation, path).set(document, value)
    try:
        return FACTORS[factor].read(SimSpec.model_validate(document)) != FACTORS[factor].read(situation)
    except ValidationError:
        return False
