"""SimSpecs packed into arrays, one row a mission: what the surrogates fly over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bench.arrays import Bools, Counts, Floats, Objects, Seeds
from bench.contracts import light_of
from bench.errors import Fault, SetupError
from bench.simspec import ASSETS, Motion, Role, SimSpec, seed_of, sun_of

from ._airspace import Airspaces
from ._draws import uniform
from ._interruptions import Interruptions, deaf_spans, interruptions, later, uninterruptible
from ._limits import limits

SURROGATES = {"reference-naive": False, "reference-bystander-aware": True}
"""Agents that have a surrogate, and whether it looks out for bystanders."""

MODELS = ("x500",)
"""Vehicles whose climb, descent and braking the surrogates have."""

HOVER_W = 178.0
"""What the x500 draws; docs/vehicle.md."""

EPOCHS = 6
EPOCH_S = 50.0
"""Wanderers stand still for an epoch, then somewhere else; after the last the first comes again."""

MEAN_LEG = 0.9054
"""Mean distance between two random points of a disc, in radii."""

FAR_M = 1e9
_MEAN_WIDTH = 2.0 / math.pi
_WALK = 1


@dataclass(frozen=True, slots=True)
class Batch:
    """n missions, k tasks and a actors at most; what a mission has less of is filled with things that play no part.

    Everything that is one number a mission is (n,). Roles are 0 bystander, 1 adversary, 2 clutter, -1 nobody.
    """

    seeds: Seeds
    aware: Bools
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
    near: Floats  # where the picture begins and ends ahead, in heights
    far: Floats
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
    task_m: Floats  # (n, k, 2)
    task_radius_m: Floats  # (n, k), 0 where there is no task
    task_priority: Counts  # (n, k)
    task_delivered_s: Floats  # (n, k)
    task_actor: Counts  # (n, k) the adversary that is meant, -1 for nobody
    role: Counts  # (n, a)
    start_m: Floats  # (n, a, 2)
    roam_m: Floats  # (n, a) how far from its start an actor may be
    rests: Floats  # (n, a) share of its time that a wanderer rests
    tall_m: Floats  # (n, a)
    wide_m: Floats  # (n, a) mean extent along a line of sight
    concealment: Floats  # (n, a)
    mistakable: Bools  # (n, a)
    group: Counts  # (n, a) by the order of groups in the scene
    asset: Counts  # (n, a) and label: by the asset catalogue's order
    label: Counts
    keeps_up: Bools  # flies home at mission height and comes down there
    floor_m: Floats  # reached before it leaves, 0 for none
    pace_mps: Floats  # with which it reckons its time
    slow_mps: Floats  # near people, inf for one who does not mind
    slow_within_m: Floats
    deadline_s: Floats
    charge_fraction: Floats
    use_per_s: Floats
    reserve: Floats
    charge_s: Floats  # when the charge falls, and to what
    charge_left: Floats
    ends_s: Floats  # when it is ordered home
    down_s: Floats  # and down where it is
    stands_s: Floats  # (n, s, 2) and so on: spans of Interruptions, inf where there is none
    strays_s: Floats  # (n, s, 3)
    blind_s: Floats
    closed_s: Floats
    drifts: Floats  # (n, d, 4)
    first_s: Floats  # (n, k) when it is ordered to be next
    mark_s: Floats  # (n, m) when it is ordered to mark the target of which task
    mark_task: Counts
    interrupted: Bools
    airspaces: Objects  # None where nothing is closed
    scenes: Objects  # the SimSpecs
    interruptions: Objects

    def __len__(self) -> int:
        return len(self.seeds)

    def part(self, begin: int, end: int) -> Batch:
        """Some of the missions."""
        return replace(self, **{field.name: getattr(self, field.name)[begin:end] for field in fields(self)})

    def places(self) -> Floats:
        """(EPOCHS, n, a, 2) where everybody stands: at a point of their disc, or somewhere on the way to the next one."""
        actors = self.role.shape[1]
        points = np.empty((EPOCHS, *self.start_m.shape))
        for epoch in range(EPOCHS):
            away = self.roam_m * np.sqrt(uniform(self.seeds, _WALK + 3 * epoch, actors))
            turn = (2.0 * np.pi * uniform(self.seeds, _WALK + 3 * epoch + 1, actors)).astype(np.float32)
            points[epoch, :, :, 0] = self.start_m[:, :, 0] + away * np.sin(turn)
            points[epoch, :, :, 1] = self.start_m[:, :, 1] + away * np.cos(turn)
        places = points.copy()
        for epoch in range(EPOCHS):
            luck = uniform(self.seeds, _WALK + 3 * epoch + 2, actors)
            walked = np.maximum(luck - self.rests, 0.0) / (1.0 - self.rests)
            places[epoch] += walked[:, :, None] * (points[(epoch + 1) % EPOCHS] - points[epoch])
        return places


def unfit(simspec: SimSpec) -> list[Fault]:
    """Why no surrogate can fly this SimSpec; empty when one can."""
    faults = []
    if simspec.agent.label not in SURROGATES:
        known = " or ".join(SURROGATES)
        faults.append(Fault("agents", f"{simspec.agent.label!r} has no surrogate", f"fly {known}, or fidelity: full"))
    beyond: dict[str, object] = {"vehicle.model": simspec.vehicle.model not in MODELS, "agent.options": simspec.agent.options}
    faults += [
        Fault(name, "is beyond the overhead simulation", "leave it out, or fidelity: full")
        for name, asked in beyond.items()
        if asked
    ]
    return faults + uninterruptible(simspec)


def pack(simspecs: Sequence[SimSpec]) -> Batch:
    """Realized SimSpecs as a batch. Raises SetupError with all that no surrogate can fly."""
    faults = {str(fault): fault for simspec in simspecs for fault in unfit(simspec)}
    if faults:
        raise SetupError(list(faults.values()))
    known: dict[str, Airspaces] = {}
    rows = [_row(simspec, known) for simspec in simspecs]
    single = {name: _column([row[name] for row in rows]) for name in rows[0] if name not in _PADDED}
    padded = {name: _stacked([row[name] for row in rows], fill) for name, fill in _PADDED.items()}
    return Batch(**single, **padded)


_PADDED: dict[str, float | int | bool] = {
    "task_m": 0.0,
    "task_radius_m": 0.0,
    "task_priority": 0,
    "task_delivered_s": 0.0,
    "task_actor": -1,
    "role": -1,
    "start_m": FAR_M,
    "roam_m": 0.0,
    "rests": 0.0,
    "tall_m": 0.0,
    "wide_m": 0.0,
    "concealment": 0.0,
    "mistakable": False,
    "group": -1,
    "asset": -1,
    "label": -1,
    "stands_s": np.inf,
    "strays_s": np.inf,
    "blind_s": np.inf,
    "closed_s": np.inf,
    "drifts": np.inf,
    "first_s": np.inf,
    "mark_s": np.inf,
    "mark_task": -1,
}

_OBJECTS = (SimSpec, Airspaces, Interruptions, type(None))


def _column(values: Sequence[Any]) -> np.ndarray:
    """One value a mission."""
    if not isinstance(values[0], _OBJECTS):
        return np.array(values)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _stacked(values: Sequence[np.ndarray], fill: float | int | bool) -> np.ndarray:
    most = max(len(value) for value in values)
    stacked = np.full((len(values), most, *values[0].shape[1:]), fill, dtype=values[0].dtype)
    for row, value in enumerate(values):
        stacked[row, : len(value)] = value
    return stacked


_ROLES = {Role.BYSTANDER: 0, Role.ADVERSARY: 1, Role.CLUTTER: 2}


_ASSET = {name: index for index, name in enumerate(ASSETS)}
LABEL = {label: index for index, label in enumerate(dict.fromkeys(asset.class_label for asset in ASSETS.values()))}


def _row(simspec: SimSpec, known: dict[str, Airspaces]) -> dict[str, Any]:
    assert simspec.realized is not None, "only a realized SimSpec says where everybody is"
    camera, model, weather, rules = simspec.vehicle.camera, simspec.perception.model, simspec.environment, simspec.rules
    tilt_rad, tan_half = math.radians(camera.tilt_deg), math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    half_rad = math.atan(tan_half * camera.height_px / camera.width_px)
    groups = {group.id: group for group in simspec.actors}
    first: dict[str, int] = {}
    for index, actor in enumerate(simspec.realized.actors):
        first.setdefault(actor.group, index)
    number = {group.id: index for index, group in enumerate(simspec.actors)}
    member = np.array([number[actor.group] for actor in simspec.realized.actors], dtype=np.int64)
    told = {report.id: report for report in simspec.realized.reports}
    tasks = [one for one in simspec.intelligence if one.id in told]
    meant = [groups[one.about].role is Role.ADVERSARY for one in tasks]
    allowed = limits(simspec, careful=SURROGATES[simspec.agent.label])
    deaf = deaf_spans(simspec.outages)
    extinction = model.fog_extinction_per_m * weather.fog_level**2 + model.rain_extinction_per_m * weather.rain_level
    return {
        "seeds": np.uint64(seed_of(simspec.seeds, "perception")),
        "aware": SURROGATES[simspec.agent.label],
        "home_m": (simspec.vehicle.home.east_m, simspec.vehicle.home.north_m),
        "height_m": allowed.height_m,
        "speed_mps": allowed.speed_mps,
        "limit_s": simspec.mission.time_limit_s,
        "returns": simspec.mission.return_home,
        "no_mark_m": rules.no_mark_within_m,
        "min_confidence": rules.min_report_confidence,
        "rate_hz": camera.rate_hz,
        "focal_px": camera.width_px / 2.0 / tan_half,
        "tan_half": tan_half,
        "tilt_rad": tilt_rad,
        "near": _ahead(tilt_rad + half_rad),
        "far": _ahead(tilt_rad - half_rad),
        "extinction_per_m": extinction,
        "light": light_of(sun_of(simspec).elevation_rad, model.night_contrast),
        "half_height_px": model.half_height_px,
        "slope": model.slope,
        "ceiling": model.ceiling,
        "concealment_weight": model.concealment_weight,
        "mislabel": model.mislabel,
        "correlation_s": model.correlation_s,
        "jitter_px": model.jitter_px,
        "gps_m": simspec.vehicle.gps.wander_m,
        "perfect": simspec.perception.mode == "perfect",
        "task_m": np.array([(told[one.id].east_m, told[one.id].north_m) for one in tasks]).reshape(-1, 2),
        "task_radius_m": np.array([one.uncertainty_m for one in tasks], dtype=np.float64),
        "task_priority": np.array([one.priority for one in tasks], dtype=np.int64),
        "task_delivered_s": np.array([later(one.delivered_s, deaf) for one in tasks], dtype=np.float64),
        "task_actor": np.array(
            [first.get(one.about, -1) if enemy else -1 for one, enemy in zip(tasks, meant, strict=True)], dtype=np.int64
        ),
        "start_m": np.array([(actor.east_m, actor.north_m) for actor in simspec.realized.actors]).reshape(-1, 2),
        "group": member,
        **{name: values[member] for name, values in _of_groups(simspec).items()},
        "keeps_up": allowed.keeps_up,
        "floor_m": allowed.floor_m,
        "pace_mps": allowed.pace_mps,
        "slow_mps": allowed.slow_mps,
        "slow_within_m": allowed.slow_within_m,
        "deadline_s": math.inf if rules.report_deadline_s is None else rules.report_deadline_s,
        "charge_fraction": simspec.vehicle.battery.initial_fraction,
        "use_per_s": HOVER_W / 3600.0 / simspec.vehicle.battery.capacity_wh,
        "reserve": rules.battery_reserve_fraction,
        "airspaces": _airspaces(simspec, known),
        "scenes": simspec,
        **_interrupted(simspec, [one.id for one in tasks]),
    }


def _of_groups(simspec: SimSpec) -> dict[str, np.ndarray]:
    """What all members of a group have in common, group by group."""
    groups = simspec.actors
    assets = [ASSETS[group.asset] for group in groups]
    return {
        "role": np.array([_ROLES[group.role] for group in groups], dtype=np.int64),
        "roam_m": np.array([group.motion.radius_m if group.motion.kind == "wander" else 0.0 for group in groups]),
        "rests": np.array([_rests(group.motion) for group in groups]),
        "tall_m": np.array([asset.height_m for asset in assets]),
        "wide_m": np.array([_MEAN_WIDTH * (asset.length_m + asset.width_m) for asset in assets]),
        "concealment": np.array([group.concealment for group in groups], dtype=np.float64),
        "mistakable": np.array([bool(asset.confused_with) for asset in assets], dtype=np.bool_),
        "asset": np.array([_ASSET[group.asset] for group in groups], dtype=np.int64),
        "label": np.array([LABEL[asset.class_label] for asset in assets], dtype=np.int64),
    }


def _airspaces(simspec: SimSpec, known: dict[str, Airspaces]) -> Airspaces | None:
    """The same object for all missions under the same rules."""
    rules = simspec.rules
    if rules.geofence is None and not rules.no_fly:
        return None
    key = repr((rules.geofence, rules.no_fly))
    if key not in known:
        known[key] = Airspaces(rules)
    return known[key]


def _interrupted(simspec: SimSpec, tasks: Sequence[str]) -> dict[str, Any]:
    one = interruptions(simspec)
    first_s = np.full(len(tasks), np.inf)
    marks = []
    for order, at_s in one.delivered:
        if order.intelligence in tasks:
            task = tasks.index(order.intelligence)
            if order.kind == "retask":
                first_s[task] = min(first_s[task], at_s)
            else:
                marks.append((at_s, task))
    return {
        "charge_s": one.charge_s,
        "charge_left": one.charge,
        "ends_s": one.ends_s,
        "down_s": one.down_s,
        "stands_s": np.array(one.stands, dtype=np.float64).reshape(-1, 2),
        "strays_s": np.array(one.strays, dtype=np.float64).reshape(-1, 3),
        "blind_s": np.array(one.blind, dtype=np.float64).reshape(-1, 2),
        "closed_s": np.array(one.closed, dtype=np.float64).reshape(-1, 2),
        "drifts": np.array(one.drifts, dtype=np.float64).reshape(-1, 4),
        "first_s": first_s,
        "mark_s": np.array([at_s for at_s, _ in marks], dtype=np.float64),
        "mark_task": np.array([task for _, task in marks], dtype=np.int64),
        "interrupted": one.any,
        "interruptions": one,
    }


def _rests(motion: Motion) -> float:
    """Share of the time that is pause, of one who walks from point to point."""
    return min(motion.pause_s / (motion.pause_s + MEAN_LEG * motion.radius_m / motion.speed_mps), 0.999)


def _ahead(below_rad: float) -> float:
    """How far ahead, in heights, a ray this far below the horizon meets the ground; at most 6."""
    return 6.0 if below_rad <= math.radians(9.5) else 1.0 / math.tan(below_rad)
