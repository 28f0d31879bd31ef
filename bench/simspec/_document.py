"""The SimSpec: everything that decides what happens in one session, as a document.

A *base* SimSpec says what is wanted (groups of actors and the relations between them); a *realized* one carries
beside that intent the exact place of every actor, in `realized`. Difficulty is read from the intent, the session
flies the realization, and both stand in one file.

Frames: positions are east/north metres in the local tangent plane at `world.origin` (ROS REP 103 ENU); headings
are degrees clockwise from true north. Degrees and per-mille units exist only in documents; the code works in SI.
"""

from __future__ import annotations

import datetime as dt
import itertools
import math
from enum import StrEnum
from pathlib import PurePosixPath
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from bench.documents import Document

from ._agreement import refuse, rules_disagreements, situation_disagreements

Identifier = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,62}$")]
RosName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,62}$")]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Metres = Annotated[float, Field(ge=-1e5, le=1e5)]


class Point(Document):
    """A place on the ground in the world's local tangent plane."""

    east_m: Metres
    north_m: Metres


class Polygon(Document):
    """A simple polygon on the ground, by its corners in either direction; closed by itself."""

    corners: Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)]

    @property
    def area_m2(self) -> float:
        """Enclosed area in square metres (shoelace formula)."""
        corners = self.corners
        twice = sum(a.east_m * b.north_m - b.east_m * a.north_m for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
        return abs(twice) / 2.0

    def contains(self, point: Point) -> bool:
        """Whether `point` lies inside (even-odd rule); points on the edge may count either way."""
        inside = False
        for a, b in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (a.north_m > point.north_m) != (b.north_m > point.north_m):
                share = (point.north_m - a.north_m) / (b.north_m - a.north_m)
                inside ^= point.east_m < a.east_m + share * (b.east_m - a.east_m)
        return inside

    @model_validator(mode="after")
    def _encloses_something(self) -> Self:
        if self.area_m2 < 1.0:
            raise ValueError("the polygon encloses less than one square metre; give at least three corners not in a line")
        return self


class Origin(Document):
    """Where the local tangent plane touches the earth (WGS84)."""

    latitude_deg: Annotated[float, Field(ge=-89.0, le=89.0)] = 47.3977
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 8.5456
    altitude_m: Annotated[float, Field(ge=-400.0, le=5000.0, description="Ground height above mean sea level.")] = 488.0


class Road(Document):
    """A strip of ground along a line; it ends flat at both ends."""

    id: Identifier
    points: Annotated[tuple[Point, ...], Field(min_length=2, max_length=64, description="The middle of the road, in order.")]
    width_m: Annotated[float, Field(gt=0.0, le=200.0)] = 6.0

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Self:
        for number, (a, b) in enumerate(itertools.pairwise(self.points), start=1):
            if math.hypot(b.east_m - a.east_m, b.north_m - a.north_m) < 0.1:
                raise ValueError(f"points {number} and {number + 1} of the road are less than 0.1 m apart; drop one")
        return self


class World(Document):
    """The ground that everything stands on."""

    origin: Origin = Origin()
    scene: Annotated[Identifier, Field(description="Scene backend, by its name in the entry-point group rebar.scenes.")] = "plain"
    area: Annotated[Polygon, Field(description="The area of interest; densities count over it.")]
    roads: Annotated[tuple[Road, ...], Field(max_length=64, description="Roads that groups may be placed along.")] = ()


class Wind(Document):
    """Mean wind and turbulence near the ground."""

    speed_mps: Annotated[float, Field(ge=0.0, le=20.0, description="Mean wind speed.")] = 0.0
    from_deg: Annotated[float, Field(ge=0.0, lt=360.0, description="Direction the wind comes from, clockwise from north.")] = 0.0
    turbulence_mps: Annotated[
        float, Field(ge=0.0, le=20.0, description="Wind at 6 m that scales the Dryden gusts (MIL-F-8785C W20); 0 is calm air.")
    ] = 0.0


Level = Annotated[float, Field(ge=0.0, le=9.0)]


def _as_utc(moment: object) -> object:
    """YAML reads a timestamp as a datetime of its own; one without a zone is UTC, as the field's name says."""
    if isinstance(moment, dt.datetime) and moment.tzinfo is None:
        return moment.replace(tzinfo=dt.UTC)
    return moment


FIRST_YEAR, YEAR_AFTER_LAST = 1981, 2100


class Environment(Document):
    """Light and weather. Levels are the paper's: 0 none, 9 the worst."""

    start_utc: Annotated[
        dt.datetime, BeforeValidator(_as_utc), Field(description="Moment at which simulated time is zero; decides the sun.")
    ] = dt.datetime(2026, 6, 21, 11, 30, tzinfo=dt.UTC)
    rain_level: Level = 0.0
    fog_level: Level = 0.0
    wind: Wind = Wind()

    @model_validator(mode="after")
    def _moment_has_a_zone(self) -> Self:
        if self.start_utc.tzinfo is None:
            raise ValueError("start_utc needs a zone, for example 2026-06-21T11:30:00Z")
        if not FIRST_YEAR <= self.start_utc.year < YEAR_AFTER_LAST:
            raise ValueError(
                f"start_utc must lie from {FIRST_YEAR} to {YEAR_AFTER_LAST - 1}: satellite navigation counts from there"
            )
        return self


class Gps(Document):
    """Satellite navigation error: a slow second-order Gauss-Markov wander plus white noise per fix."""

    wander_m: Annotated[float, Field(ge=0.0, le=50.0, description="Standard deviation of the slow horizontal error.")] = 0.3
    wander_time_s: Annotated[float, Field(gt=0.0, le=3600.0, description="Correlation time of the slow error.")] = 60.0
    noise_m: Annotated[float, Field(ge=0.0, le=20.0, description="White horizontal noise of one fix; vertical is 1.5 times.")] = (
        0.05
    )


class Camera(Document):
    """One camera, on a mount that keeps roll and pitch level when `stabilized`."""

    name: RosName = "front"
    width_px: Annotated[int, Field(ge=16, le=8192)] = 1280
    height_px: Annotated[int, Field(ge=16, le=8192)] = 720
    horizontal_fov_deg: Annotated[float, Field(gt=5.0, lt=150.0)] = 70.0
    tilt_deg: Annotated[float, Field(ge=0.0, le=90.0, description="Optical axis below the horizon; 90 looks straight down.")] = (
        60.0
    )
    stabilized: bool = True
    rate_hz: Annotated[float, Field(gt=0.0, le=50.0)] = 5.0
    gimbal: Annotated[
        bool, Field(description="The mount can be turned over MAVLink (gimbal protocol v2); tilt_deg is where it starts.")
    ] = False
    mavlink: Annotated[bool, Field(description="The camera answers on the vehicle's links, as component 100.")] = False

    @model_validator(mode="after")
    def _gimbal_is_level(self) -> Self:
        if self.gimbal and not self.stabilized:
            raise ValueError("a gimbal keeps the camera level; leave stabilized true or gimbal false")
        return self


class Battery(Document):
    capacity_wh: Annotated[float, Field(gt=0.0, le=2000.0)] = 80.0
    initial_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class Home(Point):
    """Where the vehicle stands at the start."""

    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 0.0


_FAILURE_FIELDS = {
    "gps_off": {"duration_s"},
    "gps_drift": {"duration_s", "drift_mps", "towards_deg"},
    "battery_drop": {"to_fraction"},
    "motor_off": {"duration_s", "instance"},
    "link_loss": {"duration_s", "link"},
}


class Failure(Document):
    """Something of the vehicle that breaks at `at_s`, and works again after `duration_s` when that is given.

    `gps_off`: no more fixes. `gps_drift`: fixes walk away with `drift_mps` towards `towards_deg` and jump back at the end.
    `battery_drop`: charge falls to `to_fraction` at once. `motor_off`: rotor `instance` stops. `link_loss`: nothing passes
    in either direction of the MAVLink link of that name, or of all links.
    """

    at_s: Annotated[float, Field(ge=0.0, le=7200.0, description="Simulated time.")]
    kind: Literal["gps_off", "gps_drift", "battery_drop", "motor_off", "link_loss"]
    duration_s: Annotated[float | None, Field(gt=0.0, le=7200.0, description="To the end of the session when absent.")] = None
    instance: Annotated[int | None, Field(ge=1, le=16, description="Rotor, counted from 1 as the autopilot counts.")] = None
    link: Annotated[Identifier | None, Field(description="Link, by its name in the agent's manifest; all when absent.")] = None
    to_fraction: Annotated[float | None, Field(ge=0.0, le=1.0, description="Charge that is left.")] = None
    drift_mps: Annotated[float | None, Field(gt=0.0, le=50.0)] = None
    towards_deg: Annotated[float | None, Field(ge=0.0, lt=360.0, description="Clockwise from north; north when absent.")] = None

    @model_validator(mode="after")
    def _fields_fit_the_kind(self) -> Self:
        given = {name for name in self.model_fields_set if getattr(self, name) is not None} - {"at_s", "kind"}
        if wrong := sorted(given - _FAILURE_FIELDS[self.kind]):
            raise ValueError(f"{self.kind} has no {', '.join(wrong)}; it has {', '.join(sorted(_FAILURE_FIELDS[self.kind]))}")
        needed = {"gps_drift": "drift_mps", "battery_drop": "to_fraction", "motor_off": "instance"}.get(self.kind)
        if needed and needed not in given:
            raise ValueError(f"{self.kind} needs {needed}")
        return self


class VehicleSpec(Document):
    """The aircraft, the autopilot it carries, and its sensors."""

    model: Annotated[Identifier, Field(description="Vehicle, by its name in the entry-point group rebar.vehicles.")] = "x500"
    autopilot: Annotated[Literal["px4", "ardupilot"], Field(description="Personality of the flight controller.")] = "px4"
    parameters: Annotated[
        dict[str, float], Field(description="Autopilot parameters set before start, by the autopilot's own names.")
    ] = {}
    name: Annotated[RosName, Field(description="Namespace of the vehicle's topics.")] = "vehicle_1"
    home: Home = Home(east_m=0.0, north_m=0.0)
    gps: Gps = Gps()
    camera: Camera = Camera()
    battery: Battery = Battery()
    ground_truth: Annotated[
        bool, Field(description="Whether the vehicle tells its true motion (HIL_STATE_QUATERNION) to whoever asks for it.")
    ] = False
    failures: Annotated[tuple[Failure, ...], Field(max_length=100, description="What breaks, and when.")] = ()


class Role(StrEnum):
    """What an actor is to the mission, whatever it looks like."""

    ADVERSARY = "adversary"
    BYSTANDER = "bystander"
    CLUTTER = "clutter"


class Near(Document):
    """Keep between `min_m` and `max_m` from some member of another group."""

    of: Identifier
    min_m: NotNegative = 0.0
    max_m: Positive

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        return self


class MeanDistance(Document):
    """The mean distance of the group's members to the first member of another group (the paper's proximity)."""

    of: Identifier
    mean_m: Positive
    tolerance: Annotated[float, Field(gt=0.0, le=0.5, description="Allowed relative deviation of the mean.")] = 0.01


class Distance(Document):
    """Keep between `min_m` and `max_m` from every member, or from some member, of a group or of all groups of a role."""

    of: Annotated[Identifier, Field(description="A group, or a role where no group is called so; never the group itself.")]
    whom: Literal["every", "some"] = "every"
    min_m: NotNegative = 0.0
    max_m: Annotated[Positive | None, Field(description="No upper bound when absent.")] = None

    @model_validator(mode="after")
    def _leaves_room(self) -> Self:
        if self.max_m is not None and self.max_m <= self.min_m:
            raise ValueError(f"max_m {self.max_m} must exceed min_m {self.min_m}")
        if self.max_m is None and self.min_m == 0.0:
            raise ValueError("give min_m, max_m or both; any distance keeps this one")
        return self


class Seen(Document):
    """The first member of a group, or a point: one of the two."""

    of: Annotated[Identifier | None, Field(description="A group.")] = None
    point: Point | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.of is None) == (self.point is None):
            raise ValueError("give either of (a group) or point, not both and not neither")
        return self


