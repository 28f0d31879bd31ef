"""The plain scene: flat ground, upright boxes with their own seeded motion, one camera. No pixels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.contracts import START, CameraFrame, Scene, SimTime, VehicleState, cast_of, realized_of
from bench.simspec import Camera, SimSpec, generator

from ._camera import PinholeCamera
from ._motion import ActorMotion, WalkableGround, WalkLeg, between, patrol, wander
from ._visibility import Bodies, sightings


def open_plain_scene(simspec: SimSpec) -> Scene:
    """The scene of a realized SimSpec, at time zero.

    Raises SetupError when it has no realization, or one that does not fit.
    """
    return PlainScene(simspec)


class PlainScene:
    """The contracts `Scene` and `ObservesCameras` over arrays. docs/scene.md describes it."""

    def __init__(self, simspec: SimSpec) -> None:
        self.cast = cast_of(simspec)
        self._bodies = Bodies.of(self.cast)
        self._camera = PinholeCamera.of(simspec.vehicle.camera)
        self._further: dict[str, PinholeCamera] = {}
        self._motion = _actor_motion(simspec, self._bodies)
        self._now = START
        self._foot_points_enu_m = self._foot_points()

    def advance(self, to: SimTime) -> None:
        if to < self._now:
            raise ValueError(f"the scene is at {self._now.s} s and cannot go back to {to.s} s")
        self._now = to
        self._motion.advance(to.s)
        self._foot_points_enu_m = self._foot_points()

    def positions(self) -> NDArray[np.float64]:
        return self._foot_points_enu_m

    def headings(self) -> NDArray[np.float64]:
        return self._motion.headings_rad()

    def observe(self, state: VehicleState, number: int) -> CameraFrame:
        return self._frame(self._camera, state, number)

    def observe_with(self, camera: Camera, state: VehicleState, number: int) -> CameraFrame:
        pinhole = self._further.get(camera.name)
        if pinhole is None:
            pinhole = self._further[camera.name] = PinholeCamera.of(camera)
        return self._frame(pinhole, state, number)

    def _frame(self, camera: PinholeCamera, state: VehicleState, number: int) -> CameraFrame:
        visible = sightings(camera, state, self._bodies, self._foot_points_enu_m, self._motion.headings_rad())
        return CameraFrame(number, camera.name, self._now, visible)

    def _foot_points(self) -> NDArray[np.float64]:
        foot_points = np.zeros((len(self.cast), 3))
        foot_points[:, :2] = self._motion.positions_m()
        foot_points.flags.writeable = False
        return foot_points


def _actor_motion(simspec: SimSpec, bodies: Bodies) -> ActorMotion:
    actors = realized_of(simspec).actors
    motions = {group.id: group.motion for group in simspec.actors}
    starts = np.array([(actor.east_m, actor.north_m) for actor in actors], dtype=np.float64).reshape(-1, 2)
    headings = np.radians(np.array([actor.heading_deg for actor in actors], dtype=np.float64))
    # Only what stands still closes the ground: plans must not depend on where others are now.
    walls = bodies.solid & np.array(
        [motions[actor.group].kind == "still" for actor in actors], dtype=np.bool_
    )
    ground = WalkableGround.of(simspec.world.area, starts[walls], headings[walls], bodies.half_m[walls, :2])
    plans: dict[int, Iterator[WalkLeg]] = {}
    for index, actor in enumerate(actors):
        motion = motions[actor.group]
        if motion.kind == "still":
            continue
        start = (actor.east_m, actor.north_m)
        # A patrol may lead anywhere; a wanderer stays in its disc.
        reach_m = motion.radius_m if motion.kind == "wander" else np.inf
        reachable_ground = ground.around(start, reach_m, float(bodies.half_m[index, 1]))
        walk = wander if motion.kind == "wander" else patrol
        plan = walk(start, motion, reachable_ground, generator(simspec.seeds, "motion", index))
        halt_s = np.inf if motion.halt_s is None else motion.halt_s
        plans[index] = between(plan, start, motion.depart_s, halt_s)
    return ActorMotion(starts, headings, plans)
