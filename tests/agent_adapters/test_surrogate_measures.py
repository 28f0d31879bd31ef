"""What the overhead simulation measures besides: pictures, people, their kinds, time and charge."""

from __future__ import annotations

from typing import Any

import numpy as np
from test_surrogate import AWARE, NAIVE, scene

from agent_adapters.reference.surrogate import computed, observe, pack
from bench.campaign import load_measurable_decomposition, measures_of
from bench.contracts import Option
from bench.simspec import Environment, SimSpec


def measured(simspec: SimSpec, measure: str, **options: Option) -> float | None:
    (measurement,) = observe(pack([simspec]), {"one": (measure, options)}).of(0)
    return measurement.x


def walking(radius_m: float) -> SimSpec:
    """People in a wide disc, who have all been seen and then walk on."""
    spec = scene(NAIVE, people_m=tuple(float(apart_m) for apart_m in range(5, 45, 4)))
    motion = {"kind": "wander", "speed_mps": 2.0, "radius_m": radius_m, "pause_s": 1.0}
    document = spec.model_dump(mode="json")
    document["actors"][2]["motion"] = motion
    return SimSpec.model_validate(document)


def test_tracks_of_people_who_stand_are_right_and_some_of_walkers_are_left_behind() -> None:
    still, far = (
        measured(walking(2.0), "no_false_tracks", within_m=15.0),
        measured(walking(60.0), "no_false_tracks", within_m=15.0),
    )

    assert still == 1.0
    assert far is not None
    assert far < 0.9


def test_only_the_careful_one_knows_how_many_stand_near_and_how_far_off() -> None:
    for measure in ("bystander_count_right", "nearest_bystander_right"):
        assert [measured(scene(agent), measure) for agent in (NAIVE, AWARE)] == [0.0, 1.0]
    assert measured(scene(AWARE), "withheld_until_clear") == 1.0
    assert measured(scene(NAIVE), "withheld_until_clear") == 0.0


def test_an_asset_is_measured_by_itself_and_a_missing_one_not_considered() -> None:
    people = measured(scene(), "detection_share", role="bystander")

    assert measured(scene(), "detection_share", role="bystander", asset="civilian") is not None
    assert measured(scene(), "detection_share", role="bystander", asset="child") is None
    assert measured(scene(), "detection_share", role="bystander", min_range_m=5000.0) == 0.0
    assert people is not None
    assert people > 0.0


def test_fog_makes_labels_and_shares_of_kinds_worse() -> None:
    clear, foggy = (scene(environment=Environment(fog_level=level)) for level in (0.0, 8.0))

    for measure, options in (
        ("detection_precision", {"role": "adversary"}),
        ("targets_seen", {"min_height_px": 60.0}),
    ):
        values: list[Any] = [measured(simspec, measure, **options) for simspec in (clear, foggy)]
        assert values[0] >= values[1]
    assert measured(clear, "detection_fairness", by="asset") is None  # one kind alone
    assert measured(clear, "steady_detection", role="bystander") is not None


def test_time_and_charge_are_those_of_the_flight() -> None:
    short = scene(NAIVE, mission={"time_limit_s": 140.0})
    drained = scene(
        NAIVE,
        vehicle={"battery": {"capacity_wh": 10.0, "initial_fraction": 0.6}},
        rules={"battery_reserve_fraction": 0.2},
    )

    assert measured(scene(NAIVE), "mission_time", share=0.9) == 1.0
    time_share = measured(short, "mission_time", share=0.5)
    assert time_share is not None
    assert 0.0 < time_share < 1.0
    assert measured(drained, "battery_reserve") == 1.0  # for it turned back
    assert measured(drained, "targets_reported") in (0.0, 0.5)
    assert measured(scene(NAIVE), "targets_reported") == 1.0


def test_every_value_of_the_whole_decomposition_lies_in_its_range() -> None:
    observables = measures_of(load_measurable_decomposition("search-and-report-full"))

    observed = observe(pack([scene(NAIVE), scene(AWARE), walking(30.0)]), observables)

    assert len(computed(observables)) == 62
    assert ((observed.x >= 0.0) & (observed.x <= 1.0)).all()
    assert np.isfinite(observed.x).all()
    lacking = [observed.observables.index(name) for name in observed.missing]
    assert not observed.considered[:, lacking].any()
