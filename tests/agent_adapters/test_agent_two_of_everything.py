"""Two of everything: areas, bystanders, orders, outages, equal targets, at the same time."""

from __future__ import annotations

import math
import random
from itertools import combinations

import networkx as nx
import numpy as np
import pytest
from agent_fakes import intelligence, mission_order, order_document
from shapely import LineString, MultiPoint, Polygon
from shapely.geometry import Point as ShapelyPoint

from agent_adapters.reference import Settings
from agent_adapters.reference._orders import Ordered, Orders
from agent_adapters.reference.flight._airspace import NO_FLY_MARGIN_M, Airspace, block_round
from agent_adapters.reference.flight._caution import Caution, pushed
from agent_adapters.reference.flight._paths import Place
from agent_adapters.reference.mission._planner import Planner
from agent_adapters.reference.mission._policy import BystanderAwarePolicy
from agent_adapters.reference.perception._tracks import PlacedDetection, Tracks
from agent_adapters.reference.surrogate.batch._airspace import SurrogateAirspace
from agent_adapters.reference.surrogate.batch._interruptions import delivered_at, outage_spans
from bench.simspec import Outage

SEEDS = range(40)


def random_area(rng: random.Random) -> list[Place]:
    """The corners of a convex area, as hulls of random places have them."""
    east_m, north_m = rng.uniform(-120.0, 120.0), rng.uniform(-80.0, 80.0)
    places = [(east_m + rng.uniform(-45.0, 45.0), north_m + rng.uniform(-45.0, 45.0)) for _ in range(6)]
    return list(MultiPoint(places).convex_hull.exterior.coords)[:-1]


def shortest_m(areas: list[Polygon], begin: Place, end: Place) -> float:
    """The shortest path round areas, by the visibility graph over their corners.

    Written apart from the agent's geometry.
    """
    inner = [area.buffer(-1e-5) for area in areas]
    nodes = [begin, end, *(corner for area in areas for corner in area.exterior.coords[:-1])]
    nodes = [node for node in nodes if not any(area.contains(ShapelyPoint(node)) for area in inner)]
    graph: nx.Graph[tuple[float, float]] = nx.Graph()
    graph.add_nodes_from(nodes)
    for a, b in combinations(nodes, 2):
        if a != b and not any(LineString([a, b]).intersects(area) for area in inner):
            graph.add_edge(a, b, length_m=math.dist(a, b))
    return float(nx.shortest_path_length(graph, begin, end, weight="length_m"))


@pytest.mark.parametrize("seed", SEEDS)
def test_the_way_round_two_areas_is_the_shortest(seed: int) -> None:
    """The agent's route and the surrogate's are as long as the independent reference says."""
    rng = random.Random(seed)
    corners = [random_area(rng), random_area(rng)]
    blocks = [block_round(area, NO_FLY_MARGIN_M) for area in corners]
    polygons = [Polygon(block.corners) for block in blocks]
    begin, end = (-320.0, rng.uniform(-120.0, 120.0)), (320.0, rng.uniform(-120.0, 120.0))
    expected_m = shortest_m(polygons, begin, end)

    assert Airspace(tuple(blocks)).length_m(begin, end) == pytest.approx(expected_m, abs=1e-2)
    surrogate = SurrogateAirspace(Airspace(tuple(blocks)))
    assert surrogate.length_m(np.array([begin]), np.array([end]))[0] == pytest.approx(expected_m, abs=1e-2)
    for area, polygon in zip(corners, polygons, strict=True):  # and a block keeps its margin
        assert Polygon(area).exterior.distance(polygon.exterior) >= NO_FLY_MARGIN_M - 1e-6


def tracks_of(*objects: tuple[str, float, float]) -> Tracks:
    """Tracks of objects seen in ten frames up to 2 s."""
    tracks = Tracks()
    for frame in range(10):
        time_s, bearing_rad = frame * 0.2, math.radians(60.0 * frame / 9)
        tracks.take(
            time_s, [PlacedDetection(time_s, e, n, label, 0.9, bearing_rad, 70.0) for label, e, n in objects]
        )
    return tracks