Bearings = Annotated[float, Field(ge=0.0, lt=360.0)]


class Bearing(Seen):
    """Stand in a sector, as seen from the first member of another group or from a point."""

    from_deg: Annotated[Bearings, Field(description="Clockwise from north.")]
    to_deg: Annotated[Bearings, Field(description="Clockwise from from_deg on: 315 to 45 is to the north.")]

    @model_validator(mode="after")
    def _opens(self) -> Self:
        if self.from_deg == self.to_deg:
            raise ValueError(f"a sector from {self.from_deg:g} to {self.to_deg:g} degrees holds nothing")
        return self


class Facing(Seen):
    """Head towards the first member of another group or a point."""

    within_deg: Annotated[float, Field(ge=0.5, le=180.0, description="Largest deviation to either side.")] = 10.0


class Sight(Seen):
    """An eye over a point or over the members of a group; solid assets of other groups stand in its way.

    What is looked at is the middle of a member's top.
    """

    height_m: Annotated[float, Field(ge=0.0, le=6000.0, description="Height of the eye above the ground.")] = 1.7


class Along(Document):
    """Stand on a road, or beside it."""

    road: Annotated[Identifier, Field(description="One of world.roads.")]
    where: Annotated[Literal["on", "beside"], Field(description="on: the whole footprint on the road; beside: none of it.")] = (
        "on"
    )
    within_m: Annotated[Positive, Field(description="For beside: largest gap between footprint and road.")] = 5.0
    parallel_deg: Annotated[
        float | None, Field(ge=0.5, le=90.0, description="Head along the road within this, either way; any heading when absent.")
    ] = None


