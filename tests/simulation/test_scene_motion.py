"""How actors move: seeded, bounded, and the same however often they are asked."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scene_situations import situation, square

from bench.contracts import SimTime, cast_of
from bench.errors import SetupError
from bench.simspec import ActorGroup, Motion, Point, Polygon, Role, SimSpec
from bench.simulation import open_plain_scene

WANDER = Motion(kind="wander", speed_mps=2.0, radius_m=20.0, pause_s=3.0)
CIVILIANS = [("civilian", 10.0 * a, 10.0 * b, 30.0 * (a + 3)) for a in range(-3, 4) for b in range(-3, 4)]


def at(simspec: SimSpec, seconds: list[float]) -> NDArray[np.float64]:
    """(times, n, 4): east, north, up, heading at each of the times."""
    scene = open_plain_scene(simspec)
    rows = []
    for moment in seconds:
        scene.advance(SimTime(round(moment * 1e9)))
        rows.append(np.column_stack((scene.positions(), scene.headings())))
    return np.array(rows)


def track(simspec: SimSpec, until_s: float, step_s: float) -> NDArray[np.float64]:
    return at(simspec, np.arange(0.0, until_s + step_s / 2, step_s).tolist())


def test_places_depend_on_the_time_alone() -> None:
    """Fine steps, coarse steps and one jump arrive at the very same bits."""
    simspec = situation(CIVILIANS, motion=WANDER, moving="civilian")

    fine = track(simspec, 120.0, 0.05)[-1]
    coarse = at(simspec, [0.3, 47.1, 120.0])[-1]
    once = at(simspec, [120.0])[-1]

    assert np.array_equal(fine, coarse)
    assert np.array_equal(fine, once)


def test_motion_is_the_motion_seeds_and_no_others() -> None:
    """Another motion seed moves people elsewhere; other streams do not touch them; each actor has luck of its own."""
    simspec = situation(CIVILIANS, motion=WANDER, moving="civilian")
    other = simspec.model_copy(update={"seeds": simspec.seeds.model_copy(update={"motion": 99})})
    perception = simspec.model_copy(update={"seeds": simspec.seeds.model_copy(update={"perception": 99, "placement": 7})})

    ends = at(simspec, [60.0])[0]

    assert np.array_equal(ends, at(simspec, [60.0])[0])
    assert np.array_equal(ends, at(perception, [60.0])[0])
    assert not np.isclose(ends, at(other, [60.0])[0]).all(axis=1).any()
    starts = np.array([one[1:3] for one in CIVILIANS])
    assert len(np.unique(np.round(ends[:, :2] - starts, 6), axis=0)) == len(CIVILIANS)


def test_an_actor_more_at_the_end_leaves_the_others_alone() -> None:
    """Actors have streams of their own, so a longer cast does not redraw the rest."""
    few = at(situation(CIVILIANS, motion=WANDER, moving="civilian"), [90.0])[0]
    more = at(situation([*CIVILIANS, ("civilian", 90.0, 90.0, 0.0)], motion=WANDER, moving="civilian"), [90.0])[0]

    assert np.array_equal(few, more[:-1])


def test_wanderers_keep_to_their_disc_their_speed_and_the_ground() -> None:
    """Nobody leaves the disc, outruns the speed, floats, or stands still for good; resting happens too."""
    path = track(situation(CIVILIANS, motion=WANDER, moving="civilian"), 300.0, 0.25)
    starts = path[0, :, :2]
    away = np.hypot(*(path[..., :2] - starts).transpose(2, 0, 1))
    pace = np.hypot(*np.diff(path[..., :2], axis=0).transpose(2, 0, 1)) / 0.25

    assert away.max() <= 20.0 + 1e-9
    assert away.max() > 15.0
    assert pace.max() <= 2.0 + 1e-9
    assert (pace.max(axis=0) > 1.9).all()
    assert 0.05 < (pace == 0.0).mean() < 0.6
    assert (path[..., 2] == 0.0).all()


def test_headings_follow_the_way() -> None:
    """While walking, the heading points along the displacement, clockwise from north."""
    path = track(situation(CIVILIANS, motion=WANDER, moving="civilian"), 60.0, 0.1)
    step = np.diff(path[..., :2], axis=0)
    straight = (path[:-1, :, 3] == path[1:, :, 3]) & (np.hypot(step[..., 0], step[..., 1]) > 0.19)
    bearing = np.arctan2(step[..., 0], step[..., 1]) % (2 * np.pi)
    error = np.abs((bearing - path[1:, :, 3] + np.pi) % (2 * np.pi) - np.pi)

    assert straight.any()
    assert error[straight].max() < 1e-6


def test_who_is_still_stays_to_the_bit() -> None:
    """Still actors keep the place and heading of the realization."""
    path = track(situation(CIVILIANS), 100.0, 25.0)

    assert (path == path[0]).all()
    assert path[0, 3, :2].tolist() == [*CIVILIANS[3][1:3]]
    assert path[0, :, 3] == pytest.approx(np.radians([one[3] for one in CIVILIANS]) % (2 * math.pi))


def test_wanderers_stay_inside_a_crooked_area() -> None:
    """In an L-shaped area no leg cuts the corner."""
    corners = ((0, 0), (100, 0), (100, 30), (30, 30), (30, 100), (0, 100))
    area = Polygon(corners=tuple(Point(east_m=e, north_m=n) for e, n in corners))
    walkers = [("civilian", e, n, 0.0) for e, n in itertools.product((5.0, 15.0, 25.0), (5.0, 15.0, 25.0))]
    motion = Motion(kind="wander", speed_mps=5.0, radius_m=80.0, pause_s=0.5)

    path = track(situation(walkers, motion=motion, moving="civilian", area=area), 400.0, 0.5)
    east, north = path[..., 0], path[..., 1]

    assert (east > -1e-6).all()
    assert (north > -1e-6).all()
    assert (np.minimum(east, north) < 30.0 + 1e-6).all()
    assert (np.maximum(east, north) > 60.0).any()


def test_walkers_go_round_solid_houses() -> None:
    """Nobody comes inside a turned house's footprint, though it stands amid their discs."""
    people = [("civilian", 12.0 * math.sin(a), 12.0 * math.cos(a), 0.0) for a in np.linspace(0, 6, 12)]
    simspec = situation(
        [("house", 0.0, 0.0, 30.0), *people],
        motion=Motion(kind="wander", speed_mps=3.0, radius_m=30.0, pause_s=0.1),
        moving="civilian",
    )
    path = track(simspec, 600.0, 0.2)[:, 1:, :2]
    heading = math.radians(30.0)
    ahead = path @ np.array([math.sin(heading), math.cos(heading)])
    aside = path @ np.array([math.cos(heading), -math.sin(heading)])
    inside = (np.abs(ahead) < 6.0) & (np.abs(aside) < 4.5)

    assert not inside.any()
    assert (np.hypot(*np.ptp(path, axis=0).T) > 10.0).all()
    assert ahead.min() < -10.0
    assert ahead.max() > 10.0