@pytest.mark.parametrize("distances_m", [(12.0, 30.0), (30.0, 12.0)])
def test_of_two_bystanders_both_count_and_the_nearer_one_is_stated(distances_m: tuple[float, float]) -> None:
    tracks = tracks_of(
        ("mobile_radar", 0.0, 0.0), ("civilian", distances_m[0], 0.0), ("civilian", 0.0, distances_m[1])
    )
    target = next(track for track in tracks if track.label == "mobile_radar")

    judgement = BystanderAwarePolicy(mission_order(), Settings()).judge(
        target, tracks, 2.0, lambda *place: 0.0
    )

    assert not judgement.mark
    assert (judgement.bystanders_seen, judgement.nearest_bystander_m) == (2, 12.0)


def test_between_two_people_the_nearer_one_decides_how_fast_it_flies() -> None:
    caution = Caution(("civilian",), slow_within_m=20.0, slow_mps=5.0)
    nearer, farther = (40.0, 0.0), (0.0, 90.0)

    alone = caution.speed_mps(12.0, (0.0, 0.0), [nearer])

    assert (
        caution.speed_mps(12.0, (0.0, 0.0), [nearer, farther])
        == caution.speed_mps(12.0, (0.0, 0.0), [farther, nearer])
        == alone
    )
    assert alone < caution.speed_mps(12.0, (0.0, 0.0), [farther])


def test_a_place_is_moved_out_of_both_circles() -> None:
    people = [(0.0, 0.0), (10.0, 0.0)]

    moved = pushed((4.0, 1.0), people, 12.0)

    assert all(math.dist(moved, person) >= 12.0 - 1e-3 for person in people)


def test_of_two_orders_at_once_the_later_one_holds() -> None:
    orders = Orders()

    orders.take(order_document("first", "hold"))
    orders.take(order_document("second", "hold"))
    assert orders.held_by == "second"
    orders.take(order_document("third", "retask", "alpha"))
    assert orders.held_by == ""
    orders.take(order_document("fourth", "stop_reporting"))
    orders.take(order_document("fifth", "resume_reporting"))
    assert orders.silenced == ""


def test_two_orders_to_end_are_heeded_once_and_the_later_one_is_carried_out() -> None:
    orders = Orders()
    orders.take(order_document("home", "return"))
    orders.take(order_document("down", "deactivate"))

    with pytest.raises(Ordered) as raised:
        orders.heed()

    assert raised.value.order.id == "down"
    orders.heed()  # nothing is left to carry out
    assert orders.silenced_for_good


def test_two_outages_that_overlap_are_one_and_what_comes_between_two_is_heard() -> None:
    def down(*spans_s: tuple[float, float]) -> tuple[tuple[float, float], ...]:
        outages = [
            Outage(kind="operator_link", at_s=at_s, duration_s=end_s - at_s) for at_s, end_s in spans_s
        ]
        return outage_spans(outages, "operator_link")

    overlapping, apart = down((30.0, 50.0), (40.0, 70.0)), down((60.0, 80.0), (20.0, 40.0))

    assert overlapping == ((30.0, 70.0),)
    assert [delivered_at(at_s, overlapping) for at_s in (29.0, 45.0, 70.0)] == [29.0, 70.0, 70.0]
    assert apart == ((20.0, 40.0), (60.0, 80.0))
    assert [delivered_at(at_s, apart) for at_s in (25.0, 50.0, 65.0)] == [40.0, 50.0, 80.0]


def test_of_two_targets_of_equal_priority_the_nearer_comes_first_and_neither_interrupts_the_other() -> None:
    planner = Planner(mission_order(), 10.0, 40.0, 15.0, 8.0)
    farther = planner.add(intelligence("alpha", "mobile_radar", 150.0, 0.0))
    nearer = planner.add(intelligence("bravo", "military_vehicle", -60.0, 0.0))
    assert farther is not None
    assert nearer is not None

    assert [task.id for task in planner.waiting((0.0, 0.0))] == ["bravo", "alpha"]
    assert [task.id for task in planner.waiting((140.0, 0.0))] == ["alpha", "bravo"]
    assert [task.id for task in planner.waiting((45.0, 0.0))] == [
        "alpha",
        "bravo",
    ]  # as near as each other: by name
    nearer.state = "active"
    assert planner.more_urgent_than(nearer) is None
    planner.put_first(farther)
    assert planner.more_urgent_than(nearer) is farther