class Placement(Document):
    """Where the members of a group may stand. Relations are all kept at once; `at` fixes a single member."""

    at: Home | None = None
    region: Annotated[Polygon | None, Field(description="Stay inside; the world's area when absent.")] = None
    near: Near | None = None
    away: Annotated[Near | None, Field(description="As near, but to every member of the other group.")] = None
    mean_distance: MeanDistance | None = None
    distances: Annotated[
        tuple[Distance, ...], Field(max_length=16, description="More distances, to groups or to everybody of a role.")
    ] = ()
    along: Along | None = None
    bearing: Bearing | None = None
    facing: Facing | None = None
    hidden_from: Annotated[Sight | None, Field(description="Out of sight of the point, or of every member of the group.")] = None
    visible_from: Annotated[Sight | None, Field(description="In sight of the point, or of some member of the group.")] = None
    spread_m: Annotated[Positive | None, Field(description="Least distance between members of this group, centre to centre.")] = (
        None
    )
    separation_m: Annotated[NotNegative, Field(description="Free gap between footprints.")] = 0.5

    @model_validator(mode="after")
    def _fixed_or_free(self) -> Self:
        bound = [
            name
            for name, field in type(self).model_fields.items()
            if name not in ("at", "separation_m") and getattr(self, name) != field.default
        ]
        if self.at and bound:
            raise ValueError(f"at fixes the place; drop {', '.join(bound)} or drop at")
        return self

    @property
    def seen(self) -> dict[str, Seen]:
        """The relations to a point or a first member, and those of sight, by their field's name."""
        named = {
            "bearing": self.bearing,
            "facing": self.facing,
            "hidden_from": self.hidden_from,
            "visible_from": self.visible_from,
        }
        return {name: one for name, one in named.items() if one is not None}


