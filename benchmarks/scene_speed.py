"""CPU microseconds of one look and of one detector frame, over casts of several sizes.

python benchmarks/scene_speed.py [ACTORS ...]

The vehicle circles at 60 m over the default camera; a sixth of the cast are solid houses and trees, the rest
walk.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from bench.contracts import SimTime, VehicleState
from bench.perception import open_detector
from bench.simspec import ActorGroup, Motion, PlacedActor, Point, Polygon, Realized, Role, SimSpec, World
from bench.simulation import open_plain_scene

FRAMES = 400
SIDE_M = 500.0
KINDS = (("house", 12), ("tree", 12), ("soldier", 6), ("civilian-car", 6), ("civilian", 1))


def crowded(actors: int) -> SimSpec:
    """A realized SimSpec of a square with `actors` on it."""
    rng = np.random.default_rng(actors)
    counts = {asset: actors // share for asset, share in KINDS}
    counts["civilian"] = actors - sum(counts.values()) + counts["civilian"]
    groups = tuple(
        ActorGroup(
            id=asset,
            asset=asset,
            role=Role.BYSTANDER,
            count=count,
            motion=Motion() if asset in ("house", "tree") else Motion(kind="wander"),
        )
        for asset, count in counts.items()
    )
    placed = tuple(
        PlacedActor(id=f"{asset}-{number}", group=asset, east_m=east, north_m=north, heading_deg=heading)
        for asset, count in counts.items()
        for number in range(count)
        for east, north, heading in [
            (*rng.uniform(-SIDE_M / 2, SIDE_M / 2, 2).tolist(), float(rng.uniform(0.0, 360.0)))
        ]
    )
    corners = tuple(
        Point(east_m=a * SIDE_M / 2, north_m=b * SIDE_M / 2) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    )
    return SimSpec(
        name="crowded",
        world=World(area=Polygon(corners=corners)),
        actors=groups,
        realized=Realized(actors=placed),
    )


def measure(actors: int) -> str:
    """One line of the table."""
    simspec = crowded(actors)
    began = time.process_time()
    scene = open_plain_scene(simspec)
    opening_ms = (time.process_time() - began) * 1e3
    detector = open_detector(simspec, scene.cast)
    spent = np.zeros(3)
    sighted = detected = 0
    for number in range(FRAMES):
        now = SimTime(number * 200_000_000)
        angle = number * 0.05
        place = (150.0 * math.sin(angle), 150.0 * math.cos(angle), 60.0)
        state = VehicleState(now, place, (0.0, 0.0, 0.0), 0.0, 0.0, angle + math.pi / 2.0)
        marks = [time.process_time()]
        scene.advance(now)
        marks.append(time.process_time())
        frame = scene.observe(state, number)
        marks.append(time.process_time())
        detector.process(frame)
        results = detector.due(now)
        marks.append(time.process_time())
        spent += np.diff(marks)
        sighted += len(frame.sightings)
        detected += sum(len(result.detections) for result in results)
    advance, look, detect = spent / FRAMES * 1e6
    return f"{actors:6d} {opening_ms:9.1f} {advance:11.1f} {look:9.1f} {detect:12.1f} {sighted / FRAMES:9.1f} {detected / FRAMES:10.1f}"


def main() -> None:
    """Print the table."""
    print("actors  open, ms  advance, us  look, us  detector, us  in view  detections")
    for actors in map(int, sys.argv[1:] or ("60", "150", "1000")):
        print(measure(actors))


if __name__ == "__main__":
    main()