def test_somebody_walled_in_rests_instead_of_hanging() -> None:
    """Who stands inside a house finds no way out and stays, in bounded time."""
    simspec = situation([("house", 0.0, 0.0, 0.0), ("civilian", 0.0, 0.0, 0.0)], motion=WANDER, moving="civilian")

    assert at(simspec, [600.0])[0, 1, :2].tolist() == [0.0, 0.0]


def test_somebody_placed_against_a_wall_may_walk_away() -> None:
    """Nearer to a house than its own half width, a civilian still leaves, and not through the house."""
    simspec = situation([("house", 0.0, 0.0, 0.0), ("civilian", 4.6, 0.0, 0.0)], motion=WANDER, moving="civilian")
    path = track(simspec, 200.0, 0.1)[:, 1, :2]

    assert np.hypot(*np.ptp(path, axis=0)) > 5.0
    assert not ((np.abs(path[:, 0]) < 4.5) & (np.abs(path[:, 1]) < 6.0)).any()


def test_a_patrol_walks_its_route_in_a_loop_from_the_nearest_point() -> None:
    """Nearest point first, then in order, round and round, with the speed and no pause."""
    route = tuple(Point(east_m=e, north_m=n) for e, n in ((0, 0), (40, 0), (40, 40), (0, 40)))
    motion = Motion(kind="patrol", speed_mps=4.0, pause_s=0.0, route=route)
    path = at(situation([("soldier", 40.0, -4.0, 0.0)], motion=motion, moving="soldier"), [1.0, 11.0, 21.0, 31.0, 41.0, 46.0])

    assert path[:, 0, :2] == pytest.approx(np.array([[40, 0], [40, 40], [0, 40], [0, 0], [40, 0], [40, 20]], float), abs=1e-6)


