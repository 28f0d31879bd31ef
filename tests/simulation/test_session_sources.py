"""Detections of every source reach the agent on the same topic, in the same form and at the same times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from pydantic import ValidationError
from scene_simspecs import scene_simspec
from test_scene_detector import camera_frame

from bench.contracts import (
    CameraFrame,
    CameraPicture,
    Detection,
    DetectionFrame,
    Detector,
    Record,
    SimTime,
    VehicleTopics,
    cast_of,
)
from bench.documents import read_document
from bench.perception import open_detector
from bench.simspec import DetectionModel, Perception, SimSpec, SizePoint
from bench.simulation import HostClock
from bench.simulation._air_network import open_air_network
from bench.simulation._detection_messages import DetectionMessages
from bench.streams import Detection2DArray, decode

ACTORS = 30
TICKS = 41
# A model that detects nearly everything at once, so that only errors tell it from the truth.
PROMPT = DetectionModel(
    half_height_px=0.5, slope=9.0, ceiling=1.0, mislabel=0.0, false_per_frame=0.0, latency_s=0.0
)


class PixelDetector:
    """Stands for a plug-in: finds a box that no actor has, under its own label, at once."""

    def __init__(self) -> None:
        self._results: list[DetectionFrame] = []

    def process(self, frame: CameraFrame, picture: CameraPicture | None = None) -> None:
        found = Detection("crate", 0.51, (3.25, 4.5, 40.75, 61.0), f"t{frame.number + 1}")
        self._results.append(DetectionFrame(frame.exposed, frame.exposed, (found,) * ACTORS))

    def due(self, now: SimTime) -> Sequence[DetectionFrame]:
        ready, self._results = self._results, []
        return ready


def spec_of(model: DetectionModel = PROMPT, **perception: Any) -> SimSpec:
    placed = [("soldier" if index % 2 else "civilian", float(index), 0.0, 0.0) for index in range(ACTORS)]
    return scene_simspec(placed, perception=Perception(model=model, **perception))


def published(spec: SimSpec, detector: Detector | None = None) -> list[Record]:
    """What the agent gets on the topic of detections: one frame every other tick of 0.1 s."""
    detector = detector or open_detector(spec, cast_of(spec))
    records: list[Record] = []
    with open_air_network(spec, records.append, zenoh=False, clock=HostClock()) as air:
        air.open_for_all()
        detections = DetectionMessages(spec, spec.vehicle.camera, air.detections)
        for tick in range(TICKS):
            if tick % 2 == 0:
                detector.process(camera_frame(tick // 2, ACTORS, height_px=40.0))
            detections.publish(SimTime(tick * 100_000_000), detector)
    topic = VehicleTopics(spec.vehicle.name).detections
    return [record for record in records if record.topic == topic]


def form(records: Sequence[Record]) -> list[tuple[int, str, str, int, set[tuple[str, ...]]]]:
    """Everything about messages but the values: time, topic, type, length, and the fields that are filled."""
    forms = []
    for record in records:
        message = decode(Detection2DArray, record.data)
        assert message is not None
        filled: set[tuple[str, ...]] = {
            (item.header.frame_id, message.header.frame_id, str(len(item.results)), item.id[:1])
            for item in message.detections
        }
        forms.append((record.time.ns, record.topic, record.type_name, len(message.detections), filled))
    return forms


def test_an_agent_cannot_tell_the_sources_of_detections_apart() -> None:
    """Truth, error model and plug-in: same topic, type, fields, number of messages and times."""
    simulated_spec = spec_of(source="simulated")
    truth, simulated = published(spec_of(source="truth")), published(simulated_spec)
    plugged = published(simulated_spec, PixelDetector())
    assert len(truth) == (TICKS + 1) // 2
    assert form(truth) == form(simulated) == form(plugged)
    assert [record.data for record in truth] != [record.data for record in simulated]
    # `mode: perfect`, which stays.
    assert published(spec_of(mode="perfect")) == truth
    assert published(spec_of(DetectionModel(false_per_frame=9.0), source="agent")) == []


def test_a_document_may_name_a_detector_that_is_not_installed() -> None:
    """Recordings are read where it is not; what flies them says so (test_session_detectors)."""
    text = "name: x\nworld: {area: {corners: [{east_m: 0, north_m: 0}, {east_m: 9, north_m: 0}, {east_m: 9, north_m: 9}]}}\n"
    detector = "perception:\n  source: detector\n  detector: elsewhere\n  detector_options: {floor: 0.4}\n"
    perception = read_document(text + detector, SimSpec, source="s.yaml").perception
    assert (perception.detector_name, perception.detector_options) == ("elsewhere", {"floor": 0.4})
    assert Perception(source="detector").detector_name == "small"


def test_new_fields_leave_the_document_as_it_was() -> None:
    """At their defaults they are not written, so digests of published SimSpecs stay."""
    assert set(Perception().model_dump(mode="json")) == {"source", "mode", "model"}
    assert len(DetectionModel().model_dump(mode="json")) == 12
    points = (SizePoint(px=5.0, detected=0.1), SizePoint(px=9.0, detected=0.4, doubt=0.5))
    changed = {"drift_px": 1.0, "confusion": {"combatant": {"civilian": 0.2}}, "id_switches_per_s": 0.1}
    by_size = {"size_curve": points, "class_factors": {"tree": 0.5}, "jitter_share": 0.1, "false_score": 0.5}
    options = {"floor": 0.4, "prompts": ["a", "b"]}
    for written in (
        Perception(source="agent", detector="other", detector_options=options),
        DetectionModel.model_validate(changed),
        DetectionModel.model_validate(by_size),
    ):
        assert type(written).model_validate_json(written.model_dump_json()) == written


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"size_curve": [{"px": 9, "detected": 0.1}, {"px": 9, "detected": 0.2}]}, "sizes must grow"),
        ({"false_labels": {"tree": 0.0}}, "all shares are 0"),
        ({"false_score": 1.0}, "false_score"),
    ],
)
def test_a_curve_and_labels_that_cannot_be_are_refused(fields: dict[str, object], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        DetectionModel.model_validate(fields)
