"""Random scenes for training and evaluation: who stands where, in which light and air, and from where it is seen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np

from bench.arrays import Bools, Counts, Floats
from bench.camera import (
    Conditions,
    GroundType,
    RenderedCamera,
    actors_in,
    conditions_of,
    open_camera,
    open_opencv_renderer,
    stage_of,
)
from bench.camera.sheet import SceneActor, simspec_with
from bench.clock import START
from bench.contracts import CameraPose, Lens, Pixels, cast_of
from bench.realization import place
from bench.simspec import ASSETS, DetectionModel, Point, Polygon, Road, Seeds, load_simspec

LABELS = tuple(dict.fromkeys(asset.class_label for asset in ASSETS.values()))
"""Class labels in the order in which the catalogue names them first."""

GROUPS = {
    "civilian": "person",
    "aid_worker": "person",
    "combatant": "person",
    "civilian_vehicle": "vehicle",
    "military_vehicle": "vehicle",
    "mobile_radar": "vehicle",
    "building": "structure",
    "tent": "structure",
    "crate": "structure",
    "tree": "tree",
    "animal": "animal",
}
"""What a label is when its class cannot be told."""

SITUATIONS = Path(__file__).parents[2] / "campaigns" / "standard"

# How often actors of a group are drawn: people are what an agent must not miss.
_GROUP_SHARES = {"person": 0.42, "vehicle": 0.28, "structure": 0.12, "tree": 0.1, "animal": 0.08}

# As often as campaigns have them; half sides of the area.
_EMPTY_SHARE, _GRASS_SHARE, _SPARSE_SHARE = 0.13, 0.4, 0.3
_EMPTY_HEIGHTS_M = (0.1, 15.0)
_AREA_SIDES_M = (60.0, 330.0)
_LABEL_SHARES = {"civilian": 0.45, "aid_worker": 0.2, "combatant": 0.35}

_REACH_M = 58.0
_NEAREST_M, _FARTHEST_M = 15.0, 240.0
# A third of the people stand around something else, as at a tent or a car.
_GATHERED_SHARE = 0.35

LEAST_SIDE_PX = 5
"""Longest side of the smallest object that counts: a detector is neither taught nor measured on smaller ones."""
LEAST_VISIBLE = 0.35
"""Visible share of an object that counts."""
_LEAST_EDGE_SIDE_PX = 6
"""Shortest side of an object that counts and is cut by the picture's edge: less is a strip of something unknown."""


class Split(IntEnum):
    """What a scene is for. Each split has generators of its own, so no scene is in two of them."""

    TRAINING = 1
    CALIBRATION = 2
    EVALUATION = 3


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """A picture with the boxes (n, 4) of what it shows; labels (n,) are places in LABELS.

    `counts` (n,) is False for what is too small, too much hidden or cut off: neither right nor wrong to detect.
    """

    bgr: Pixels
    boxes_px: Floats
    labels: Counts
    counts: Bools


@dataclass(frozen=True, slots=True)
class View:
    """How a scene is looked at: the lens, and the ranges from which heights and tilts are drawn."""

    width_px: int = 640
    height_px: int = 480
    focal_px: tuple[float, float] = (380.0, 1000.0)
    # Lenses whose axis is not in the middle stand for parts of larger pictures.
    shifted_share: float = 0.4
    height_m: tuple[float, float] = (12.0, 100.0)
    tilt_deg: tuple[float, float] = (25.0, 90.0)


