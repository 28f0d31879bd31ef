"""Knowledge rests on looks: enough of the subject visible in an earlier frame, or a right detection of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from cases import scene
from cases.perception import actors_of, looked_at, own_labels
from made_run import NEAR, RADAR, TRUCK, at_s, report, request, simspec, tape

from bench.campaign import measure_all
from bench.contracts import (
    CameraFrame,
    Detection,
    DetectionFrame,
    Measure,
    Observation,
    Option,
    Sighting,
    Timed,
    load_plugin,
)
from bench.simspec import Outage, PerceptionSource, SimSpec, factor_values

PICTURE_PX = (1280.0, 720.0)
WHOLE_PX = 50.0
LIMIT_PX = 12.0
# On which side of the picture, to the right and downwards, a part of the target is outside it.
BORDERS = {"left": (-1, 0), "right": (1, 0), "top": (0, -1), "bottom": (0, 1), "corner": (1, 1)}
RADAR_AT = ("mobile_radar", 100.0, 100.0)
SPEC = simspec()
OWN_PERCEPTION = simspec(perception={"source": "agent"})
TWO_CAMERAS = simspec(
    vehicle={"more_cameras": [{"name": "down", "tilt_deg": 90.0}]}, perception={"more_cameras": ["down"]}
)


def at_border(border: str, size_px: float, actor: int = RADAR) -> Sighting:
    """A square across a border: of its pixels, as many lie in the picture as a square of `size_px` has."""
    sides = BORDERS[border]
    inside_px = size_px if all(sides) else size_px**2 / WHOLE_PX
    box = []
    for side, length_px in zip(sides, PICTURE_PX, strict=True):
        shown_px = inside_px if side else WHOLE_PX
        begin_px = {-1: 0.0, 0: 300.0, 1: length_px - shown_px}[side]
        box.append((begin_px, begin_px + shown_px))
    (left, right), (top, bottom) = box
    visible = (right - left) * (bottom - top) / WHOLE_PX**2
    return Sighting(actor, 60.0, WHOLE_PX, visible, (left, top, right, bottom))


def behind_a_house(size_px: float, actor: int = RADAR) -> Sighting:
    """As much of it is visible, and none of it is outside the picture."""
    return Sighting(
        actor, 60.0, WHOLE_PX, (size_px / WHOLE_PX) ** 2, (300.0, 300.0, 300.0 + WHOLE_PX, 300.0 + WHOLE_PX)
    )


def pictures(*sightings: Sighting, at: float = 20.0, camera: str = "front") -> tuple[CameraFrame, ...]:
    return (CameraFrame(0, camera, at_s(at), sightings),)


def answer(
    sighting: Sighting, label: str, score: float = 0.9, at: float = 20.0, camera: str = ""
) -> DetectionFrame:
    found = Detection(label, score, sighting.box, "t")
    return DetectionFrame(at_s(at), at_s(at + 0.1), (found,), camera)


def observed(
    measure: str, spec: SimSpec = SPEC, options: Mapping[str, Option] | None = None, **streams: Any
) -> Observation:
    return measure_all({"OBS-1": (measure, options or {})}, tape(spec, **streams), spec)[0]


def is_known(spec: SimSpec = SPEC, at: float = 30.0, **streams: Any) -> bool:
    """Whether a report about the radar vehicle shows knowledge of it."""
    x = observed("no_false_reports", spec, reports=(report(at, *RADAR_AT),), **streams).x
    assert x in (0.0, 1.0)
    return x == 1.0


@pytest.mark.parametrize("hidden_by", [*BORDERS, "house"])
@pytest.mark.parametrize(("size_px", "is_enough"), [(LIMIT_PX - 0.1, False), (LIMIT_PX + 0.1, True)])
def test_a_sight_is_measured_by_what_shows_whatever_hides_the_rest(
    hidden_by: str, size_px: float, *, is_enough: bool
) -> None:
    """At each border, in a corner and behind a house; below the limit a right detection makes up for it."""
    partly = behind_a_house(size_px) if hidden_by == "house" else at_border(hidden_by, size_px)
    assert is_known(frames=pictures(partly)) is is_enough
    assert is_known(frames=pictures(partly), detections=(answer(partly, "mobile_radar"),))
    elsewhere = Sighting(RADAR, 60.0, WHOLE_PX, 1.0, (700.0, 100.0, 760.0, 160.0))
    for wrong in (
        answer(partly, "military_vehicle"),
        answer(partly, "mobile_radar", score=0.34),
        answer(partly, "mobile_radar", at=20.2),
        answer(elsewhere, "mobile_radar"),
    ):
        assert is_known(frames=pictures(partly), detections=(wrong,)) is is_enough
    # An agent with a perception of its own was given no detections.
    given = (answer(partly, "mobile_radar"),)
    assert is_known(OWN_PERCEPTION, frames=pictures(partly), detections=given) is is_enough
    # Another camera's picture and its detections count alike.
    second = pictures(partly, camera="down")
    assert is_known(TWO_CAMERAS, frames=second) is is_enough
    answers = [(answer(partly, "mobile_radar", camera=camera),) for camera in ("down", "")]
    assert is_known(TWO_CAMERAS, frames=second, detections=answers[0])
    assert is_known(TWO_CAMERAS, frames=second, detections=answers[1]) is is_enough


def test_the_reason_says_what_was_missing() -> None:
    """Never, or only later; a perception of the agent's own is not asked for detections that nobody gave."""
    early, late = at_border("left", 5.0), at_border("left", 30.0)
    streams: dict[str, Any] = {
        "frames": (*pictures(early), *pictures(late, at=43.0)),
        "reports": (report(30.0, *RADAR_AT),),
    }

    def reason(measure: str = "no_false_reports", spec: SimSpec = SPEC, **changes: Any) -> str:
        return observed(measure, spec, **{**streams, **changes}).evidence[0].text

    lacking = "radar-1 had not been in sight (first at 43.0 s) or rightly detected (it never was)"
    assert reason() == f"report r30 (mobile_radar): {lacking}"
    detected_later = (answer(early, "military_vehicle"), answer(late, "mobile_radar", at=43.0))
    assert reason(detections=detected_later).endswith("or rightly detected (first at 43.0 s)")
    assert reason(spec=OWN_PERCEPTION).endswith("radar-1 had not been in sight (first at 43.0 s)")
    assert reason(frames=()).endswith("in sight (it never was) or rightly detected (it never was)")
    assert reason("marks_on_adversaries", reports=(report(30.0, *RADAR_AT, mark=True),)).endswith(lacking)
    told, nowhere = report(50.0, "mobile_radar", 105.0, 95.0), report(50.0, "mobile_radar", -200.0, 0.0)
    assert reason(reports=(told,)).endswith("radar-1 was placed as intelligence had it, or guessed at")
    assert reason(reports=(nowhere,)).endswith("no such adversary within 30 m")


