"""Sheets of every asset, every concealment, every kind of ground and every condition, for a person to look at."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from bench.arrays import Floats
from bench.clock import START
from bench.contracts import CameraPose, Lens, Pixels
from bench.simspec import (
    ASSETS,
    ActorGroup,
    PlacedActor,
    Point,
    Polygon,
    Realized,
    Road,
    Role,
    Seeds,
    SimSpec,
    World,
)

from ._camera import RenderedCamera, stage_of
from ._conditions import Conditions
from ._ground import GroundType
from ._renderer import open_opencv_renderer

_CELL_PX = (240, 180)
_LABEL_PX = 18
_FIELD_OF_VIEW = math.radians(40.0)

DAY = Conditions(sun_elevation_rad=math.radians(48.0), sun_azimuth_rad=math.radians(150.0))
"""Clear light from the south-east, in which the assets are shown."""


@dataclass(frozen=True, slots=True)
class SceneActor:
    """One thing of a scene on a sheet."""

    asset: str
    east_m: float
    north_m: float
    heading_deg: float = 0.0
    concealment: float = 0.0


def simspec_with(
    actors: Sequence[SceneActor], roads: tuple[Road, ...] = (), *, root_seed: int = 7
) -> SimSpec:
    """A realized SimSpec with these actors, each a group of its own, around the origin."""
    side = 60.0
    corners = tuple(Point(east_m=e * side, north_m=n * side) for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    groups = tuple(
        ActorGroup(
            id=f"g{index}",
            asset=actor.asset,
            role=Role.CLUTTER,
            count=1,
            concealment=actor.concealment,
        )
        for index, actor in enumerate(actors)
    )
    placed = tuple(
        PlacedActor(
            id=f"a{index}",
            group=f"g{index}",
            east_m=actor.east_m,
            north_m=actor.north_m,
            heading_deg=actor.heading_deg % 360.0,
        )
        for index, actor in enumerate(actors)
    )
    return SimSpec(
        name="sheet",
        world=World(area=Polygon(corners=corners), roads=roads),
        actors=groups,
        seeds=Seeds(root=root_seed),
        realized=Realized(actors=placed),
    )


def pose_towards(position_enu_m: Floats, target_enu_m: Floats) -> CameraPose:
    """A level camera at rest that looks at a point."""
    forward = target_enu_m - position_enu_m
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    axes = np.array((right, np.cross(forward, right), forward))
    return CameraPose(START, position_enu_m, axes, np.zeros(3), np.zeros(3))


def asset_sheet(columns: int = 6) -> Pixels:
    """Every asset: from low in front and from high behind, each in another posture where it has several."""
    cells = []
    for name, asset in ASSETS.items():
        size = max(asset.length_m, asset.width_m, asset.height_m)
        actors = [SceneActor(name, 0.0, 0.0, 200.0), SceneActor(name, 0.75 * size, -0.75 * size, 60.0)]
        lens = _lens(*_CELL_PX)
        distance = 2.9 * size / (2.0 * math.tan(_FIELD_OF_VIEW / 2.0)) / 1.25
        elevation = math.radians(38.0)
        offset = np.array((-0.25, -math.cos(elevation), math.sin(elevation))) * distance
        middle = np.array((0.375 * size, -0.375 * size, 0.4 * asset.height_m))
        picture = _shot(
            simspec_with(actors), lens, DAY, GroundType.GRASS, pose_towards(middle + offset, middle)
        )
        cells.append(_labelled(picture, f"{name} ({asset.class_label})"))
    return _grid(cells, columns)


def condition_sheet(columns: int = 4) -> Pixels:
    """One scene under every condition, over every kind of ground, and with every degree of concealment."""
    lens = _lens(320, 240)
    pose = pose_towards(np.array((-30.0, -62.0, 38.0)), np.array((1.0, 4.0, 0.0)))
    # Movement for the cells that show blur: 12 m/s ahead and a turn of half a radian in a second.
    moving = replace(
        pose, velocity_enu_mps=np.array((4.0, 11.0, 0.0)), rates_optical_radps=np.array((0.0, 0.5, 0.0))
    )
    scene = simspec_with(VILLAGE, VILLAGE_ROADS)
    cells = [
        _labelled(
            _shot(scene, lens, conditions, GroundType.GRASS, moving if "blur" in label else pose), label
        )
        for label, conditions in _CONDITIONS
    ]
    cells += [_labelled(_shot(scene, lens, DAY, kind, pose), f"ground: {kind}") for kind in GroundType]
    near = pose_towards(np.array((-8.0, -26.0, 17.0)), np.array((1.0, 0.0, 0.0)))
    for level in (0.0, 0.25, 0.5, 0.75, 1.0):
        hidden = simspec_with(
            [
                SceneActor("radar-vehicle", -4.0, 3.0, 60.0, level),
                SceneActor("tracked-vehicle", 7.0, 4.0, 120.0, level),
                SceneActor("soldier", -3.0, -6.0, 200.0, level),
                SceneActor("armed-person", 1.0, -7.0, 160.0, level),
            ]
        )
        cells.append(_labelled(_shot(hidden, lens, DAY, GroundType.GRASS, near), f"concealment {level:g}"))
    return _grid(cells, columns)


def _lens(width_px: int, height_px: int) -> Lens:
    focal_px = width_px / 2.0 / math.tan(_FIELD_OF_VIEW / 2.0)
    return Lens("sheet", width_px, height_px, focal_px, focal_px, width_px / 2.0, height_px / 2.0)


def _shot(simspec: SimSpec, lens: Lens, conditions: Conditions, kind: GroundType, pose: CameraPose) -> Pixels:
    """One picture, drawn at twice the size and halved, as a sheet shows more of a scene than a camera's pixels do."""
    fine = replace(
        lens,
        width_px=2 * lens.width_px,
        height_px=2 * lens.height_px,
        fx=2 * lens.fx,
        fy=2 * lens.fy,
        cx=2 * lens.cx,
        cy=2 * lens.cy,
    )
    camera = RenderedCamera(
        stage_of(simspec, fine, conditions, kind), conditions, simspec.seeds, open_opencv_renderer
    )
    assert simspec.realized is not None
    actors = simspec.realized.actors
    positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in actors]).reshape(-1, 3)
    headings = np.radians(np.array([actor.heading_deg for actor in actors], dtype=np.float64))
    frame = camera.capture(pose, positions, headings, 0)
    assert frame is not None
    return np.asarray(
        cv2.resize(frame.bgr, (lens.width_px, lens.height_px), interpolation=cv2.INTER_AREA), np.uint8
    )