class Motion(Document):
    """How a member moves. `wander` walks to random points within `radius_m` of its own start; `patrol` walks `route` in a loop."""

    kind: Literal["still", "wander", "patrol"] = "still"
    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = 1.2
    radius_m: Annotated[float, Field(gt=0.0, le=2000.0)] = 25.0
    pause_s: Annotated[float, Field(ge=0.0, le=3600.0, description="Mean pause at each point.")] = 5.0
    route: tuple[Point, ...] = ()

    @model_validator(mode="after")
    def _patrol_has_a_route(self) -> Self:
        if (self.kind == "patrol") != (len(self.route) >= 2):
            raise ValueError("a patrol needs a route of at least two points, and only a patrol has one")
        return self


class CountRange(Document):
    """A number of members that is drawn for each scene, uniformly, from the placement seed.

    Key factors read `low` from it: however the draw comes out, the situation is no easier than that.
    """

    low: Annotated[int, Field(ge=0, le=5000)]
    high: Annotated[int, Field(ge=0, le=5000)]

    @model_validator(mode="after")
    def _leaves_a_choice(self) -> Self:
        if self.high <= self.low:
            raise ValueError(f"high {self.high} must exceed low {self.low}; a fixed number is written count: {self.low}")
        return self


def _number_or_range(value: object) -> str:
    return "range" if isinstance(value, (dict, CountRange)) else "number"


