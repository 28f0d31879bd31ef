"""Small stages, poses, and an independent picture of them by ray casting."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bench.arrays import Floats
from bench.camera import Conditions, light_of_conditions, look_of
from bench.clock import START
from bench.contracts import CameraPose, CastMember, Ground, Labels, Lens, Look, Stage
from bench.simspec import ActorGroup, Role

NOON = Conditions(math.radians(60.0), math.radians(180.0))
DARK_SKY = Conditions(math.radians(-20.0), 0.0)
PLAIN_BGR = (60, 110, 90)

Placement = tuple[str, float, float, float]
"""Asset, east in metres, north in metres, heading in degrees."""


def lens(width_px: int = 320, height_px: int = 240, focal_px: float = 300.0) -> Lens:
    """A lens whose axis does not pass through the middle of the picture."""
    return Lens(
        "test", width_px, height_px, focal_px, focal_px * 1.01, width_px / 2 + 3.5, height_px / 2 - 2.25
    )


def flat_ground() -> Ground:
    """Ground without any structure."""
    texture = np.full((64, 64, 3), PLAIN_BGR, np.uint8)
    return Ground(texture, 10.0, -320.0, 320.0, np.full((512, 512), 128, np.uint8), 0.05)


def member(asset: str) -> CastMember:
    return CastMember.of("a", ActorGroup(id="g", asset=asset, role=Role.CLUTTER, count=1))


def look(asset: str, seed: int = 0, concealment: float = 0.0) -> Look:
    return look_of(member(asset), concealment, np.random.default_rng(seed), np.array(PLAIN_BGR, float))


def stage(
    placements: Sequence[Placement], conditions: Conditions = NOON, camera: Lens | None = None
) -> tuple[Stage, Floats, Floats]:
    """A stage on flat ground, with the positions and headings of its actors."""
    looks = tuple(look(asset, seed) for seed, (asset, *_) in enumerate(placements))
    positions = np.array([(east, north, 0.0) for _, east, north, _ in placements]).reshape(-1, 3)
    headings = np.radians(np.array([heading for *_, heading in placements], dtype=np.float64))
    return (
        Stage(camera or lens(), flat_ground(), light_of_conditions(conditions), looks),
        positions,
        headings,
    )


def pose(
    position_enu_m: Sequence[float], yaw_deg: float, tilt_deg: float, roll_deg: float = 0.0
) -> CameraPose:
    """A camera at rest: heading clockwise from north, tilted below the horizon, rolled clockwise."""
    # Level and north: optical right is east, down is down, forward is north. Then yaw, tilt and roll, by scipy.
    level = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)))
    turn = Rotation.from_euler("ZXY", (-yaw_deg, -tilt_deg, roll_deg), degrees=True)
    return CameraPose(START, np.array(position_enu_m, float), turn.apply(level), np.zeros(3), np.zeros(3))


def cast_rays(
    stage: Stage, pose: CameraPose, positions: Floats, headings: Floats
) -> tuple[Labels, NDArray[np.float64]]:
    """(h, w) instances and depths by intersecting the ray of each pixel with every solid, taken as half-spaces.

    It shares the geometry with the renderer, and nothing of its projection, order or filling.
    """
    camera = stage.lens
    x, y = np.meshgrid(
        (np.arange(camera.width_px) + 0.5 - camera.cx) / camera.fx,
        (np.arange(camera.height_px) + 0.5 - camera.cy) / camera.fy,
    )
    rays = np.stack((x, y, np.ones_like(x)), axis=-1).reshape(-1, 3) @ pose.axes_enu
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(rays[:, 2] < 0, -pose.position_enu_m[2] / rays[:, 2], np.inf)
        nearest, labels = ground, np.zeros(len(rays), np.uint16)
        for actor, body in enumerate(stage.looks):
            turn = Rotation.from_euler("Z", math.pi / 2 - headings[actor])
            start = turn.inv().apply(pose.position_enu_m - positions[actor])
            along = turn.inv().apply(rays)
            shape = body.geometry
            middle, reach = shape.corners_m.reshape(-1, 3).mean(axis=0), np.abs(shape.corners_m).max() * 1.8
            # Rays that pass the actor by far are spared, for speed alone.
            off = np.linalg.norm(np.cross(along, start - middle), axis=1) / np.linalg.norm(along, axis=1)
            close_by = np.flatnonzero(off < reach)
            along = along[close_by]
            for solid in range(int(shape.solids.max()) + 1):
                faces = (shape.solids == solid) & ~shape.details
                normals, corners = shape.normals[faces], shape.corners_m[faces, 0]
                speed = along @ normals.T
                height = ((start - corners) * normals).sum(axis=1)
                crossing = -height / speed
                enter = np.where(speed < 0, crossing, -np.inf).max(axis=1)
                leave = np.where(speed > 0, crossing, np.inf).min(axis=1)
                # A ray along a plane is inside of it or misses the solid.
                outside = ((speed == 0) & (height > 0)).any(axis=1)
                hit = (enter < leave) & (enter > 0) & (enter < nearest[close_by]) & ~outside
                nearest[close_by[hit]] = enter[hit]
                labels[close_by[hit]] = actor + 1
    shape_px = (camera.height_px, camera.width_px)
    return labels.reshape(shape_px).astype(np.uint16), nearest.reshape(shape_px)
