"""Whether the parts of a SimSpec agree with one another; every inconsistency comes with its field."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from pydantic_core import InitErrorDetails, PydanticCustomError, ValidationError

from ._orders import MOTION_ORDERS
from ._placement import HOME
from ._roles import TARGET_ROLES, Role

# Only for types: those modules import this one.
if TYPE_CHECKING:
    from ._actors import ActorGroup
    from ._document import Intelligence, SimSpec
    from ._orders import Order
    from ._rules import Rules

FieldPath = tuple[str | int, ...]
Inconsistency = tuple[FieldPath, str]
"""The field, and what is wrong there."""


def raise_inconsistencies(title: str, inconsistencies: Iterable[Inconsistency]) -> None:
    """Raise pydantic's ValidationError with one error for each inconsistency; do nothing when there is
    none.
    """
    # All at once: a person who corrects a file wants the whole list, not one fault for each attempt.
    if errors := [_error(field, message) for field, message in inconsistencies]:
        raise ValidationError.from_exception_data(title, errors)


def _error(field: FieldPath, message: str) -> InitErrorDetails:
    # The message is a parameter, because pydantic reads braces in a message as a template.
    return InitErrorDetails(
        type=PydanticCustomError("value_error", "{what}", {"what": message}), loc=field, input=None
    )


def rule_inconsistencies(rules: Rules) -> Iterator[Inconsistency]:
    """Where the rules contradict one another."""
    if (rules.bystander_slow_within_m is None) != (rules.bystander_slow_mps is None):
        stated = "bystander_slow_mps" if rules.bystander_slow_within_m is None else "bystander_slow_within_m"
        yield (stated,), "bystander_slow_within_m and bystander_slow_mps are one rule: give both or neither"
    if rules.min_altitude_m is not None and rules.min_altitude_m >= rules.max_altitude_m:
        yield (
            ("min_altitude_m",),
            f"{rules.min_altitude_m:g} must be less than max_altitude_m {rules.max_altitude_m:g}",
        )
    yield from _duplicate_ids("no_fly", "no_fly", [area.id for area in rules.no_fly])
    for index, (earlier, later) in enumerate(itertools.pairwise(rules.report_windows), start=1):
        if later.from_s < earlier.until_s:
            message = (
                f"begins at {later.from_s:g} s, before the window ahead of it ends at {earlier.until_s:g} s"
            )
            yield ("report_windows", index), message


def situation_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """Where the parts of a SimSpec contradict one another."""
    for part, kind in (("roads", "road"), ("areas", "area")):
        for field, message in _duplicate_ids(
            part, kind, [ground.id for ground in getattr(simspec.world, part)]
        ):
            yield ("world", *field), message
    yield from _actor_inconsistencies(simspec)
    yield from _intelligence_inconsistencies(simspec)
    yield from _order_inconsistencies(simspec)
    yield from _consent_inconsistencies(simspec)
    yield from _handover_inconsistencies(simspec)
    yield from _outage_inconsistencies(simspec)
    yield from _perception_inconsistencies(simspec)
    yield from _label_inconsistencies(simspec)
    yield from _escort_inconsistencies(simspec)
    yield from _altitude_inconsistencies(simspec)
    yield from _home_inconsistencies(simspec)


def _duplicate_ids(part: str, kind: str, ids: Sequence[str]) -> Iterator[Inconsistency]:
    for index, item_id in enumerate(ids):
        if item_id in ids[:index]:
            yield (part, index, "id"), f"{kind} id {item_id!r} is used twice"


def _label_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """Class labels that neither the catalogue nor an asset of the SimSpec has."""
    known = simspec.class_labels
    fields: dict[FieldPath, Iterable[str]] = {
        ("perception", "model", name): labels
        for name, labels in simspec.perception.model.labels_by_field.items()
    }
    fields |= {
        ("assets", name, "confused_with"): asset.confused_with for name, asset in simspec.assets.items()
    }
    for field, labels in fields.items():
        for label in sorted(set(labels) - set(known)):
            yield field, f"{label!r} is no class label; known: {', '.join(known)}"


def _role_inconsistency(group: ActorGroup, index: int) -> Inconsistency:
    """Of a group without a role: its asset states none, or nobody defines the asset."""
    if fault := group.asset_fault(""):
        return ("actors", index, "asset"), f"{fault.what} ({fault.remedy})"
    return ("actors", index, "role"), f"is missing, and asset {group.asset!r} states none: add it"


def _perception_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """Cameras of `perception.more_cameras` that are none of `vehicle.more_cameras`, or stand there twice."""
    names, main = simspec.perception.more_cameras, simspec.vehicle.camera.name
    cameras = [camera.name for camera in simspec.vehicle.more_cameras]
    for index, name in enumerate(names):
        field = ("perception", "more_cameras", index)
        if name == main:
            yield (
                field,
                f"{name!r} is the main camera, which always has detections; name further cameras alone",
            )
        elif name not in cameras:
            yield (
                field,
                f"there is no camera {name!r} in vehicle.more_cameras (there: {', '.join(cameras) or 'none'})",
            )
        elif name in names[:index]:
            yield field, f"the camera {name!r} stands twice; name it once"


def _actor_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    group_ids = [group.id for group in simspec.actors]
    yield from _duplicate_ids("actors", "group", group_ids)
    for index, group in enumerate(simspec.actors):
        for name in ("near", "away", "mean_distance"):
            relation = getattr(group.placement, name)
            if relation:
                yield from _reference_inconsistencies(
                    ("actors", index, "placement", name, "of"), group.id, relation.of, group_ids
                )
        if not group.has_role:
            yield _role_inconsistency(group, index)
        yield from _distance_inconsistencies(simspec, index)
        yield from _avoid_inconsistencies(simspec, index)
        yield from _count_inconsistencies(simspec, index)
        yield from _place_inconsistencies(simspec, index)
        yield from _between_inconsistencies(simspec, index)
        yield from _inside_inconsistencies(simspec, index)


def _reference_inconsistencies(
    field: FieldPath, group: str, target: str, group_ids: Sequence[str]
) -> Iterator[Inconsistency]:
    """A relation of a group to itself, or to a group that does not exist."""
    if target == group:
        yield field, f"group {group!r} relates to itself"
    elif target not in group_ids and target != HOME:
        yield (
            field,
            f"group {group!r} relates to {target!r}, which is neither one of the groups {[*group_ids]} nor {HOME!r}",
        )


def _distance_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, group_ids = simspec.actors[index], [group.id for group in simspec.actors]
    roles = [other.role for other in simspec.actors]
    for number, distance in enumerate(group.placement.distances):
        field = ("actors", index, "placement", "distances", number, "of")
        if distance.of == group.id:
            yield field, f"group {group.id!r} relates to itself; use spread_m to keep its members apart"
        elif distance.of not in (None, HOME, *group_ids, *roles):
            message = (
                f"group {group.id!r} relates to {distance.of!r}, which is neither one of the groups {group_ids}, "
                f"nor a role of any of them, nor {HOME!r}"
            )
            yield field, message


def _avoid_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, group_ids = simspec.actors[index], [group.id for group in simspec.actors]
    roles, area_ids = [other.role for other in simspec.actors], [area.id for area in simspec.world.areas]
    for number, avoid in enumerate(group.placement.avoid):
        field = ("actors", index, "placement", "avoid", number)
        if avoid.area is not None and avoid.area not in area_ids:
            message = (
                f"group {group.id!r} avoids area {avoid.area!r}, which is not one of world.areas {area_ids}"
            )
            yield (*field, "area"), message
        if avoid.of == group.id:
            yield (
                (*field, "of"),
                f"group {group.id!r} relates to itself; use separation_m to keep its members apart",
            )
        elif avoid.of not in (None, HOME, *group_ids, *roles):
            message = (
                f"group {group.id!r} avoids {avoid.of!r}, which is neither one of the groups {group_ids}, "
                f"nor a role of any of them, nor {HOME!r}"
            )
            yield (*field, "of"), message


def _count_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, area_ids = simspec.actors[index], [area.id for area in simspec.world.areas]
    named = [count.area for count in group.placement.counts]
    for number, area in enumerate(named):
        field = ("actors", index, "placement", "counts", number, "area")
        if area not in area_ids:
            yield (
                field,
                f"group {group.id!r} counts members in area {area!r}, which is not one of world.areas {area_ids}",
            )
        elif area in named[:number]:
            yield field, f"group {group.id!r} counts members in area {area!r} twice; keep one"


def _place_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, group_ids = simspec.actors[index], [group.id for group in simspec.actors]
    placement_field = ("actors", index, "placement")
    for name, reference in group.placement.place_references.items():
        if reference.of is not None:
            yield from _reference_inconsistencies(
                (*placement_field, name, "of"), group.id, reference.of, group_ids
            )
    road_ids = [road.id for road in simspec.world.roads]
    if group.placement.along and group.placement.along.road not in road_ids:
        message = f"group {group.id!r} is placed along road {group.placement.along.road!r}, which is not one of {road_ids}"
        yield (*placement_field, "along", "road"), message


def _between_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, group_ids = simspec.actors[index], [group.id for group in simspec.actors]
    between = group.placement.between
    if between is None:
        return
    field = ("actors", index, "placement", "between")
    for name in ("first", "second"):
        yield from _reference_inconsistencies((*field, name), group.id, getattr(between, name), group_ids)
    # A group called `home` has a first and a second member; the vehicle's home is a single place.
    if between.first == between.second == HOME and HOME not in group_ids:
        yield (*field, "second"), f"there is nothing between {HOME!r} and itself; name a group"


def _inside_inconsistencies(simspec: SimSpec, index: int) -> Iterator[Inconsistency]:
    group, groups = simspec.actors[index], {group.id: group for group in simspec.actors}
    inside, area_ids = group.placement.inside, [area.id for area in simspec.world.areas]
    field = ("actors", index, "placement", "inside")
    if inside is None:
        return
    if inside.area is not None and inside.area not in area_ids:
        message = f"group {group.id!r} is placed inside area {inside.area!r}, which is not one of world.areas {area_ids}"
        yield (*field, "area"), message
    if inside.of is None:
        return
    if inside.of == group.id:
        yield (*field, "of"), f"group {group.id!r} relates to itself"
    elif inside.of not in groups:
        yield (
            (*field, "of"),
            f"group {group.id!r} is placed inside group {inside.of!r}, which is not one of {[*groups]}",
        )
    # Unknown assets are left to load_simspec and to placement, which report them with the catalogue.
    elif group.is_known and groups[inside.of].is_known:
        yield from _host_inconsistencies(field, index, group, groups[inside.of])


def _host_inconsistencies(
    field: FieldPath, index: int, guest: ActorGroup, host: ActorGroup
) -> Iterator[Inconsistency]:
    """Whether the guest fits into the host's asset and may move there."""
    guest_asset, host_asset = guest.definition, host.definition
    if not host_asset.has_room_for(guest_asset):
        message = (
            f"a {guest.asset} of {guest_asset.length_m:g} by {guest_asset.width_m:g} m does not fit inside a {host.asset} of "
            f"{host_asset.length_m:g} by {host_asset.width_m:g} m at any heading; put group {guest.id!r} inside something larger"
        )
        yield (*field, "of"), message
    if host_asset.solid and guest.motion.kind != "still":
        message = (
            f"group {guest.id!r} cannot {guest.motion.kind} from inside {host.id!r}: its asset {host.asset!r} is solid: "
            "set motion.kind to still, or delete placement.inside"
        )
        yield ("actors", index, "motion", "kind"), message


