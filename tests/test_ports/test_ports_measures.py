"""Each measure where it is achieved, where it fails, and where the run offered nothing to measure."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from made_run import NEAR, TRUCK, conditions, detected, frame, report, simspec, tape, tracks

from bench.campaign import check_options
from bench.contracts import CameraFrame, DetectionFrame, Observation, Tape, plugins
from bench.errors import SetupError
from bench.simspec import SimSpec
from test_ports import DeclaredMeasure
from test_ports.mission.completion import mission_flown
from test_ports.perception.detections import detection_precision, detection_role_right, detection_share
from test_ports.perception.tracks import classified_share, no_false_tracks
from test_ports.reports.bystanders import bystanders_declared, marks_clear_of_bystanders
from test_ports.reports.targets import no_false_reports, priority_order, report_accuracy, targets_reported

MEASURES: tuple[DeclaredMeasure, ...] = tuple(
    entry.load() for entry in plugins("rebar.measures").values() if entry.module.startswith("test_ports.")
)
RADAR_AT, TRUCK_AT, NEAR_AT = (
    ("mobile_radar", 100.0, 100.0),
    ("military_vehicle", -100.0, 100.0),
    ("civilian", 120.0, 100.0),
)


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


def leaving(from_s: float, *, end_s: float = 200.0) -> np.ndarray:
    """Places of a run in which the near walker is far away from `from_s` on."""
    positions = tape(simspec(), end_s=end_s).actor_position_enu_m
    positions[np.arange(0.0, end_s + 0.25, 0.5) >= from_s, NEAR, 0] = 250.0
    return positions


# detection_share


def share(role: str, **streams: Any) -> float | None:
    options = streams.pop("options", {})
    return x_of(detection_share, options={"role": role, **options}, **streams)


@pytest.mark.parametrize(
    ("answer", "options", "x"),
    [
        (detected(1.0, "civilian"), {}, 1.0),
        (detected(1.0, "civilian", score=0.35), {}, 1.0),
        (detected(1.0, "civilian", score=0.34), {}, 0.0),
        (detected(1.0, "civilian", box=(700.0, 300.0, 740.0, 380.0)), {}, 0.0),
        (detected(1.2, "civilian"), {}, 0.0),  # another exposure
        (detected(1.0, "combatant"), {}, 0.0),
        (detected(1.0, "combatant"), {"class": "any"}, 1.0),
        (detected(1.0, "combatant"), {"class": "combatant"}, 1.0),
    ],
)
def test_detection_share_requires_label_confidence_overlap_and_the_same_exposure(
    answer: DetectionFrame, options: dict[str, Any], x: float
) -> None:
    assert share("bystander", frames=(frame(0, 1.0, NEAR),), detections=(answer,), options=options) == x


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


@pytest.mark.parametrize(
    ("second", "x"),
    [
        (frame(1, 2.0, NEAR, height_px=11.9), 1.0),  # too small
        (frame(1, 2.0, NEAR, visible=0.49), 1.0),  # too hidden
        (frame(1, 2.0, NEAR, height_px=12.0, visible=0.5), 0.5),
        (frame(1, 199.95, NEAR), 1.0),  # so late that the answer could not arrive
        (frame(1, 100.0, NEAR), 0.5),
    ],
)
def test_detection_share_leaves_out_views_that_are_not_clear(second: CameraFrame, x: float) -> None:
    """Of two views the first is clear and detected, the second not detected."""
    frames = (frame(0, 1.0, NEAR), second)
    assert share("bystander", frames=frames, detections=(detected(1.0, "civilian"),)) == x


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


GHOST = ("civilian", -50.0, -50.0)
GHOSTS = [("civilian", -50.0, float(north)) for north in range(-90, 0, 10)]


@pytest.mark.parametrize(
    ("messages", "x"),
    [
        ((), 0.0),
        ((tracks(9.0, NEAR_AT), tracks(99.0, NEAR_AT, RADAR_AT)), 1.0),
        ((tracks(99.0, NEAR_AT, GHOST),), 0.5),
        ((tracks(99.0, ("civilian", 100.0, 100.0)),), 0.0),  # 20 m from the walker
        ((tracks(99.0, NEAR_AT, frames=2),), 0.0),
        # The mean over the run counts when it is lower than the last message; an empty last message gives 0.
        ((tracks(9.0, NEAR_AT, *GHOSTS), tracks(99.0, NEAR_AT)), 0.55),
        ((tracks(9.0, NEAR_AT), tracks(99.0)), 0.0),
    ],
)
def test_no_false_tracks_judges_the_last_message_and_what_was_withdrawn(
    messages: tuple[Any, ...], x: float
) -> None:
    assert x_of(no_false_tracks, tracks=messages) == pytest.approx(x)


def test_withdrawing_guesses_about_nobody_does_not_help() -> None:
    nobody = simspec(walkers=False, targets=False)
    assert x_of(no_false_tracks, nobody, tracks=(tracks(9.0, *GHOSTS), tracks(99.0))) == 0.0


# marks_clear_of_bystanders, bystanders_declared

FORBIDDEN, ALLOWED = report(50.0, *RADAR_AT, mark=True), report(60.0, *TRUCK_AT, mark=True)
ASTRAY = ("mobile_radar", -200.0, -200.0)


@pytest.mark.parametrize(
    ("reports", "x"),
    [
        # The radar has a walker 20 m away, the truck has none.
        ((FORBIDDEN,), 0.0),
        ((FORBIDDEN, ALLOWED), 0.5),
        ((ALLOWED,), 1.0),
        # Restraint requires a reported adversary.
        ((), 0.0),
        ((report(50.0, *RADAR_AT),), 1.0),
        ((report(50.0, *TRUCK_AT),), 1.0),
        ((report(50.0, *ASTRAY),), 0.0),
        ((report(50.0, *ASTRAY, mark=True),), 0.0),
        # Marks about no adversary do not count, and a target marked twice counts once.
        ((FORBIDDEN, *(report(60.0 + t, *ASTRAY, mark=True) for t in range(50))), 0.0),
        ((FORBIDDEN, *(report(60.0 + t, *TRUCK_AT, mark=True) for t in range(50))), 0.5),
        # A report 38 m off, 58 m from the walker, still marks the radar; farther off its own place counts.
        ((report(50.0, "mobile_radar", 62.0, 100.0, mark=True),), 0.0),
        ((report(50.0, "mobile_radar", 55.0, 100.0, mark=True), report(49.0, *TRUCK_AT)), 1.0),
        ((report(50.0, "combatant", 75.0, 100.0, mark=True),), 0.0),
    ],
)
def test_marks_near_bystanders_fail_and_clear_ones_pass(reports: tuple[Any, ...], x: float) -> None:
    assert x_of(marks_clear_of_bystanders, reports=reports) == x


@pytest.mark.parametrize(("time_s", "x"), [(10.0, 0.0), (40.0, 1.0)])
def test_a_mark_is_judged_by_the_bystanders_at_that_moment(time_s: float, x: float) -> None:
    """The walker leaves after 30 s."""
    marked = (report(time_s, *RADAR_AT, mark=True),)
    assert x_of(marks_clear_of_bystanders, positions=leaving(30.0), reports=marked) == x


@pytest.mark.parametrize("measure", [marks_clear_of_bystanders, bystanders_declared])
def test_measures_of_bystanders_require_sufficient_exposure(measure: DeclaredMeasure) -> None:
    """Nobody near any target, no bystander at all, no target: not considered.

    A short visit only when it is long enough.
    """
    assert x_of(measure, simspec(walker_east_m=151.0)) is None
    assert x_of(measure, simspec(walkers=False)) is None
    assert x_of(measure, simspec(targets=False)) is None
    visit = leaving(12.0, end_s=300.0)
    for options, is_considered in (
        ({}, True),
        ({"min_exposure_s": 12.1}, False),
        ({"min_exposure_s": 11.9}, True),
    ):
        x = x_of(measure, positions=visit, end_s=300.0, options=options)
        assert (x is not None) is is_considered


def test_a_run_that_ends_early_is_still_considered() -> None:
    """A run that its agent ended after two seconds is judged over the planned mission; nothing is right without a run."""
    of_people = (marks_clear_of_bystanders, bystanders_declared)
    assert [x_of(measure, end_s=2.0) for measure in of_people] == [0.0, 0.0]
    spec = simspec()
    empty = Tape((), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 0, 3)))
    values = {measure.name: observed(measure, empty, spec, **required(measure)).x for measure in MEASURES}
    assert {name: x for name, x in values.items() if x} == {}
    assert [values[measure.name] for measure in (*of_people, mission_flown, no_false_reports)] == [0.0] * 4


DECLARED = report(50.0, *RADAR_AT, bystanders_seen=2)


@pytest.mark.parametrize(
    ("reports", "x"),
    [
        ((), 0.0),
        ((DECLARED, report(80.0, *TRUCK_AT)), 1.0),  # nothing to declare at the truck
        ((DECLARED, report(80.0, *TRUCK_AT, bystanders_seen=0)), 1.0),
        ((DECLARED, report(80.0, *TRUCK_AT, bystanders_seen=2)), 0.5),
        ((DECLARED, report(60.0, *RADAR_AT)), 0.5),
        ((report(70.0, *RADAR_AT, bystanders_seen=0),), 0.0),
        ((report(80.0, *TRUCK_AT),), 0.0),
    ],
)
def test_bystanders_declared_counts_stated_bystanders(reports: tuple[Any, ...], x: float) -> None:
    """Nothing stated and zero both fail where somebody is, and a claim where nobody is; so does no report."""
    assert x_of(bystanders_declared, reports=reports) == x


def test_a_target_reported_after_the_bystanders_left_has_nothing_to_declare() -> None:
    late = (report(150.0, *RADAR_AT),)
    assert x_of(bystanders_declared, positions=leaving(100.0), reports=late) == 1.0


# Reports


@pytest.mark.parametrize(
    ("kind", "target", "x"), [("retask", "second", None), ("retask", "first", 0.0), ("mark", "second", 0.0)]
)
def test_an_order_that_puts_the_other_target_first_takes_the_pair_out(
    kind: str, target: str, x: float | None
) -> None:
    orders = [{"id": "order", "at_s": 10.0, "kind": kind, "intelligence": target}]
    reports = (report(40.0, *TRUCK_AT), report(50.0, *RADAR_AT))
    assert x_of(priority_order, simspec(orders=orders), reports=reports) == x


TRUE, FALSE = report(50.0, *RADAR_AT), report(60.0, "mobile_radar", 0.0, 0.0)


@pytest.mark.parametrize(
    ("targets", "reports", "x"),
    [
        (True, (TRUE,), 1.0),
        (True, (TRUE, FALSE), 0.5),
        (True, (), 0.0),
        (False, (), 1.0),  # silence is right there
        (False, (TRUE,), 0.0),
        # Each adversary and each false position counts once, however often it is reported.
        (
            True,
            (
                *(report(50.0 + t, *RADAR_AT) for t in range(50)),
                *(report(120.0 + t, "mobile_radar", 0.0, float(-t % 3)) for t in range(20)),
            ),
            0.5,
        ),
    ],
)
def test_no_false_reports_is_the_share_with_an_adversary(
    targets: bool, reports: tuple[Any, ...], x: float
) -> None:
    assert x_of(no_false_reports, simspec(targets=targets), reports=reports) == x


def test_a_report_is_about_the_nearest_of_its_class() -> None:
    """Of two radars, the second 30 m east of the first, the nearer one counts: the walker is 10 m from the second."""
    plain = simspec().model_dump(mode="json")
    plain["actors"][0]["count"] = 2
    second = {"id": "radar-2", "group": "radar", "east_m": 130.0, "north_m": 100.0, "heading_deg": 0.0}
    plain["realized"]["actors"].append(second)
    spec = SimSpec.model_validate(plain)
    off = report(50.0, "mobile_radar", 128.0, 100.0, mark=True)
    assert x_of(report_accuracy, spec, reports=(report(40.0, *RADAR_AT), off)) == 1.0, "nobody's target"
    assert x_of(report_accuracy, spec, reports=(off,)) == 0.0
    evidence = observed(marks_clear_of_bystanders, tape(spec, reports=(off,)), spec).evidence[0].text
    assert "marks radar-2; nearest bystander 10.0 m: forbidden" in evidence


# mission_flown


ELSEWHERE = tape(simspec()).vehicle_position_enu_m + np.linspace(0.0, 11.0, 401)[:, None] * (1.0, 0.0, 0.0)
BOUNCED = conditions((0.0, True), (5.0, False), (80.0, True), (90.0, False), (140.0, True), (160.0, True))
UNDER_WAY = conditions((0.0, True), (5.0, False))
CRASHED = conditions((0.0, False), (90.0, True), crashed=True)


@pytest.mark.parametrize(
    ("mission", "options", "streams", "x"),
    [
        ({}, {}, {}, 1.0),
        ({}, {}, {"route": ELSEWHERE}, 0.5),
        ({}, {"home_m": 12.0}, {"route": ELSEWHERE}, 1.0),
        ({"return_home": False}, {}, {"route": ELSEWHERE}, 1.0),
        ({}, {}, {"condition": UNDER_WAY}, 0.5),
        ({"time_limit_s": 150.0}, {}, {}, 0.5),
        # The landing is the last touchdown; staying down past the limit does not matter.
        ({"time_limit_s": 150.0}, {}, {"condition": BOUNCED}, 1.0),
        ({"time_limit_s": 130.0}, {}, {"condition": BOUNCED}, 0.5),
        ({}, {}, {"condition": CRASHED}, 0.0),
        ({}, {}, {"condition": UNDER_WAY[:1]}, 0.0),  # never left the ground
        ({}, {}, {"route": np.zeros((401, 3))}, 0.0),  # hopped at home
        ({}, {}, {"condition": ()}, 0.0),
    ],
)
def test_mission_flown_asks_for_a_flight_home_in_time(
    mission: dict[str, Any], options: dict[str, Any], streams: dict[str, Any], x: float
) -> None:
    """Out over the sub-areas, home, down, whole: 1. Landed elsewhere, still flying, or late: half."""
    assert x_of(mission_flown, simspec(mission=mission), options=options, **streams) == x


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


def test_an_unknown_measure_is_named() -> None:
    """The message lists the known measures."""
    with pytest.raises(SetupError, match=r"no plug-in named 'share_of_luck'.*targets_reported"):
        check_options("share_of_luck", {})


def test_a_simspec_without_places_cannot_be_measured() -> None:
    """Measures need the realized SimSpec, as recordings carry it, and the message says so."""
    base = simspec().model_copy(update={"realized": None})
    with pytest.raises(ValueError, match="realized"):
        observed(targets_reported, tape(simspec()), base)
