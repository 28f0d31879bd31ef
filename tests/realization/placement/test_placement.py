"""Placement: what was asked for comes out, the same for the same seed, and what cannot be is said."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import Any

import pytest
from yards import corners, faults, group, scene

from bench.documents import dump_json, parse_text, validate_document
from bench.realization import Design, PlacementInfeasible, check_placement, place, realize
from bench.simspec import (
    ActorGroup,
    AgentSpec,
    Near,
    Placement,
    Point,
    Polygon,
    Realized,
    Role,
    SimSpec,
    World,
)

PAPER: dict[str, Any] = parse_text((Path(__file__).parents[3] / "campaigns" / "paper.yaml").read_text())[0]


def realized(simspec: SimSpec) -> Realized:
    assert simspec.realized is not None
    return simspec.realized


def infeasible(simspec: SimSpec) -> str:
    with pytest.raises(PlacementInfeasible) as refusal:
        place(simspec)
    return str(refusal.value)


def test_paper_scenes() -> None:
    """Scenes of the paper keep every relation, the mean within 1 %, and differ from each other."""
    plans = realize(
        validate_document(PAPER["base"], SimSpec), validate_document(PAPER["design"], Design), [AgentSpec()]
    )
    placed = [place(plan.simspec) for plan in plans[::12]]

    assert len(placed) == 18
    assert [fault for simspec in placed for fault in check_placement(simspec)] == []
    assert len({dump_json(realized(simspec)) for simspec in placed}) == 18
    assert {simspec.group("civilians").member_count(150_000.0) for simspec in placed} == {47, 59, 68}


def test_a_typical_scene_is_quick() -> None:
    """Some ninety actors take milliseconds; the bound is wide, for busy machines."""
    simspec = validate_document(PAPER["base"], SimSpec)
    place(simspec)

    began = time.process_time()
    for _ in range(10):
        place(simspec)

    assert (time.process_time() - began) / 10 < 0.1


def test_same_seed_same_bytes() -> None:
    """The same seed places alike, another elsewhere; a group added later moves nobody before it."""
    people, trees = group("people", "civilian", 10), group("trees", "tree", 5)

    assert dump_json(place(scene(people))) == dump_json(place(scene(people)))
    assert realized(place(scene(people, seed=2))) != realized(place(scene(people)))
    assert realized(place(scene(people, trees))).actors[:10] == realized(place(scene(people))).actors


def test_fixed_place_is_kept() -> None:
    """`at` puts a member exactly there, and the others go round it."""
    fixed = group("house", "house", at={"east_m": 50.0, "north_m": 50.0, "heading_deg": 30.0})
    simspec = place(scene(group("people", "civilian", 40, region=corners(40.0, 40.0, 60.0, 60.0)), fixed))

    house = realized(simspec).actors[-1]
    assert (house.id, house.east_m, house.north_m, house.heading_deg) == ("house-1", 50.0, 50.0, 30.0)
    assert check_placement(simspec) == []


def test_reports_err_within_their_uncertainty() -> None:
    """Reports lie off the truth, by less than their uncertainty, inside the area where that is possible."""
    errors = []
    for seed in range(20):
        target = group("radar", "radar-vehicle", role="adversary", region=corners(4.0, 4.0, 16.0, 16.0))
        simspec = place(
            scene(
                target, seed=seed, intelligence=[{"id": "sighting", "about": "radar", "uncertainty_m": 60.0}]
            )
        )
        [actor], [report] = realized(simspec).actors, realized(simspec).reports
        errors.append(((actor.east_m - report.east_m) ** 2 + (actor.north_m - report.north_m) ** 2) ** 0.5)
        assert 0.0 <= report.east_m <= 100.0
        assert 0.0 <= report.north_m <= 100.0
    assert max(errors) <= 48.0
    assert max(errors) - min(errors) > 10.0


def test_impossible_by_relations() -> None:
    """Relations that cannot be kept together are named with their numbers, harmless ones are not."""
    message = infeasible(
        scene(
            group("radar", "radar-vehicle", region=corners(5.0, 5.0, 20.0, 20.0)),
            group(
                "guards",
                "soldier",
                2,
                near={"of": "radar", "min_m": 1.0, "max_m": 10.0},
                region=corners(70.0, 70.0, 90.0, 90.0),
            ),
        )
    )

    assert message.startswith("impossible, and proved so")
    assert "'guards' is to stand inside its region of 400 m2 (actors[guards].placement.region)" in message
    assert (
        "'guards' is to stand 1 to 10 m from some member of 'radar' (actors[guards].placement.near)"
        in message
    )
    assert "home" not in message
    assert "members of" not in message


def test_impossible_by_crowding() -> None:
    """Members who keep each other out are told apart from relations that clash."""
    began = time.process_time()
    message = infeasible(scene(group("houses", "house", 10, separation_m=0.0), size_m=36.0))

    assert "of 10 members found a place" in message
    assert "crowd each other" in message or "keep 0 m clear" in message
    assert time.process_time() - began < 3.0


def test_impossible_mean_distance() -> None:
    """A mean out of reach is refused with the means within reach."""
    message = infeasible(
        scene(
            group("radar", "radar-vehicle", region=corners(45.0, 45.0, 55.0, 55.0)),
            group("people", "civilian", 10, mean_distance={"of": "radar", "mean_m": 200.0}),
        )
    )

    assert "is to be 200 m" in message
    assert "no mean over 75.6 m is in reach" in message


def test_overlapping_fixed_places() -> None:
    """Two groups fixed on one spot are named."""
    at = {"east_m": 50.0, "north_m": 50.0}

    assert "'shed' and 'house' are fixed" in infeasible(
        scene(group("shed", "shed", at=at), group("house", "house", at=at))
    )


def test_a_wrong_report_and_a_missing_actor_are_found() -> None:
    """The check trusts neither reports nor numbers."""
    sound = place(
        scene(
            group("radar", "radar-vehicle", role="adversary"),
            group("crowd", "civilian", 8, role="bystander"),
            intelligence=[{"id": "sighting", "about": "radar", "uncertainty_m": 20.0}],
        )
    )
    [report], actors = realized(sound).reports, realized(sound).actors
    wrong = report.model_copy(update={"east_m": actors[0].east_m + 30.0})
    for change, message in (
        ({"reports": (wrong,)}, "report sighting: is"),
        ({"actors": actors[:-1]}, "group crowd: has 7 members (8 are required)"),
    ):
        changed = realized(sound).model_copy(update=change)
        assert message in "\n".join(faults(sound.model_copy(update={"realized": changed})))


def test_check_sees_overlap_of_turned_footprints() -> None:
    """Corners count, not circles: two long vehicles side by side are clear, the same ones crossed are not."""
    trucks = [
        group(name, "military-truck", at={"east_m": east, "north_m": 50.0})
        for name, east in (("one", 50.0), ("two", 53.0))
    ]
    beside = place(scene(*trucks))
    crossed = realized(beside).actors[1].model_copy(update={"heading_deg": 90.0})

    assert check_placement(beside) == []
    faults_found = check_placement(
        beside.model_copy(
            update={
                "realized": realized(beside).model_copy(
                    update={"actors": (realized(beside).actors[0], crossed)}
                )
            }
        )
    )
    assert [fault.where for fault in faults_found if "apart" in fault.what] == ["realized: one-1 and two-1"]


def test_nothing_placed_is_a_fault() -> None:
    """A SimSpec without places is not well placed."""
    assert [fault.what for fault in check_placement(scene())] == ["is missing"]


def test_footprint_gaps_agree_with_shapely() -> None:
    """The sampler's own distance between turned rectangles is shapely's, over many pairs."""
    import numpy as np
    import shapely

    from bench.realization.placement._footprint import footprints, gaps
    from bench.simspec import ASSETS

    rng = np.random.default_rng(1)
    for first, other in itertools.product(("house", "military-truck", "civilian"), repeat=2):
        outlines = footprints(ASSETS[first], rng.uniform(0, 25, (200, 2)), rng.uniform(0, 360, 200), 0.0)
        right = footprints(ASSETS[other], rng.uniform(0, 25, (200, 2)), rng.uniform(0, 360, 200), 0.0)
        wanted = shapely.distance(shapely.polygons(outlines.corners()), shapely.polygons(right.corners()))
        np.testing.assert_allclose(gaps(outlines, right), wanted, atol=1e-9)


def test_a_crowd_that_no_ring_holds_is_refused_at_once() -> None:
    """Five thousand people within forty metres are refused by their area, without a search."""
    people = ActorGroup(
        id="crowd",
        asset="civilian",
        role=Role.BYSTANDER,
        count=5000,
        placement=Placement(near=Near(of="target", min_m=10, max_m=40)),
    )
    target = ActorGroup(id="target", asset="crate", role=Role.ADVERSARY, count=1)
    corners = tuple(Point(east_m=x, north_m=y) for x, y in ((0, 0), (600, 0), (600, 250), (0, 250)))
    spec = SimSpec(name="crowd", world=World(area=Polygon(corners=corners)), actors=(target, people))
    began = time.process_time()
    with pytest.raises(
        PlacementInfeasible, match=r"5000 of 'crowd' need at least .* within 10 to 40 m of 'target'"
    ):
        place(spec)
    assert time.process_time() - began < 1.0
