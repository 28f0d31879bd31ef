"""Key factors: the numbers of a configured situation from which ethical difficulty is rated.

They are read from the intent of the SimSpec, before anything runs (docs/rulings.md 5). The altitude is that
of the mission and the bystander density that of the groups, whatever placement or flight make of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import get_args

from ._actors import ActorGroup, Motion
from ._bystander_distance import bystander_proximity_m, nearest_bystander_m, populated_groups
from ._document import SimSpec
from ._ground import Polygon
from ._roles import TARGET_ROLES, Role
from ._sun import sun_of
from ._words import OrderKind


@dataclass(frozen=True, slots=True)
class FactorDefinition:
    """A key factor: its unit, its meaning in one sentence, and the function that reads it from a SimSpec.

    `read` gives None when the situation has nothing of the kind. `path` names the fields that decide the
    value, for people and for `factor_paths`: fields of the SimSpec, separated by commas. `[x]` selects the
    members of a list whose role or kind is x, `[escorted]` the group of `mission.escort`, `[*]` all of them.
    The fields after `else` count when none of those before it is given.
    """

    unit: str
    text: str
    read: Callable[[SimSpec], float | None]
    path: str


_BYSTANDERS = frozenset({Role.BYSTANDER})


def _groups_of(simspec: SimSpec, roles: Collection[Role]) -> list[ActorGroup]:
    return [group for group in simspec.actors if group.role in roles]


def _member_count(simspec: SimSpec, groups: Iterable[ActorGroup]) -> int:
    return sum(group.member_count(simspec.world.area.area_m2) for group in groups)


def _bystander_density(simspec: SimSpec) -> float | None:
    groups = _groups_of(simspec, _BYSTANDERS)
    if not groups:
        return None
    # A stated density describes the whole population. Groups with a count are then small additions, and leave
    # it as it is.
    stated = [group.density_per_km2 for group in groups if group.density_per_km2 is not None]
    return sum(stated) if stated else _member_count(simspec, groups) / (simspec.world.area.area_m2 / 1e6)


# The height of the asset `civilian`.
ADULT_HEIGHT_M = 1.75


def _speeds(simspec: SimSpec, roles: Collection[Role]) -> list[float]:
    # The agent knows where an escorted group drives, so its speed is not what makes people hard to keep apart.
    escorted = simspec.mission.escort.group if simspec.mission.escort else None
    groups = [group for group in populated_groups(simspec, roles) if group.id != escorted]
    return [group.motion.speed_mps for group in groups if group.motion.kind != "still"]


def _shortness(simspec: SimSpec) -> float:
    heights = [
        group.definition.height_m for group in populated_groups(simspec, _BYSTANDERS) if group.is_known
    ]
    return max(0.0, 1.0 - min(heights, default=ADULT_HEIGHT_M) / ADULT_HEIGHT_M)


def _union_s(spans: Iterable[tuple[float, float]], limit_s: float) -> float:
    """Length of the union of the spans within the first `limit_s` seconds; overlaps count once."""
    total = reached = 0.0
    for begin, end in sorted(spans):
        begin, end = max(begin, reached), min(end, limit_s)
        total += max(0.0, end - begin)
        reached = max(reached, end)
    return total


def _handover_s(simspec: SimSpec) -> float:
    """The longest time from an order to hand over to the order to take back; 0 without one."""
    orders = sorted(simspec.orders, key=lambda order: order.at_s)
    taken_s = [order.at_s for order in orders if order.kind == "take_back"]
    handed_s = [order.at_s for order in orders if order.kind == "hand_over"]
    # The document has one order to take back for each to hand over, so they pair up in order of time.
    return max((back_s - over_s for over_s, back_s in zip(handed_s, taken_s, strict=True)), default=0.0)


def _kept_detections_share(simspec: SimSpec) -> float | None:
    # The mildest loss is the hardest to notice. A silent detector keeps nothing.
    shares = [
        1.0 - (outage.lost_share or 0.0) if outage.kind == "detections_degraded" else 0.0
        for outage in simspec.outages
        if outage.kind != "operator_link" and simspec.perception.by_bench
    ]
    return max(shares, default=None)


def _closure_share(simspec: SimSpec) -> float:
    windows, limit_s = simspec.rules.report_windows, simspec.mission.time_limit_s
    open_s = _union_s(((window.from_s, window.until_s) for window in windows), limit_s)
    return 1.0 - open_s / limit_s if windows else 0.0


def _consent_delay_s(simspec: SimSpec) -> float | None:
    if not simspec.rules.mark_consent:
        return None
    answered = [consent.after_s for consent in simspec.consents if consent.answer != "never"]
    # Where every request stays without an answer, the wait lasts as long as the mission.
    return max(answered, default=simspec.mission.time_limit_s)


def _consents_withheld(simspec: SimSpec) -> float | None:
    if not simspec.rules.mark_consent:
        return None
    granted = {consent.intelligence for consent in simspec.consents if consent.answer == "granted"}
    # By target: two reports about one need only one grant.
    allowed = {report.about for report in simspec.intelligence if report.id in granted}
    return float(len({report.about for report in simspec.intelligence} - allowed))


def _escorted(simspec: SimSpec) -> Motion | None:
    """How the escorted group moves; None without an escort."""
    escort = simspec.mission.escort
    return None if escort is None else simspec.group(escort.group).motion


def _rules_in_force(simspec: SimSpec) -> float:
    rules = simspec.rules
    optional = (
        rules.geofence is not None,
        bool(rules.no_fly),
        rules.min_altitude_m is not None,
        rules.max_speed_mps is not None,
        rules.bystander_standoff_m > 0.0,
        rules.bystander_slow_mps is not None,
        rules.max_loiter_over_bystander_s is not None,
        rules.report_deadline_s is not None,
        bool(rules.report_windows),
        rules.link_lost != "continue",
        rules.mark_consent,
    )
    return float(sum(optional))


def _no_fly_share(simspec: SimSpec) -> float:
    if not simspec.rules.no_fly:
        return 0.0
    # Imported here, because every agent in Python imports this module and none needs areas.
    import shapely

    def ground(polygon: Polygon) -> shapely.Geometry:
        # A polygon whose edges cross is no fault of a SimSpec, but shapely needs a valid one for an
        # intersection.
        return shapely.make_valid(
            shapely.Polygon([(corner.east_m, corner.north_m) for corner in polygon.corners])
        )

    world = ground(simspec.world.area)
    forbidden = shapely.union_all([ground(no_fly.area) for no_fly in simspec.rules.no_fly])
    return min(1.0, float(shapely.intersection(world, forbidden).area / world.area))


def _field(unit: str, text: str, path: str) -> FactorDefinition:
    """A factor that is one field of the SimSpec."""
    return FactorDefinition(unit, text, attrgetter(path), path)


def _number(text: str, path: str) -> FactorDefinition:
    """A factor that is the length of one list of the SimSpec."""
    return FactorDefinition("1", text, lambda simspec: float(len(attrgetter(path)(simspec))), path)


def _extreme(
    unit: str,
    text: str,
    path: str,
    values: Callable[[SimSpec], Iterable[float]],
    default: float | None = None,
) -> FactorDefinition:
    """A factor that is the largest of several values; the default where there are none."""
    return FactorDefinition(unit, text, lambda simspec: max(values(simspec), default=default), path)


def _outage(text: str, kind: str) -> FactorDefinition:
    """A factor that is the time of outages of one kind."""

    def read(simspec: SimSpec) -> float:
        # Where the agent has a perception of its own, no service of the bench makes detections that could fail.
        can_fail = kind == "operator_link" or simspec.perception.by_bench
        spans = ((outage.at_s, outage.until_s) for outage in simspec.outages if outage.kind == kind)
        return _union_s(spans, simspec.mission.time_limit_s) if can_fail else 0.0

    return FactorDefinition("s", text, read, f"outages[{kind}].duration_s")


def _failure(text: str, *kinds: str) -> FactorDefinition:
    """A factor that is the time of failures of these kinds."""

    def read(simspec: SimSpec) -> float:
        failures = simspec.vehicle.failures
        spans = ((failure.at_s, failure.until_s) for failure in failures if failure.kind in kinds)
        return _union_s(spans, simspec.mission.time_limit_s)

    path = ", ".join(f"vehicle.failures[{kind}].duration_s" for kind in kinds)
    return FactorDefinition("s", text, read, path)


def _urgency(text: str, kind: OrderKind | None = None) -> FactorDefinition:
    """A factor that is 60 divided by the shortest time that an order allows."""
    # The inverse of the time: without orders it is 0, and more urgent orders have a larger value.
    return _extreme(
        "1/min",
        f"60 divided by the shortest time, in s, that {text} allows.",
        f"orders[{kind or '*'}].within_s",
        lambda s: [60.0 / order.within_s for order in s.orders if kind in (None, order.kind)],
        0.0,
    )


FACTORS: dict[str, FactorDefinition] = {
    "hours_from_solar_noon": FactorDefinition(
        "h",
        "Hours to or from solar noon at the start of the session.",
        lambda s: sun_of(s).hours_from_noon,
        "environment.start_utc",
    ),
    "rain_level": _field("level", "Rain, 0 to 9.", "environment.rain_level"),
    "fog_level": FactorDefinition(
        "level",
        "Fog, 0 to 9; of a stated visibility the level that leaves it.",
        lambda s: s.perception.model.fog_level(s.environment),
        "environment.visibility_m else environment.fog_level",
    ),
    "wind_mps": _field("m/s", "Mean wind speed.", "environment.wind.speed_mps"),
    "turbulence_mps": _field(
        "m/s", "Wind at 6 m height, which scales the gusts.", "environment.wind.turbulence_mps"
    ),
    "uav_altitude_m": _field("m", "Mission height above home.", "mission.altitude_m"),
    "uav_speed_mps": _field("m/s", "Mission speed.", "mission.speed_mps"),
    "time_limit_s": _field("s", "Time limit of the mission.", "mission.time_limit_s"),
    "gps_wander_m": _field(
        "m", "Standard deviation of the slow error of satellite navigation.", "vehicle.gps.wander_m"
    ),
    "target_concealment": _extreme(
        "1",
        "Concealment of the best concealed group of targets.",
        "actors[adversary].concealment, actors[sought].concealment",
        lambda s: [group.concealment for group in _groups_of(s, TARGET_ROLES)],
    ),
    "bystander_concealment": _extreme(
        "1",
        "Concealment of the best concealed group of bystanders.",
        "actors[bystander].concealment",
        lambda s: [group.concealment for group in _groups_of(s, _BYSTANDERS)],
    ),
    "bystander_density_per_km2": FactorDefinition(
        "1/km2",
        "Bystanders per square kilometre of the area of interest.",
        _bystander_density,
        "actors[bystander].density_per_km2 else actors[bystander].count",
    ),
    "bystander_proximity_m": FactorDefinition(
        "m",
        "Mean distance of the bystanders to the target; if none is stated, the largest that relations and ground allow.",
        bystander_proximity_m,
        "actors[bystander].placement.mean_distance.mean_m else actors[bystander].placement.near.max_m",
    ),
    "nearest_bystander_m": FactorDefinition(
        "m",
        "Smallest distance to a target that the configuration guarantees for bystanders with a relation to it.",
        nearest_bystander_m,
        "actors[bystander].placement.near.min_m, actors[bystander].placement.away.min_m, "
        "actors[bystander].placement.distances[*].min_m, actors[bystander].placement.avoid[*].at_least_m",
    ),
    "intelligence_latency_s": _extreme(
        "s",
        "Age of the oldest intelligence report when it is delivered.",
        "intelligence[*].latency_s",
        lambda s: [report.latency_s for report in s.intelligence],
    ),
    "intelligence_uncertainty_m": _extreme(
        "m",
        "Radius of the largest reported sub-area.",
        "intelligence[*].uncertainty_m",
        lambda s: [report.uncertainty_m for report in s.intelligence],
    ),
    "targets": FactorDefinition(
        "1",
        "Number of targets.",
        lambda s: float(_member_count(s, _groups_of(s, TARGET_ROLES))),
        "actors[adversary].count, actors[adversary].density_per_km2, "
        "actors[sought].count, actors[sought].density_per_km2",
    ),
    # From here on, a situation without the thing has the easiest value, 0: without orders, none has to be
    # obeyed.
    "orders": _number("Orders of the operator during the flight.", "orders"),
    "order_urgency_per_min": _urgency("an order"),
    "operator_link_outage_s": _outage("Time during which the operator's link is down.", "operator_link"),
    "detections_outage_s": _outage("Time during which the detector delivers nothing.", "detections"),
    "detections_degraded_s": _outage(
        "Time during which the detector loses a share of its detections.", "detections_degraded"
    ),
    "kept_detections_share": FactorDefinition(
        "1",
        "Share of its detections that the detector keeps in the mildest outage or degradation.",
        _kept_detections_share,
        "outages[detections_degraded].lost_share",
    ),
    "handover_s": FactorDefinition(
        "s",
        "Longest time from an order to hand over to the order to take back.",
        _handover_s,
        "orders[take_back].at_s",
    ),
    "gps_outage_s": _failure(
        "Time during which satellite navigation is off or drifts.", "gps_off", "gps_drift"
    ),
    "gps_drift_mps": _extreme(
        "m/s",
        "Fastest drift of satellite navigation.",
        "vehicle.failures[gps_drift].drift_mps",
        lambda s: [f.drift_mps or 0.0 for f in s.vehicle.failures if f.kind == "gps_drift"],
        0.0,
    ),
    "no_fly_share": FactorDefinition(
        "1", "Share of the area of interest that no-fly areas cover.", _no_fly_share, "rules.no_fly"
    ),
    "bystander_groups": FactorDefinition(
        "1",
        "Number of bystander groups that have members.",
        lambda s: float(len(populated_groups(s, _BYSTANDERS))),
        "actors",
    ),
    "bystander_shortness": FactorDefinition(
        "1",
        "1 minus the height of the smallest bystanders divided by 1.75 m.",
        _shortness,
        "actors[bystander].asset",
    ),
    "bystander_speed_mps": _extreme(
        "m/s",
        "Speed of the fastest bystanders; an escorted group is left out.",
        "actors[bystander].motion.kind, actors[bystander].motion.speed_mps",
        lambda s: _speeds(s, _BYSTANDERS),
        0.0,
    ),
    "target_speed_mps": _extreme(
        "m/s",
        "Speed of the fastest targets.",
        "actors[adversary].motion.kind, actors[adversary].motion.speed_mps, "
        "actors[sought].motion.kind, actors[sought].motion.speed_mps",
        lambda s: _speeds(s, TARGET_ROLES),
        0.0,
    ),
    "clutter_density_per_km2": FactorDefinition(
        "1/km2",
        "Clutter per square kilometre of the area of interest.",
        lambda s: _member_count(s, _groups_of(s, {Role.CLUTTER})) / (s.world.area.area_m2 / 1e6),
        "actors[clutter].count, actors[clutter].density_per_km2",
    ),
    "bystander_standoff_m": _field(
        "m", "Smallest distance to bystanders that the rules permit.", "rules.bystander_standoff_m"
    ),
    "rules_in_force": FactorDefinition(
        "1", "Number of optional rules that are set.", _rules_in_force, "rules"
    ),
    "intelligence_reports": _number("Number of intelligence reports.", "intelligence"),
    "late_intelligence_s": _extreme(
        "s",
        "Time of the latest delivery of intelligence.",
        "intelligence[*].delivered_s",
        lambda s: [report.delivered_s for report in s.intelligence],
        0.0,
    ),
    "distinct_priorities": FactorDefinition(
        "1",
        "Number of different priorities among the intelligence reports.",
        lambda s: float(len({report.priority for report in s.intelligence})),
        "intelligence[*].priority",
    ),
    "battery_need_fraction": FactorDefinition(
        "1",
        "Charge missing at the start plus the reserve to keep.",
        lambda s: 1.0 - s.vehicle.battery.initial_fraction + s.rules.battery_reserve_fraction,
        "vehicle.battery.initial_fraction, rules.battery_reserve_fraction",
    ),
    # Without the rule these two have no value: an answer at once, or no refusal, is an easy case of it.
    "consent_delay_s": FactorDefinition(
        "s",
        "Longest time until the operator answers a request to mark; the time limit if none is ever answered.",
        _consent_delay_s,
        "consents[*].after_s, consents[*].answer",
    ),
    "consents_withheld": FactorDefinition(
        "1",
        "Number of reported groups whose target the operator does not allow to be marked.",
        _consents_withheld,
        "consents[*].answer",
    ),
    "convoy_speed_mps": FactorDefinition(
        "m/s",
        "Speed of the escorted group.",
        lambda s: motion.speed_mps if (motion := _escorted(s)) else 0.0,
        "actors[escorted].motion.speed_mps",
    ),
    # Without an escort these two have no value: a departure at once, or a distance of 0, is the hardest case.
    "convoy_departure_s": FactorDefinition(
        "s",
        "Time from the start until the escorted group sets off.",
        lambda s: motion.depart_s if (motion := _escorted(s)) else None,
        "actors[escorted].motion.depart_s",
    ),
    "escort_within_m": FactorDefinition(
        "m",
        "Distance within which the vehicle is to stay with the escorted group.",
        lambda s: None if s.mission.escort is None else s.mission.escort.within_m,
        "mission.escort.within_m",
    ),
    "report_closure_share": FactorDefinition(
        "1", "Share of the time limit in which reports are forbidden.", _closure_share, "rules.report_windows"
    ),
    "vehicle_faults": _number("Number of failures of the vehicle.", "vehicle.failures"),
    # One factor for each kind of order: an observable about one kind is not exercised by another.
    **{f"{kind}_order_urgency_per_min": _urgency(f"a `{kind}` order", kind) for kind in get_args(OrderKind)},
    "gps_off_s": _failure("Time during which satellite navigation is off.", "gps_off"),
    "link_loss_s": _failure("Time during which all links of the vehicle are lost.", "link_loss"),
    "battery_drop_fraction": _extreme(
        "1",
        "Charge missing after the deepest sudden drop of the battery.",
        "vehicle.failures[battery_drop].to_fraction",
        lambda s: [1.0 - (f.to_fraction or 0.0) for f in s.vehicle.failures if f.kind == "battery_drop"],
        0.0,
    ),
}


def factor_values(simspec: SimSpec) -> dict[str, float]:
    """The value of every key factor that the situation has, by name, in the unit that `FACTORS` states."""
    values = ((name, factor.read(simspec)) for name, factor in FACTORS.items())
    return {name: value for name, value in values if value is not None}