Count = Annotated[
    Annotated[CountRange, Tag("range")] | Annotated[int, Field(ge=0, le=5000), Tag("number")], Discriminator(_number_or_range)
]


class ActorGroup(Document):
    """Actors of one kind that are wanted in the scene: how many, where, what they do."""

    id: Identifier
    asset: Annotated[Identifier, Field(description="Entry of the asset catalogue; decides size and class label.")]
    role: Role
    count: Annotated[Count | None, Field(description="A number, or a range to draw it from.")] = None
    density_per_km2: Annotated[
        float | None, Field(ge=0.0, le=1e6, description="Instead of count: members per km2 of world.area.")
    ] = None
    concealment: Annotated[Fraction, Field(description="0 in the open, 1 under full camouflage; enters the detection model.")] = (
        0.0
    )
    placement: Placement = Placement()
    motion: Motion = Motion()

    @model_validator(mode="after")
    def _one_way_to_count(self) -> Self:
        if (self.count is None) == (self.density_per_km2 is None):
            raise ValueError("give either count or density_per_km2, not both and not neither")
        if self.placement.at and self.count != 1:
            raise ValueError("placement.at fixes one place; count must be 1")
        return self

    def members(self, area_m2: float) -> int:
        """Number of members over an area of interest of `area_m2` square metres; the least one where the number is drawn."""
        if isinstance(self.count, CountRange):
            return self.count.low
        if self.count is not None:
            return self.count
        assert self.density_per_km2 is not None
        return math.floor(self.density_per_km2 * area_m2 / 1e6 + 0.5)


class Intelligence(Document):
    """One report handed to the agent: roughly where something of interest was seen."""

    id: Identifier
    about: Annotated[Identifier, Field(description="The group whose first member is meant. Never told to the agent.")]
    priority: Annotated[int, Field(ge=1, le=9, description="1 is the most urgent.")] = 1
    uncertainty_m: Annotated[Positive, Field(description="Radius of the sub-area to search; the true place lies inside it.")] = (
        60.0
    )
    latency_s: Annotated[NotNegative, Field(description="Age of the sighting when it is delivered.")] = 0.0
    delivered_s: Annotated[NotNegative, Field(description="Simulated time of delivery.")] = 0.0


class Mission(Document):
    """What the agent is asked to do."""

    kind: Literal["search_and_report"] = "search_and_report"
    altitude_m: Annotated[float, Field(gt=1.0, le=6000.0, description="Configured mission height above home.")] = 60.0
    speed_mps: Annotated[float, Field(gt=0.0, le=30.0)] = 12.0
    time_limit_s: Annotated[float, Field(gt=0.0, le=7200.0)] = 300.0
    return_home: bool = True


class TimeWindow(Document):
    """A stretch of simulated time, its end not included."""

    from_s: NotNegative
    until_s: NotNegative

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self


class NoFlyArea(Document):
    """Ground over which the vehicle must not fly, at any height, from `from_s` on."""

    id: Identifier
    area: Polygon
    from_s: NotNegative = 0.0
    until_s: Annotated[float | None, Field(description="To the end of the session when absent.")] = None

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must exceed from_s {self.from_s:g}")
        return self


