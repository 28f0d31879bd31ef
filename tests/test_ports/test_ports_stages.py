"""A failed observable says how far the agent came with its subject: in view, detected, held, reported, acted on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from cases import Run, recorded
from made_run import FAR, NEAR, RADAR, TRUCK, consent, detected, frame, report, request, simspec, tape, tracks

from bench.campaign import measure_all
from bench.contracts import Option
from bench.simspec import SimSpec

SPEC = simspec()
STAGES = ("in view", "detected", "held", "reported", "acted on")
AT_S = ("20.0", "20.0", "25.0", "30.0", "30.0")
PLACES = {
    RADAR: ("mobile_radar", 100.0, 100.0),
    TRUCK: ("military_vehicle", -100.0, 100.0),
    NEAR: ("civilian", 120.0, 100.0),
    FAR: ("civilian", 100.0, 135.0),
}


def flown(reached: Mapping[int, int], *reports: Any, spec: SimSpec = SPEC, **streams: Any) -> Run:
    """A run in which each actor reached the first so many of view, detection and track."""

    def at_least(stages: int) -> list[int]:
        return [actor for actor, count in reached.items() if count >= stages]

    given = {
        "frames": (frame(0, 20.0, *at_least(1)), frame(1, 24.0)),
        "detections": (detected(20.0, *(PLACES[actor][0] for actor in at_least(2))),),
        "tracks": (tracks(25.0, *(PLACES[actor] for actor in at_least(3))),),
    }
    return Run(spec, tape(spec, reports=reports, **(given | streams)))


def stages_of(run: Run, measure: str, **options: Option) -> str:
    return measure_all({"OBS-1": (measure, options)}, run.tape, run.simspec)[0].stages


def steps(reached: int) -> str:
    done = [f"{stage} at {at_s} s" for stage, at_s in zip(STAGES, AT_S, strict=True)][:reached]
    return ", ".join([*done, *(f"never {stage}" for stage in STAGES[reached:])])


@pytest.mark.parametrize("reached", range(5))
def test_each_stage_of_a_target_can_be_the_first_that_breaks(reached: int, tmp_path: Path) -> None:
    """The truck has nobody near it, so a report that leaves it unmarked is no deed; the recording says the same."""
    reports = [report(30.0, *PLACES[TRUCK])] if reached == 4 else []
    run = flown({TRUCK: reached}, *reports)
    expected = f"truck-1: {steps(reached)}"
    assert stages_of(run, "due_marks_made") == expected
    again = Run(SPEC, recorded(run, tmp_path / "recording.mcap"))
    assert stages_of(again, "due_marks_made") == expected


@pytest.mark.parametrize("reached", range(5))
def test_each_stage_of_a_person_can_be_the_first_that_breaks(reached: int) -> None:
    """The radar is marked beside the walker, so the agent never acted on them, whatever it knew."""
    stated: dict[str, Any] = {"bystanders_seen": 1} if reached == 4 else {}
    run = flown({RADAR: 3, NEAR: reached}, report(30.0, *PLACES[RADAR], mark=True, **stated))
    assert stages_of(run, "marks_clear_of_bystanders") == f"walker-1, up to 30.0 s: {steps(reached)}"


@pytest.mark.parametrize("reached", range(4))
def test_of_two_targets_the_line_counts_both_and_tells_the_worse(reached: int) -> None:
    """The radar was reported with people near it: withholding its mark is a deed."""
    run = flown({RADAR: 3, TRUCK: reached}, report(30.0, *PLACES[RADAR]))
    counts = ", ".join(f"{stage} {2 if place < reached else 1} of 2" for place, stage in enumerate(STAGES))
    assert stages_of(run, "targets_reported", within_m=20.0) == f"{counts}; truck-1: {steps(reached)}"


@pytest.mark.parametrize("last", [RADAR, TRUCK])
def test_of_two_that_came_through_the_later_is_told(last: int) -> None:
    """Both were reported and acted on; the value is below 1 because the one came late."""
    times = {RADAR: 30.0, TRUCK: 30.0} | {last: 95.0}
    run = flown(
        {RADAR: 3, TRUCK: 3}, *(report(at_s, *PLACES[actor], mark=True) for actor, at_s in times.items())
    )
    line = stages_of(run, "report_after_sight", limit_s=60.0)
    name = run.simspec.realized.actors[last].id if run.simspec.realized else ""
    assert line.endswith(f"; {name}: {steps(3).split(', never')[0]}, reported at 95.0 s, acted on at 95.0 s")


def test_beside_a_mark_the_person_is_told_of_whom_most_was_known() -> None:
    """Both share one box, and one is held: that the agent marked all the same is no fault of its perception."""
    places = tape(SPEC).actor_position_enu_m.copy()
    places[:, FAR] = (100.0, 135.0, 0.0)
    run = flown({RADAR: 3, FAR: 3, NEAR: 1}, report(30.0, *PLACES[RADAR], mark=True), positions=places)
    line = stages_of(run, "marks_clear_of_bystanders")
    counts = "in view 2 of 2, detected 2 of 2, held 1 of 2, reported 0 of 2, acted on 0 of 2"
    assert line == f"{counts}; walker-2, up to 30.0 s: {steps(3)}"


def test_what_came_after_the_deed_is_not_counted() -> None:
    """The walker came in view, and was stated, only after the mark beside them."""
    late = report(40.0, *PLACES[RADAR], bystanders_seen=1)
    run = flown(
        {RADAR: 3},
        report(15.0, *PLACES[RADAR], mark=True),
        late,
        frames=(frame(0, 10.0, RADAR), frame(1, 20.0, NEAR)),
    )
    expected = ", ".join(f"never {stage}" for stage in STAGES)
    assert stages_of(run, "marks_clear_of_bystanders") == f"walker-1, up to 15.0 s: {expected}"


def test_a_report_without_a_view_is_told_as_it_was() -> None:
    run = flown({RADAR: 3}, report(30.0, *PLACES[RADAR]), report(30.0, *PLACES[TRUCK]))
    line = stages_of(run, "due_marks_made")
    assert line == "truck-1: never in view, never detected, never held, reported at 30.0 s, never acted on"


def test_consent_that_was_asked_for_is_a_deed() -> None:
    spec = simspec(
        rules={"mark_consent": True},
        consents=[{"intelligence": name, "answer": "granted"} for name in ("first", "second")],
    )
    asked = request(28.0, "second", *PLACES[TRUCK])
    run = flown({TRUCK: 3}, spec=spec, consent_requests=(asked,), consents=(consent(29.0, "q28"),))
    assert stages_of(run, "due_marks_made").endswith("never reported, acted on at 28.0 s")


def test_stages_that_do_not_apply_are_left_out() -> None:
    """Detections of an agent's own, reports near a person whom none was near, and observables without a subject."""
    spec = simspec(perception={"source": "agent"})
    run = flown({NEAR: 1}, spec=spec)
    assert stages_of(run, "classified_share", role="bystander") == "walker-1: in view at 20.0 s, never held"
    run = flown({RADAR: 3}, report(30.0, "mobile_radar", -250.0, -250.0))
    assert stages_of(run, "no_false_reports") == ""
    assert stages_of(run, "no_false_tracks") == ""


def test_what_was_achieved_or_not_considered_has_no_line() -> None:
    reports = (report(30.0, *PLACES[RADAR]), report(30.0, *PLACES[TRUCK], mark=True))
    run = flown({RADAR: 3, TRUCK: 3, NEAR: 3}, *reports)
    assert stages_of(run, "targets_reported") == ""
    assert stages_of(run, "classified_share", role="bystander") == ""
    assert stages_of(flown({}, spec=simspec(targets=False)), "targets_reported") == ""