def test_a_patrol_is_held_inside_the_area_and_skips_what_is_walled_off() -> None:
    """A point beyond the border is drawn inside it, and one inside a house is left out."""
    route = tuple(Point(east_m=e, north_m=n) for e, n in ((0, -20), (90, 0), (0, 20), (-30, 0)))
    motion = Motion(kind="patrol", speed_mps=5.0, pause_s=0.0, route=route)
    simspec = situation(
        [("soldier", 0.0, -21.0, 0.0), ("house", -30.0, 0.0, 0.0)], motion=motion, moving="soldier", area=square(100.0)
    )
    path = track(simspec, 200.0, 0.1)[:, 0, :2]

    assert np.abs(path).max() <= 50.0
    assert path[:, 0].max() == pytest.approx(49.5, abs=0.5)
    assert path[:, 0].min() > -1.0
    assert path[:, 1].max() == pytest.approx(20.0, abs=0.5)


def test_a_patrol_that_can_reach_nothing_stands() -> None:
    """All points inside a house: the soldier stays where he is."""
    route = (Point(east_m=0.0, north_m=0.0), Point(east_m=1.0, north_m=1.0))
    motion = Motion(kind="patrol", speed_mps=5.0, pause_s=0.0, route=route)
    simspec = situation([("soldier", 30.0, 0.0, 0.0), ("house", 0.0, 0.0, 0.0)], motion=motion, moving="soldier")

    assert at(simspec, [500.0])[0, 0, :2].tolist() == [30.0, 0.0]


@pytest.mark.parametrize(
    "motion",
    [
        Motion(kind="wander", speed_mps=40.0, radius_m=1e-6, pause_s=0.0),
        Motion(kind="patrol", speed_mps=40.0, pause_s=0.0, route=(Point(east_m=0.0, north_m=0.0),) * 2),
    ],
)
def test_endless_tiny_legs_cannot_stop_time(motion: Motion) -> None:
    """A vanishing disc or a route of equal points costs four legs a second, no more."""
    simspec = situation([("civilian", 0.0, 0.0, 0.0)], motion=motion, moving="civilian")
    began = time.process_time()
    at(simspec, [600.0])

    assert time.process_time() - began < 5.0


def test_time_does_not_run_back_and_the_past_is_not_overwritten() -> None:
    """Advancing backwards is an error of the caller; arrays handed out stay what they were and cannot be written."""
    scene = open_plain_scene(situation(CIVILIANS, motion=WANDER, moving="civilian"))
    scene.advance(SimTime(10**9))
    before, copy = scene.positions(), scene.positions().copy()
    scene.advance(SimTime(20 * 10**9))

    assert np.array_equal(before, copy)
    assert not np.array_equal(before, scene.positions())
    with pytest.raises(ValueError, match="cannot go back"):
        scene.advance(SimTime(10**9))
    with pytest.raises(ValueError, match="read-only"):
        scene.positions()[0, 0] = 1.0


def test_a_base_simspec_is_refused_with_a_sentence() -> None:
    """Without realization there is no scene, and the message says what to do."""
    simspec = situation(CIVILIANS).model_copy(update={"realized": None})

    with pytest.raises(SetupError, match="is not realized"):
        open_plain_scene(simspec)


def test_every_wrong_name_is_told_at_once() -> None:
    """A placed actor of no group and a group of no asset are two faults."""
    good = situation(CIVILIANS[:2])
    assert good.realized is not None
    placed = good.realized.actors
    odd = placed[0].model_copy(update={"group": "nobody"})
    unicorn = ActorGroup(id="unicorn", asset="unicorn", role=Role.CLUTTER, count=0)
    bad = good.model_copy(
        update={
            "actors": (*good.actors, unicorn),
            "realized": good.realized.model_copy(update={"actors": (odd, placed[1])}),
        }
    )

    with pytest.raises(SetupError) as caught:
        open_plain_scene(bad)
    assert [fault.where for fault in caught.value.faults] == ["realized.actors[0].group", "actors[1].asset"]


def test_the_cast_is_the_realization_in_its_order() -> None:
    """Ids, labels and sizes come from the realization, the groups and the catalogue."""
    cast = cast_of(situation([("soldier", 0.0, 0.0, 0.0), ("house", 50.0, 0.0, 0.0)], concealment=0.5))

    assert [(one.id, one.group, one.class_label) for one in cast] == [
        ("a0", "soldier", "combatant"),
        ("a1", "house", "building"),
    ]
    assert (cast[1].length_m, cast[1].width_m, cast[1].height_m, cast[1].concealment) == (12.0, 9.0, 6.5, 0.5)
