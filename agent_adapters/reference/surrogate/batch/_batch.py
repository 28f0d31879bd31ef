"""SimSpecs packed into arrays, one row a mission: what the surrogates fly over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from bench.arrays import Bools, Counts, Floats, Objects, Seeds
from bench.contracts import NO_DISTORTION, distortion_faults, lens_of, light_of
from bench.errors import SetupError
from bench.simspec import (
    ASSETS,
    ActorGroup,
    Camera,
    Intelligence,
    Motion,
    Order,
    Role,
    SimSpec,
    seed_of,
    sun_of,
)

from ...flight._airspace import Airspaces, places_of
from ...flight._caution import SLOW_SHARE, Caution
from ...flight._limits import MissionLimits
from ...mission._planner import FRESH_S
from ._draws import uniform
from ._interruptions import Span, delivered_at, interruptions, outage_spans
from ._unfit import BYSTANDER_AWARE, unfit

HOVER_W = 178.0
"""What the x500 draws; docs/vehicle.md."""

# Six spans of 50 s cover the usual time limit of 300 s. Chosen, not measured.
STANDING_SPANS = 6
STANDING_S = 50.0
"""Wanderers stand still for an epoch, then somewhere else; after the last the first comes again."""

# 128 / (45 pi), the mean distance of two random points of a unit disc.
MEAN_LEG_RADII = 0.9054
"""Mean distance between two random points of a disc, in radii."""

# Actors that fill up a row stand here, out of everybody's sight.
FAR_M = 1e9
# Cauchy: the mean width of a rectangle over all directions is its perimeter over pi.
_MEAN_WIDTH = 2.0 / math.pi
_STREAM_WALK = 1


# Of fields with several entries a mission: with what missions are filled up that have fewer (things that play no part),
# and how many numbers an entry is, 0 for a number by itself.
_FLAGS = {"fill": False, "width": 0}
_RANKS = {"fill": 0, "width": 0}
_INDICES = {"fill": -1, "width": 0}
_NUMBERS = {"fill": 0.0, "width": 0}
_MOMENTS = {"fill": math.inf, "width": 0}
_PLACES = {"fill": 0.0, "width": 2}
_FAR_PLACES = {"fill": FAR_M, "width": 2}
_SPANS = {"fill": math.inf, "width": 2}
_FOURS = {"fill": math.inf, "width": 4}


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """n missions, k tasks and a actors at most; what a mission has less of is filled with things that play no
    part.

    Everything that is one number a mission is (n,). Roles are 0 bystander, 1 adversary, 2 clutter, -1 nobody.
    """

    seeds: Seeds
    bystander_aware: Bools
    home_m: Floats  # (n, 2)
    height_m: Floats
    speed_mps: Floats
    limit_s: Floats
    returns: Bools
    no_mark_m: Floats
    min_confidence: Floats
    rate_hz: Floats
    focal_px: Floats
    tan_half: Floats  # of the camera's width
    tilt_rad: Floats
    near_edge: Floats  # where the picture begins and ends ahead, in heights
    far_edge: Floats
    extinction_per_m: Floats
    light: Floats
    half_height_px: Floats
    slope: Floats
    ceiling: Floats
    concealment_weight: Floats
    mislabel: Floats
    correlation_s: Floats
    jitter_px: Floats
    gps_m: Floats
    perfect: Bools
    task_m: Floats = field(metadata=_PLACES)  # (n, k, 2)
    task_radius_m: Floats = field(metadata=_NUMBERS)  # (n, k), 0 where there is no task
    task_priority: Counts = field(metadata=_RANKS)  # (n, k)
    task_delivered_s: Floats = field(metadata=_NUMBERS)  # (n, k)
    task_due_s: Floats = field(metadata=_MOMENTS)  # (n, k) SearchTask.due_s_after
    task_actor: Counts = field(metadata=_INDICES)  # (n, k) the adversary that is meant, -1 for nobody
    role: Counts = field(metadata=_INDICES)  # (n, a)
    start_m: Floats = field(metadata=_FAR_PLACES)  # (n, a, 2)
    roam_m: Floats = field(metadata=_NUMBERS)  # (n, a) how far from its start an actor may be
    rest_share: Floats = field(metadata=_NUMBERS)  # (n, a) share of its time that a wanderer rests
    tall_m: Floats = field(metadata=_NUMBERS)  # (n, a)
    wide_m: Floats = field(metadata=_NUMBERS)  # (n, a) mean extent along a line of sight
    concealment: Floats = field(metadata=_NUMBERS)  # (n, a)
    mistakable: Bools = field(metadata=_FLAGS)  # (n, a)
    group: Counts = field(metadata=_INDICES)  # (n, a) by the order of groups in the scene
    asset: Counts = field(metadata=_INDICES)  # (n, a) and label: by the asset catalogue's order
    label: Counts = field(metadata=_INDICES)
    keeps_up: Bools  # flies home at mission height and comes down there
    floor_m: Floats  # reached before it leaves, 0 for none
    pace_mps: Floats  # with which it reckons its time
    slow_mps: Floats  # near people, inf for one who does not mind
    slow_within_m: Floats
    deadline_s: Floats
    charge_fraction: Floats
    use_per_s: Floats
    reserve: Floats
    charge_s: Floats  # when the charge falls, and to what at most
    charge_left: Floats
    ends_s: Floats  # when it flies home for good
    landed_from_s: Floats  # when it lands where it is
    ordered_down_s: Floats  # the same, by order alone: from then on the measures of flight count nothing
    # (n, s, 2): stays where it is, ordered, the operator out of reach, or without a position
    stands_s: Floats = field(metadata=_SPANS)
    # (n, s, 4): from, until: it flies home and comes back; how long over home ends the mission, the greatest speed
    strays_s: Floats = field(metadata=_FOURS)
    blind_s: Floats = field(metadata=_SPANS)  # (n, s, 2): nothing is detected
    closed_s: Floats = field(metadata=_SPANS)  # (n, s, 2): nothing may be reported
    drifts: Floats = field(
        metadata=_FOURS
    )  # (n, d, 4): from, until, metres a second to the east and the north
    first_s: Floats = field(metadata=_MOMENTS)  # (n, k) when it is ordered to be next
    consent_s: Floats = field(metadata=_NUMBERS)  # (n, k) from a report to leave to mark; 0 if none is asked
    mark_s: Floats = field(metadata=_MOMENTS)  # (n, m) when it is ordered to mark the target of which task
    mark_task: Counts = field(metadata=_INDICES)
    airspaces: Objects  # None where nothing is closed
    scenes: Objects  # the SimSpecs
    tasks: Objects  # the intelligence reports of each mission, in the order of its tasks
    delivered: Objects  # every order of each mission, with the moment of its delivery

    def __len__(self) -> int:
        return len(self.seeds)

    def select(self, begin: int, end: int) -> Batch:
        """Some of the missions."""
        return replace(self, **{field.name: getattr(self, field.name)[begin:end] for field in fields(self)})

    @property
    def is_task(self) -> Bools:
        """(n, k) whether there is a task."""
        return np.asarray(self.task_radius_m > 0.0)

    @property
    def is_target(self) -> Bools:
        """(n, k) tasks that are about an adversary."""
        return self.is_task & (self.task_actor >= 0)

    @property
    def correlated_frames(self) -> Floats:
        """(n,) frames that hang together, as one look."""
        return np.maximum(2.0 * self.correlation_s * self.rate_hz, 1.0)

    def places(self) -> Floats:
        """(EPOCHS, n, a, 2) where everybody stands: at a point of their disc, or on the way to the next."""
        actors = self.role.shape[1]
        points = np.empty((STANDING_SPANS, *self.start_m.shape))
        for span in range(STANDING_SPANS):
            away = self.roam_m * np.sqrt(uniform(self.seeds, _STREAM_WALK + 3 * span, actors))
            turn = (2.0 * np.pi * uniform(self.seeds, _STREAM_WALK + 3 * span + 1, actors)).astype(np.float32)
            points[span, :, :, 0] = self.start_m[:, :, 0] + away * np.sin(turn)
            points[span, :, :, 1] = self.start_m[:, :, 1] + away * np.cos(turn)
        places = points.copy()
        for span in range(STANDING_SPANS):
            draw = uniform(self.seeds, _STREAM_WALK + 3 * span + 2, actors)
            walked = np.maximum(draw - self.rest_share, 0.0) / (1.0 - self.rest_share)
            places[span] += walked[:, :, None] * (points[(span + 1) % STANDING_SPANS] - points[span])
        return places


def standing_span_of(time_s: Floats | float) -> Counts:
    """The epoch of each moment; the first for what never was."""
    return np.asarray(
        (np.where(np.isfinite(time_s), time_s, 0.0) // STANDING_S).astype(np.int64) % STANDING_SPANS
    )


def pack(simspecs: Sequence[SimSpec]) -> Batch:
    """Realized SimSpecs as a batch. Raises SetupError with all that no surrogate can fly."""
    faults = {str(fault): fault for simspec in simspecs for fault in unfit(simspec)}
    if faults:
        raise SetupError(list(faults.values()))
    known: dict[str, Airspaces] = {}
    rows = [_row(simspec, known) for simspec in simspecs]
    columns: dict[str, Any] = {}
    for column in fields(Batch):
        values = [row[column.name] for row in rows]
        if column.metadata:
            columns[column.name] = _stacked(values, **column.metadata)
        elif column.type == "Objects":
            columns[column.name] = np.fromiter(values, dtype=np.object_)
        else:
            columns[column.name] = np.array(values)
    return Batch(**columns)


def _stacked(values: Sequence[Sequence[Any]], fill: float, width: int) -> np.ndarray:
    most = max(len(value) for value in values)
    stacked = np.full((len(values), most, *[width] * (width > 0)), fill)
    for row, value in enumerate(values):
        if len(value):
            stacked[row, : len(value)] = value
    return stacked


_ROLES = {Role.BYSTANDER: 0, Role.ADVERSARY: 1, Role.CLUTTER: 2}


ASSET_INDEX = {name: index for index, name in enumerate(ASSETS)}
NO_ASSET = len(ASSET_INDEX)
"""The index of every asset beside the catalogue's, which no actor of a batch has."""
LABEL_INDEX = {
    label: index for index, label in enumerate(dict.fromkeys(asset.class_label for asset in ASSETS.values()))
}


