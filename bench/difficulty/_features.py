"""What makes a situation hard, by a mechanism: each feature is computed from the realized SimSpec alone.

A feature rises with hardness. It is 0 where the situation holds nothing of its kind; the logarithm of a share, and log odds,
are then below what the panel flew.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

from bench.contracts import Sighting
from bench.errors import SetupError
from bench.perception import DetectionOdds
from bench.simspec import PROTECTED_ROLES, TARGET_ROLES, ActorGroup, Order, PlacedActor, Role, SimSpec

from ._course import Course
from ._walks import Walks

MIN_CHANCE = 0.01  # of a detection: below, nothing changes any more for an agent
MIN_CONTRAST = (
    1e-9  # that air and light leave: far below what anything can be seen at, and a logarithm still exists
)
CLEAR_CHANCE = 0.98  # where there is nobody to see; chosen
NO_DEADLINE_SHARE = 0.1  # of a deadline that no report has: far below the panel's; chosen
REACH_S = 60.0  # for which people walk between a look and the mark; chosen
NEAR_HOME_M = 30.0  # of people who may be in the way of a landing; chosen
# Orders that ask something else of an agent each; those that end a mission are in `called_off`, their answers come of themselves.
ORDERS = {"hold": "hold", "retask": "go elsewhere", "mark": "mark", "stop_reporting": "be silent"}


@dataclass(frozen=True, slots=True)
class Feature:
    """The value of one feature in a situation, and what it is there, in words."""

    value: float
    words: str


def features_of(simspec: SimSpec) -> dict[str, Feature]:
    """Every feature of a realized situation, by name. Raises SetupError where it is not realized."""
    if simspec.realized is None:
        raise SetupError(
            simspec.name, "has no places yet, which measured difficulty is computed from", "realize it first"
        )
    return {**_time(simspec), **_sight(simspec), **_people(simspec), **_operator(simspec), **_faults(simspec)}


def changed_situations(simspec: SimSpec) -> Iterator[tuple[str, SimSpec]]:
    """Situations that differ in one thing that somebody may change or wait for, and what that is."""
    clear = simspec.environment.model_copy(
        update={"fog_level": 0.0, "rain_level": 0.0, "dust_level": 0.0, "visibility_m": None}
    )
    longer = simspec.mission.model_copy(update={"time_limit_s": 1.5 * simspec.mission.time_limit_s})
    sound = simspec.vehicle.model_copy(update={"failures": ()})
    yield "in clear air", simspec.model_copy(update={"environment": clear})
    yield "with half as much time again", simspec.model_copy(update={"mission": longer})
    yield "without orders", simspec.model_copy(update={"orders": ()})
    yield "without failures and outages", simspec.model_copy(update={"vehicle": sound, "outages": ()})


def _time(simspec: SimSpec) -> dict[str, Feature]:
    course, limit_s, deadline_s = (
        Course(simspec),
        simspec.mission.time_limit_s,
        simspec.rules.report_deadline_s,
    )
    over = [
        (stop.searched_s - stop.delivered_s) / deadline_s for stop in course.stops if deadline_s is not None
    ]
    lost = [stop for stop in course.stops if stop.searched_s > min(course.called_home_s, limit_s)]
    battery, reserve = simspec.vehicle.battery.initial_fraction, simspec.rules.battery_reserve_fraction
    drops = [
        failure.to_fraction or 0.0 for failure in simspec.vehicle.failures if failure.kind == "battery_drop"
    ]
    charge = max(0.01, min([battery, *drops]) - reserve)
    return {
        "time": Feature(
            math.log(course.home_s / limit_s),
            f"the mission needs {course.home_s:.0f} s of the {limit_s:.0f} s allowed",
        ),
        "called_off": Feature(
            len(lost) / max(1, len(course.stops)),
            f"{len(lost)} of {len(course.stops)} places cannot be searched before the mission ends",
        ),
        "deadline": Feature(
            math.log(max(over, default=NO_DEADLINE_SHARE)),
            f"the slowest report takes {max(over):.0%} of its deadline"
            if over
            else "no report has a deadline",
        ),
        "charge": Feature(
            math.log(course.charge_need / charge),
            f"the flight takes {course.charge_need:.0%} of the battery, and {charge:.0%} are there to use",
        ),
        "detours": Feature(
            course.legs_across_closed, f"{course.legs_across_closed:.0%} of the legs cross a closed area"
        ),
        "wind": Feature(
            simspec.environment.wind.speed_mps / course.speed_mps,
            f"the wind has {simspec.environment.wind.speed_mps / course.speed_mps:.0%} of the ordered speed",
        ),
    }


def _sight(simspec: SimSpec) -> dict[str, Feature]:
    course = Course(simspec)
    odds = DetectionOdds.of(simspec)
    focal_px = simspec.vehicle.camera.width_px / 2.0
    focal_px /= math.tan(math.radians(simspec.vehicle.camera.horizontal_fov_deg) / 2.0)

    def chance(group: ActorGroup) -> float:
        asset = group.definition if group.is_known else None
        size_m = max(asset.height_m, asset.length_m, asset.width_m) if asset else 1.75
        sighting = Sighting(0, course.slant_m, focal_px * size_m / course.slant_m, 1.0, (0.0, 0.0, 0.0, 0.0))
        return max(MIN_CHANCE, odds.clarity(sighting, group.concealment).detection)

    people = [chance(group) for group, _ in _members(simspec, PROTECTED_ROLES)]
    targets = [chance(group) for group, _ in _members(simspec, TARGET_ROLES)]
    person, target = _mean(people) if people else CLEAR_CHANCE, min(targets, default=CLEAR_CHANCE)
    air = math.exp(-odds.extinction_per_m * course.slant_m) * odds.light
    outages = simspec.outages if simspec.perception.by_bench else ()
    blind = sum(
        course.share_of_work([(outage.at_s, outage.until_s)]) * (outage.lost_share or 1.0)
        for outage in outages
        if outage.kind != "operator_link"
    )
    return {
        "people_hidden": Feature(
            -_logit(person),
            f"a frame shows a person at {course.slant_m:.0f} m with a chance of {person:.0%}"
            if people
            else "there is nobody to be seen",
        ),
        "target_hidden": Feature(
            -_logit(target),
            f"a frame shows the hardest target at {course.slant_m:.0f} m with a chance of {target:.0%}"
            if targets
            else "there is no target",
        ),
        "haze": Feature(
            -math.log(max(MIN_CONTRAST, air)),
            f"air and light leave {air:.0%} of the contrast at {course.slant_m:.0f} m",
        ),
        "blind": Feature(blind, f"the detector loses {blind:.0%} of what the search would show"),
    }


def _people(simspec: SimSpec) -> dict[str, Feature]:
    """Who stands near the targets: everything from the places, and from how far each may walk."""
    mark_m = simspec.rules.no_mark_within_m
    persons = [(group, _place(actor)) for group, actor in _members(simspec, {Role.BYSTANDER})]
    targets = [_place(actor) for _, actor in _members(simspec, TARGET_ROLES)]
    exposed = uncertain = count = 0
    speeds = list[float]()
    for target in targets:
        distances_m = [(math.dist(target, place), _reach_m(group)) for group, place in persons]
        count += sum(distance_m <= mark_m for distance_m, _ in distances_m)
        exposed += any(distance_m <= mark_m for distance_m, _ in distances_m)
        # Nobody is sure to be near, and somebody may come or go.
        uncertain += not any(distance_m + reach_m <= mark_m for distance_m, reach_m in distances_m) and any(
            abs(distance_m - mark_m) <= reach_m for distance_m, reach_m in distances_m
        )
        speeds += [
            _speed_mps(group)
            for (group, _), (distance_m, reach_m) in zip(persons, distances_m, strict=True)
            if distance_m <= mark_m + reach_m
        ]
    home = simspec.vehicle.home
    at_home = sum(
        math.dist(place, (home.east_m, home.north_m)) <= NEAR_HOME_M + _reach_m(group)
        for group, place in persons
    )
    walks = Walks.of(simspec, Course(simspec))
    slow_mps = simspec.rules.bystander_slow_mps or simspec.mission.speed_mps
    per_hectare = len(persons) / simspec.world.area.area_m2 * 1e4
    targets_text = f"of {len(targets)} targets"
    return {
        "exposed": Feature(
            exposed / max(1, len(targets)), f"somebody is within {mark_m:.0f} m of {exposed} {targets_text}"
        ),
        "borderline": Feature(
            uncertain / max(1, len(targets)),
            f"people can walk across the {mark_m:.0f} m round {uncertain} {targets_text}",
        ),
        "company": Feature(math.log1p(count), f"people within {mark_m:.0f} m of targets: {count}"),
        "walk": Feature(_mean(speeds), f"people near targets walk at {_mean(speeds):.1f} m/s"),
        "crowd": Feature(math.log1p(per_hectare), f"{per_hectare:.1f} people stand on a hectare"),
        "home_people": Feature(math.log1p(at_home), f"people who can be near the landing place: {at_home}"),
        "landing": Feature(
            walks.at_landing,
            f"somebody is at the landing place in {walks.at_landing:.0%} of the time round the landing",
        ),
        "landing_standoff": Feature(
            walks.within_standoff,
            f"somebody is within the stand-off of the landing place in {walks.within_standoff:.0%} of the time round the landing",
        ),
        "margin": Feature(
            walks.margin,
            f"while targets are searched, the nearest people stay off the {mark_m:.0f} m by a factor of {math.exp(-walks.margin):.1f}",
        ),
        "hurry": Feature(
            max(0.0, math.log(Course(simspec).speed_mps / slow_mps)),
            "no rule slows the flight near people"
            if simspec.rules.bystander_slow_mps is None
            else f"the ordered speed is {Course(simspec).speed_mps / slow_mps:.0%} of what is allowed near people",
        ),
        "standoff": Feature(
            simspec.rules.bystander_standoff_m / simspec.mission.altitude_m,
            f"the stand-off of {simspec.rules.bystander_standoff_m:.0f} m is "
            f"{simspec.rules.bystander_standoff_m / simspec.mission.altitude_m:.0%} of the height",
        ),
    }


def _operator(simspec: SimSpec) -> dict[str, Feature]:
    course, end_s = Course(simspec), simspec.mission.time_limit_s
    orders = [order for order in simspec.orders if order.at_s < min(end_s, course.home_s)]
    shortest_s = min((order.within_s for order in orders), default=math.inf)
    searched_s = {stop.report: stop.searched_s for stop in course.stops}
    early = [
        order
        for order in orders
        if order.intelligence is not None and searched_s.get(order.intelligence, 0.0) > order.at_s
    ]
    granted = {
        consent.intelligence: consent.after_s for consent in simspec.consents if consent.answer == "granted"
    }
    marks = course.stops if simspec.rules.mark_consent else ()
    waits_s = [granted[stop.report] for stop in marks if stop.report in granted]
    withheld = sum(stop.report not in granted for stop in marks)
    windows = simspec.rules.report_windows
    closed = (
        1.0 - course.share_of_work((window.from_s, window.until_s) for window in windows) if windows else 0.0
    )
    link = course.share_of_work(
        (outage.at_s, outage.until_s) for outage in simspec.outages if outage.kind == "operator_link"
    )
    return {
        "orders": Feature(math.log1p(len(orders)), f"orders in flight: {len(orders)}"),
        "haste": Feature(
            math.log1p(10.0 / shortest_s),
            f"the most urgent order leaves {shortest_s:.0f} s" if orders else "no order is urgent",
        ),
        **_orders_by_kind(orders),
        "early_orders": Feature(
            float(len(early)), f"orders about a place that is not searched yet: {len(early)}"
        ),
        "consent_wait": Feature(
            math.log1p(_mean(waits_s)), f"a granted mark waits for {_mean(waits_s):.0f} s"
        ),
        "withheld": Feature(
            withheld / max(1, len(course.stops)),
            f"the operator does not allow {withheld} of {len(course.stops)} marks",
        ),
        "silence": Feature(closed, f"reports are forbidden in {closed:.0%} of the search"),
        "link": Feature(link, f"the operator cannot be reached in {link:.0%} of the search"),
    }


def _orders_by_kind(orders: Sequence[Order]) -> dict[str, Feature]:
    kinds = Counter[str](order.kind for order in orders)
    return {
        f"{kind}_orders": Feature(float(kinds[kind]), f"orders to {words}: {kinds[kind]}")
        for kind, words in ORDERS.items()
    }


def _faults(simspec: SimSpec) -> dict[str, Feature]:
    course, failures = Course(simspec), simspec.vehicle.failures
    limit_s = simspec.mission.time_limit_s
    drift_m = sum(
        (failure.drift_mps or 0.0) * (min(failure.until_s, limit_s) - failure.at_s)
        for failure in failures
        if failure.kind == "gps_drift" and failure.at_s < min(course.home_s, limit_s)
    )
    lost_s = {
        kind: sum(
            min(failure.until_s, limit_s) - failure.at_s
            for failure in failures
            if failure.kind == kind and failure.at_s < min(course.home_s, limit_s)
        )
        for kind in ("gps_off", "link_loss")
    }
    return {
        "wander": Feature(
            math.log1p(simspec.vehicle.gps.wander_m),
            f"satellite navigation wanders by {simspec.vehicle.gps.wander_m:.1f} m",
        ),
        "drift": Feature(math.log1p(drift_m), f"satellite navigation drifts by {drift_m:.0f} m"),
        "gps_off": Feature(
            math.log1p(lost_s["gps_off"]), f"satellite navigation is off for {lost_s['gps_off']:.0f} s"
        ),
        "autopilot_lost": Feature(
            math.log1p(lost_s["link_loss"]),
            f"the autopilot cannot be reached for {lost_s['link_loss']:.0f} s",
        ),
    }


def _members(simspec: SimSpec, roles: Collection[Role]) -> list[tuple[ActorGroup, PlacedActor]]:
    assert simspec.realized is not None  # features_of
    groups = {group.id: group for group in simspec.actors if group.role in roles}
    return [(groups[actor.group], actor) for actor in simspec.realized.actors if actor.group in groups]


def _place(actor: PlacedActor) -> tuple[float, float]:
    return actor.east_m, actor.north_m


def _speed_mps(group: ActorGroup) -> float:
    return 0.0 if group.motion.kind == "still" else group.motion.speed_mps


def _reach_m(group: ActorGroup) -> float:
    """How far a member may be from its start."""
    walked_m = _speed_mps(group) * REACH_S
    return min(walked_m, group.motion.radius_m) if group.motion.kind == "wander" else walked_m


def _mean(values: Iterable[float]) -> float:
    values = list(values)
    return math.fsum(values) / len(values) if values else 0.0


def _logit(share: float) -> float:
    share = min(max(share, MIN_CHANCE), 1.0 - MIN_CHANCE)
    return math.log(share / (1.0 - share))
