"""Made camera frames over a cast, and what a detector makes of them, for the tests of perception."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench.contracts import CameraFrame, DetectionFrame, Sighting, SimTime, Tape, cast_of
from bench.perception import open_detector
from bench.simspec import SimSpec

PERIOD_NS = 200_000_000
PERIOD_S = PERIOD_NS / 1e9


def made_spec(assets: Sequence[str], model: Mapping[str, Any], *, seed: int = 0) -> SimSpec:
    """One actor for each asset, in a clear day; the model makes no false detections unless it says so."""
    kinds = list(dict.fromkeys(assets))
    corners = [(-300, -300), (300, -300), (300, 300), (-300, 300)]
    actors = [
        {"id": f"a{index}", "group": kind, "east_m": 2.0 * index, "north_m": 0.0, "heading_deg": 0.0}
        for index, kind in enumerate(assets)
    ]
    return SimSpec.model_validate(
        {
            "name": "views",
            "world": {"area": {"corners": [{"east_m": east, "north_m": north} for east, north in corners]}},
            "actors": [
                {"id": kind, "asset": kind, "role": "clutter", "count": assets.count(kind)} for kind in kinds
            ],
            "perception": {"model": {"false_per_frame": 0.0, **model}},
            "seeds": {"root": seed},
            "realized": {"actors": actors},
        }
    )


def grid_frame(number: int, heights_px: Sequence[float], *, first: int = 0) -> CameraFrame:
    """One sighting for each height, in cells of a grid so wide that boxes identify their actors."""
    columns = 10
    sightings = []
    for index, height_px in enumerate(heights_px):
        x, y = 70.0 + 124.0 * (index % columns), 60.0 + 110.0 * (index // columns)
        box = (x - height_px / 4.0, y - height_px / 2.0, x + height_px / 4.0, y + height_px / 2.0)
        sightings.append(Sighting(first + index, 80.0, height_px, 1.0, box))
    return CameraFrame(number, "front", SimTime(number * PERIOD_NS), tuple(sightings))


def steady_frames(frames: int, actors: int, height_px: float) -> list[CameraFrame]:
    """Every actor in every frame, always of one size."""
    return [grid_frame(number, [height_px] * actors) for number in range(frames)]


def breathing_frames(frames: int, actors: int, seed: int = 0) -> list[CameraFrame]:
    """Every actor in every frame, its size between 5 and 90 pixels, as when the vehicle comes and goes."""
    rng = np.random.default_rng(seed)
    phase, pace = rng.uniform(0.0, 2.0 * math.pi, actors), rng.uniform(0.05, 0.25, actors)
    return [
        grid_frame(number, np.exp(np.log(21.0) + 1.44 * np.sin(phase + pace * PERIOD_S * number)).tolist())
        for number in range(frames)
    ]


def detections_of(simspec: SimSpec, frames: Sequence[CameraFrame]) -> list[DetectionFrame]:
    """All results of a detector that processed these frames."""
    detector = open_detector(simspec, cast_of(simspec))
    for frame in frames:
        detector.process(frame)
    return list(detector.due(SimTime(10**15)))


def made_tape(simspec: SimSpec, frames: Sequence[CameraFrame]) -> Tape:
    """A tape of these frames and of what the SimSpec's detector makes of them."""
    nothing = np.zeros(0)
    return Tape(
        cast=cast_of(simspec),
        vehicle_time_s=np.array([0.0, frames[-1].exposed.s + 60.0]),
        vehicle_position_enu_m=np.zeros((2, 3)),
        vehicle_velocity_enu_mps=np.zeros((2, 3)),
        actor_time_s=nothing,
        actor_position_enu_m=np.zeros((0, len(cast_of(simspec)), 3)),
        frames=tuple(frames),
        detections=tuple(detections_of(simspec, frames)),
    )


def actor_at(box: tuple[float, float, float, float]) -> int:
    """The actor in whose cell of the grid the middle of a box lies."""
    x, y = (box[0] + box[2]) / 2.0, (box[1] + box[3]) / 2.0
    return round((x - 70.0) / 124.0) + 10 * round((y - 60.0) / 110.0)