def _row(simspec: SimSpec, known: dict[str, Airspaces]) -> dict[str, Any]:
    assert simspec.realized is not None, "only a realized SimSpec says where everybody is"
    camera, model, rules = simspec.vehicle.camera, simspec.perception.model, simspec.rules
    tilt_rad = math.radians(camera.tilt_deg)
    tan_half = math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    left, upper, right, lower = _edges(camera, tan_half)
    events = interruptions(simspec)
    return {
        "seeds": np.uint64(seed_of(simspec.seeds, "perception")),
        "bystander_aware": BYSTANDER_AWARE[simspec.agent.label],
        "home_m": (simspec.vehicle.home.east_m, simspec.vehicle.home.north_m),
        **_limits(simspec),
        "limit_s": simspec.mission.time_limit_s,
        "returns": simspec.mission.return_home,
        "no_mark_m": rules.no_mark_within_m,
        "min_confidence": rules.min_report_confidence,
        "rate_hz": camera.rate_hz,
        "focal_px": camera.width_px / 2.0 / tan_half,
        "tan_half": (left + right) / 2.0,
        "tilt_rad": tilt_rad,
        "near_edge": _ahead(tilt_rad + math.atan(lower)),
        "far_edge": _ahead(tilt_rad - math.atan(upper)),
        "extinction_per_m": model.extinction_per_m(simspec.environment),
        "light": light_of(sun_of(simspec).elevation_rad, model.night_contrast),
        **{name: getattr(model, name) for name in _OF_MODEL},
        "gps_m": simspec.vehicle.gps.wander_m,
        "perfect": simspec.perception.error_free,
        "deadline_s": math.inf if rules.report_deadline_s is None else rules.report_deadline_s,
        "charge_fraction": simspec.vehicle.battery.initial_fraction,
        "use_per_s": HOVER_W / 3600.0 / simspec.vehicle.battery.capacity_wh,
        "reserve": rules.battery_reserve_fraction,
        **_actors(simspec),
        **_tasks(simspec, events["delivered"]),
        **events,
        "airspaces": _airspaces(simspec, known),
        "scenes": simspec,
    }


