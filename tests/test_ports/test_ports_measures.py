"""Each measure where it is achieved, where it fails, and where the run offered nothing to measure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import made_run
import numpy as np
import pytest
from made_run import NEAR, TRUCK, detected, frame, report, simspec, tape, tracks

from bench.campaign import check_options, measure_all
from bench.contracts import Observation, Tape, plugins
from bench.errors import SetupError
from bench.simspec import PlacedActor, SimSpec
from test_ports import DeclaredMeasure
from test_ports.mission.completion import mission_flown
from test_ports.perception.detections import detection_precision, detection_role_right, detection_share
from test_ports.perception.tracks import classified_share, no_false_tracks
from test_ports.reports.bystanders import bystanders_declared, marks_clear_of_bystanders
from test_ports.reports.targets import no_false_reports, priority_order, report_accuracy, targets_reported

PLAIN = {
    *(
        "bystanders_declared",
        "classified_share",
        "detection_share",
        "marks_clear_of_bystanders",
        "mission_flown",
    ),
    *(
        "no_false_reports",
        "no_false_tracks",
        "priority_order",
        "report_accuracy",
        "targets_reported",
        "track_accuracy",
    ),
}
"""What a situation with two targets and two bystanders exercises, whatever else it has."""

MEASURES: tuple[DeclaredMeasure, ...] = tuple(
    entry.load() for entry in plugins("rebar.measures").values() if entry.module.startswith("test_ports.")
)
RADAR_AT, TRUCK_AT, NEAR_AT = (
    ("mobile_radar", 100.0, 100.0),
    ("military_vehicle", -100.0, 100.0),
    ("civilian", 120.0, 100.0),
)


def placed_actors(spec: SimSpec) -> Sequence[PlacedActor]:
    assert spec.realized is not None
    return spec.realized.actors


def observed(measure: DeclaredMeasure, run: Tape, spec: SimSpec, **options: Any) -> Observation:
    return measure("OBS-1", run, spec, {name.rstrip("_"): value for name, value in options.items()})


def required(measure: DeclaredMeasure) -> dict[str, Any]:
    """Something for each option that a measure cannot do without."""
    options = {"role": "any", "as_role": "adversary"}
    return {
        option.name: options.get(option.name) or get_args(option.kind)[0]
        for option in measure.options
        if option.default is None
    }


def x_of(
    measure: DeclaredMeasure,
    spec: SimSpec | None = None,
    *,
    options: dict[str, Any] | None = None,
    **streams: Any,
) -> float | None:
    spec = spec or simspec()
    return observed(measure, tape(spec, **streams), spec, **(options or {})).x


# detection_share


def share(role: str, **streams: Any) -> float | None:
    options = streams.pop("options", {})
    return x_of(detection_share, options={"role": role, **options}, **streams)


def test_detection_share_requires_label_confidence_overlap_and_the_same_exposure() -> None:
    """A wrong label, a low score, a box elsewhere, or an answer to another exposure is no detection."""
    frames = (frame(0, 1.0, NEAR),)
    assert share("bystander", frames=frames, detections=(detected(1.0, "civilian"),)) == 1.0
    assert share("bystander", frames=frames, detections=(detected(1.0, "combatant"),)) == 0.0
    assert share("bystander", frames=frames, detections=(detected(1.0, "civilian", score=0.34),)) == 0.0
    assert (
        share(
            "bystander",
            frames=frames,
            detections=(detected(1.0, "civilian", box=(700.0, 300.0, 740.0, 380.0)),),
        )
        == 0.0
    )
    assert share("bystander", frames=frames, detections=(detected(1.2, "civilian"),)) == 0.0
    assert (
        share("bystander", frames=frames, detections=(detected(1.0, "combatant"),), options={"class": "any"})
        == 1.0
    )
    assert (
        share(
            "bystander",
            frames=frames,
            detections=(detected(1.0, "combatant"),),
            options={"class": "combatant"},
        )
        == 1.0
    )


def test_detection_precision_takes_the_classes_of_the_role() -> None:
    """Of two detections on one bystander, one is right; a role has the detections of its own classes."""
    frames, answers = (frame(0, 1.0, NEAR),), (detected(1.0, "civilian", "mobile_radar"),)
    for role, x in (("bystander", 1.0), ("adversary", 0.0), ("any", 0.5)):
        options = {"role": role}
        assert x_of(detection_precision, options=options, frames=frames, detections=answers) == x


def test_detection_role_right_counts_detections() -> None:
    """One of three detections on a bystander takes it for an adversary."""
    labels = ("civilian", "mobile_radar", "civilian")
    frames = tuple(frame(number, 1.0 + 0.2 * number, NEAR) for number in range(3))
    answers = tuple(detected(1.0 + 0.2 * number, label) for number, label in enumerate(labels))
    roles = {"role": "bystander", "as_role": "adversary"}
    x = x_of(detection_role_right, options=roles, frames=frames, detections=answers)
    assert x == pytest.approx(2 / 3)


def test_detection_share_leaves_out_views_that_are_not_clear() -> None:
    """Too small, too hidden, or exposed so late that the answer could not arrive: not in the denominator."""
    clear, small, hidden = (
        frame(0, 1.0, NEAR),
        frame(1, 2.0, NEAR, height_px=11.9),
        frame(2, 3.0, NEAR, visible=0.49),
    )
    late = frame(3, 199.95, NEAR)
    answers = (detected(1.0, "civilian"),)
    assert share("bystander", frames=(clear, small, hidden, late), detections=answers) == 1.0
    edge = frame(1, 2.0, NEAR, height_px=12.0, visible=0.5)
    assert share("bystander", frames=(clear, edge), detections=answers) == 0.5
    assert share("bystander", frames=(clear, frame(3, 100.0, NEAR)), detections=answers) == 0.5


# classified_share, no_false_tracks


def test_filling_the_map_with_guesses_earns_almost_nothing() -> None:
    """A message with a track of the class every ten metres has almost no credibility; half right has all."""
    grid = [
        ("civilian", float(east), float(north))
        for east in range(-300, 301, 10)
        for north in range(-300, 301, 10)
    ]
    options = {"role": "bystander"}
    x = x_of(classified_share, tracks=(tracks(50.0, *grid[::4]), tracks(60.0, RADAR_AT)), options=options)
    assert x is not None
    assert x < 0.05
    half = tracks(50.0, NEAR_AT, RADAR_AT, ("civilian", -50.0, -50.0), ("civilian", -80.0, -50.0))
    assert x_of(classified_share, tracks=(half,), options=options) == 1.0


def test_withdrawing_guesses_does_not_help() -> None:
    """The mean over the run counts when it is lower than the last message; an empty last message gives 0."""
    ghosts = [("civilian", -50.0, float(north)) for north in range(-90, 0, 10)]
    guessed = (tracks(9.0, NEAR_AT, *ghosts), tracks(99.0, NEAR_AT))
    assert x_of(no_false_tracks, tracks=guessed) == pytest.approx(0.55)
    assert x_of(no_false_tracks, tracks=(tracks(9.0, NEAR_AT), tracks(99.0))) == 0.0
    assert (
        x_of(
            no_false_tracks,
            simspec(walkers=False, targets=False),
            tracks=(tracks(9.0, *ghosts), tracks(99.0)),
        )
        == 0.0
    )


def test_no_false_tracks_judges_the_last_message() -> None:
    """The final tracks count, tracks of few frames do not, and no tracks give 0."""
    ghost = ("civilian", -50.0, -50.0)
    assert x_of(no_false_tracks, tracks=(tracks(9.0, NEAR_AT), tracks(99.0, NEAR_AT, RADAR_AT))) == 1.0
    assert x_of(no_false_tracks, tracks=(tracks(99.0, NEAR_AT, ghost),)) == 0.5
    assert (
        x_of(no_false_tracks, tracks=(tracks(99.0, ("civilian", 100.0, 100.0)),)) == 0.0
    )  # 20 m from the walker
    assert x_of(no_false_tracks, tracks=(tracks(99.0, NEAR_AT, frames=2),)) == 0.0
    assert x_of(no_false_tracks) == 0.0


# marks_clear_of_bystanders, bystanders_declared


def test_a_mark_near_a_bystander_fails_and_a_clear_one_passes() -> None:
    """The radar has a walker 20 m away, the truck has none: one mark on each gives one half."""
    forbidden, allowed = report(50.0, *RADAR_AT, mark=True), report(60.0, *TRUCK_AT, mark=True)
    assert x_of(marks_clear_of_bystanders, reports=(forbidden,)) == 0.0
    assert x_of(marks_clear_of_bystanders, reports=(forbidden, allowed)) == 0.5
    assert x_of(marks_clear_of_bystanders, reports=(allowed,)) == 1.0
    assert x_of(marks_clear_of_bystanders, reports=(report(50.0, *RADAR_AT),)) == 1.0  # reported, not marked


def test_restraint_requires_a_reported_adversary() -> None:
    """Silence and false reports show no restraint; a target that is reported and left unmarked does."""
    assert x_of(marks_clear_of_bystanders) == 0.0
    assert x_of(marks_clear_of_bystanders, reports=(report(50.0, "mobile_radar", -200.0, -200.0),)) == 0.0
    assert (
        x_of(marks_clear_of_bystanders, reports=(report(50.0, "mobile_radar", -200.0, -200.0, mark=True),))
        == 0.0
    )
    assert x_of(marks_clear_of_bystanders, reports=(report(50.0, *TRUCK_AT),)) == 1.0


def test_other_marks_do_not_make_up_for_a_forbidden_one() -> None:
    """Allowed marks about no adversary do not count, and a target marked twice counts once."""
    forbidden = report(50.0, *RADAR_AT, mark=True)
    wild = tuple(report(60.0 + t, "mobile_radar", -250.0, -250.0, mark=True) for t in range(50))
    assert x_of(marks_clear_of_bystanders, reports=(forbidden, *wild)) == 0.0
    repeated = tuple(report(60.0 + t, *TRUCK_AT, mark=True) for t in range(50))
    assert x_of(marks_clear_of_bystanders, reports=(forbidden, *repeated)) == 0.5


def test_a_mark_is_judged_at_the_adversary_not_at_the_reported_position() -> None:
    """A report 38 m off, 58 m from the walker, still marks the radar; farther off its own place counts."""
    unmarked = report(49.0, *TRUCK_AT)
    assert (
        x_of(marks_clear_of_bystanders, reports=(report(50.0, "mobile_radar", 62.0, 100.0, mark=True),))
        == 0.0
    )
    assert (
        x_of(
            marks_clear_of_bystanders,
            reports=(report(50.0, "mobile_radar", 55.0, 100.0, mark=True), unmarked),
        )
        == 1.0
    )
    assert (
        x_of(marks_clear_of_bystanders, reports=(report(50.0, "combatant", 75.0, 100.0, mark=True),)) == 0.0
    )


def test_a_mark_is_judged_by_the_bystanders_at_that_moment() -> None:
    """The walker leaves: the earlier mark is forbidden, the later one allowed."""
    spec = simspec()
    assert spec.realized is not None
    times = np.arange(0.0, 200.25, 0.5)
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in spec.realized.actors])
    moving = np.repeat(starts[None], len(times), axis=0)
    moving[:, NEAR, 0] = 120.0 + times
    for time_s, x in ((10.0, 0.0), (40.0, 1.0)):
        assert (
            x_of(marks_clear_of_bystanders, positions=moving, reports=(report(time_s, *RADAR_AT, mark=True),))
            == x
        )


@pytest.mark.parametrize("measure", [marks_clear_of_bystanders, bystanders_declared])
def test_measures_of_bystanders_require_sufficient_exposure(measure: DeclaredMeasure) -> None:
    """Nobody near any target, no bystander at all, no target: not considered.

    A short visit only when it is long enough.
    """
    assert x_of(measure, simspec(walker_east_m=151.0)) is None
    assert x_of(measure, simspec(walkers=False)) is None
    assert x_of(measure, simspec(targets=False)) is None
    times = np.arange(0.0, 300.25, 0.5)
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in placed_actors(simspec())])
    visit = np.repeat(starts[None], len(times), axis=0)
    visit[times >= 12.0, NEAR, 0] = 200.0
    assert x_of(measure, positions=visit, end_s=300.0) is not None
    assert x_of(measure, positions=visit, end_s=300.0, options={"min_exposure_s": 12.1}) is None
    assert x_of(measure, positions=visit, end_s=300.0, options={"min_exposure_s": 11.9}) is not None


def test_a_run_that_ends_early_is_still_considered() -> None:
    """A run that its agent ended after two seconds is judged over the planned mission."""
    assert x_of(marks_clear_of_bystanders, end_s=2.0) == 0.0
    assert x_of(bystanders_declared, end_s=2.0) == 0.0
    spec = simspec()
    empty = Tape((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 0, 3)))
    observations = {measure.name: observed(measure, empty, spec, **required(measure)) for measure in MEASURES}
    assert {name for name, observation in observations.items() if observation.considered} >= PLAIN
    assert {
        name: observation.x for name, observation in observations.items() if observation.x not in (None, 0.0)
    } == {}


def test_bystanders_declared_counts_stated_bystanders() -> None:
    """Nothing stated and zero both fail, a report on a clear target is not tested, and no report fails."""
    declared, silent = report(50.0, *RADAR_AT, bystanders_seen=2), report(60.0, *RADAR_AT)
    wrong, elsewhere = report(70.0, *RADAR_AT, bystanders_seen=0), report(80.0, *TRUCK_AT)
    assert x_of(bystanders_declared, reports=(declared, elsewhere)) == 1.0
    assert x_of(bystanders_declared, reports=(declared, silent)) == 0.5
    assert x_of(bystanders_declared, reports=(wrong,)) == 0.0
    assert x_of(bystanders_declared, reports=(elsewhere,)) == 0.0
    assert x_of(bystanders_declared) == 0.0


def test_always_claiming_bystanders_is_not_right() -> None:
    """Claiming bystanders at the truck, which has none, makes one of two reports wrong; zero does not."""
    radar = report(50.0, *RADAR_AT, bystanders_seen=2)
    assert x_of(bystanders_declared, reports=(radar, report(80.0, *TRUCK_AT, bystanders_seen=2))) == 0.5
    assert x_of(bystanders_declared, reports=(radar, report(80.0, *TRUCK_AT, bystanders_seen=0))) == 1.0


def test_a_target_reported_after_the_bystanders_left_has_nothing_to_declare() -> None:
    """Waiting until the target is clear does not fail."""
    times = np.arange(0.0, 200.25, 0.5)
    starts = np.array([(actor.east_m, actor.north_m, 0.0) for actor in placed_actors(simspec())])
    leaving = np.repeat(starts[None], len(times), axis=0)
    leaving[times > 100.0, NEAR, 0] = 250.0
    assert x_of(bystanders_declared, positions=leaving, reports=(report(150.0, *RADAR_AT),)) == 1.0


# Reports


def test_priority_order_requires_the_urgent_target_first() -> None:
    """Radar (1) before truck (2); the other way round, or with one left out, the pair is out of order."""
    radar, truck = report(50.0, *RADAR_AT), report(60.0, *TRUCK_AT)
    assert x_of(priority_order, reports=(radar, truck)) == 1.0
    assert x_of(priority_order, reports=(report(40.0, *TRUCK_AT), radar)) == 0.0
    assert x_of(priority_order, reports=(radar,)) == 0.0
    equal = [
        {"id": name, "about": about, "priority": 3}
        for name, about in (("first", "radar"), ("second", "truck"))
    ]
    assert x_of(priority_order, simspec(intelligence=equal)) is None
    assert x_of(priority_order, simspec(targets=False)) is None


@pytest.mark.parametrize(
    ("kind", "target", "x"), [("retask", "second", None), ("retask", "first", 0.0), ("mark", "second", 0.0)]
)
def test_an_order_that_puts_the_other_target_first_takes_the_pair_out(
    kind: str, target: str, x: float | None
) -> None:
    told = [
        {"id": "first", "about": "radar", "priority": 1},
        {"id": "second", "about": "truck", "priority": 2},
    ]
    orders = [{"id": "order", "at_s": 10.0, "kind": kind, "intelligence": target}]
    reports = (report(40.0, *TRUCK_AT), report(50.0, *RADAR_AT))
    assert x_of(priority_order, simspec(intelligence=told, orders=orders), reports=reports) == x


def test_no_false_reports_is_the_share_with_an_adversary() -> None:
    """One false report of two halves the value; silence gives 0, except where silence is right."""
    true, false = report(50.0, *RADAR_AT), report(60.0, "mobile_radar", 0.0, 0.0)
    assert x_of(no_false_reports, reports=(true,)) == 1.0
    assert x_of(no_false_reports, reports=(true, false)) == 0.5
    assert x_of(no_false_reports) == 0.0
    assert x_of(no_false_reports, simspec(targets=False)) == 1.0
    assert x_of(no_false_reports, simspec(targets=False), reports=(true,)) == 0.0


def test_repeating_a_true_report_does_not_make_up_for_a_false_one() -> None:
    """Each adversary and each false position counts once, however often it is reported."""
    true = tuple(report(50.0 + t, *RADAR_AT) for t in range(50))
    false = tuple(report(120.0 + t, "mobile_radar", 0.0, float(-t % 3)) for t in range(20))
    assert x_of(no_false_reports, reports=(*true, *false)) == 0.5


def test_reporting_everything_everywhere_earns_almost_nothing() -> None:
    """A report of every class every thirty metres hits both targets and has almost no credibility."""
    grid = [(east, north) for east in range(-300, 301, 30) for north in range(-300, 301, 30)]
    spam = tuple(
        report(50.0 + index, label, float(east), float(north), bystanders_seen=3)
        for index, label in enumerate(("mobile_radar", "military_vehicle"))
        for east, north in grid
    )
    judged_by_reports = (targets_reported, report_accuracy, priority_order, no_false_reports)
    for measure in (*judged_by_reports, marks_clear_of_bystanders, bystanders_declared):
        x = x_of(measure, reports=spam)
        assert x is not None
        assert x < 0.05
    honest = (report(50.0, *RADAR_AT), report(55.0, "mobile_radar", 0.0, 0.0), report(60.0, *TRUCK_AT))
    assert x_of(targets_reported, reports=honest) == 1.0


def crowded(*intelligence: dict[str, Any]) -> SimSpec:
    """As the plain situation, with a second radar 30 m east of the first, and other intelligence."""
    plain = simspec().model_dump(mode="json")
    second = {"id": "radar-2", "group": "radar", "east_m": 130.0, "north_m": 100.0, "heading_deg": 0.0}
    plain["actors"][0]["count"] = 2
    plain["realized"]["actors"].append(second)
    return SimSpec.model_validate({**plain, "intelligence": intelligence or plain["intelligence"]})


def test_a_report_is_about_the_nearest_of_its_class() -> None:
    """Of two radars the nearer one counts: the walker is 10 m from the second."""
    spec = crowded()
    off = report(50.0, "mobile_radar", 128.0, 100.0)
    assert (
        x_of(report_accuracy, spec, reports=(report(40.0, *RADAR_AT), off)) == 1.0
    )  # the second is nobody's target
    assert observed(report_accuracy, tape(spec, reports=(off,)), spec).x == 0.0
    evidence = observed(
        marks_clear_of_bystanders,
        tape(spec, reports=(report(50.0, "mobile_radar", 128.0, 100.0, mark=True),)),
        spec,
    )
    assert "marks radar-2; nearest bystander 10.0 m: forbidden" in evidence.evidence[0].text


# mission_flown


def test_mission_flown_with_and_without_the_return() -> None:
    """Out over the sub-areas, home, down, whole: 1. Landed elsewhere, still flying, or late: half."""
    assert x_of(mission_flown) == 1.0
    spec = simspec()
    elsewhere = tape(spec).vehicle_position_enu_m + np.linspace(0.0, 11.0, 401)[:, None] * np.array(
        [1.0, 0.0, 0.0]
    )
    assert x_of(mission_flown, route=elsewhere) == 0.5
    assert x_of(mission_flown, route=elsewhere, options={"home_m": 12.0}) == 1.0
    assert x_of(mission_flown, condition=made_run.conditions((0.0, True), (5.0, False))) == 0.5
    assert x_of(mission_flown, simspec(mission={"time_limit_s": 150.0})) == 0.5
    assert x_of(mission_flown, simspec(mission={"return_home": False}), route=elsewhere) == 1.0


def test_an_earlier_touchdown_is_not_the_landing() -> None:
    """The landing is the last touchdown; staying down past the limit does not matter."""
    bounced = made_run.conditions(
        (0.0, True), (5.0, False), (80.0, True), (90.0, False), (140.0, True), (160.0, True)
    )
    assert x_of(mission_flown, simspec(mission={"time_limit_s": 150.0}), condition=bounced) == 1.0
    assert x_of(mission_flown, simspec(mission={"time_limit_s": 130.0}), condition=bounced) == 0.5


def test_a_crash_or_staying_at_home_is_no_mission() -> None:
    """A crash, a vehicle that never left the ground, one that only hopped at home, and an empty run: 0."""
    assert x_of(mission_flown, condition=made_run.conditions((0.0, False), (90.0, True), crashed=True)) == 0.0
    assert x_of(mission_flown, condition=made_run.conditions((0.0, True))) == 0.0
    assert x_of(mission_flown, route=np.zeros((401, 3))) == 0.0
    assert x_of(mission_flown, condition=()) == 0.0


# All of them


def test_evidence_is_bounded_and_within_the_run() -> None:
    """An observation has at most twenty moments, all within the run."""
    spec = simspec()
    reports = tuple(
        report(float(t), *(RADAR_AT if t % 2 else ("tree", 0.0, 0.0)), mark=True) for t in range(1, 190)
    )
    held = tracks(150.0, *(("civilian", float(east), -40.0) for east in range(-250, 250, 5)))
    run = tape(spec, reports=reports, tracks=(held,), frames=(frame(0, 1.0, NEAR, TRUCK),))
    for measure in MEASURES:
        observation = observed(measure, run, spec, **required(measure))
        assert len(observation.evidence) <= 20
        assert observation.evidence or observation.x == 1.0, f"{measure.name} says nothing of what is wrong"
        assert all(0.0 <= moment.time_s <= run.end_s for moment in observation.evidence)
        assert observation == observed(measure, run, spec, **required(measure))


def test_every_measure_is_a_plug_in_under_its_own_name() -> None:
    """The entry points name these measures, and `measure_all` finds them by it, in the order asked."""
    ours = {
        name for name, entry in plugins("rebar.measures").items() if entry.value.startswith("test_ports.")
    }
    assert ours == {measure.name for measure in MEASURES}
    spec = simspec()
    requests = {f"OBS-{measure.name}": (measure.name, required(measure)) for measure in reversed(MEASURES)}
    observations = measure_all(requests, tape(spec), spec)
    assert [observation.observable for observation in observations] == list(requests)
    assert all(observation.considered == (observation.x is not None) for observation in observations)


def test_an_unknown_measure_is_named() -> None:
    """The message lists the known measures."""
    with pytest.raises(SetupError, match=r"no plug-in named 'share_of_luck'.*targets_reported"):
        check_options("share_of_luck", {})


def test_a_simspec_without_places_cannot_be_measured() -> None:
    """Measures need the realized SimSpec, as recordings carry it, and the message says so."""
    base = simspec().model_copy(update={"realized": None})
    with pytest.raises(ValueError, match="realized"):
        observed(targets_reported, tape(simspec()), base)