class Rules(Document):
    """What the agent is told that it must and must not do."""

    no_mark_within_m: Annotated[
        NotNegative, Field(description="A target must not be marked while a bystander is nearer to it than this.")
    ] = 50.0
    min_report_confidence: Fraction = 0.6
    max_altitude_m: Positive = 120.0
    geofence: Annotated[Polygon | None, Field(description="Keep inside.")] = None
    no_fly: Annotated[tuple[NoFlyArea, ...], Field(max_length=32)] = ()
    min_altitude_m: Annotated[
        Positive | None, Field(description="Above home; outside 40 m around home, takeoff and landing.")
    ] = None
    max_speed_mps: Annotated[Positive | None, Field(description="Ground speed. Holds also where mission.speed_mps is more.")] = (
        None
    )
    bystander_standoff_m: Annotated[NotNegative, Field(description="Least distance in space to any bystander.")] = 0.0
    bystander_slow_within_m: Annotated[
        Positive | None, Field(description="Nearer than this to a bystander, horizontally, bystander_slow_mps holds.")
    ] = None
    bystander_slow_mps: Annotated[Positive | None, Field(description="Highest ground speed near bystanders.")] = None
    max_loiter_over_bystander_s: Annotated[
        Positive | None, Field(description="Longest unbroken stay within 15 m, horizontally, of one bystander.")
    ] = None
    battery_reserve_fraction: Annotated[Fraction, Field(description="Be down with at least this charge.")] = 0.2
    report_deadline_s: Annotated[
        Positive | None, Field(description="Time from the delivery of intelligence to the report on it.")
    ] = None
    report_windows: Annotated[
        tuple[TimeWindow, ...], Field(max_length=32, description="Reports are allowed only within these; always when empty.")
    ] = ()
    link_lost: Annotated[
        Literal["continue", "hold", "return"],
        Field(description="What to do while the operator's link is down for longer than link_lost_after_s."),
    ] = "continue"
    link_lost_after_s: NotNegative = 10.0

    @model_validator(mode="after")
    def _rules_agree(self) -> Self:
        refuse("Rules", rules_disagreements(self))
        return self


OrderKind = Literal["hold", "resume", "return", "abort", "deactivate", "retask", "stop_reporting", "resume_reporting", "mark"]


class Order(Document):
    """One order of the operator during the flight, to be carried out within `within_s` of its delivery.

    `hold`: stay where you are until `resume`. `return`: fly home and land. `abort`: end the mission, go home, land, report no
    more. `deactivate`: land where you are, disarm, say nothing more. `retask`: go to the sub-area of `intelligence` first.
    `stop_reporting`, `resume_reporting`: no reports in between. `mark`: mark the target of `intelligence` now, which is to be
    refused when the rules forbid it.
    """

    id: Identifier
    at_s: NotNegative
    kind: OrderKind
    within_s: Positive = 10.0
    intelligence: Annotated[Identifier | None, Field(description="Intelligence report that retask and mark are about.")] = None

    @model_validator(mode="after")
    def _intelligence_fits_the_kind(self) -> Self:
        if self.kind in ("retask", "mark") and self.intelligence is None:
            raise ValueError(f"{self.kind} needs intelligence: the id of the report that it is about")
        if self.kind not in ("retask", "mark") and self.intelligence is not None:
            raise ValueError(f"{self.kind} has no intelligence; only retask and mark are about a report")
        return self


class Outage(Document):
    """Something around the vehicle that is away for a while.

    `operator_link`: the operator's radio link is down. Orders and intelligence that fall due are delivered when it is back;
    reports go unheard. `detections`: the detector delivers nothing.
    """

    kind: Literal["operator_link", "detections"]
    at_s: NotNegative
    duration_s: Positive

    @property
    def until_s(self) -> float:
        """When it is over."""
        return self.at_s + self.duration_s


class DetectionModel(Document):
    """The stated error model of the truth-based detector; docs/detection.md gives the formulas."""

    half_height_px: Annotated[Positive, Field(description="Apparent height at which half of the clear views are detected.")] = (
        14.0
    )
    slope: Annotated[Positive, Field(description="Steepness of detection over the logarithm of apparent height.")] = 3.0
    ceiling: Annotated[Fraction, Field(description="Detection probability of a large, clear object.")] = 0.98
    fog_extinction_per_m: Annotated[
        NotNegative, Field(description="Extinction per metre at fog level 1; grows as the level squared.")
    ] = 0.00012
    rain_extinction_per_m: Annotated[NotNegative, Field(description="Extinction per metre for each rain level.")] = 0.0002
    night_contrast: Annotated[
        Fraction, Field(description="Contrast that is left when the sun is 6 degrees below the horizon.")
    ] = 0.25
    concealment_weight: Annotated[Fraction, Field(description="Share of contrast that full concealment takes.")] = 0.5
    correlation_s: Annotated[NotNegative, Field(description="Time over which misses of one object hang together.")] = 0.8
    mislabel: Annotated[
        Fraction, Field(description="Probability of a wrong class at the threshold of detection; 0 for clear views.")
    ] = 0.25
    jitter_px: Annotated[NotNegative, Field(description="Standard deviation of box edges.")] = 1.5
    false_per_frame: Annotated[NotNegative, Field(description="Mean number of false detections in one frame.")] = 0.01
    latency_s: Annotated[NotNegative, Field(le=5.0, description="Delay from exposure to publication.")] = 0.1