_OF_MODEL = (
    *("half_height_px", "slope", "ceiling", "concealment_weight"),
    *("mislabel", "correlation_s", "jitter_px"),
)


def _limits(simspec: SimSpec) -> dict[str, Any]:
    """How high and fast the rules let the agent fly; `slow_mps` is inf for one who does not mind people."""
    rules, careful = simspec.rules, BYSTANDER_AWARE[simspec.agent.label]
    caution = Caution.of(rules) if careful else Caution()
    flown = MissionLimits.of(simspec.mission, rules, caution)
    return {
        "height_m": flown.height_m,
        "speed_mps": flown.speed_mps,
        "pace_mps": flown.pace_mps,
        "floor_m": rules.min_altitude_m or 0.0,
        "slow_mps": SLOW_SHARE * caution.slow_mps if caution.slow_mps is not None else math.inf,
        "slow_within_m": (caution.slow_within_m or 0.0) if caution.slow_mps is not None else 0.0,
        "keeps_up": caution.watches or rules.min_altitude_m is not None,
    }


def _tasks(simspec: SimSpec, delivered: Sequence[tuple[Order, float]]) -> dict[str, Any]:
    """What is told of each task, and ordered about it."""
    assert simspec.realized is not None
    places = {report.id: (report.east_m, report.north_m) for report in simspec.realized.reports}
    tasks = [report for report in simspec.intelligence if report.id in places]
    names = [task.id for task in tasks]
    enemies = {group.id for group in simspec.actors if group.role is Role.ADVERSARY}
    # Reversed, so that the first member of each group stays.
    members = reversed(list(enumerate(simspec.realized.actors)))
    targets = {actor.group: index for index, actor in members if actor.group in enemies}
    link_down = outage_spans(simspec.outages, "operator_link")
    return {
        "task_m": [places[name] for name in names],
        "task_radius_m": [task.uncertainty_m for task in tasks],
        "task_priority": [task.priority for task in tasks],
        "task_delivered_s": [delivered_at(task.delivered_s, link_down) for task in tasks],
        "task_due_s": [_due_s(simspec, task, link_down) for task in tasks],
        "task_actor": [targets.get(task.about, -1) for task in tasks],
        "consent_s": _consents_s(simspec, names),
        "tasks": tasks,
        **_ordered(names, delivered),
    }