# Each with its own limit of what must show.
OF_KNOWLEDGE: Mapping[str, float | None] = {
    "evidence_true": 8.0,
    "surroundings_seen": 10.0,
    "consent_requests_true": None,
    "second_look": None,
}


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("measure", OF_KNOWLEDGE)
def test_every_measure_of_knowledge_rests_on_looks(border: str, measure: str) -> None:
    """Evidence, people near a target, requests, second looks: the view at a border counts in all."""
    spec = simspec(rules={"mark_consent": True, "no_mark_within_m": 30.0})
    limit_px = OF_KNOWLEDGE[measure] or LIMIT_PX
    # The vehicle is to the south-west of the radar vehicle at the first moment, to the west at the second.
    moments_s = (40.0, 80.0)
    reported = (report(90.0, *RADAR_AT, evidence=moments_s),)
    asked = (request(90.0, "first", *RADAR_AT, bystanders_seen=1),)

    def x_of(size_px: float, *labels: str) -> float | None:
        """Both the radar vehicle and the walker beside it show so much. At first all of the radar vehicle does, so
        that all know of it but those that ask for more than that.
        """
        views = [at_border(border, size_px, actor) for actor in (RADAR, NEAR)]
        early = () if limit_px == LIMIT_PX else pictures(behind_a_house(WHOLE_PX), at=10.0)
        answers = tuple(
            DetectionFrame(
                at_s(time_s),
                at_s(time_s + 0.1),
                tuple(
                    Detection(label, 0.9, view.box, "t")
                    for view, label in zip(views, labels, strict=bool(labels))
                ),
            )
            for time_s in moments_s
        )
        frames = (*early, *(frame for at in moments_s for frame in pictures(*views, at=at)))
        streams: dict[str, Any] = {"frames": frames, "reports": reported, "consent_requests": asked}
        return observed(measure, spec, **streams, detections=answers).x

    assert x_of(limit_px + 0.1) == 1.0
    assert x_of(limit_px - 0.1) == 0.0
    assert x_of(limit_px - 0.1, "mobile_radar", "civilian") == 1.0


