"""SimSpecs packed into arrays, one row a mission: what the surrogates fly over."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.errors import Fault, SetupError
from bench.simspec import ASSETS, Role, Rules, SimSpec, seed_of, sun_of

from .._detector import light_of
from ._draws import Counts, Floats, Seeds, uniform

Bools = NDArray[np.bool_]

SURROGATES = {"reference-naive": False, "reference-bystander-aware": True}
"""Agents that have a surrogate, and whether it looks out for bystanders."""

MODELS = ("x500",)
"""Vehicles whose climb, descent and braking the surrogates have."""

RULES = (
    "no_mark_within_m",
    "min_report_confidence",
    "max_altitude_m",
    "battery_reserve_fraction",
    "link_lost",
    "link_lost_after_s",
)
"""Rules that the surrogates keep, or that nothing in what they fly brings up; any other is refused."""

_USUAL = Rules()

EPOCHS = 6
EPOCH_S = 50.0
"""Wanderers stand still for an epoch, then somewhere else within their radius; after the last the first comes again."""

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
    tall_m: Floats  # (n, a)
    wide_m: Floats  # (n, a) mean extent along a line of sight
    concealment: Floats  # (n, a)
    mistakable: Bools  # (n, a)

    def __len__(self) -> int:
        return len(self.seeds)

    def part(self, begin: int, end: int) -> Batch:
        """Some of the missions."""
        return replace(self, **{field.name: getattr(self, field.name)[begin:end] for field in fields(self)})

    def places(self) -> Floats:
        """(EPOCHS, n, a, 2) where everybody stands."""
        actors = self.role.shape[1]
        places = np.empty((EPOCHS, *self.start_m.shape))
        for epoch in range(EPOCHS):
            away = self.roam_m * np.sqrt(uniform(self.seeds, _WALK + 2 * epoch, actors))
            turn = 2.0 * np.pi * uniform(self.seeds, _WALK + 2 * epoch + 1, actors)
            places[epoch, :, :, 0] = self.start_m[:, :, 0] + away * np.sin(turn)
            places[epoch, :, :, 1] = self.start_m[:, :, 1] + away * np.cos(turn)
        return places


def unfit(simspec: SimSpec) -> list[Fault]:
    """Why no surrogate can fly this SimSpec; empty when one can."""
    faults = []
    if simspec.agent.label not in SURROGATES:
        known = " or ".join(SURROGATES)
        faults.append(Fault("agents", f"{simspec.agent.label!r} has no surrogate", f"fly {known}, or fidelity: full"))
    rules = simspec.rules
    beyond: dict[str, object] = {
        "orders": simspec.orders,
        "outages": simspec.outages,
        "vehicle.failures": simspec.vehicle.failures,
        "vehicle.model": simspec.vehicle.model not in MODELS,
        "agent.options": simspec.agent.options,
    }
    beyond |= {f"rules.{name}": getattr(rules, name) != getattr(_USUAL, name) for name in Rules.model_fields if name not in RULES}
    faults += [
        Fault(name, "is beyond the overhead simulation", "leave it out, or fidelity: full")
        for name, asked in beyond.items()
        if asked
    ]
    return faults


def pack(simspecs: Sequence[SimSpec]) -> Batch:
    """Realized SimSpecs as a batch. Raises SetupError with all that no surrogate can fly."""
    faults = {str(fault): fault for simspec in simspecs for fault in unfit(simspec)}
    if faults:
        raise SetupError(list(faults.values()))
    rows = [_row(simspec) for simspec in simspecs]
    single = {name: np.array([row[name] for row in rows]) for name in rows[0] if name not in _PADDED}
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
    "tall_m": 0.0,
    "wide_m": 0.0,
    "concealment": 0.0,
    "mistakable": False,
}


def _stacked(values: Sequence[np.ndarray], fill: float | int | bool) -> np.ndarray:
    most = max(len(value) for value in values)
    stacked = np.full((len(values), most, *values[0].shape[1:]), fill, dtype=values[0].dtype)
    for row, value in enumerate(values):
        stacked[row, : len(value)] = value
    return stacked


_ROLES = {Role.BYSTANDER: 0, Role.ADVERSARY: 1, Role.CLUTTER: 2}


def _row(simspec: SimSpec) -> dict[str, Any]:
    assert simspec.realized is not None, "only a realized SimSpec says where everybody is"
    camera, model, weather, rules = simspec.vehicle.camera, simspec.perception.model, simspec.environment, simspec.rules
    tilt_rad, tan_half = math.radians(camera.tilt_deg), math.tan(math.radians(camera.horizontal_fov_deg) / 2.0)
    half_rad = math.atan(tan_half * camera.height_px / camera.width_px)
    groups = {group.id: group for group in simspec.actors}
    first: dict[str, int] = {}
    for index, actor in enumerate(simspec.realized.actors):
        first.setdefault(actor.group, index)
    members = [groups[actor.group] for actor in simspec.realized.actors]
    assets = [ASSETS[group.asset] for group in members]
    told = {report.id: report for report in simspec.realized.reports}
    tasks = [one for one in simspec.intelligence if one.id in told]
    meant = [groups[one.about].role is Role.ADVERSARY for one in tasks]
    extinction = model.fog_extinction_per_m * weather.fog_level**2 + model.rain_extinction_per_m * weather.rain_level
    return {
        "seeds": np.uint64(seed_of(simspec.seeds, "perception")),
        "aware": SURROGATES[simspec.agent.label],
        "home_m": (simspec.vehicle.home.east_m, simspec.vehicle.home.north_m),
        "height_m": min(simspec.mission.altitude_m, rules.max_altitude_m),
        "speed_mps": simspec.mission.speed_mps,
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
        "task_delivered_s": np.array([one.delivered_s for one in tasks], dtype=np.float64),
        "task_actor": np.array(
            [first.get(one.about, -1) if enemy else -1 for one, enemy in zip(tasks, meant, strict=True)], dtype=np.int64
        ),
        "role": np.array([_ROLES[group.role] for group in members], dtype=np.int64),
        "start_m": np.array([(actor.east_m, actor.north_m) for actor in simspec.realized.actors]).reshape(-1, 2),
        "roam_m": np.array([group.motion.radius_m if group.motion.kind == "wander" else 0.0 for group in members]),
        "tall_m": np.array([asset.height_m for asset in assets]),
        "wide_m": np.array([_MEAN_WIDTH * (asset.length_m + asset.width_m) for asset in assets]),
        "concealment": np.array([group.concealment for group in members]),
        "mistakable": np.array([bool(asset.confused_with) for asset in assets], dtype=np.bool_),
    }


def _ahead(below_rad: float) -> float:
    """How far ahead, in heights, a ray this far below the horizon meets the ground; at most 6."""
    return 6.0 if below_rad <= math.radians(9.5) else 1.0 / math.tan(below_rad)
