"""Counts of members inside areas: parts of the ground, and how many members each may take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import shapely

from bench.simspec import ActorGroup, AreaCount, SimSpec

from ._geometry import Geometry, areal_parts, grown_at_most, polygon_ground, prepared_ground
from ._groups import centre_ground, inner_radius_m

# Moves of single members between parts, for each part: enough to forget where they began. Chosen, not measured.
MOVES_PER_PART = 60


@dataclass(frozen=True, slots=True)
class GroundPart:
    """Ground of centres, and for each of the counted areas whether a member there stands inside it."""

    inside: tuple[bool, ...]
    ground: Geometry


def named_area(simspec: SimSpec, name: str) -> Geometry:
    """An area of the world as a shapely polygon."""
    return polygon_ground(next(area for area in simspec.world.areas if area.id == name))


def prepared_area(simspec: SimSpec, name: str) -> Geometry:
    """The same, prepared for many questions."""
    return prepared_ground(next(area for area in simspec.world.areas if area.id == name))


def ground_parts(
    simspec: SimSpec, group: ActorGroup, counts: Sequence[AreaCount], ground: Geometry
) -> list[GroundPart]:
    """The parts of a group's ground that are not empty; each errs to too much.

    A member is wholly inside an area or wholly outside it, so its centre keeps off the border.
    """
    areas = [named_area(simspec, count.area) for count in counts]
    within = [centre_ground(area, group) for area in areas]
    beyond = [grown_at_most(area, inner_radius_m(group)) for area in areas]
    parts = []
    for inside in product((True, False), repeat=len(areas)):
        part = ground
        for is_inside, room, border in zip(inside, within, beyond, strict=True):
            part = part.intersection(room) if is_inside else part.difference(border)
        if not part.is_empty:
            parts.append(GroundPart(inside, part))
    return parts


def areal_ground_parts(simspec: SimSpec, group: ActorGroup, ground: Geometry) -> list[GroundPart]:
    """The parts from which places can be drawn."""
    parts = ground_parts(simspec, group, group.placement.counts, ground)
    grounds = [(part.inside, areal_parts(part.ground)) for part in parts]
    return [GroundPart(inside, room) for inside, room in grounds if shapely.area(room) > 0.0]


def feasible_numbers(
    parts: Sequence[GroundPart], counts: Sequence[AreaCount], count: int, capacities: Sequence[int]
) -> list[int] | None:
    """How many of `count` members stand in each part so that all counts are kept; None when it is impossible."""
    if any(sum(part.inside) > 1 for part in parts):
        return _numbers_by_solver(parts, counts, count, capacities)
    # Areas that share no ground: the least that each needs, and the others where there is room.
    numbers = [
        sum(item.low for item, is_inside in zip(counts, part.inside, strict=True) if is_inside)
        for part in parts
    ]
    most = [
        min(
            [
                capacity,
                *(item.high(count) for item, inside in zip(counts, part.inside, strict=True) if inside),
            ]
        )
        for part, capacity in zip(parts, capacities, strict=True)
    ]
    present = {part.inside.index(True) for part in parts if any(part.inside)}
    missing = any(item.low > 0 for index, item in enumerate(counts) if index not in present)
    if missing or any(number > bound for number, bound in zip(numbers, most, strict=True)):
        return None
    # The outside first, where every count allows them.
    for index in sorted(range(len(parts)), key=lambda index: any(parts[index].inside)):
        numbers[index] += max(0, min(most[index] - numbers[index], count - sum(numbers)))
    return numbers if sum(numbers) == count else None


def _numbers_by_solver(
    parts: Sequence[GroundPart], counts: Sequence[AreaCount], count: int, capacities: Sequence[int]
) -> list[int] | None:
    # Imported here: ortools takes 0.2 to 0.8 s, and only areas that overlap need it.
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    numbers = [model.new_int_var(0, min(count, capacity), "") for capacity in capacities]
    model.add(sum(numbers) == count)
    for index, item in enumerate(counts):
        inside = [number for number, part in zip(numbers, parts, strict=True) if part.inside[index]]
        model.add(sum(inside) >= item.low)
        model.add(sum(inside) <= item.high(count))
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    return [solver.value(number) for number in numbers]


def drawn_numbers(
    parts: Sequence[GroundPart], counts: Sequence[AreaCount], count: int, rng: np.random.Generator
) -> list[int] | None:
    """How many members stand in each part, drawn as if `count` uniform places had happened to keep the counts.

    Metropolis steps on the multinomial distribution of the parts' areas. None when no numbers keep the counts.
    """
    numbers = feasible_numbers(parts, counts, count, [count] * len(parts))
    if numbers is None or len(parts) < 2:
        return numbers
    area_m2 = [float(shapely.area(part.ground)) for part in parts]
    for _ in range(MOVES_PER_PART * len(parts)):
        source, target = (int(index) for index in rng.choice(len(parts), size=2, replace=False))
        odds = area_m2[target] * numbers[source] / (area_m2[source] * (numbers[target] + 1))
        if rng.random() >= odds:
            continue
        numbers[source] -= 1
        numbers[target] += 1
        if not _are_kept(parts, counts, count, numbers):
            numbers[source] += 1
            numbers[target] -= 1
    return numbers


def _are_kept(
    parts: Sequence[GroundPart], counts: Sequence[AreaCount], count: int, numbers: Sequence[int]
) -> bool:
    totals = [
        sum(number for number, part in zip(numbers, parts, strict=True) if part.inside[index])
        for index in range(len(counts))
    ]
    return all(item.low <= total <= item.high(count) for item, total in zip(counts, totals, strict=True))