def _intelligence_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    group_ids = [group.id for group in simspec.actors]
    yield from _duplicate_ids("intelligence", "intelligence", [report.id for report in simspec.intelligence])
    for index, report in enumerate(simspec.intelligence):
        if report.about not in group_ids:
            message = (
                f"intelligence {report.id!r} is about group {report.about!r}, which is not one of {group_ids}"
            )
            yield ("intelligence", index, "about"), message
            continue
        if report.at is not None and simspec.realized is None and not _is_kept(simspec, report):
            yield (
                ("intelligence", index, "at"),
                f"nothing keeps {report.about!r} within {report.uncertainty_m:g} m of it; give that group's "
                "placement.distances this point with that max_m",
            )


def _is_kept(simspec: SimSpec, report: Intelligence) -> bool:
    """Whether placement keeps the group of a report within its accuracy of the place that it states."""
    place, at = simspec.group(report.about).placement, report.at
    if place.at is not None and at is not None:
        return math.hypot(place.at.east_m - at.east_m, place.at.north_m - at.north_m) <= report.uncertainty_m
    return any(
        distance.point == at and (distance.max_m or math.inf) <= report.uncertainty_m
        for distance in place.distances
    )


def _order_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    limit_s = simspec.mission.time_limit_s
    delivered_s = {report.id: report.delivered_s for report in simspec.intelligence}
    yield from _duplicate_ids("orders", "order", [order.id for order in simspec.orders])
    for index, order in enumerate(simspec.orders):
        if order.at_s >= limit_s:
            message = f"order {order.id!r} at {order.at_s:g} s comes after the end: mission.time_limit_s is {limit_s:g}"
            yield ("orders", index, "at_s"), message
        if order.intelligence is None:
            continue
        field = ("orders", index, "intelligence")
        subject = f"order {order.id!r} at {order.at_s:g} s names intelligence {order.intelligence!r}"
        if order.intelligence not in delivered_s:
            yield field, f"{subject}, which is not one of {[*delivered_s]}"
        elif order.at_s < (due_s := delivered_s[order.intelligence]):
            yield field, f"{subject}, which is not delivered before {due_s:g} s"


