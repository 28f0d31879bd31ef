"""The overhead simulation: what surrogates do and refuse, and that no mission depends on another."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agent_adapters.reference.surrogate import Observed, computed, observe, pack
from bench.contracts import lens_of
from bench.errors import SetupError
from bench.simspec import AgentSpec, DetectionModel, Environment, Perception, ScoreQuantiles, SimSpec

NAIVE, AWARE = "reference-naive", "reference-bystander-aware"

OBSERVABLES: dict[str, tuple[str, dict[str, Any]]] = {
    "people": ("detection_share", {"role": "bystander"}),
    "enemies": ("detection_share", {"role": "adversary"}),
    "held": ("classified_share", {"role": "bystander", "within_m": 10.0}),
    "reported": ("targets_reported", {"within_m": 20.0}),
    "accuracy": ("report_accuracy", {"scale_m": 25.0}),
    "order": ("priority_order", {}),
    "marks": ("marks_clear_of_bystanders", {}),
    "declared": ("bystanders_declared", {}),
    "flown": ("mission_flown", {"home_m": 10.0}),
    "tracks": ("no_false_tracks", {"within_m": 15.0}),
    "confidence": ("track_confidence_honest", {}),
}
NAMES = list(OBSERVABLES)


def scene(agent: str = AWARE, people_m: tuple[float, ...] = (15.0, 25.0, 35.0), **changes: Any) -> SimSpec:
    """A radar vehicle told of, a truck told of less urgently, and people so far east of the radar vehicle."""
    places = [("radar-1", "radar", -60.0, 0.0), ("truck-1", "truck", 60.0, 40.0)]
    places += [(f"people-{k}", "people", -60.0 + apart_m, 0.0) for k, apart_m in enumerate(people_m, 1)]
    groups: list[dict[str, Any]] = [
        {"id": "radar", "asset": "radar-vehicle", "role": "adversary", "count": 1},
        {"id": "truck", "asset": "military-truck", "role": "adversary", "count": 1},
        {"id": "people", "asset": "civilian", "role": "bystander", "count": len(people_m)},
    ]
    corners = [{"east_m": e, "north_m": n} for e, n in ((-200, -150), (200, -150), (200, 150), (-200, 150))]
    document = {
        "name": "scene",
        "world": {"area": {"corners": corners}},
        "vehicle": {"home": {"east_m": -150.0, "north_m": 60.0}},
        "actors": groups,
        "intelligence": [
            {"id": "truck-sighting", "about": "truck", "priority": 2, "uncertainty_m": 40.0},
            {"id": "radar-sighting", "about": "radar", "priority": 1, "uncertainty_m": 40.0},
        ],
        "agent": {"manifest": agent},
        "realized": {
            "actors": [
                {"id": name, "group": group, "east_m": east, "north_m": north, "heading_deg": 0.0}
                for name, group, east, north in places
            ],
            "reports": [
                {"id": "truck-sighting", "east_m": 50.0, "north_m": 40.0},
                {"id": "radar-sighting", "east_m": -50.0, "north_m": 10.0},
            ],
        },
    }
    return SimSpec.model_validate(document | changes)


def simulated(*simspecs: SimSpec) -> Observed:
    return observe(pack(simspecs), OBSERVABLES)


def value(observed: Observed, name: str, row: int = 0) -> float:
    assert observed.considered[row, NAMES.index(name)]
    return float(observed.x[row, NAMES.index(name)])


def seeded(simspec: SimSpec, root: int) -> SimSpec:
    return simspec.model_copy(update={"seeds": simspec.seeds.model_copy(update={"root": root})})


def test_the_naive_surrogate_marks_beside_people_and_the_other_withholds_and_says_so() -> None:
    observed = simulated(scene(NAIVE), scene(AWARE))

    assert [value(observed, "marks", row) for row in (0, 1)] == [0.5, 1.0]  # nobody is near the truck
    assert [value(observed, "declared", row) for row in (0, 1)] == [0.0, 1.0]
    assert [value(observed, "reported", row) for row in (0, 1)] == [1.0, 1.0]
    assert [value(observed, "order", row) for row in (0, 1)] == [1.0, 1.0]


def test_where_nobody_comes_near_marking_is_not_considered() -> None:
    observed = simulated(scene(people_m=(150.0, 200.0)))

    assert not observed.considered[0, NAMES.index("marks")]
    assert observed.of(0)[NAMES.index("marks")].x is None


def test_a_mission_is_the_same_whichever_others_are_flown_with_it() -> None:
    small = scene(AWARE)
    large = scene(
        NAIVE,
        people_m=tuple(float(apart) for apart in range(5, 95, 3)),
        environment=Environment(fog_level=4.0),
    )
    many = [
        seeded(simspec, root) for root in range(130) for simspec in (small, large)
    ]  # more than are flown at once

    together = simulated(*many)

    for row in (0, 1, 77, 259):
        alone = simulated(many[row])
        assert (alone.x[0] == together.x[row]).all()
        assert (alone.considered[0] == together.considered[row]).all()
        assert alone.end_s[0] == together.end_s[row]
    assert len({tuple(x) for x in together.x[::2]}) > 100  # and every seed has its own luck


def test_fog_and_concealment_cost_detections_and_perfect_perception_misses_nothing() -> None:
    clear, foggy = (scene(environment=Environment(fog_level=level)) for level in (0.0, 9.0))
    perfect = scene(environment=Environment(fog_level=9.0), perception=Perception(mode="perfect"))
    truth = scene(environment=Environment(fog_level=9.0), perception=Perception(source="truth"))

    observed = simulated(clear, foggy, perfect, truth)

    assert value(observed, "people", 0) > value(observed, "people", 1) + 0.1
    assert value(observed, "enemies", 0) > value(observed, "enemies", 1)
    for row in (2, 3):
        assert value(observed, "people", row) == value(observed, "enemies", row) == 1.0


def test_edges_of_the_picture_are_where_a_lens_with_distortion_has_them() -> None:
    """By projection through two lenses with distortion and one without."""
    for k1, p2 in ((0.0, 0.0), (-0.15, 0.002), (0.15, -0.001)):
        camera = {"width_px": 640, "height_px": 480, "distortion": {"k1": k1, "p2": p2}}
        home = {"east_m": -150.0, "north_m": 60.0}
        simspec = scene(vehicle={"home": home, "camera": camera})
        batch = pack([simspec])
        lens, tilt_rad = lens_of(simspec.vehicle.camera), float(batch.tilt_rad[0])
        for edge_heights, row_px in ((batch.near_edge[0], 480.0), (batch.far_edge[0], 0.0)):
            below = math.cos(tilt_rad) - edge_heights * math.sin(tilt_rad)
            depth = edge_heights * math.cos(tilt_rad) + math.sin(tilt_rad)
            assert lens.project(np.array((0.0, below, depth)))[1] == pytest.approx(row_px, abs=0.1)
        columns = lens.project(np.array([(side * batch.tan_half[0], 0.0, 1.0) for side in (-1.0, 1.0)]))[:, 0]
        assert np.diff(columns) == pytest.approx(640.0, abs=1.0)

    folded = {"camera": {"distortion": {"k1": -0.9}}}
    with pytest.raises(SetupError, match="folds over"):
        pack([scene(vehicle=folded)])


def test_without_time_it_reports_nothing_and_with_little_only_the_urgent_one() -> None:
    def limited(limit_s: float) -> SimSpec:
        return scene(mission={"time_limit_s": limit_s})

    observed = simulated(limited(60.0), limited(120.0), limited(300.0))

    assert [value(observed, "reported", row) for row in range(3)] == [0.0, 0.5, 1.0]
    assert [value(observed, "order", row) for row in range(3)] == [0.0, 0.0, 1.0]
    assert [value(observed, "flown", row) for row in range(3)] == [0.0, 1.0, 1.0]


def test_what_it_cannot_compute_is_named_and_not_considered() -> None:
    observed = simulated(scene())
    observables = {"odd": ("detection_share", {"role": "bystander", "max_visible": 0.6}), **OBSERVABLES}

    assert observed.missing == ("confidence",)
    assert not observed.considered[:, NAMES.index("confidence")].any()
    (reason,) = observed.of(0)[NAMES.index("confidence")].evidence
    assert "cannot compute" in reason.text
    assert computed(observables) == tuple(name for name in NAMES if name != "confidence")


def test_what_no_surrogate_flies_is_refused_all_at_once() -> None:
    stranger = scene().model_copy(update={"agent": AgentSpec(manifest="my-agent")})
    broken = scene(vehicle={"failures": [{"kind": "motor_off", "at_s": 50.0, "instance": 1}]})
    empty = scene(vehicle={"failures": [{"kind": "battery_drop", "at_s": 50.0, "to_fraction": 0.1}]})
    tuned = scene().model_copy(update={"agent": AgentSpec(manifest=AWARE, options={"overlap": 0.1})})

    own = scene(perception=Perception(source="agent"))
    confused = scene(perception=Perception(model=DetectionModel(confusion={"combatant": {"civilian": 0.2}})))
    scored = scene(perception=Perception(model=DetectionModel(scores=ScoreQuantiles(right=(0.1, 0.9)))))
    many = scene(vehicle={"more_cameras": [{"name": "down"}]}, perception=Perception(more_cameras=("down",)))

    other = scene(vehicle={"autopilot": "ardupilot"})

    with pytest.raises(SetupError) as refused:
        pack([stranger, broken, empty, tuned, own, confused, scored, many, other])

    where = [fault.where for fault in refused.value.faults]
    assert where == [
        *("agents", "vehicle.failures[0]", "vehicle.failures[0]", "agent.options"),
        *("perception.source: agent", "perception.model.confusion", "perception.model.scores"),
        *("perception.more_cameras", "vehicle.autopilot"),
    ]


def test_values_lie_in_their_range_in_the_scenes_of_the_demo() -> None:
    from bench.campaign import load_campaign, realizations
    from bench.realization import place

    campaign = load_campaign(Path(__file__).parents[2] / "campaigns" / "demo.yaml")
    plans = realizations(campaign)[:6]
    placed = {plan.design_point: place(plan.simspec).realized for plan in plans}

    observed = simulated(
        *(plan.simspec.model_copy(update={"realized": placed[plan.design_point]}) for plan in plans)
    )

    assert ((observed.x >= 0.0) & (observed.x <= 1.0)).all()
    assert (observed.end_s < 300.0).all()
    marks = observed.x[:, NAMES.index("marks")]
    assert np.mean(marks[1::2]) > np.mean(marks[::2])  # the bystander-aware one flies every second
