"""Honeypots: targets in the SimSpec that nothing else shows."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_run import at_s, tape
from yards import corners, group, scene

from bench.campaign import load_measurable_decomposition
from bench.campaign.planning._honeypots import NEAR_M, chance_of_a_hit, truth_sightings
from bench.contracts import TargetReport, Timed, cast_of
from bench.documents import dump_json, load_json_document
from bench.realization import check_placement, place
from bench.realization.placement._honeypot import CLEAR_M
from bench.scoring import difficulty_of
from bench.simspec import PlacedActor, Role, SimSpec, load_simspec
from bench.simulation._truth import _without_honeypots

EXAMPLE = Path(__file__).parents[3] / "examples" / "search.yaml"


def simspec(root: int, honeypot: bool) -> SimSpec:
    base = load_simspec(EXAMPLE)
    seeds = base.seeds.model_copy(update={"root": root})
    return base.model_copy(update={"honeypot": honeypot, "seeds": seeds, "realized": None})


def placed_with_one(base: SimSpec) -> tuple[SimSpec, PlacedActor]:
    placed = place(base)
    assert placed.realized is not None
    (honeypot,) = placed.realized.honeypots
    return placed, honeypot


@pytest.mark.parametrize("root", [1, 2])
def test_it_is_far_from_everything_and_changes_no_place(root: int) -> None:
    """Over several scenes, by distances of our own: from starts with the whole reach, reported places and home."""
    placed, honeypot = placed_with_one(simspec(root, True))
    assert placed.realized is not None
    assert placed.realized.model_copy(update={"honeypots": ()}) == place(simspec(root, False)).realized
    assert placed.group(honeypot.group).role is Role.ADVERSARY
    assert honeypot.id not in {actor.id for actor in placed.realized.actors}
    for actor in placed.realized.actors:
        motion = placed.group(actor.group).motion
        reach_m = motion.radius_m if motion.kind == "wander" else 0.0
        assert distance_m(honeypot, actor.east_m, actor.north_m) >= CLEAR_M + reach_m - 0.5
    for report in placed.realized.reports:
        assert distance_m(honeypot, report.east_m, report.north_m) >= CLEAR_M - 0.5
    home = placed.vehicle.home
    assert distance_m(honeypot, home.east_m, home.north_m) >= CLEAR_M - 0.5


def test_somebody_sought_can_be_a_honeypot_too() -> None:
    """Where nobody else is a target; a bystander never is."""
    base = simspec(1, True)
    groups = tuple(
        one.model_copy(update={"role": Role.SOUGHT}) if one.role is Role.ADVERSARY else one
        for one in base.actors
    )
    realized = place(base.model_copy(update={"actors": groups})).realized
    assert realized == place(base).realized
    assert realized is not None
    assert len(realized.honeypots) == 1


def distance_m(honeypot: PlacedActor, east_m: float, north_m: float) -> float:
    return math.hypot(honeypot.east_m - east_m, honeypot.north_m - north_m)


def test_a_file_shows_it_as_one_more_actor_and_is_read_back_the_same(tmp_path: Path) -> None:
    """Whoever takes `realized.actors` from the file takes it for a target; the bench's own rooms never see it."""
    placed = place(simspec(1, True))
    assert placed.realized is not None
    text = dump_json(placed)
    document = json.loads(text)["realized"]
    assert len(document["actors"]) == len(placed.realized.actors) + 1
    assert document["honeypots"] == [document["actors"][-1]["id"]]
    path = tmp_path / "simspec.json"
    path.write_text(text)
    assert load_json_document(path, SimSpec) == placed
    assert SimSpec.model_validate(placed.model_dump()) == placed
    assert len(cast_of(placed)) == len(placed.realized.actors)
    assert check_placement(placed) == check_placement(_without_honeypots(placed)) == []
    decomposition = load_measurable_decomposition("search-and-report")
    assert difficulty_of(decomposition, placed) == difficulty_of(decomposition, place(simspec(1, False)))
    assert '"honeypot' not in dump_json(place(simspec(1, False)))
    assert '"honeypots' not in dump_json(_without_honeypots(placed))


def test_a_scene_without_adversaries_or_room_has_none() -> None:
    """Nothing to be one more of, or no place that is far from everything."""
    for role, half_m, count in (
        (Role.ADVERSARY, 240.0, 1),
        (Role.ADVERSARY, 30.0, 0),
        (Role.BYSTANDER, 240.0, 0),
        (Role.BYSTANDER, 30.0, 0),
    ):
        soldiers = group("group", "soldier", 2, role)
        realized = place(
            scene(soldiers, area=corners(-half_m, -half_m, half_m, half_m), honeypot=True)
        ).realized
        assert realized is not None
        assert len(realized.honeypots) == count


def test_a_report_of_it_is_named_with_its_chance() -> None:
    """Two reports, one of them near: that one is named, with the share of sessions in which chance does it."""
    placed, honeypot = placed_with_one(simspec(1, True))
    place_of: dict[str, Any] = {
        "class_label": "mobile_radar",
        "north_m": honeypot.north_m,
        "confidence": 1.0,
        "mark": False,
    }
    reports = tuple(
        Timed(
            at_s(3.0 + number),
            TargetReport(id=f"r{number}", time_s=3.0, east_m=honeypot.east_m + offset_m, **place_of),
        )
        for number, offset_m in enumerate((NEAR_M + 0.1, NEAR_M - 0.1))
    )
    ((text,),) = (sightings.texts for sightings in truth_sightings(placed, tape(placed, reports=reports)))
    assert text.startswith("report 'r1' at 4.0 s is 14.9 m from " + honeypot.id)
    assert truth_sightings(placed, tape(placed, reports=reports[:1])) == []
    assert truth_sightings(_without_honeypots(placed), tape(placed, reports=reports)) == []


def test_the_chance_of_an_innocent_hit_is_that_of_random_places() -> None:
    """Against a count: reports all over a square, and a honeypot away from its edges."""
    rng = np.random.default_rng(14)
    places = rng.uniform(-150.0, 150.0, (4000, 10, 2))
    hits = (np.hypot(places[..., 0] - 40.0, places[..., 1] + 20.0) <= NEAR_M).any(axis=1)
    # Three standard errors of a share near 0.11 over 4,000 sessions are 0.015.
    assert abs(hits.mean() - chance_of_a_hit(10, 300.0**2)) < 0.015
