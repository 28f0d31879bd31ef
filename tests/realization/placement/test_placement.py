"""Placement: what was asked for comes out, the same for the same seed, and what cannot be is said."""

from __future__ import annotations

import itertools
import time
from pathlib import Path
from typing import Any

import pytest
from yards import corners, faults, group, scene

from bench.documents import parse_text, validate_document
from bench.realization import PlacementInfeasible, check_placement, place
from bench.simspec import Realized, SimSpec

PAPER: dict[str, Any] = parse_text((Path(__file__).parents[3] / "campaigns" / "paper.yaml").read_text())[0]


def realized(simspec: SimSpec) -> Realized:
    assert simspec.realized is not None
    return simspec.realized


def test_a_typical_scene_is_quick() -> None:
    """Some ninety actors take milliseconds; the bound is wide, for busy machines."""
    simspec = validate_document(PAPER["base"], SimSpec)
    place(simspec)

    began = time.process_time()
    for _ in range(10):
        place(simspec)

    assert (time.process_time() - began) / 10 < 0.1


def test_another_seed_places_elsewhere_and_a_group_added_later_moves_nobody() -> None:
    people, trees = group("people", "civilian", 10), group("trees", "tree", 5)

    assert realized(place(scene(people, seed=2))) != realized(place(scene(people)))
    assert realized(place(scene(people, trees))).actors[:10] == realized(place(scene(people))).actors


def test_reports_err_within_their_uncertainty() -> None:
    """Reports lie off the truth, by less than their uncertainty, inside the area where that is possible."""
    errors = []
    for seed in range(20):
        target = group("radar", "radar-vehicle", role="adversary", region=corners(4.0, 4.0, 16.0, 16.0))
        sighting = {"id": "sighting", "about": "radar", "uncertainty_m": 60.0}
        simspec = place(scene(target, seed=seed, intelligence=[sighting]))
        [actor], [report] = realized(simspec).actors, realized(simspec).reports
        errors.append(((actor.east_m - report.east_m) ** 2 + (actor.north_m - report.north_m) ** 2) ** 0.5)
        assert 0.0 <= report.east_m <= 100.0
        assert 0.0 <= report.north_m <= 100.0
    assert max(errors) <= 48.0
    assert max(errors) - min(errors) > 10.0


RADAR = group("radar", "radar-vehicle", region=corners(45.0, 45.0, 55.0, 55.0))
AT = {"east_m": 50.0, "north_m": 50.0}


@pytest.mark.parametrize(
    ("groups", "message"),
    [
        (
            [RADAR, group("guards", "soldier", 2, near={"of": "radar", "min_m": 1.0, "max_m": 10.0}, region=corners(70.0, 70.0, 90.0, 90.0))],
            "proved so: .*'guards' is to stand inside its region of 400 m2 .* 1 to 10 m from some member of 'radar'",
        ),
        (
            [RADAR, group("people", "civilian", 10, mean_distance={"of": "radar", "mean_m": 200.0})],
            "is to be 200 m .*no mean over 75.6 m is in reach",
        ),
        ([group("shed", "shed", at=AT), group("house", "house", at=AT)], "'shed' and 'house' are fixed"),
        (
            [RADAR, group("crowd", "civilian", 5000, near={"of": "radar", "min_m": 10, "max_m": 30})],
            "5000 of 'crowd' need at least .* within 10 to 30 m of 'radar'",
        ),
        ([group("a", "civilian", 2, region=corners(0, 0, 100, 0.02))], r"proved so: .* region of 2 m2 \(actors\[a\].placement.region\)"),
        ([group("a", "civilian", 1000, region=corners(0, 0, 20, 20))], "1000 of 'a' need at least 1046 m2"),
        ([group("a", "civilian", 3, separation_m=500.0)], "of 'a' need at least"),
    ],
)  # fmt: skip
def test_the_impossible_is_refused_at_once_with_its_numbers(
    groups: list[dict[str, Any]], message: str
) -> None:
    """Relations that clash, a mean out of reach, two on one spot, a sliver of a region, crowds: without a search."""
    began = time.process_time()

    with pytest.raises(PlacementInfeasible, match=message):
        place(scene(*groups))
    assert time.process_time() - began < 1.0


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