def generator_of(seed: int, split: Split, *path: int) -> np.random.Generator:
    """The generator of one scene: by its number, so any scene can be drawn without those before it."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, int(split), *path])))


def frames_of(
    random: np.random.Generator,
    frame_count: int,
    view: View,
    conditions: Conditions | None = None,
    *,
    empty: bool | None = None,
) -> Iterator[LabelledFrame]:
    """Pictures of one random scene; without `conditions` these are random too, and `empty` leaves the ground bare."""
    conditions = conditions or random_conditions(random)
    if empty is None:
        empty = random.random() < _EMPTY_SHARE
        # A vehicle that stands sees ground without structure.
        view = replace(view, height_m=_EMPTY_HEIGHTS_M) if empty and random.random() < 0.4 else view
    actors = _random_actors(random, empty)
    roads = _random_roads(random) if random.random() < 0.5 else ()
    simspec = simspec_with(actors, roads, root_seed=int(random.integers(2**31)))
    # A larger area has coarser ground, in which tufts of grass look more like people.
    side_m = float(random.uniform(*_AREA_SIDES_M))
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    area = Polygon(corners=tuple(Point(east_m=e * side_m, north_m=n * side_m) for e, n in corners))
    simspec = simspec.model_copy(update={"world": simspec.world.model_copy(update={"area": area})})
    kinds = list(GroundType)
    grass = random.random() < _GRASS_SHARE
    kind = GroundType.GRASS if grass else kinds[int(random.integers(len(kinds)))]
    lens = _random_lens(random, view)
    camera = RenderedCamera(
        stage_of(simspec, lens, conditions, kind), conditions, simspec.seeds, open_opencv_renderer
    )
    positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in actors]).reshape(-1, 3)
    headings = np.radians(np.array([actor.heading_deg for actor in actors], dtype=np.float64))
    names = [actor.asset for actor in actors]
    for number in range(frame_count):
        pose = _random_pose(random, view)
        frame = _labelled(camera, pose, positions, headings, names, number)
        if frame is not None:
            yield frame


def _labelled(
    camera: RenderedCamera,
    pose: CameraPose,
    positions_enu_m: Floats,
    headings_rad: Floats,
    assets: Sequence[str],
    number: int,
) -> LabelledFrame | None:
    frame = camera.capture(pose, positions_enu_m, headings_rad, number)
    if frame is None:
        return None
    actor_pixels = actors_in(frame.picture)
    boxes = np.array([pixels.box for pixels in actor_pixels], dtype=np.float64).reshape(-1, 4)
    visible = np.array([pixels.visible for pixels in actor_pixels], dtype=np.float64)
    shown = [ASSETS[assets[pixels.actor]].class_label for pixels in actor_pixels]
    labels = np.array([LABELS.index(label) for label in shown], dtype=np.int64)
    height_px, width_px = frame.bgr.shape[:2]
    counts = (visible >= LEAST_VISIBLE) & large_enough(boxes, width_px, height_px)
    return LabelledFrame(frame.bgr, boxes, labels, counts)


def mission_frames(
    split: Split,
    seed: int,
    frame_count: int,
    size_px: tuple[int, int],
    conditions: Conditions | None = None,
) -> Iterator[LabelledFrame]:
    """Pictures of each situation of campaigns/standard, its actors placed anew, from poses of its mission.

    From 0.6 to 1.1 of the mission's height, anywhere over the area, by its camera at another size. Without `conditions` in
    those of the situation. Equal seeds give the same scenes and poses under all.
    """
    for place_number, path in enumerate(sorted(SITUATIONS.glob("*.yaml"))):
        random = generator_of(seed, split, place_number)
        base = load_simspec(path)
        simspec = place(base.model_copy(update={"seeds": Seeds(root=int(random.integers(2**31)))}))
        camera_spec = simspec.vehicle.camera.model_copy(
            update={"width_px": size_px[0], "height_px": size_px[1]}
        )
        camera = open_camera(simspec, camera_spec, conditions=conditions or conditions_of(simspec))
        assert simspec.realized is not None
        placed = simspec.realized.actors
        positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in placed])
        headings = np.radians(np.array([actor.heading_deg for actor in placed]))
        names = [member.asset for member in cast_of(simspec)]
        corners = np.array([(corner.east_m, corner.north_m) for corner in simspec.world.area.corners])
        low, high = corners.min(axis=0), corners.max(axis=0)
        mission = simspec.mission
        for number in range(frame_count):
            tilt = math.radians(camera_spec.tilt_deg)
            height_m = mission.altitude_m * float(random.uniform(0.6, 1.1))
            target = np.array((*random.uniform(low, high), 0.0))
            velocity_mps = mission.speed_mps * float(random.random())
            yaw = float(random.uniform(0.0, 2.0 * math.pi))
            pose = _pose(target, height_m, tilt, yaw, 0.0, velocity_mps, random.normal(0.0, 0.05, 3))
            frame = _labelled(camera, pose, positions, headings, names, number)
            if frame is not None:
                yield frame


def large_enough(boxes_px: Floats, width_px: int, height_px: int) -> Bools:
    """(n,) whether boxes in a picture of that size are of objects that count."""
    sides = boxes_px[:, 2:] - boxes_px[:, :2]
    cut = (boxes_px[:, :2] <= 0.0).any(axis=1) | (boxes_px[:, 2:] >= (width_px, height_px)).any(axis=1)
    result: Bools = (sides.max(axis=1, initial=0.0) >= LEAST_SIDE_PX) & (
        ~cut | (sides.min(axis=1, initial=1e9) >= _LEAST_EDGE_SIDE_PX)
    )
    return result


def _random_actors(random: np.random.Generator, empty: bool) -> list[SceneActor]:
    """Assets on free places: groups and labels by their shares, the assets of a label equally often."""
    low, high = (8, 41) if random.random() < _SPARSE_SHARE else (40, 111)
    wanted = 0 if empty else int(random.integers(low, high))
    actors: list[SceneActor] = []
    taken = np.zeros((0, 3))
    groups = list(_GROUP_SHARES)
    for _ in range(wanted):
        group = groups[int(random.choice(len(groups), p=list(_GROUP_SHARES.values())))]
        of_group = [label for label in LABELS if GROUPS[label] == group]
        shares = np.array([_LABEL_SHARES.get(label, 1.0) for label in of_group])
        label = of_group[int(random.choice(len(of_group), p=shares / shares.sum()))]
        name = _choice(random, [name for name, asset in ASSETS.items() if asset.class_label == label])
        asset = ASSETS[name]
        # Half of the sides' mean: things may stand close, and their corners may touch.
        radius = 0.27 * (asset.length_m + asset.width_m)
        gathered = group == "person" and len(taken) and random.random() < _GATHERED_SHARE
        for _ in range(8):
            place = random.uniform(-_REACH_M, _REACH_M, 2)
            if gathered:
                host = taken[int(random.integers(len(taken)))]
                angle, gap = random.uniform(0.0, 2.0 * math.pi), random.uniform(0.2, 5.0)
                place = host[:2] + (host[2] + radius + gap) * np.array((math.cos(angle), math.sin(angle)))
            if (np.hypot(*(taken[:, :2] - place).T) > taken[:, 2] + radius).all():
                break
        else:
            continue
        taken = np.vstack((taken, (*place, radius)))
        hidden = float(random.uniform(0.1, 1.0)) if random.random() < 0.3 else 0.0
        east_m, north_m = place.tolist()
        actors.append(SceneActor(name, east_m, north_m, float(random.uniform(0.0, 360.0)), hidden))
    return actors


def _choice(random: np.random.Generator, names: list[str]) -> str:
    return names[int(random.integers(len(names)))]


def _random_roads(random: np.random.Generator) -> tuple[Road, ...]:
    roads = []
    for number in range(int(random.integers(1, 4))):
        angle, offset = random.uniform(0.0, math.pi), random.uniform(-50.0, 50.0)
        along = np.array((math.cos(angle), math.sin(angle)))
        across = np.array((-along[1], along[0])) * offset
        points = [
            across + along * step + random.uniform(-8.0, 8.0, 2) for step in (-120.0, -30.0, 30.0, 120.0)
        ]
        roads.append(
            Road(
                id=f"r{number}",
                width_m=float(random.uniform(2.5, 9.0)),
                points=tuple(Point(east_m=float(e), north_m=float(n)) for e, n in points),
            )
        )
    return tuple(roads)


def _random_lens(random: np.random.Generator, view: View) -> Lens:
    low, high = view.focal_px
    focal_px = low * (high / low) ** float(random.random())
    shift = random.uniform(-180.0, 180.0, 2) if random.random() < view.shifted_share else np.zeros(2)
    return Lens(
        "training",
        view.width_px,
        view.height_px,
        focal_px,
        focal_px,
        view.width_px / 2.0 + float(shift[0]),
        view.height_px / 2.0 + float(shift[1]),
    )


def _random_pose(random: np.random.Generator, view: View) -> CameraPose:
    """A camera that flies over the scene and looks at a place in it."""
    low, high = view.height_m
    height_m = low * (high / low) ** float(random.random())
    tilt = math.radians(float(random.uniform(*view.tilt_deg)))
    # A camera far away sees nothing that counts: it looks down more steeply instead.
    tilt = max(tilt, math.asin(min(1.0, height_m / _FARTHEST_M)))
    yaw = float(random.uniform(0.0, 2.0 * math.pi))
    roll = math.radians(float(random.normal(0.0, 5.0))) if random.random() < 0.3 else 0.0
    target = np.array((*random.uniform(-40.0, 40.0, 2), 0.0))
    turning = 0.4 if random.random() < 0.1 else 0.05
    velocity_mps = float(random.uniform(0.0, 14.0))
    return _pose(target, height_m, tilt, yaw, roll, velocity_mps, random.normal(0.0, turning, 3))


def _pose(
    target: Floats,
    height_m: float,
    tilt: float,
    yaw: float,
    roll: float,
    velocity_mps: float,
    rates_radps: Floats,
) -> CameraPose:
    """A camera that flies ahead and looks at a target on the ground; angles in radians."""
    ahead = np.array((math.sin(yaw), math.cos(yaw), 0.0))
    forward = ahead * math.cos(tilt) - np.array((0.0, 0.0, math.sin(tilt)))
    level = np.array((math.cos(yaw), -math.sin(yaw), 0.0))
    right = level * math.cos(roll) + np.cross(forward, level) * math.sin(roll)
    return CameraPose(
        START,
        target - forward * (height_m / math.sin(tilt)),
        np.array((right, np.cross(forward, right), forward)),
        ahead * velocity_mps,
        rates_radps,
    )


def weather(
    elevation_deg: float = 45.0,
    azimuth_deg: float = 150.0,
    *,
    fog_level: float = 0.0,
    rain_level: float = 0.0,
    dust_level: float = 0.0,
) -> Conditions:
    """Conditions with the extinction that a SimSpec has for these levels of fog and rain."""
    model = DetectionModel()
    return Conditions(
        math.radians(elevation_deg),
        math.radians(azimuth_deg),
        model.fog_extinction_per_m * fog_level**2 + model.rain_extinction_per_m * rain_level,
        rain_level,
        fog_level,
        dust_level,
    )


def random_conditions(random: np.random.Generator) -> Conditions:
    """Two fifths as campaigns have it: a sun above 5 degrees, fog up to level 4 and rain up to level 3, often both. The
    rest in heavy rain, fog or dust, at dusk, at night. Some of each with a camera that is noisy, dirty, badly exposed
    or too slow.
    """
    kind = int(random.choice(6, p=(0.4, 0.14, 0.12, 0.1, 0.12, 0.12)))
    elevation = float(random.uniform(5.0, 72.0))
    fog, rain, dust = (
        float(level) for level in random.uniform(0.0, (4.0, 3.0, 0.0)) * (random.random(3) < 0.65)
    )
    heavy = float(random.uniform(3.0, 9.0))
    if kind == 1:
        rain = heavy
    elif kind == 2:
        fog, rain = heavy, 0.0
    elif kind == 3:
        fog, rain, dust = 0.0, 0.0, 1.0 + (heavy - 3.0) * 8.0 / 6.0
    elif kind == 4:
        elevation = float(random.uniform(-25.0, -6.0))
    elif kind == 5:
        elevation = float(random.uniform(-6.0, 8.0))
    azimuth = float(random.uniform(0.0, 360.0))
    conditions = weather(elevation, azimuth, fog_level=fog, rain_level=rain, dust_level=dust)
    if random.random() < 0.15:
        conditions = replace(conditions, noise=float(0.5 * 12.0 ** random.random()))
    if random.random() < 0.15:
        conditions = replace(conditions, lens_dirt=float(random.uniform(0.1, 1.0)))
    if random.random() < 0.12:
        conditions = replace(conditions, exposure_ev=float(random.uniform(-1.5, 1.5)))
    if random.random() < 0.12:
        conditions = replace(conditions, shutter_s=float(1.0 / random.uniform(25.0, 120.0)))
    return conditions
