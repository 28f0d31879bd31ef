"""The tape: the same from live records and from their recording, and untouched by what it cannot understand."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import made_run
import numpy as np
import pytest

from bench.contracts import TF, DetectionFrame, Record, SimTime, Tape, VehicleTopics
from bench.recording import TapeBuilder, open_recording, read_tape
from bench.streams import Detection2D, Detection2DArray, encode

TOPICS = VehicleTopics("vehicle_1")


def built(records: list[Record]) -> Tape:
    builder = TapeBuilder(made_run.simspec())
    for record in records:
        builder(record)
    return builder.tape()


def same(a: Tape, b: Tape) -> bool:
    return all(
        np.array_equal(value, other) if isinstance(value, np.ndarray) else value == other
        for value, other in ((getattr(a, field.name), getattr(b, field.name)) for field in fields(Tape))
    )


def record(path: Path, records: list[Record]) -> Path:
    with open_recording(path, simspec=made_run.simspec(), versions={}) as recorder:
        for entry in records:
            recorder(entry)
    return path


def test_live_and_read_tapes_are_equal(tmp_path: Path) -> None:
    """The builder fed by the session and the recording of the same records give one tape, to the last bit."""
    garbage = made_run.text_record(3.0, TOPICS.reports, "not a report")
    records = made_run.records(made_run.simspec(), extra=[garbage])
    live = built(records)
    assert same(live, read_tape(record(tmp_path / "recording.mcap", records)))
    assert live.malformed == {TOPICS.reports: 1}
    filled = ("frames", "detections", "condition", "reports", "tracks", "events", "orders", "answers")
    assert all(len(getattr(live, name)) for name in (*filled, "operator_link", "estimate_time_s"))


def test_every_stream_arrives_in_si_units_and_map_axes() -> None:
    """Numbers of the tape are those of the records; the body's velocity is turned into the map's axes."""
    tape = built(made_run.records(made_run.simspec(), seconds=10.0))
    assert tape.end_s == pytest.approx(9.9)
    np.testing.assert_allclose(tape.vehicle_position_enu_m[10], [1.0, 2.0, 60.0])
    # Facing north (yaw of 90 degrees from east) at 3 m/s ahead.
    np.testing.assert_allclose(tape.vehicle_velocity_enu_mps, np.tile([0.0, 3.0, 0.0], (100, 1)), atol=1e-12)
    assert tape.actor_position_enu_m.shape == (20, 5, 3)
    np.testing.assert_allclose(tape.actor_position_enu_m[2, made_run.RADAR], [100.5, 100.0, 0.0])
    assert [member.id for member in tape.cast] == list(made_run.PLACES)
    frame = tape.frames[1]
    assert (frame.number, frame.camera, frame.exposed) == (1, "front", SimTime(200_000_000))
    assert frame.sightings[0].box == made_run.BOX
    answer = tape.detections[1]
    assert (answer.exposed, answer.published) == (SimTime(200_000_000), SimTime(300_000_000))
    (found,) = answer.detections
    assert (found.class_label, found.score, found.track) == ("civilian", 0.75, "t1")
    assert found.box == pytest.approx(made_run.BOX)
    assert tape.reports[0].time == SimTime(5_000_000_000)
    assert tape.reports[0].value.mark


def test_orders_and_answers_have_their_delivery_times() -> None:
    """The time of an order is that of its delivery; the operator's link appears at each change."""
    tape = built(made_run.records(made_run.simspec(), seconds=10.0))
    orders = [(order.time.s, order.value.id, order.value.issued_s) for order in tape.orders]
    assert orders == [(6.0, "hold", 5.0)]
    assert [(answer.value.order, answer.value.accepted) for answer in tape.answers] == [("hold", True)]
    links = [(link.time.s, link.value.up) for link in tape.operator_link]
    assert links == [(0.0, True), (4.0, False), (6.0, True)]


def test_the_estimated_pose_is_kept_beside_the_true_one() -> None:
    """Only map to base_link is the estimate; the level frame of the camera's mount in the same message does not count."""
    tape = built(made_run.records(made_run.simspec(), seconds=10.0))
    assert tape.estimate_position_enu_m.shape == (100, 3)
    np.testing.assert_allclose(tape.estimate_time_s, tape.vehicle_time_s)
    np.testing.assert_allclose(
        tape.estimate_position_enu_m - tape.vehicle_position_enu_m, np.tile([0.5, 0.0, 0.0], (100, 1))
    )