def test_a_search_and_its_clock_ask_for_sight() -> None:
    """A lucky detection of a few pixels brings no target into view, and starts no time to report it in."""
    speck, near = at_border("top", 5.0), at_border("top", 13.0)
    truck = at_border("top", 13.0, TRUCK)
    frames = (*pictures(speck, at=10.0), *pictures(near, truck, at=100.0))
    lucky = (answer(speck, "mobile_radar", at=10.0),)
    reports: tuple[Timed[Any], ...] = (
        report(110.0, *RADAR_AT),
        report(111.0, "military_vehicle", -100.0, 100.0),
    )
    assert observed("report_after_sight", frames=frames, detections=lucky, reports=reports).x == 1.0
    assert observed("targets_seen", frames=frames, detections=lucky).x == 1.0
    assert observed("targets_seen", frames=frames[:1], detections=lucky).x == 0.0
    asking: dict[str, Option] = {"min_visible": 0.5}
    assert observed("targets_seen", options=asking, frames=frames).x == 0.0


OF_DETECTIONS: Mapping[str, Mapping[str, Any]] = {
    "detection_share": {"role": "bystander"},
    "detection_precision": {"role": "any"},
    "detection_role_right": {"role": "bystander", "as_role": "adversary"},
    "steady_detection": {"role": "any"},
    "detection_fairness": {"by": "asset"},
}


def with_source(spec: SimSpec, source: PerceptionSource) -> SimSpec:
    return spec.model_copy(update={"perception": spec.perception.model_copy(update={"source": source})})


@pytest.mark.parametrize("name", OF_DETECTIONS)
def test_without_detections_of_the_bench_none_of_these_measures_considers_a_run(name: str) -> None:
    """The same tape is considered with every source of the bench, and not with that of the agent."""
    spec = scene()
    measure: Measure = load_plugin("rebar.measures", name)
    actors = actors_of(spec)
    tape = looked_at(spec, actors, {}, own_labels(spec, actors)).tape
    answers = {
        source: measure("O-1", tape, with_source(spec, source), OF_DETECTIONS[name])
        for source in ("truth", "simulated", "agent")
    }
    assert answers["truth"].considered
    assert answers["truth"] == answers["simulated"]
    assert not answers["agent"].considered
    assert answers["agent"].evidence[0].text.startswith("perception.source is agent")


def test_outages_of_the_detector_do_not_exist_for_an_agent_with_its_own_perception() -> None:
    """Neither as key factors nor as faults that a run has to answer for; others stay."""
    outages = (
        Outage(kind="detections", at_s=10.0, duration_s=5.0),
        Outage(kind="operator_link", at_s=20.0, duration_s=7.0),
    )
    spec = scene().model_copy(update={"outages": outages})
    ours, own = factor_values(spec), factor_values(with_source(spec, "agent"))
    assert (ours["detections_outage_s"], own["detections_outage_s"]) == (5.0, 0.0)
    assert ours["operator_link_outage_s"] == own["operator_link_outage_s"] == 7.0
    assert ours["kept_detections_share"] == 0.0
    assert "kept_detections_share" not in own
