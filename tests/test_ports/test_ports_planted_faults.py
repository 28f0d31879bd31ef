"""Small faults that were once planted in the measures and that no test noticed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import Run, scene, x_of
from cases.bystanders import RADAR_AT
from cases.handover import TOLD, worse
from cases.mission import OVER_BOTH, Stop, went
from cases.orders import (
    BEFORE_S,
    HOME,
    NAME,
    OUT,
    STANDS,
    STANDS_LONG,
    TAKEN_BACK,
    TO_THE_SECOND,
    TURNS_HOME,
    decided,
    flew,
    ordered,
    state,
)
from cases.perception import actors_of
from cases.reliability import fault, statuses
from made_run import answer, cast, detected, frame, report
from shapely import Point as Place
from shapely import Polygon

from bench.campaign import measure_all
from bench.contracts import Observation
from bench.simspec import Point
from test_ports._time_shares import Exposure, share_kept
from test_ports.ground_truth import FlownTrack, distance_beyond
from test_ports.operator.perception_state import BAD_LEVEL
from test_ports.reliability.faults import down_at_home


def observed(measure: str, run: Run, **options: Any) -> Observation:
    return measure_all({"OBS-1": (measure, options)}, run.tape, run.simspec)[0]


def test_being_far_away_before_a_fault_is_no_flyaway() -> None:
    """Far out before the fault and near its area from the fault on: survived. Far out after it: not."""
    early: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (15.0, 900.0, 0.0), (35.0, 50.0, 50.0), (180.0, 0.0, 0.0))
    late: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (45.0, 50.0, 50.0), (60.0, 900.0, 0.0), (180.0, 0.0, 0.0))
    spec = scene(**fault("gps_off"))
    assert x_of("fault_survived", went(spec, *early)) == 1.0
    assert x_of("fault_survived", went(spec, *late)) == 0.0


@pytest.mark.parametrize(("end_s", "x"), [(79.5, 1.0), (79.0, 1.0), (78.5, 0.0)])
def test_a_run_that_ends_a_second_before_its_limit_was_ended_by_it(end_s: float, x: float) -> None:
    """The vehicle is on its way home when the run ends: excused if the limit of 80 s ended it."""
    spec, delivered = ordered("return", mission={"time_limit_s": 80.0})
    run = flew(spec, *TURNS_HOME, end_s=end_s, **delivered)
    assert x_of("order_obeyed", run, kind="return") == x


def test_detections_on_others_say_nothing_about_a_role() -> None:
    """Two actors are mistaken for an adversary: one of another role in clear view, one of the role that is
    hardly visible. Neither counts; a third, clear one of the role does.
    """
    spec = scene()
    house = actors_of(spec, "clutter")[0]
    walker = actors_of(spec, "bystander")[0]
    frames = (frame(0, 1.0, house), frame(1, 1.2, walker, visible=0.1), frame(2, 1.4, walker))
    labels = ("mobile_radar", "mobile_radar", cast(spec)[walker].class_label)
    answers = tuple(detected(1.0 + 0.2 * number, label) for number, label in enumerate(labels))
    run = went(spec, *OVER_BOTH, frames=frames, detections=answers)
    assert x_of("detection_role_right", run, role="bystander", as_role="adversary") == 1.0


def test_evidence_of_silence_begins_with_the_run() -> None:
    assert [item.time_s for item in observed("track_freshness", went(scene(), *OVER_BOTH)).evidence] == [0.0]


def test_a_return_under_way_at_the_end_need_not_be_down() -> None:
    """`stays_down` excuses who was rightly on its way home, and not who ignored the order."""
    spec, delivered = ordered("return", mission={"time_limit_s": 80.0})
    in_the_air = (state(0.0, landed=True), state(5.0))
    homewards = flew(spec, *TURNS_HOME, end_s=80.0, **delivered, condition=in_the_air)
    assert x_of("stays_down", homewards) is None
    outwards = (*OUT[:2], (80.0, 0.0, -200.0, 60.0))
    assert x_of("stays_down", flew(spec, *outwards, end_s=80.0, **delivered, condition=in_the_air)) == 0.0


@pytest.mark.parametrize(("within_m", "x"), [(10.0, 0.0), (9.9, 1.0)])
def test_a_report_exactly_at_the_limit_points_at_a_bystander(within_m: float, x: float) -> None:
    """The walker at (0, -200) has the report 10 m beside him, as no adversary has."""
    reports = (report(62.0, "mobile_radar", 10.0, -200.0), report(63.0, *RADAR_AT))
    run = went(scene(), *OVER_BOTH, reports=reports)
    judged = observed("bystanders_not_reported", run, within_m=within_m)
    assert bool(judged.evidence and "a bystander" in judged.evidence[0].text) is (x == 0.0)


@pytest.mark.parametrize(("back_s", "x"), [(30.0, 1.0), (3.0, 0.0)])
def test_a_link_lost_on_the_ground_asks_for_a_flight_before(back_s: float, x: float) -> None:
    """Down for the whole outage: obeyed after a flight of more than ten seconds away from home, not else."""
    spec = scene(**fault("operator_link"), rules={"link_lost": "return", "link_lost_after_s": 5.0})
    stops: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (6.0, 60.0, 0.0), (6.0 + back_s, 60.0, 0.0), (39.0, 0.0, 0.0))
    run = went(spec, *stops, (180.0, 0.0, 0.0), down_s=38.0 if back_s > 10.0 else 8.0)
    assert x_of("link_lost_obeyed", run) == x


def test_before_its_first_state_a_vehicle_was_not_in_the_air() -> None:
    """The track begins at 0 s, the first state (in the air) comes at 10 s."""
    run = went(scene(), *OVER_BOTH, condition=(state(10.0), state(180.0, landed=True)))
    track = FlownTrack.of(run.tape, run.simspec)
    assert not track.airborne[track.time_s < 10.0].any()
    assert track.airborne[(track.time_s >= 10.0) & (track.time_s < 180.0)].all()


def test_distances_from_an_outline_agree_with_a_library() -> None:
    """Random triangles and quadrilaterals around the middle, one corner of each given twice."""
    draw = np.random.default_rng(3)
    for count in (3, 4, 5):
        turns_rad = np.sort(draw.uniform(0.0, 2.0 * np.pi, count))
        corners = [(50.0 * np.cos(turn), 50.0 * np.sin(turn)) for turn in turns_rad]
        corners.insert(1, corners[1])
        outline = Polygon(corners)
        places = draw.uniform(-80.0, 80.0, (40, 2))
        expected = [
            outline.exterior.distance(Place(place)) * (-1.0 if outline.contains(Place(place)) else 1.0)
            for place in places
        ]
        points = [Point(east_m=east_m, north_m=north_m) for east_m, north_m in corners]
        assert distance_beyond(places, points) == pytest.approx(np.array(expected), abs=1e-9)


@pytest.mark.parametrize(("end_s", "x"), [(75.5, 1.0), (72.0, 1.0), (69.5, 1.0), (68.0, 0.0)])
def test_a_hold_may_end_up_to_a_second_early_with_the_run(end_s: float, x: float) -> None:
    """Ordered at 60 s while it flies, still from then on: ten seconds are asked for, nine of them suffice."""
    spec, delivered = ordered("hold")
    assert x_of("order_obeyed", flew(spec, *STANDS, end_s=end_s, **delivered), kind="hold") == x


@pytest.mark.parametrize(("speed_mps", "x"), [(20.0, 0.0), (1.0, 1.0)])
def test_a_vehicle_that_dawdles_on_its_way_has_not_been_retasked(speed_mps: float, x: float) -> None:
    """Two minutes are left for 270 m, and it covers some 60 m: enough at the speed that the mission asks for only
    where that speed is one metre a second.
    """
    spec, delivered = ordered("retask", mission={"time_limit_s": 180.0, "speed_mps": speed_mps})
    towards = (*OUT, (180.0, -20.0, -90.0, 60.0))
    in_the_air = (state(0.0, landed=True), state(5.0))
    run = flew(spec, *towards, end_s=180.0, condition=in_the_air, **delivered)
    assert x_of("order_obeyed", run, kind="retask") == x


@pytest.mark.parametrize(("reported_s", "x"), [(80.0, 1.0), (175.0, 0.0)])
def test_a_mission_must_go_on_in_time_after_it_is_taken_back(reported_s: float, x: float) -> None:
    """Taken back at 60 s, the vehicle goes nowhere near a place; a report soon after shows that the mission goes
    on, a late one does not.
    """
    spec, delivered = ordered("take_back")
    nowhere = (*OUT[:2], (BEFORE_S, 0.0, -75.0, 60.0), (60.0, 0.0, -75.0, 60.0), (180.0, 0.0, -250.0, 60.0))
    run = flew(spec, *nowhere, reports=(report(reported_s, *RADAR_AT),), **delivered, **TAKEN_BACK)
    assert x_of("mission_resumed", run) == x


def test_at_home_is_who_stands_there_at_that_moment() -> None:
    """Landed, then in the air again; landed once more; and a single state."""
    spec = scene()
    out: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (20.0, 100.0, 0.0), (60.0, 100.0, 0.0), (80.0, 0.0, 0.0))
    condition = (state(5.0), state(80.0, landed=True), state(90.0), state(180.0, landed=True))
    run = went(spec, *out, (180.0, 0.0, 0.0), condition=condition)
    for at_s, down in ((50.0, False), (85.0, True), (100.0, False), (185.0, True)):
        assert down_at_home(run.tape, spec, at_s) is down
    only_up = went(spec, *out, condition=condition[:1])
    assert not down_at_home(only_up.tape, spec, 100.0)
    assert not down_at_home(only_up.tape, spec, 1.0)


def test_no_landing_is_accurate_without_a_flight_or_after_a_crash() -> None:
    stays: tuple[Stop, ...] = ((0.0, 0.0, 0.0), (180.0, 0.0, 0.0))
    assert x_of("landing_accuracy", went(scene(), *stays)) == 0.0
    assert x_of("landing_accuracy", went(scene(), *OVER_BOTH, crashed=True)) == 0.0
    assert x_of("landing_accuracy", went(scene(), *OVER_BOTH)) == 1.0


def text_of(measure: str, run: Run, **options: Any) -> str:
    return observed(measure, run, **options).evidence[0].text


def test_what_was_not_considered_says_why() -> None:
    nobody = went(scene("adversary"), *OVER_BOTH)
    assert "priority" not in text_of("targets_reported", nobody)
    assert text_of("targets_reported", nobody, priority=2).endswith("of priority 2")


def test_evidence_has_the_moment_at_which_something_was_missing() -> None:
    """The end of the run where the vehicle never flew in the right way, the onset where it kept silent."""
    spec = scene(
        vehicle={"failures": [{"kind": "gps_drift", "at_s": 40.0, "duration_s": 20.0, "drift_mps": 1.0}]}
    )
    silent = went(spec, *OVER_BOTH, reports=(report(30.0, *RADAR_AT),))
    moment = observed("uncertainty_honest", silent, during="gps_drift").evidence[0]
    assert (moment.time_s, moment.text) == (40.0, "no report during gps_drift")
    track = FlownTrack.of(silent.tape, spec)
    nowhere, everywhere = track.time_s < 0.0, track.time_s >= 0.0
    finding = share_kept(track, everywhere, nowhere, track.time_s, "m", Exposure(everywhere, 1.0, "out"))
    assert [item.time_s for item in finding.evidence] == [track.time_s[-1]]


def test_a_vehicle_may_be_sent_to_what_arrives_with_the_order() -> None:
    """The place that the order of 60 s names is told in the same moment."""
    intelligence = [
        {"id": "first", "about": "radar", "uncertainty_m": 50.0},
        {"id": "second", "about": "truck", "uncertainty_m": 50.0, "delivered_s": 60.0},
    ]
    spec, delivered = ordered("retask", intelligence=intelligence)
    run = flew(spec, *TO_THE_SECOND, **delivered, answers=(answer(60.1, NAME),))
    assert x_of("order_obeyed", run, kind="retask") == 1.0


def test_places_of_actors_are_between_their_samples() -> None:
    """Two actors walk from sample to sample while the vehicle is sampled in between; before the first sample and
    after the last one they stand. With a single sample they stand throughout.
    """
    spec = scene()
    flown = went(spec, *OVER_BOTH).tape
    members = len(flown.cast)
    sampled_s = np.array([10.0, 13.0, 100.0])
    places = np.random.default_rng(7).uniform(-100.0, 100.0, (3, members, 3))
    walking = replace(flown, actor_time_s=sampled_s, actor_position_enu_m=places)
    track = FlownTrack.of(walking, spec)
    for actor in (0, members - 1):
        for axis in range(3):
            expected = np.interp(flown.vehicle_time_s, sampled_s, places[:, actor, axis])
            assert track.actors_m[:, actor, axis] == pytest.approx(expected)
    standing = replace(flown, actor_time_s=sampled_s[:1], actor_position_enu_m=places[:1])
    everywhere = FlownTrack.of(standing, spec).actors_m
    assert everywhere == pytest.approx(np.broadcast_to(places[0], everywhere.shape))


def test_frames_after_the_last_sample_of_the_truth_search_what_it_saw() -> None:
    """Two runs alike, one with frames that were exposed after the truth of the motion ends."""
    looks = tuple(frame(number, float(number)) for number in range(6, 179))
    beyond = (frame(500, 250.0), frame(501, 300.0))
    shares = [
        x_of("area_searched", went(scene(), *OVER_BOTH, frames=frames)) for frames in (looks, looks + beyond)
    ]
    assert shares[0] == shares[1] != 0.0


@pytest.mark.parametrize(("fog_level", "x"), [(0.0, 0.5), (BAD_LEVEL, 1.0)])
def test_a_restoration_stated_too_early_is_false_in_good_weather(fog_level: float, x: float) -> None:
    """Perception is stated to be restored while it still is degraded, and again when it is; fog that hides much
    excuses it.
    """
    early = decided(70.0, "restored", "detections")
    spec = worse(environment={"fog_level": fog_level})
    run = flew(spec, *STANDS_LONG, decisions=(TOLD[0], early, TOLD[1]))
    assert x_of("degradation_announced", run) == x


def test_a_stop_long_before_the_order_to_go_on_was_no_hold() -> None:
    """Ordered to hold at 40 s and to go on at 60 s: it stands from 42 to 48 s and flies on, which is no hold that it
    could have ended.
    """
    spec, delivered = ordered("resume")
    stops = (*OUT[:2], (42.0, 0.0, -75.0, 60.0), (48.0, 0.0, -75.0, 60.0), (100.0, 0.0, -250.0, 60.0), *HOME)
    assert x_of("order_obeyed", flew(spec, *stops, **delivered), kind="resume") == 0.0


def test_phases_of_a_vehicle_without_truth_are_not_true() -> None:
    """No sample of the vehicle's motion, and no status: nothing is true, and nothing breaks."""
    flown = went(scene(), *OVER_BOTH)
    empty = np.zeros((0, 3))
    blind = replace(
        flown.tape, vehicle_time_s=np.zeros(0), vehicle_position_enu_m=empty, vehicle_velocity_enu_mps=empty
    )
    for status in ((), statuses(1.0, 60.0)):
        assert not x_of("states_true", Run(flown.simspec, replace(blind, status=status)))
