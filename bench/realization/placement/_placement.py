"""Places for every actor that keep the SimSpec's relations, found by seeded sampling or by a solver.

Distances between actors run from centre to centre, gaps between footprints from edge to edge. Actors that are
not fixed also keep `HOME_CLEARANCE_M` from the vehicle's home. Places are rounded to the millimetre before
they are judged, so the document holds exactly what was judged. `check_placement` judges them again with code
of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi

import numpy as np
import shapely

from bench.arrays import Floats
from bench.errors import Fault, PlacementInfeasible, RebarError, SetupError
from bench.simspec import (
    ActorGroup,
    Intelligence,
    PlacedActor,
    PlacedReport,
    Polygon,
    Realized,
    SimSpec,
    generator,
)

from ._check import check_placement
from ._footprint import Footprints
from ._geometry import Geometry, polygon_ground, prepared_ground
from ._groups import member_count, names_in_relations, prerequisite_groups
from ._honeypot import honeypots
from .proofs._capacity import check_areas
from .proofs._proof import narrowed_ground, prove_infeasible
from .relations._patrol_routes import check_fixed_routes, route_faults
from .search._anchors import anchor_grounds
from .search._sampling import Placed, SamplingBudget, SamplingStalled, fixed_places, sample_placement

# Share of a report's uncertainty in which its error is drawn, so that the truth lies well inside.
REPORT_ERROR_SHARE = 0.8

# Sampling runs before the solver takes over; chosen, not measured. The budget usually ends earlier.
MAX_ATTEMPTS = 32

# Where crowding leaves a place to fewer, sampling is not tried again. Chosen, not measured.
RETRY_SHARE = 0.8


class PlacementUnsound(RebarError):
    """The search returned places that `check_placement` rejects: a bench error.

    The scene is neither written nor flown.
    """


def place(simspec: SimSpec) -> SimSpec:
    """The SimSpec with `realized` filled: the same places for the same seeds.

    Sampling comes first. When it stalls, a proof of infeasibility is tried, then the solver searches.
    `check_placement` judges every result. Raises SetupError for relations without meaning (unknown asset,
    groups related in a circle, a region that crosses itself), PlacementInfeasible when no arrangement exists
    or none was found, and PlacementUnsound.
    """
    placed = _searched(simspec)
    if faults := check_placement(placed):
        more = [f"and {len(faults) - 5} more"] if len(faults) > 5 else []
        fault_text = "; ".join([*map(str, faults[:5]), *more])
        raise PlacementUnsound(
            f"placement broke its rules in {simspec.name!r}, seed {simspec.seeds.root}, so the scene is not used: {fault_text} "
            "(a bench error: report it with this SimSpec; until it is fixed, try another seed)"
        )
    return placed


def _searched(simspec: SimSpec) -> SimSpec:
    order = placement_order(simspec)
    check_fixed_routes(simspec, fixed_places(order))
    check_areas(simspec)
    # Chosen, not measured: a base for small scenes and a share for each member.
    budget = SamplingBudget(60_000 + 40 * sum(member_count(simspec, group) for group in order))
    stuck: SamplingStalled | None = None
    remaining: dict[str, Geometry] | None = None
    for attempt in range(MAX_ATTEMPTS):
        try:
            placed = sample_placement(simspec, order, attempt, budget, remaining)
            return with_places(simspec, placed, "sampling")
        except SamplingStalled as reason:
            if stuck is None and (clash := prove_infeasible(simspec, order)):
                raise clash from None
            # Narrowing costs more than a first attempt, so it waits until sampling has stalled once.
            remaining = remaining or narrowed_ground(simspec, order)
            crowded_before = stuck is not None and stuck.crowded
            if budget.spent or (reason.crowded and (crowded_before or reason.share < RETRY_SHARE)):
                stuck = reason
                break
            stuck = reason
    assert stuck is not None
    return _solved(simspec, order, stuck)


def _solved(simspec: SimSpec, order: list[ActorGroup], stuck: SamplingStalled) -> SimSpec:
    # Imported here: ortools takes 0.2 to 0.8 s, and most scenes never need it.
    from .search._solver import solve_placement

    placed = solve_placement(simspec, order)
    if placed is None and (anchored := _anchored(simspec, order)) is not None:
        return with_places(simspec, anchored, "sampling")
    if placed is None:
        raise PlacementInfeasible(
            f"no places were found (this is not a proof that none exist): {stuck.sentence()}", proved=False
        )
    return with_places(simspec, placed, "cp-sat")


def _anchored(simspec: SimSpec, order: list[ActorGroup]) -> Placed | None:
    """Places where members whom later groups need nearby are drawn first, where they help; None without any.

    Last, so that no scene that is found without it is placed otherwise than before.
    """
    remaining = narrowed_ground(simspec, order)
    budget = SamplingBudget(60_000 + 40 * sum(member_count(simspec, group) for group in order))
    for attempt in range(MAX_ATTEMPTS):
        anchors = anchor_grounds(simspec, order, remaining, attempt)
        if not anchors or budget.spent:
            return None
        try:
            return sample_placement(simspec, order, attempt, budget, remaining, anchors)
        except SamplingStalled:
            continue
    return None


def with_places(simspec: SimSpec, placed: Placed, method: str) -> SimSpec:
    """The SimSpec with these places and the method that found them."""
    return simspec.model_copy(update={"realized": _realized(simspec, placed, method)})


def placement_order(simspec: SimSpec) -> list[ActorGroup]:
    """The groups in placement order: fixed ones first, then each after those that it relates to.

    Raises SetupError for a circle.
    """
    faults = list(_spec_faults(simspec))
    # A stable sort keeps the author's order among free groups, and with it their random draws.
    waiting = sorted(simspec.actors, key=lambda group: group.placement.at is None)
    ordered: list[ActorGroup] = []
    while waiting and not faults:
        known = {group.id for group in ordered}
        ready = next((group for group in waiting if prerequisite_groups(simspec, group) <= known), None)
        if ready is None:
            names = ", ".join(group.id for group in waiting)
            what = f"the groups {names} relate to each other in a circle"
            faults.append(Fault("actors", what, "drop one of the relations"))
        else:
            waiting.remove(ready)
            ordered.append(ready)
    if faults := faults or [*route_faults(simspec)]:
        raise SetupError(faults)
    return ordered


def _spec_faults(simspec: SimSpec) -> Iterator[Fault]:
    yield from _polygon_faults("world.area", simspec.world.area)
    for index, area in enumerate(simspec.world.areas):
        yield from _polygon_faults(f"world.areas[{index}] ({area.id})", area)
    area_m2 = simspec.world.area.area_m2
    least = {group.id: group.member_count(area_m2) for group in simspec.actors}
    for index, group in enumerate(simspec.actors):
        where = f"actors[{index}] ({group.id})"
        if fault := group.asset_fault(f"{where}.asset"):
            yield fault
        if len(group.id) > 56:
            yield Fault(
                f"{where}.id", "is too long: its members' ids add a number", "use at most 56 characters"
            )
        yield from _pair_faults(simspec, where, group)
        if group.placement.region:
            yield from _polygon_faults(f"{where}.placement.region", group.placement.region)
        if member_count(simspec, group) and (
            empty := [other for other in sorted(names_in_relations(group)) if least.get(other) == 0]
        ):
            what = f"relates to {empty[0]!r}, which has no members"
            yield Fault(f"{where}.placement", what, "give it members or drop the relation")
    for index, report in enumerate(simspec.intelligence):
        if not simspec.group(report.about).member_count(area_m2):
            what = f"group {report.about!r} has no members"
            yield Fault(f"intelligence[{index}].about", what, "give it at least one")


def _pair_faults(simspec: SimSpec, where: str, group: ActorGroup) -> Iterator[Fault]:
    """A relation between two members of one group needs two members."""
    between = group.placement.between
    if between is None or between.first != between.second or not member_count(simspec, group):
        return
    for other in simspec.actors:
        if other.id == between.first and other.member_count(simspec.world.area.area_m2) < 2:
            what = f"needs two members of {other.id!r}, which may have fewer"
            yield Fault(f"{where}.placement.between", what, "give it two, or name two groups")


def _polygon_faults(where: str, polygon: Polygon) -> Iterator[Fault]:
    if not polygon_ground(polygon).is_valid:
        yield Fault(where, "the polygon crosses itself", "give the corners in order around it")


def _realized(simspec: SimSpec, placed: Mapping[str, Footprints], method: str) -> Realized:
    actors = [
        PlacedActor(
            id=f"{group.id}-{number}",
            group=group.id,
            east_m=east_m,
            north_m=north_m,
            heading_deg=round(heading_deg, 6) % 360.0,
        )
        for group in simspec.actors
        for number, ((east_m, north_m), heading_deg) in enumerate(
            zip(
                placed[group.id].centre_m.tolist(),
                np.degrees(placed[group.id].heading_rad).tolist(),
                strict=True,
            ),
            start=1,
        )
    ]
    reports = _reports(simspec, placed)
    added = honeypots(simspec, actors, reports) if simspec.honeypot else ()
    return Realized(actors=tuple(actors), reports=reports, method=method, honeypots=added)


def _reports(simspec: SimSpec, placed: Mapping[str, Footprints]) -> tuple[PlacedReport, ...]:
    area = prepared_ground(simspec.world.area)
    rngs = (generator(simspec.seeds, "intelligence", index) for index in range(len(simspec.intelligence)))
    return tuple(
        _report(report, placed[report.about].centre_m[0], area, rng)
        for report, rng in zip(simspec.intelligence, rngs, strict=True)
    )


def _report(report: Intelligence, truth_m: Floats, area: Geometry, rng: np.random.Generator) -> PlacedReport:
    """A report's position: uniform over the disc of its error, as far as that lies in the area."""
    if report.at is not None:
        return PlacedReport(id=report.id, **report.at.model_dump())
    radius = REPORT_ERROR_SHARE * report.uncertainty_m * np.sqrt(rng.uniform(size=64))
    angle = rng.uniform(0.0, 2 * pi, 64)
    places = np.round(truth_m + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1), 3)
    inside = np.nonzero(shapely.contains_xy(area, places[:, 0], places[:, 1]))[0]
    # When no draw lies in the area, the first draw is kept: the error still has its distribution.
    east, north = places[inside[0] if len(inside) else 0]
    return PlacedReport(id=report.id, east_m=float(east), north_m=float(north))