def _consent_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    ids = [report.id for report in simspec.intelligence]
    named = [consent.intelligence for consent in simspec.consents]
    if named and not simspec.rules.mark_consent:
        yield ("consents",), "the operator answers no request: set rules.mark_consent, or remove consents"
    for index, report_id in enumerate(named):
        field = ("consents", index, "intelligence")
        if report_id not in ids:
            yield field, f"consent names intelligence {report_id!r}, which is not one of {ids}"
        elif report_id in named[:index]:
            yield field, f"intelligence {report_id!r} has two consents; keep one"


def _handover_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """Every `hand_over` needs a `take_back`, late enough, and no order to fly in between."""
    pending: tuple[int, Order] | None = None
    for index, order in sorted(enumerate(simspec.orders), key=lambda pair: pair[1].at_s):
        if order.kind == "take_back":
            if pending is None:
                yield ("orders", index, "kind"), f"order {order.id!r} takes back what was not handed over"
            elif order.at_s <= (due_s := pending[1].at_s + pending[1].within_s):
                message = f"order {order.id!r} at {order.at_s:g} s must come after {pending[1].id!r} is due, at {due_s:g} s"
                yield ("orders", index, "at_s"), message
            pending = None
        # What moves the vehicle cannot be ordered of an agent that does not have it.
        elif pending is not None and order.kind in MOTION_ORDERS:
            message = f"order {order.id!r} ({order.kind}) comes while the operator has the vehicle, after {pending[1].id!r}"
            yield ("orders", index, "at_s"), f"{message}; put take_back first"
        elif order.kind == "hand_over":
            pending = index, order
    if pending is not None:
        index, order = pending
        yield ("orders", index, "kind"), f"order {order.id!r} hands over for good: add take_back after it"


