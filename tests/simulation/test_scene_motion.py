"""Actor motion is seeded, bounded, and independent of how often positions are read."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scene_simspecs import scene_simspec, square

from bench.contracts import SimTime, cast_of, convoy_places_m, escort_document
from bench.errors import SetupError
from bench.simspec import ActorGroup, Escort, Motion, Point, Polygon, Role, SimSpec
from bench.simulation import open_plain_scene
from bench.simulation._box_intersection import crosses_box, crosses_rectangle

WANDER = Motion(kind="wander", speed_mps=2.0, radius_m=20.0, pause_s=3.0)
CIVILIANS = [("civilian", 10.0 * a, 10.0 * b, 30.0 * (a + 3)) for a in range(-3, 4) for b in range(-3, 4)]


WANDERERS = scene_simspec(CIVILIANS, motion=WANDER)


def points(*places_m: tuple[float, float]) -> tuple[Point, ...]:
    return tuple(Point(east_m=east_m, north_m=north_m) for east_m, north_m in places_m)


def poses_at(simspec: SimSpec, seconds: list[float]) -> NDArray[np.float64]:
    """East, north, up and heading of each actor at each time; shape (times, actors, 4)."""
    scene = open_plain_scene(simspec)
    rows = []
    for moment in seconds:
        scene.advance(SimTime(round(moment * 1e9)))
        rows.append(np.column_stack((scene.positions(), scene.headings())))
    return np.array(rows)


def poses_every(simspec: SimSpec, until_s: float, step_s: float) -> NDArray[np.float64]:
    return poses_at(simspec, np.arange(0.0, until_s + step_s / 2, step_s).tolist())


def test_positions_do_not_depend_on_the_step_size() -> None:
    fine = poses_every(WANDERERS, 120.0, 0.05)[-1]
    assert np.array_equal(fine, poses_at(WANDERERS, [0.3, 47.1, 120.0])[-1])
    assert np.array_equal(fine, poses_at(WANDERERS, [120.0])[-1])


def test_motion_depends_on_the_motion_seed_alone() -> None:
    """Another motion seed moves actors elsewhere, other seeds do not; each actor has its own stream."""

    def ends(**seeds: int) -> NDArray[np.float64]:
        seeded = WANDERERS.model_copy(update={"seeds": WANDERERS.seeds.model_copy(update=seeds)})
        (poses,) = poses_at(seeded, [60.0])
        return np.asarray(poses)

    usual = ends()
    assert np.array_equal(usual, ends(perception=99, placement=7))
    assert not np.isclose(usual, ends(motion=99)).all(axis=1).any()
    starts = np.array([placement[1:3] for placement in CIVILIANS])
    assert len(np.unique(np.round(usual[:, :2] - starts, 6), axis=0)) == len(CIVILIANS)
    # A longer cast does not redraw the rest.
    more = scene_simspec([*CIVILIANS, ("civilian", 90.0, 90.0, 0.0)], motion=WANDER)
    assert np.array_equal(usual, poses_at(more, [60.0])[0][:-1])


def test_wanderers_stay_in_their_disc_below_their_speed_and_on_the_ground() -> None:
    """No actor leaves its disc, exceeds its speed, leaves the ground or stops for good; actors do pause."""
    path = poses_every(WANDERERS, 300.0, 0.25)
    starts = path[0, :, :2]
    away = np.hypot(*(path[..., :2] - starts).transpose(2, 0, 1))
    pace = np.hypot(*np.diff(path[..., :2], axis=0).transpose(2, 0, 1)) / 0.25

    assert away.max() <= 20.0 + 1e-9
    assert away.max() > 15.0
    assert pace.max() <= 2.0 + 1e-9
    assert (pace.max(axis=0) > 1.9).all()
    assert 0.05 < (pace == 0.0).mean() < 0.6
    assert (path[..., 2] == 0.0).all()


def test_headings_follow_the_direction_of_motion() -> None:
    path = poses_every(WANDERERS, 60.0, 0.1)
    step = np.diff(path[..., :2], axis=0)
    straight = (path[:-1, :, 3] == path[1:, :, 3]) & (np.hypot(step[..., 0], step[..., 1]) > 0.19)
    bearing = np.arctan2(step[..., 0], step[..., 1]) % (2 * np.pi)
    error = np.abs((bearing - path[1:, :, 3] + np.pi) % (2 * np.pi) - np.pi)

    assert straight.any()
    assert error[straight].max() < 1e-6


def test_still_actors_keep_their_realized_pose() -> None:
    path = poses_every(scene_simspec(CIVILIANS), 100.0, 25.0)
    assert (path == path[0]).all()
    assert path[0, :, :2].tolist() == [[east_m, north_m] for _, east_m, north_m, _ in CIVILIANS]
    assert path[0, :, 3] == pytest.approx(np.radians([heading for *_, heading in CIVILIANS]) % (2 * math.pi))


def test_wanderers_stay_inside_a_concave_area() -> None:
    """In an L-shaped area no leg cuts the corner."""
    area = Polygon(corners=points((0, 0), (100, 0), (100, 30), (30, 30), (30, 100), (0, 100)))
    walkers = [("civilian", e, n, 0.0) for e, n in itertools.product((5.0, 15.0, 25.0), (5.0, 15.0, 25.0))]
    motion = Motion(kind="wander", speed_mps=5.0, radius_m=80.0, pause_s=0.5)

    path = poses_every(scene_simspec(walkers, motion=motion, area=area), 400.0, 0.5)
    east, north = path[..., 0], path[..., 1]

    assert (east > -1e-6).all()
    assert (north > -1e-6).all()
    assert (np.minimum(east, north) < 30.0 + 1e-6).all()
    assert (np.maximum(east, north) > 60.0).any()


def test_walkers_go_round_solid_houses() -> None:
    people = [("civilian", 12.0 * math.sin(a), 12.0 * math.cos(a), 0.0) for a in np.linspace(0, 6, 12)]
    simspec = scene_simspec(
        [("house", 0.0, 0.0, 30.0), *people],
        motion=Motion(kind="wander", speed_mps=3.0, radius_m=30.0, pause_s=0.1),
    )
    path = poses_every(simspec, 600.0, 0.2)[:, 1:, :2]
    heading = math.radians(30.0)
    ahead = path @ np.array([math.sin(heading), math.cos(heading)])
    aside = path @ np.array([math.cos(heading), -math.sin(heading)])
    inside = (np.abs(ahead) < 6.0) & (np.abs(aside) < 4.5)

    assert not inside.any()
    assert (np.hypot(*np.ptp(path, axis=0).T) > 10.0).all()
    assert ahead.min() < -10.0
    assert ahead.max() > 10.0


@pytest.mark.parametrize(
    ("east_m", "motion"),
    [
        (0.0, WANDER),
        (30.0, Motion(kind="patrol", speed_mps=5.0, pause_s=0.0, route=points((0, 0), (1, 1)))),
    ],
    ids=["inside the house", "a patrol whose points are inside"],
)
def test_an_actor_without_a_way_stays_in_place(east_m: float, motion: Motion) -> None:
    """The search for a free leg ends in bounded time."""
    placements = [("house", 0.0, 0.0, 0.0), ("civilian", east_m, 0.0, 0.0)]
    assert poses_at(scene_simspec(placements, motion=motion), [600.0])[0, 1, :2].tolist() == [east_m, 0.0]


def test_an_actor_against_a_wall_can_walk_away() -> None:
    """A civilian closer to a house than its half width still leaves, and not through the house."""
    simspec = scene_simspec([("house", 0.0, 0.0, 0.0), ("civilian", 4.6, 0.0, 0.0)], motion=WANDER)
    path = poses_every(simspec, 200.0, 0.1)[:, 1, :2]

    assert np.hypot(*np.ptp(path, axis=0)) > 5.0
    assert not ((np.abs(path[:, 0]) < 4.5) & (np.abs(path[:, 1]) < 6.0)).any()


def test_a_patrol_walks_its_route_in_a_loop_from_the_nearest_point() -> None:
    """A patrol starts at the nearest point and repeats the route in order, without a pause."""
    route = points((0, 0), (40, 0), (40, 40), (0, 40))
    motion = Motion(kind="patrol", speed_mps=4.0, pause_s=0.0, route=route)
    path = poses_at(
        scene_simspec([("soldier", 40.0, -4.0, 0.0)], motion=motion),
        [1.0, 11.0, 21.0, 31.0, 41.0, 46.0],
    )

    assert path[:, 0, :2] == pytest.approx(
        np.array([[40, 0], [40, 40], [0, 40], [0, 0], [40, 0], [40, 20]], float), abs=1e-6
    )


def test_a_patrol_stays_inside_the_area_and_skips_unreachable_points() -> None:
    """A point beyond the border is moved inside it; a point inside a house is skipped."""
    route = points((0, -20), (90, 0), (0, 20), (-30, 0))
    motion = Motion(kind="patrol", speed_mps=5.0, pause_s=0.0, route=route)
    simspec = scene_simspec(
        [("soldier", 0.0, -21.0, 0.0), ("house", -30.0, 0.0, 0.0)],
        motion=motion,
        area=square(100.0),
    )
    path = poses_every(simspec, 200.0, 0.1)[:, 0, :2]

    assert np.abs(path).max() <= 50.0
    assert path[:, 0].max() == pytest.approx(49.5, abs=0.5)
    assert path[:, 0].min() > -1.0
    assert path[:, 1].max() == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize(
    "motion",
    [
        Motion(kind="wander", speed_mps=40.0, radius_m=1e-6, pause_s=0.0),
        Motion(kind="patrol", speed_mps=40.0, pause_s=0.0, route=points((0, 0), (0, 0))),
    ],
)
def test_tiny_legs_take_bounded_time(motion: Motion) -> None:
    """A vanishing disc or a route of equal points costs at most four legs a second."""
    began = time.process_time()
    poses_at(scene_simspec([("civilian", 0.0, 0.0, 0.0)], motion=motion), [600.0])
    assert time.process_time() - began < 5.0


def test_time_cannot_go_back_and_returned_positions_are_read_only() -> None:
    """Advancing backwards is a caller error; returned arrays do not change later and cannot be written."""
    scene = open_plain_scene(WANDERERS)
    scene.advance(SimTime(10**9))
    before, copy = scene.positions(), scene.positions().copy()
    scene.advance(SimTime(20 * 10**9))

    assert np.array_equal(before, copy)
    assert not np.array_equal(before, scene.positions())
    with pytest.raises(ValueError, match="cannot go back"):
        scene.advance(SimTime(10**9))
    with pytest.raises(ValueError, match="read-only"):
        scene.positions()[0, 0] = 1.0


def test_a_simspec_that_no_scene_can_be_is_refused() -> None:
    """Not realized; or an actor with an unknown group and a group with an unknown asset, two faults of one error."""
    valid = scene_simspec(CIVILIANS[:2])
    assert valid.realized is not None
    with pytest.raises(SetupError, match="is not realized"):
        open_plain_scene(valid.model_copy(update={"realized": None}))
    first, second = valid.realized.actors
    actors = (first.model_copy(update={"group": "nobody"}), second)
    unicorn = ActorGroup(id="unicorn", asset="unicorn", role=Role.CLUTTER, count=0)
    realized = valid.realized.model_copy(update={"actors": actors})
    with pytest.raises(SetupError) as caught:
        open_plain_scene(valid.model_copy(update={"actors": (*valid.actors, unicorn), "realized": realized}))
    assert [fault.where for fault in caught.value.faults] == ["realized.actors[0].group", "actors[1].asset"]


def test_the_cast_keeps_the_order_of_the_realization() -> None:
    """Ids come from the realization, labels and sizes from the groups and the catalogue."""
    cast = cast_of(scene_simspec([("soldier", 0.0, 0.0, 0.0), ("house", 50.0, 0.0, 0.0)], concealment=0.5))

    assert [(member.id, member.group, member.class_label) for member in cast] == [
        ("a0", "soldier", "combatant"),
        ("a1", "house", "building"),
    ]
    assert (cast[1].length_m, cast[1].width_m, cast[1].height_m, cast[1].concealment) == (12.0, 9.0, 6.5, 0.5)


@pytest.mark.parametrize("kind", ["wander", "patrol"])
def test_an_actor_moves_between_departure_and_halt_only(kind: str) -> None:
    """Before, it stands at its start; after, where it was; between, as without them, only later."""
    route = () if kind == "wander" else points((-40, 0), (40, 30), (0, 60))
    plain = Motion.model_validate({**WANDER.model_dump(), "kind": kind, "route": route})
    timed = plain.model_copy(update={"depart_s": 30.0, "halt_s": 75.3})
    usual_poses = poses_at(scene_simspec(CIVILIANS, motion=plain), [10.0, 45.3])
    poses = poses_at(scene_simspec(CIVILIANS, motion=timed), [0.0, 29.9, 40.0, 75.3, 200.0])
    assert np.array_equal(poses[0], poses[1])
    np.testing.assert_allclose(poses[2:4, :, :3], usual_poses[:, :, :3], atol=1e-6)
    assert np.array_equal(poses[3][:, :3], poses[4][:, :3])


@pytest.mark.parametrize("seed", range(6))
def test_a_convoy_drives_as_the_agent_is_told(seed: int) -> None:
    """The plan of an escort against the simulation: random starts, routes, speeds and times."""
    rng = np.random.default_rng(seed)
    route = points(*rng.uniform(-200.0, 200.0, (2 + seed % 3, 2)).tolist())
    starts = rng.uniform(-200.0, 200.0, (2, 2))
    cars = [("civilian-car", float(east), float(north), 0.0) for east, north in starts]
    motion = Motion(
        kind="patrol", pause_s=0.0, route=route, speed_mps=float(rng.uniform(2.0, 20.0)),
        depart_s=float(rng.uniform(0.0, 40.0)), halt_s=float(rng.uniform(60.0, 150.0)),
    )  # fmt: skip
    spec = scene_simspec(cars, motion=motion, area=square(600.0))
    spec = spec.model_copy(
        update={"mission": spec.mission.model_copy(update={"escort": Escort(group="civilian-car")})}
    )
    plan = escort_document(spec)
    assert plan is not None
    times_s = sorted([0.0, *rng.uniform(0.0, 200.0, 40).tolist()])
    driven = poses_at(spec, times_s)[:, :, :2]
    # A moment of MIN_STAY_S at most is lost at a point of the route where two arrivals come close.
    np.testing.assert_allclose(convoy_places_m(plan, times_s), driven, atol=0.25 * motion.speed_mps + 1e-6)


def test_a_rectangle_is_crossed_where_the_box_of_arrays_is() -> None:
    """On random segments, some of them parallel to a side, and some that only touch."""
    draws = np.random.default_rng(7)
    starts, ends = draws.integers(-4, 5, (2, 3000, 2)).astype(np.float64)
    halves = draws.integers(1, 4, (3000, 2)).astype(np.float64)
    crossed = [
        crosses_rectangle(tuple(start), tuple(end), tuple(half))
        for start, end, half in zip(starts.tolist(), ends.tolist(), halves.tolist(), strict=True)
    ]
    assert crossed == crosses_box(starts, ends, halves).tolist()
    assert 300 < sum(crossed) < 2700