def _ordered(names: Sequence[str], delivered: Sequence[tuple[Order, float]]) -> dict[str, Any]:
    """What is ordered about the tasks: to be next, and to mark."""
    first_s = [math.inf] * len(names)
    marks = []
    for order, at_s in delivered:
        if order.intelligence in names:
            task = names.index(order.intelligence)
            if order.kind == "retask":
                first_s[task] = min(first_s[task], at_s)
            else:
                marks.append((at_s, task))
    return {
        "first_s": first_s,
        "mark_s": [at_s for at_s, _ in marks],
        "mark_task": [task for _, task in marks],
    }


def _actors(simspec: SimSpec) -> dict[str, Any]:
    """Where everybody is, and what all members of a group have in common."""
    assert simspec.realized is not None
    actors, groups = simspec.realized.actors, simspec.actors
    numbers = {group.id: number for number, group in enumerate(groups)}
    member = np.array([numbers[actor.group] for actor in actors], dtype=np.int64)
    of_groups = [_of_group(group) for group in groups]
    return {
        "start_m": [(actor.east_m, actor.north_m) for actor in actors],
        "group": member,
        # Indexed as arrays: actors are many, and groups few.
        **{name: np.array([row[name] for row in of_groups])[member] for name in _OF_GROUP},
    }


