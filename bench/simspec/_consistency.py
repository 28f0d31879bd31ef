"""What the parts of a situation must agree on, beyond each by itself: every fault with the place where it stands."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from ._assets import ASSETS
from ._placement import HOME

if TYPE_CHECKING:
    from ._actors import ActorGroup
    from ._document import SimSpec
    from ._rules import Rules

Inconsistency = tuple[tuple[str | int, ...], str]
"""Path inside the document, and what is wrong there."""


def raise_inconsistencies(title: str, wrong: Iterable[Inconsistency]) -> None:
    """Raise pydantic's ValidationError with one error for each disagreement; nothing when there is none."""
    if faults := list(wrong):
        raise ValidationError.from_exception_data(title, [_error(where, what) for where, what in faults])


def _error(where: tuple[str | int, ...], what: str) -> InitErrorDetails:
    # By a parameter: pydantic would take braces in a message for a template.
    return InitErrorDetails(type=PydanticCustomError("value_error", "{what}", {"what": what}), loc=where, input=None)


def rule_inconsistencies(rules: Rules) -> Iterator[Inconsistency]:
    """What the rules contradict in themselves."""
    if (rules.bystander_slow_within_m is None) != (rules.bystander_slow_mps is None):
        given = "bystander_slow_mps" if rules.bystander_slow_within_m is None else "bystander_slow_within_m"
        yield (given,), "bystander_slow_within_m and bystander_slow_mps are one rule: give both or none"
    if rules.min_altitude_m is not None and rules.min_altitude_m >= rules.max_altitude_m:
        yield ("min_altitude_m",), f"{rules.min_altitude_m:g} must be under max_altitude_m {rules.max_altitude_m:g}"
    yield from _twice("no_fly", "no_fly", [area.id for area in rules.no_fly])
    for index, (earlier, later) in enumerate(itertools.pairwise(rules.report_windows), start=1):
        if later.from_s < earlier.until_s:
            what = f"from {later.from_s:g} s on is out of order: the window before it ends at {earlier.until_s:g} s"
            yield ("report_windows", index), what


def situation_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """What the parts of a SimSpec contradict in one another."""
    for part, name in (("roads", "road"), ("areas", "area")):
        for where, what in _twice(part, name, [one.id for one in getattr(simspec.world, part)]):
            yield ("world", *where), what
    yield from _actors(simspec)
    yield from _intelligence(simspec)
    yield from _orders(simspec)
    yield from _outages(simspec)
    yield from _heights(simspec)
    yield from _home(simspec)


def _twice(part: str, name: str, ids: list[str]) -> Iterator[Inconsistency]:
    for index, one in enumerate(ids):
        if one in ids[:index]:
            yield (part, index, "id"), f"{name} id {one!r} is used twice"


def _actors(simspec: SimSpec) -> Iterator[Inconsistency]:
    groups = [group.id for group in simspec.actors]
    yield from _twice("actors", "group", groups)
    for index, group in enumerate(simspec.actors):
        for name in ("near", "away", "mean_distance"):
            relation = getattr(group.placement, name)
            where = ("actors", index, "placement", name, "of")
            if relation:
                yield from _stranger(where, group.id, relation.of, groups)
        yield from _more_relations(simspec, index)
        yield from _between(simspec, index)
        yield from _inside(simspec, index)


def _stranger(where: tuple[str | int, ...], own: str, of: str, groups: list[str]) -> Iterator[Inconsistency]:
    """A relation to a group that is not there; `home` is, whatever the groups are called."""
    if of == own:
        yield where, f"group {own!r} relates to itself"
    elif of not in groups and of != HOME:
        yield where, f"group {own!r} relates to group {of!r}, which is not among {groups}, nor is it {HOME!r}"


