"""`rebar fit-detector` from a recording file alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from command_line import Rebar
from detector_fit import DetectorFit, declare
from made_views import breathing_frames, made_spec

from bench.contracts import SimTime, VehiclePlan, cast_of
from bench.perception import open_detector
from bench.recording import open_recording
from bench.simspec import Perception, SimSpec
from bench.simulation import HostClock, open_plain_scene
from bench.simulation._air_network import open_air_network
from bench.simulation._detection_messages import DetectionMessages
from bench.simulation._mission_information import MissionInformation
from bench.simulation._truth import TruthRecorder
from bench.testing import StillVehicle

ASSETS = ["soldier", "civilian"] * 15
FRAMES = 120


@pytest.fixture(autouse=True)
def declared(monkeypatch: pytest.MonkeyPatch) -> None:
    declare(monkeypatch)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames and detections as a session writes them: exposures on every other tick, results at ticks."""
    path = tmp_path_factory.mktemp("fit") / "recording.mcap"
    spec = made_spec(ASSETS, {"false_per_frame": 0.5, "latency_s": 0.25, "jitter_px": 1.0})
    vehicle, scene = StillVehicle(VehiclePlan(spec, ())), open_plain_scene(spec)
    detector = open_detector(spec, cast_of(spec))
    with (
        open_recording(path, simspec=spec, versions={}) as recorder,
        open_air_network(spec, recorder, zenoh=False, clock=HostClock()) as air,
    ):
        air.open_for_all()
        truth, information = TruthRecorder(spec.vehicle.name, recorder), MissionInformation(spec, air, scene)
        detections = DetectionMessages(spec, spec.vehicle.camera, air.detections)
        truth.write_cast(SimTime(0), scene)
        for frame in breathing_frames(FRAMES, len(ASSETS)):
            truth.write_frame(frame)
            detector.process(frame)
            for tick_ns in (0, 100_000_000):
                now = SimTime(frame.exposed.ns + tick_ns)
                information.publish(now, vehicle)
                detections.publish(now, detector)
    return path


def test_a_recording_gives_a_model_and_its_counts(recording: Path, tmp_path: Path, rebar: Rebar) -> None:
    out = tmp_path / "fitted.yaml"
    text = rebar("fit-detector", recording, "--out", out)
    assert text == out.read_text()
    document = yaml.safe_load(text)
    fit = DetectorFit.model_validate(document)
    assert isinstance(SimSpec.model_fields["perception"].default, Perception)
    assert Perception.model_validate(document["perception"]) == fit.perception
    model, counts = fit.perception.model, fit.evidence
    assert model.jitter_px == pytest.approx(1.0, rel=0.05)
    # 0.25 s is published with the next tick of 0.1 s. The last result is still on its way at the end.
    assert (model.latency_s, model.latency_jitter_s) == (0.3, 0.0)
    assert (counts.frames, counts.unanswered) == (FRAMES - 1, 1)
    assert DetectorFit.model_validate(rebar.json("fit-detector", recording)) == fit


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, rebar: Rebar) -> None:
    path = tmp_path / "none.mcap"
    assert str(path) in rebar.refused("fit-detector", path)