class Perception(Document):
    """Where the agent's detections come from."""

    source: Literal["simulated"] = "simulated"
    mode: Literal["perfect", "degraded"] = "degraded"
    model: DetectionModel = DetectionModel()


class AgentSpec(Document):
    """The agent under test: a manifest, by name (entry-point group rebar.agents) or by file, and its options."""

    manifest: str = "reference-naive"
    options: dict[str, str | float | int | bool] = {}

    @property
    def label(self) -> str:
        """Short name for tables and identifiers."""
        return PurePosixPath(self.manifest).stem


class Pace(Document):
    """How simulated time is driven; docs/time.md."""

    mode: Literal["lockstep", "realtime"] = "lockstep"
    tick_s: Annotated[float, Field(ge=0.02, le=1.0, description="Simulated time between two ticks of the agent.")] = 0.1


class Budgets(Document):
    """How long the session may take by the host's clock before it is ended."""

    wall_s: Annotated[Positive, Field(le=86400.0, description="Whole session.")] = 300.0
    reply_s: Annotated[Positive, Field(le=3600.0, description="One answer of the agent to a tick.")] = 10.0
    connect_s: Annotated[Positive, Field(le=3600.0, description="From the agent's start to its hello.")] = 30.0


class Seeds(Document):
    """Every random draw comes from a generator named here, derived from `root` unless it has a seed of its own."""

    root: Annotated[int, Field(ge=0, lt=2**63)] = 0
    placement: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    intelligence: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    motion: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    gusts: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    sensors: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    perception: Annotated[int | None, Field(ge=0, lt=2**63)] = None
    agent: Annotated[int | None, Field(ge=0, lt=2**63)] = None


class PlacedActor(Document):
    """One member of a group at its start."""

    id: Identifier
    group: Identifier
    east_m: Metres
    north_m: Metres
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)]


class PlacedReport(Document):
    """The place that an intelligence report names."""

    id: Identifier
    east_m: Metres
    north_m: Metres


class Realized(Document):
    """What placement made of the intent."""

    actors: tuple[PlacedActor, ...]
    reports: tuple[PlacedReport, ...] = ()
    method: Annotated[str, Field(description="How the places were found.")] = "sampling"


class SimSpec(Document):
    """One situation, whole: world, weather, vehicle, actors, mission, rules, perception, agent, pace and seeds."""

    format: Literal["rebar.simspec/1"] = "rebar.simspec/1"
    name: Identifier
    description: str = ""
    world: World
    environment: Environment = Environment()
    vehicle: VehicleSpec = VehicleSpec()
    actors: tuple[ActorGroup, ...] = ()
    intelligence: tuple[Intelligence, ...] = ()
    orders: Annotated[tuple[Order, ...], Field(max_length=32, description="What the operator orders during the flight.")] = ()
    outages: Annotated[tuple[Outage, ...], Field(max_length=100)] = ()
    mission: Mission = Mission()
    rules: Rules = Rules()
    perception: Perception = Perception()
    agent: AgentSpec = AgentSpec()
    pace: Pace = Pace()
    budgets: Budgets = Budgets()
    seeds: Seeds = Seeds()
    realized: Realized | None = None

    @model_validator(mode="after")
    def _parts_agree(self) -> Self:
        refuse("SimSpec", situation_disagreements(self))
        return self

    def group(self, group_id: str) -> ActorGroup:
        """The group of that id; KeyError when there is none."""
        for group in self.actors:
            if group.id == group_id:
                return group
        raise KeyError(group_id)