def _outage_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    limit_s = simspec.mission.time_limit_s
    for index, outage in enumerate(simspec.outages):
        if outage.until_s > limit_s:
            outage_text = f"{outage.kind} from {outage.at_s:g} to {outage.until_s:g} s lasts past the end"
            yield ("outages", index), f"{outage_text}: mission.time_limit_s is {limit_s:g}"


def _escort_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    """Whether the escorted group exists, may be escorted, and can be predicted from what the agent is told."""
    escort = simspec.mission.escort
    if escort is None:
        return
    groups = {group.id: (index, group) for index, group in enumerate(simspec.actors)}
    if escort.group not in groups:
        message = f"escort names group {escort.group!r}, which is not one of {[*groups]}"
        yield ("mission", "escort", "group"), message
        return
    index, group = groups[escort.group]
    # The area does not matter here: a density of 0 has no members in any.
    if not group.member_count(simspec.world.area.area_m2):
        yield (
            ("actors", index, "count"),
            f"group {group.id!r} is escorted and may be empty: set count to 1 or more",
        )
    if group.role in TARGET_ROLES:
        kind = "no adversary" if group.role is Role.ADVERSARY else "not sought"
        yield (
            ("actors", index, "role"),
            f"group {group.id!r} is escorted, so it is {kind}: set role to bystander",
        )
    motion = group.motion
    if motion.kind != "patrol":
        message = f"group {group.id!r} is escorted along a route: set motion.kind to patrol, and give a route"
        yield ("actors", index, "motion", "kind"), message
    elif motion.pause_s > 0.0:
        message = f"group {group.id!r} is escorted, and rests are drawn at random: set motion.pause_s to 0"
        yield ("actors", index, "motion", "pause_s"), message
    limit_s = simspec.mission.time_limit_s
    if motion.depart_s >= limit_s:
        message = f"escorted group {group.id!r} sets off after the end: mission.time_limit_s is {limit_s:g}"
        yield ("actors", index, "motion", "depart_s"), message


def _altitude_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    altitude_m, rules = simspec.mission.altitude_m, simspec.rules
    field = ("mission", "altitude_m")
    if altitude_m > rules.max_altitude_m:
        yield field, f"mission.altitude_m {altitude_m} is above rules.max_altitude_m {rules.max_altitude_m}"
    if rules.min_altitude_m is not None and altitude_m < rules.min_altitude_m:
        yield field, f"mission.altitude_m {altitude_m} is below rules.min_altitude_m {rules.min_altitude_m}"


def _home_inconsistencies(simspec: SimSpec) -> Iterator[Inconsistency]:
    home, rules = simspec.vehicle.home, simspec.rules
    if rules.geofence is not None and not rules.geofence.contains(home):
        yield (
            ("rules", "geofence"),
            "the geofence does not contain vehicle.home: the vehicle would start outside it",
        )
    for index, no_fly in enumerate(rules.no_fly):
        # Whatever its times are: an area that opens later could still forbid the landing.
        if no_fly.area.contains(home):
            message = (
                f"no-fly area {no_fly.id!r} contains vehicle.home: the vehicle could neither start nor land"
            )
            yield ("rules", "no_fly", index), message