_OF_GROUP = (
    *("role", "roam_m", "rest_share", "tall_m", "wide_m"),
    *("concealment", "mistakable", "asset", "label"),
)


def _of_group(group: ActorGroup) -> dict[str, Any]:
    asset, motion = group.definition, group.motion
    return {
        "role": _ROLES[group.role],
        "roam_m": motion.radius_m if motion.kind == "wander" else 0.0,
        "rest_share": _rest_share(motion),
        "tall_m": asset.height_m,
        "wide_m": _MEAN_WIDTH * (asset.length_m + asset.width_m),
        "concealment": group.concealment,
        "mistakable": bool(asset.confused_with),
        "asset": ASSET_INDEX[group.asset],
        "label": LABEL_INDEX[asset.class_label],
    }


def _due_s(simspec: SimSpec, task: Intelligence, link_down: Sequence[Span]) -> float:
    observed_in_flight = task.delivered_s - task.latency_s > 0.0
    deadline_s = simspec.rules.report_deadline_s
    good_for_s = min(FRESH_S if observed_in_flight else math.inf, deadline_s or math.inf)
    return delivered_at(task.delivered_s, link_down) + good_for_s


def _consents_s(simspec: SimSpec, names: Sequence[str]) -> list[float]:
    if not simspec.rules.mark_consent:
        return [0.0] * len(names)
    granted = {
        consent.intelligence: consent.after_s for consent in simspec.consents if consent.answer == "granted"
    }
    return [granted.get(name, math.inf) for name in names]


def _airspaces(simspec: SimSpec, known: dict[str, Airspaces]) -> Airspaces | None:
    """The same object for all missions under the same rules."""
    rules = simspec.rules
    if rules.geofence is None and not rules.no_fly:
        return None
    key = repr((rules.geofence, rules.no_fly))
    if key not in known:
        areas = [(area.from_s, area.until_s, places_of(area.area.corners)) for area in rules.no_fly]
        known[key] = Airspaces(areas, None if rules.geofence is None else places_of(rules.geofence.corners))
    return known[key]


def _rest_share(motion: Motion) -> float:
    """Share of the time that is pause, of one who walks from point to point."""
    return min(motion.pause_s / (motion.pause_s + MEAN_LEG_RADII * motion.radius_m / motion.speed_mps), 0.999)


def _edges(camera: Camera, tan_half: float) -> tuple[float, float, float, float]:
    """Tangents of the angles from the axis to the middles of the left, upper, right and lower edge, with distortion."""
    lens = lens_of(camera)
    # The test takes a millisecond, and a batch has thousands of rows.
    if lens.distortion != NO_DISTORTION and (faults := distortion_faults(lens)):
        raise SetupError(faults)
    tan_upper = tan_half * camera.height_px / camera.width_px
    rays = lens.undistort(np.array(((-tan_half, 0.0), (0.0, -tan_upper), (tan_half, 0.0), (0.0, tan_upper))))
    return -float(rays[0, 0]), -float(rays[1, 1]), float(rays[2, 0]), float(rays[3, 1])


def _ahead(below_rad: float) -> float:
    """How far ahead, in heights, a ray this far below the horizon meets the ground; at most 6."""
    return 6.0 if below_rad <= math.radians(9.5) else 1.0 / math.tan(below_rad)
