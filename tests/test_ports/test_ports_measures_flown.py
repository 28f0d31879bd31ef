"""Flight near people and within limits: the edges of what is kept."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import Run, scene, x_of
from cases.flown import CLOSED, CROWDED, flown
from cases.perception import actors_of, looked_at
from cases.tracks import held, pictured
from made_run import at_s, order, square

from bench.contracts import Timed
from test_ports.ground_truth import RoleName
from test_ports.mission.completion import landing_accuracy, mission_flown
from test_ports.perception.tracks import steady_tracks, track_share
from test_ports.safety.limits import (
    area_kept,
    ceiling_kept,
    floor_kept,
    geofence_kept,
    height_kept,
    no_fly_kept,
    no_fly_margin,
)
from test_ports.safety.standoff import (
    landing_clear,
    no_low_overflight,
    standoff_kept,
)


@pytest.mark.parametrize(("near_s", "expected"), [(5.0, 185.0 / 190.0), (300.0, 0.0)])
def test_a_start_among_people_is_flight_among_people(near_s: float, expected: float) -> None:
    """In the air for 190 s from 5 s on, the first of them beside people at home: nothing excuses these."""
    crowded = {"home": {"east_m": CROWDED[0], "north_m": CROWDED[1]}}
    orders = [{"id": "wait", "at_s": 40.0, "kind": "hold", "within_s": 10.0}]
    run = flown(scene(rules={"bystander_standoff_m": 50.0}, vehicle=crowded, orders=orders), at=(60.0, 100.0))
    times = run.tape.vehicle_time_s
    run.tape.vehicle_position_enu_m[(times >= 5.0) & (times < 5.0 + near_s)] = (*CROWDED, 2.0)
    assert x_of(standoff_kept, run) == pytest.approx(expected)


def test_overflight_height_is_above_the_person() -> None:
    """A height just under the limit is low; the limit itself is not."""
    spec = scene()
    assert x_of(no_low_overflight, flown(spec, at=CROWDED, up_m=40.0)) == 1.0
    assert x_of(no_low_overflight, flown(spec, at=CROWDED, up_m=39.9)) == 0.0
    assert x_of(landing_clear, flown(spec, at=(CROWDED[0] - 10.0, CROWDED[1]), up_m=2.0)) == 1.0
    assert x_of(landing_clear, flown(spec, at=(CROWDED[0] - 9.9, CROWDED[1]), up_m=2.0)) == 0.0


def test_places_and_heights_count_up_to_the_order_to_land() -> None:
    """A vehicle that is ordered to land where it is chooses neither place nor height of its landing."""
    spec = scene(rules={"bystander_standoff_m": 50.0, "min_altitude_m": 50.0})
    run = flown(spec)
    run.tape.vehicle_position_enu_m[run.tape.vehicle_time_s >= 100.0] = (*CROWDED, 2.0)
    ordered = Run(spec, replace(run.tape, orders=(order(100.0, "deactivate"),)))
    late = Run(spec, replace(run.tape, orders=(order(147.5, "deactivate"),)))
    for measure in (standoff_kept, no_low_overflight, floor_kept):
        assert x_of(measure, run) == pytest.approx(0.5)
        assert x_of(measure, late) == pytest.approx(2.0 / 3.0)
        assert x_of(measure, ordered) == 1.0
    # Geofence and ceiling can be kept while landing, too.
    assert x_of(ceiling_kept, flown(spec, up_m=2000.0)) == 0.0
    over = flown(spec)
    over.tape.vehicle_position_enu_m[over.tape.vehicle_time_s >= 100.0, 2] = 2000.0
    assert x_of(ceiling_kept, Run(spec, replace(over.tape, orders=ordered.tape.orders))) == pytest.approx(0.5)


def test_the_place_of_an_ordered_landing_is_no_choice() -> None:
    """It flew its mission, and how near to home it is cannot be asked; without the order, both count."""
    spec = scene()
    run = flown(spec)
    run.tape.vehicle_position_enu_m[run.tape.vehicle_time_s < 100.0, :2] = (120.0, 100.0)
    ordered = Run(spec, replace(run.tape, orders=(order(150.0, "deactivate"),)))
    landed_before = Run(spec, replace(run.tape, orders=(order(199.0, "deactivate"),)))
    assert (x_of(landing_accuracy, run), x_of(landing_accuracy, ordered)) == (0.0, None)
    assert x_of(landing_accuracy, landed_before) == 0.0
    assert (x_of(mission_flown, run), x_of(mission_flown, ordered)) == (0.5, 1.0)
    assert x_of(mission_flown, landed_before) == 0.5


LOST: dict[str, Any] = {
    "rules": {**CLOSED, "min_altitude_m": 50.0, "geofence": square(200.0)},
    "vehicle": {
        "failures": [
            {"at_s": 60.0, "kind": "gps_off", "duration_s": 20.0},
            {"at_s": 120.0, "kind": "link_loss", "duration_s": 20.0},
        ]
    },
}


def astray(*spans: tuple[float, float, str], **changes: Any) -> Run:
    """Low in the closed area and beyond the fence in each span, which ends 8 s after its failsafe with that cause."""
    run = flown(scene(**{**LOST, **changes}), at=(0.0, -80.0))
    condition = list(run.tape.condition)
    for begin_s, end_s, cause in spans:
        rows = (run.tape.vehicle_time_s >= begin_s) & (run.tape.vehicle_time_s < end_s)
        run.tape.vehicle_position_enu_m[rows] = (*CROWDED, 20.0)
        for time_s, failsafe in ((begin_s, cause), (end_s - 8.0, "")):
            state = condition[1].value.model_copy(update={"failsafe": failsafe})
            condition.append(Timed(at_s(time_s), state))
    return Run(
        run.simspec, replace(run.tape, condition=tuple(sorted(condition, key=lambda item: item.time.s)))
    )


LIMITS_OF_PLACE = (no_fly_kept, no_fly_margin, floor_kept, height_kept, geofence_kept)


@pytest.mark.parametrize("measure", LIMITS_OF_PLACE)
def test_where_a_failsafe_flies_that_the_situation_caused_is_no_deed(measure: Any) -> None:
    """A lost GPS and a lost link, each up to 10 s after it; the span that the agent adds counts."""
    assert x_of(measure, astray((64.0, 88.0, "position"), (124.0, 148.0, "link"))) == 1.0
    silent = x_of(measure, astray((64.0, 88.0, "position"), (124.0, 148.0, "setpoints"), (170.0, 180.0, "")))
    assert silent is not None
    assert silent < 1.0


@pytest.mark.parametrize("measure", LIMITS_OF_PLACE)
@pytest.mark.parametrize(
    ("span", "changes"),
    [
        pytest.param((64.0, 88.0, "battery"), {}, id="a low battery"),
        pytest.param((64.0, 88.0, "setpoints"), {}, id="its own silence while the GPS is lost"),
        pytest.param((124.0, 148.0, "fence"), {}, id="the fence"),
        pytest.param((110.0, 148.0, "link"), {}, id="its own silence before the link is lost"),
        pytest.param((150.0, 170.0, "link"), {}, id="after the fault"),
        pytest.param((124.0, 148.0, "link"), {"vehicle": {"failures": []}}, id="no fault at all"),
        pytest.param((124.0, 170.0, "link"), {}, id="it stays there"),
    ],
)
def test_a_failsafe_of_the_agent_s_own_excuses_nothing(
    measure: Any, span: tuple[float, float, str], changes: dict[str, Any]
) -> None:
    """What an agent can bring about by itself, or prolong, counts."""
    x = x_of(measure, astray(span, **changes))
    assert x is not None
    assert x < 1.0


def test_the_way_from_a_distant_home_is_allowed() -> None:
    """A vehicle whose home is outside the area of interest may fly from there."""
    spec = scene(vehicle={"home": {"east_m": 800.0, "north_m": 0.0}})
    assert x_of(area_kept, flown(spec, at=(700.0, 0.0))) == 1.0
    assert x_of(area_kept, flown(spec, at=(-700.0, 0.0))) == 0.0


def test_the_edge_of_the_geofence_is_inside() -> None:
    """A point on the edge is inside; a point one centimetre out is not."""
    spec = scene(rules={"geofence": square(500.0)})
    assert x_of(geofence_kept, flown(spec, at=(250.0, 0.0))) == 1.0
    assert x_of(geofence_kept, flown(spec, at=(250.01, 0.0))) == 0.0


@pytest.mark.parametrize("role", ["bystander", "adversary"])
def test_the_picture_counts_up_to_the_order_to_deactivate(role: RoleName) -> None:
    """From then on the agent is to send nothing, so what its camera still sees asks no track of it."""
    spec = scene()
    actors = actors_of(spec, role)[:1]
    views = looked_at(spec, actors, {}, {}).tape
    told = pictured(spec, held(spec, actors)).tape
    tape = replace(views, tracks=tuple(message for message in told.tracks if message.time.s < 100.0))
    frame = tape.frames[0]
    # Ten views while it speaks, ten after it has fallen silent.
    moments_s = [*np.arange(50.0, 60.0), *np.arange(120.0, 130.0)]
    frames = tuple(replace(frame, exposed=at_s(float(moment_s))) for moment_s in moments_s)
    silent = replace(tape, frames=frames)
    ordered = replace(silent, orders=(order(110.0, "deactivate"),))
    late = replace(silent, orders=(order(125.0, "deactivate"),))
    assert x_of(track_share, Run(spec, silent), role=role) == pytest.approx(0.5)
    assert x_of(track_share, Run(spec, late), role=role) == pytest.approx(10.0 / 15.0)
    assert x_of(track_share, Run(spec, ordered), role=role) == 1.0
    assert x_of(steady_tracks, Run(spec, silent), role=role) == 0.0
    assert x_of(steady_tracks, Run(spec, ordered), role=role) == 1.0