@pytest.mark.parametrize("tilt_rad", [0.0, 1e-9, 0.3, 2.0, np.pi])
def test_tilt_is_the_angle_from_the_vertical_at_any_heading(tilt_rad: float) -> None:
    """From level over small angles, which rounding must not eat, to upside down."""
    turned = [
        made_run.odometry(0.1, (0.0, 0.0, 0.0), yaw_rad, 0.0, pitch_rad=tilt_rad)
        for yaw_rad in (0.0, 1.0, -2.5)
    ]
    np.testing.assert_allclose(built(turned).vehicle_tilt_rad, [tilt_rad] * 3, rtol=1e-6, atol=1e-15)


def test_an_empty_run_has_an_empty_tape() -> None:
    """A session that ended before anything was recorded still has a tape, of the right shapes."""
    tape = built([])
    assert tape.end_s == 0.0
    assert tape.vehicle_position_enu_m.shape == (0, 3)
    assert tape.actor_position_enu_m.shape == (0, 0, 3)
    assert (tape.vehicle_tilt_rad.shape, tape.estimate_position_enu_m.shape) == ((0,), (0, 3))
    assert tape.malformed == {}


def test_undecodable_messages_are_counted_and_left_out() -> None:
    """Bad CDR, bad JSON, wrong fields and positions of another cast are counted by topic and never raise."""
    head = b"\x00\x01\x00\x00"
    bad = [
        Record(made_run.at_s(1.0), "/truth/odometry", "nav_msgs/msg/Odometry", head + b"short"),
        Record(made_run.at_s(1.0), TOPICS.detections, "vision_msgs/msg/Detection2DArray", b""),
        Record(made_run.at_s(1.0), TOPICS.status, "std_msgs/msg/String", head + b"\xff\xff\xff\x7fx"),
        made_run.text_record(1.0, TOPICS.tracks, '{"time_s": 1.0, "tracks": [{"id": "a"}]}'),
        made_run.text_record(1.0, TOPICS.reports, '{"id": "r", "time_s": NaN}'),
        made_run.text_record(1.0, TOPICS.decisions, "[" * 5000),
        made_run.text_record(1.0, TOPICS.answers, '{"time_s": 1.0, "order": "hold", "accepted": "perhaps"}'),
        Record(made_run.at_s(1.0), TF, "tf2_msgs/msg/TFMessage", head + b"\x07"),
    ]
    records = made_run.records(made_run.simspec())
    stranger = made_run.simspec(walkers=False)
    bad.append(next(record for record in made_run.records(stranger) if record.topic == "/truth/actors"))
    tape = built(sorted([*records, *bad], key=lambda record: record.time.ns))
    assert tape.malformed == {record.topic: 1 for record in bad}
    plain = built(records)
    assert len(tape.actor_time_s) == len(plain.actor_time_s)
    assert len(tape.vehicle_time_s) == len(plain.vehicle_time_s)


def test_a_box_without_hypothesis_is_not_a_detection() -> None:
    """vision_msgs allows it, so it is not an error either."""
    message = Detection2DArray(detections=(Detection2D(), Detection2D()))
    tape = built([Record(SimTime(5), TOPICS.detections, Detection2DArray.TYPE, encode(message))])
    assert tape.detections == (DetectionFrame(SimTime(0), SimTime(5), ()),)
    assert tape.malformed == {}


def test_the_tape_of_a_truncated_recording_says_so(tmp_path: Path) -> None:
    """The tape shows lost records, but not the loss of the index alone."""
    records = made_run.records(made_run.simspec(), seconds=60.0)
    path = record(tmp_path / "recording.mcap", records)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert read_tape(path).malformed == {"recording": 1}
    assert 0.0 < read_tape(path).end_s < 59.0
    path.write_bytes(whole[:-10])
    assert same(read_tape(path), built(records))


def test_the_builder_continues_after_a_tape_was_taken() -> None:
    """A live view may take tapes during the run without changing the last one."""
    records = made_run.records(made_run.simspec())
    builder = TapeBuilder(made_run.simspec())
    for index, record in enumerate(records):
        builder(record)
        if index % 200 == 0:
            builder.tape()
    assert same(builder.tape(), built(records))