def _labelled(picture: Pixels, label: str) -> Pixels:
    strip = np.full((_LABEL_PX, picture.shape[1], 3), 32, np.uint8)
    cv2.putText(strip, label, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (240, 240, 240), 1, cv2.LINE_AA)
    return np.concatenate((picture, strip))


def _grid(cells: Iterable[Pixels], columns: int) -> Pixels:
    cells = list(cells)
    while len(cells) % columns:
        cells.append(np.full_like(cells[0], 32))
    return np.concatenate(
        [np.concatenate(cells[row : row + columns], axis=1) for row in range(0, len(cells), columns)]
    )


def _sun(elevation_deg: float, azimuth_deg: float) -> Conditions:
    return Conditions(math.radians(elevation_deg), math.radians(azimuth_deg))


_CONDITIONS = (
    ("noon", _sun(62.0, 180.0)),
    ("afternoon, sun 30 deg", _sun(30.0, 250.0)),
    ("sun 12 deg", _sun(12.0, 280.0)),
    ("sunset, sun 3 deg", _sun(3.0, 300.0)),
    ("dusk, sun -4 deg", _sun(-4.0, 305.0)),
    ("night, sun -20 deg", _sun(-20.0, 340.0)),
    ("fog level 5", replace(DAY, fog_level=5.0, extinction_per_m=0.003)),
    ("fog level 9", replace(DAY, fog_level=9.0, extinction_per_m=0.0098)),
    ("rain level 3", replace(DAY, rain_level=3.0, extinction_per_m=0.0006)),
    ("rain level 9", replace(DAY, rain_level=9.0, extinction_per_m=0.0018)),
    ("dust level 5", replace(DAY, dust_level=5.0)),
    ("dust level 9", replace(DAY, dust_level=9.0)),
    ("exposure -1.5 EV", replace(DAY, exposure_ev=-1.5)),
    ("exposure +1.5 EV", replace(DAY, exposure_ev=1.5)),
    ("motion blur, 1/30 s", replace(DAY, shutter_s=1.0 / 30.0)),
    ("sensor noise x 6", replace(DAY, noise=6.0)),
    ("dirty lens 0.4", replace(DAY, lens_dirt=0.4)),
    ("dirty lens 1", replace(DAY, lens_dirt=1.0)),
)


def _road(name: str, width_m: float, *points: tuple[float, float]) -> Road:
    return Road(id=name, width_m=width_m, points=tuple(Point(east_m=e, north_m=n) for e, n in points))


VILLAGE_ROADS = (
    _road("main", 7.0, (-80.0, -8.0), (0.0, -4.0), (90.0, 2.0)),
    _road("lane", 4.0, (8.0, -4.0), (4.0, 40.0), (12.0, 90.0)),
)
VILLAGE = (
    SceneActor("house", 20.0, 14.0, 95.0),
    SceneActor("house", -12.0, 14.0, 80.0),
    SceneActor("apartment-block", 26.0, 40.0, 10.0),
    SceneActor("shed", -22.0, 5.0, 0.0),
    SceneActor("tree", -5.0, 22.0),
    SceneActor("tree", 14.0, 27.0, 70.0),
    SceneActor("tree", -18.0, -20.0, 30.0),
    SceneActor("conifer", -26.0, 22.0, 10.0),
    SceneActor("conifer", -30.0, 14.0, 60.0),
    SceneActor("bush", 11.0, 8.0, 20.0),
    SceneActor("bus", 8.0, -5.5, 266.0),
    SceneActor("civilian-car", -8.0, -6.4, 87.0),
    SceneActor("pickup", -20.0, -7.0, 87.0),
    SceneActor("military-truck", 3.5, 10.0, 355.0),
    SceneActor("tent", 14.0, -17.0, 30.0),
    SceneActor("ambulance", 5.0, -16.0, 120.0),
    SceneActor("cow", -12.0, -18.0, 40.0),
    SceneActor("sheep", -9.0, -20.0, 100.0),
    SceneActor("man", -2.0, 1.5, 150.0),
    SceneActor("woman", -0.5, 2.5, 30.0),
    SceneActor("child", -1.0, 1.0, 200.0),
    SceneActor("aid-worker", 10.0, -14.0, 250.0),
    SceneActor("soldier", 6.0, 6.0, 190.0),
    SceneActor("crate-stack", 19.0, -12.0, 15.0),
)
