"""Sheets of every asset, every concealment, every kind of ground and every condition, for a person to look at."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bench.arrays import Floats
from bench.clock import START
from bench.contracts import CameraPose, Ground, Lens, OpenRenderer, Pixels
from bench.documents import parse_text
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
from ._ground import GroundType, ground_of
from ._renderer import open_opencv_renderer

_SHEET_PX = 1440
_ASSET_PX, _SCENE_PX = (240, 180), (288, 216)
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


def draw_sheet(open_renderer: OpenRenderer = open_opencv_renderer) -> Pixels:
    """Every asset, then one scene under every condition, on every ground, and with every degree of concealment."""
    return np.concatenate((asset_sheet(open_renderer=open_renderer), condition_sheet(open_renderer)))


def asset_sheet(
    names: Sequence[str] = tuple(ASSETS), open_renderer: OpenRenderer = open_opencv_renderer
) -> Pixels:
    """Assets of the catalogue, each twice, seen obliquely from above: from in front and from behind."""
    cells = []
    for name in names:
        asset = ASSETS[name]
        length, width, height = asset.length_m, asset.width_m, asset.height_m
        step = 0.42 * (max(length, width) + 0.5 * (width + height))
        actors = [SceneActor(name, -step / 2, step / 2, 200.0), SceneActor(name, step / 2, -step / 2, 60.0)]
        radius = 0.62 * step + 0.5 * math.hypot(length, width, height)
        distance = 1.02 * radius / math.tan(_FIELD_OF_VIEW / 2.0)
        elevation = math.radians(36.0)
        offset = np.array((-0.3, -math.cos(elevation), math.sin(elevation))) * distance
        middle = np.array((0.0, 0.0, 0.45 * height))
        picture = _shot(
            simspec_with(actors),
            _ASSET_PX,
            replace(DAY, noise=0.0),
            GroundType.GRAVEL,
            pose_towards(middle + offset, middle),
            open_renderer,
            2,
        )
        cells.append(_labelled(picture, f"{name} ({asset.class_label})"))
    return _grid(cells)


def condition_sheet(open_renderer: OpenRenderer = open_opencv_renderer) -> Pixels:
    """One village under every condition and on every ground, and four actors at every degree of concealment."""
    pose = pose_towards(np.array((-26.0, -54.0, 34.0)), np.array((1.0, 3.0, 0.0)))
    # For the cells that show blur: 12 m/s ahead, and a turn of a fifth of a radian in a second.
    moving = replace(
        pose, velocity_enu_mps=np.array((4.0, 11.0, 0.0)), rates_optical_radps=np.array((0.0, 0.2, 0.0))
    )
    village = simspec_with(VILLAGE, VILLAGE_ROADS)
    cells = [
        _labelled(
            _shot(
                village,
                _SCENE_PX,
                conditions,
                GroundType.GRASS,
                moving if "blur" in label else pose,
                open_renderer,
            ),
            label,
        )
        for label, conditions in _conditions()
    ]
    cells += [
        _labelled(_shot(village, _SCENE_PX, DAY, kind, pose, open_renderer), f"ground: {kind}")
        for kind in GroundType
    ]
    close_by = pose_towards(np.array((-8.0, -26.0, 17.0)), np.array((1.0, 0.0, 0.0)))
    for level in (0.0, 0.25, 0.5, 0.75, 1.0):
        hidden = simspec_with(
            [
                SceneActor("radar-vehicle", -4.0, 3.0, 60.0, level),
                SceneActor("tracked-vehicle", 7.0, 4.0, 120.0, level),
                SceneActor("soldier", -3.0, -6.0, 200.0, level),
                SceneActor("armed-person", 1.0, -7.0, 160.0, level),
            ]
        )
        cells.append(
            _labelled(
                _shot(hidden, _SCENE_PX, DAY, GroundType.GRASS, close_by, open_renderer, 2),
                f"concealment {level:g}",
            )
        )
    return _grid(cells)


def _shot(
    simspec: SimSpec,
    size_px: tuple[int, int],
    conditions: Conditions,
    kind: GroundType,
    pose: CameraPose,
    open_renderer: OpenRenderer,
    finer: int = 1,
) -> Pixels:
    """One picture. What is about shapes is drawn `finer` and shrunk; noise, rain and blur are shown as they are."""
    width_px, height_px = size_px[0] * finer, size_px[1] * finer
    focal_px = width_px / 2.0 / math.tan(_FIELD_OF_VIEW / 2.0)
    lens = Lens("sheet", width_px, height_px, focal_px, focal_px, width_px / 2.0, height_px / 2.0)
    stage = stage_of(simspec, lens, conditions, ground=_ground(kind, simspec.world.area, simspec.world.roads))
    camera = RenderedCamera(stage, conditions, simspec.seeds, open_renderer)
    assert simspec.realized is not None
    actors = simspec.realized.actors
    positions = np.array([(actor.east_m, actor.north_m, 0.0) for actor in actors]).reshape(-1, 3)
    headings = np.radians(np.array([actor.heading_deg for actor in actors], dtype=np.float64))
    frame = camera.capture(pose, positions, headings, 0)
    assert frame is not None
    if finer == 1:
        return frame.bgr
    return np.asarray(cv2.resize(frame.bgr, size_px, interpolation=cv2.INTER_AREA), np.uint8)


@cache
def _ground(kind: GroundType, area: Polygon, roads: tuple[Road, ...]) -> Ground:
    return ground_of(area, roads, kind, np.random.Generator(np.random.PCG64(1)))


def _conditions() -> Iterator[tuple[str, Conditions]]:
    for label, fields in _TABLES["conditions"].items():
        if "sun_deg" in fields:
            yield label, Conditions(*map(math.radians, fields["sun_deg"]))
        else:
            yield label, replace(DAY, **fields)


def _labelled(picture: Pixels, label: str) -> Pixels:
    strip = np.full((_LABEL_PX, picture.shape[1], 3), 32, np.uint8)
    cv2.putText(strip, label, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (240, 240, 240), 1, cv2.LINE_AA)
    return np.concatenate((picture, strip))


def _grid(cells: list[Pixels]) -> Pixels:
    """Rows of cells as wide as the sheet, the last one filled up."""
    columns = _SHEET_PX // cells[0].shape[1]
    empty = [np.full_like(cells[0], 32)] * (-len(cells) % columns)
    every = [*cells, *empty]
    return np.concatenate(
        [np.concatenate(every[row : row + columns], axis=1) for row in range(0, len(every), columns)]
    )


_TABLES: dict[str, Any] = parse_text(Path(__file__).with_suffix(".yaml").read_text("utf-8"))[0]
VILLAGE_ROADS = tuple(Road.model_validate(road) for road in _TABLES["roads"])
VILLAGE = tuple(SceneActor(*row) for row in _TABLES["village"])