def _more_relations(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, groups = simspec.actors[index], [one.id for one in simspec.actors]
    where = ("actors", index, "placement")
    for number, distance in enumerate(group.placement.distances):
        if distance.of == group.id:
            yield (*where, "distances", number, "of"), f"group {group.id!r} relates to itself; spread_m keeps its members apart"
        elif distance.of not in (None, HOME, *groups, *(one.role for one in simspec.actors)):
            what = (
                f"group {group.id!r} relates to {distance.of!r}, which is neither among {groups} nor a role of any of them, "
                f"nor is it {HOME!r}"
            )
            yield (*where, "distances", number, "of"), what
    for name, seen in group.placement.place_references.items():
        if seen.of is not None:
            yield from _stranger((*where, name, "of"), group.id, seen.of, groups)
    roads = [road.id for road in simspec.world.roads]
    if group.placement.along and group.placement.along.road not in roads:
        what = f"group {group.id!r} is to stand along road {group.placement.along.road!r}, which is not among {roads}"
        yield (*where, "along", "road"), what


def _between(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, groups = simspec.actors[index], [one.id for one in simspec.actors]
    between = group.placement.between
    if between is None:
        return
    where = ("actors", index, "placement", "between")
    for name in ("first", "second"):
        yield from _stranger((*where, name), group.id, getattr(between, name), groups)
    if between.first == between.second == HOME and HOME not in groups:
        yield (*where, "second"), f"nothing lies between {HOME!r} and itself; name a group"


def _inside(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, groups = simspec.actors[index], {one.id: one for one in simspec.actors}
    inside, areas = group.placement.inside, [one.id for one in simspec.world.areas]
    where = ("actors", index, "placement", "inside")
    if inside is None:
        return
    if inside.area is not None and inside.area not in areas:
        what = f"group {group.id!r} is to stand inside area {inside.area!r}, which is not among world.areas {areas}"
        yield (*where, "area"), what
    if inside.of is None:
        return
    if inside.of == group.id:
        yield (*where, "of"), f"group {group.id!r} relates to itself"
    elif inside.of not in groups:
        yield (*where, "of"), f"group {group.id!r} is to stand inside group {inside.of!r}, which is not among {[*groups]}"
    elif group.asset in ASSETS and groups[inside.of].asset in ASSETS:
        yield from _guest(where, index, group, groups[inside.of])


def _guest(where: tuple[str | int, ...], index: int, guest: ActorGroup, host: ActorGroup) -> Iterator[Inconsistency]:
    """Whether the host's asset can have the guest in it."""
    own, around = ASSETS[guest.asset], ASSETS[host.asset]
    if not around.has_room_for(own):
        yield (
            (*where, "of"),
            (
                f"a {guest.asset} of {own.length_m:g} by {own.width_m:g} m has no room inside a {host.asset} of {around.length_m:g} by "
                f"{around.width_m:g} m, whatever its heading; put group {guest.id!r} inside something larger"
            ),
        )
    if around.solid and guest.motion.kind != "still":
        yield (
            ("actors", index, "motion", "kind"),
            (
                f"group {guest.id!r} is to {guest.motion.kind} from inside {host.id!r}, whose asset {host.asset!r} is solid: nobody walks "
                "through it; make it still or drop placement.inside"
            ),
        )


def _intelligence(simspec: SimSpec) -> Iterator[Inconsistency]:
    groups = [group.id for group in simspec.actors]
    yield from _twice("intelligence", "intelligence", [report.id for report in simspec.intelligence])
    for index, report in enumerate(simspec.intelligence):
        if report.about not in groups:
            what = f"intelligence {report.id!r} is about group {report.about!r}, which is not among {groups}"
            yield ("intelligence", index, "about"), what


def _orders(simspec: SimSpec) -> Iterator[Inconsistency]:
    limit_s = simspec.mission.time_limit_s
    delivered_s = {report.id: report.delivered_s for report in simspec.intelligence}
    yield from _twice("orders", "order", [order.id for order in simspec.orders])
    for index, order in enumerate(simspec.orders):
        if order.at_s >= limit_s:
            what = f"order {order.id!r} at {order.at_s:g} s comes after the end: mission.time_limit_s is {limit_s:g}"
            yield ("orders", index, "at_s"), what
        if order.intelligence is None:
            continue
        where = ("orders", index, "intelligence")
        if order.intelligence not in delivered_s:
            yield where, f"order {order.id!r} names intelligence {order.intelligence!r}, which is not among {[*delivered_s]}"
        elif order.at_s < (due_s := delivered_s[order.intelligence]):
            named = f"order {order.id!r} at {order.at_s:g} s names intelligence {order.intelligence!r}"
            yield where, f"{named}, which is delivered at {due_s:g} s only"


def _outages(simspec: SimSpec) -> Iterator[Inconsistency]:
    limit_s = simspec.mission.time_limit_s
    for index, outage in enumerate(simspec.outages):
        if outage.until_s > limit_s:
            lasting = f"{outage.kind} from {outage.at_s:g} to {outage.until_s:g} s lasts past the end"
            yield ("outages", index), f"{lasting}: mission.time_limit_s is {limit_s:g}"


def _heights(simspec: SimSpec) -> Iterator[Inconsistency]:
    height_m, rules = simspec.mission.altitude_m, simspec.rules
    where = ("mission", "altitude_m")
    if height_m > rules.max_altitude_m:
        yield where, f"mission.altitude_m {height_m} exceeds rules.max_altitude_m {rules.max_altitude_m}"
    if rules.min_altitude_m is not None and height_m < rules.min_altitude_m:
        yield where, f"mission.altitude_m {height_m} is under rules.min_altitude_m {rules.min_altitude_m}"


def _home(simspec: SimSpec) -> Iterator[Inconsistency]:
    home, rules = simspec.vehicle.home, simspec.rules
    if rules.geofence is not None and not rules.geofence.contains(home):
        yield ("rules", "geofence"), "the geofence does not contain vehicle.home: the vehicle would start outside"
    for index, one in enumerate(rules.no_fly):
        if one.area.contains(home):
            what = f"no-fly area {one.id!r} contains vehicle.home: the vehicle could neither start nor land"
            yield ("rules", "no_fly", index), what
