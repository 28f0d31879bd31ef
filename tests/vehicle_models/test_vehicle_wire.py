"""The wire: frames byte for byte as pymavlink makes them, and whatever comes in taken without a stumble."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vehicle_client import Make, mavlink, simspec

from vehicle_models.controller.links._frames import KINDS, Decoder, FrameReader, Packer


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_every_streamed_message_is_packed_as_pymavlink_packs_it(make: Make, autopilot: str) -> None:
    """Every message that is streamed, sent in flight or requested: decoded by pymavlink and packed again, the
    same bytes.
    """
    from vehicle_models.controller import AUTOPILOTS

    client = make(simspec(autopilot, environment={"wind": {"speed_mps": 3.0, "turbulence_mps": 3.0}}))
    if autopilot == "px4":
        client.airborne(3.0)
        client.offboard(3, 2, -4)
    names = AUTOPILOTS[autopilot].telemetry.messages
    raw = len(client.raw)
    for name in sorted(names):
        client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, KINDS[name].id)
        if autopilot == "px4":
            client.setpoint(3, 2, -4)
    frames = FrameReader().feed(client.raw[raw:])
    streamed = set()
    for frame in frames:
        message = Decoder().decode(frame)
        assert message is not None
        again = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        again.seq = frame[4]
        assert bytes(message.pack(again)) == frame, message.get_type()
        streamed.add(message.get_type())
    silent_on_the_ground = {
        "FENCE_STATUS",
        "MAG_CAL_PROGRESS",
        "ATTITUDE_TARGET",
        "POSITION_TARGET_LOCAL_NED",
        "POSITION_TARGET_GLOBAL_INT",
    }
    assert names - streamed <= (
        silent_on_the_ground
        if autopilot == "ardupilot"
        else {"ORBIT_EXECUTION_STATUS", "CURRENT_EVENT_SEQUENCE"}
    )


def test_frames_are_found_in_garbage() -> None:
    """Whole MAVLink 1 and 2 frames survive what lies between, in pieces of any size; a wrong checksum is
    garbage.
    """
    mav = mavlink.MAVLink(None, srcSystem=9, srcComponent=8)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    second = bytes(beat.pack(mav))
    first = bytes(beat.pack(mav, force_mavlink1=True))
    broken = second[:-1] + bytes([second[-1] ^ 1])
    stream = b"\xfd\xfe\x00" + first + b"noise\xfd" + second + broken + second + first
    for size in (1, 7, len(stream)):
        reader = FrameReader()
        frames = [
            frame for at in range(0, len(stream), size) for frame in reader.feed(stream[at : at + size])
        ]
        frames += reader.feed(b"", last=True)
        assert frames == [first, second, second, first]
        assert reader.garbage_bytes == 3 + 6 + len(broken)


@pytest.mark.parametrize("old", [False, True], ids=["v2", "v1"])
def test_every_message_decodes_to_what_pymavlink_makes_of_it(old: bool) -> None:
    """Random payloads of every kind that a service takes or sends, in full and cut off: the same class with
    the same fields.
    """
    draws, reference, decoder, packer = random.Random(7), mavlink.MAVLink(None), Decoder(), Packer(9, 8)
    for name, kind in KINDS.items():
        for keep in (1.0, 0.5, 0.0):
            size = kind.unpacker.size
            values = kind.unpacker.unpack(draws.randbytes(round(keep * size)).ljust(size, b"\0"))
            frame = (packer.pack_v1 if old else packer.pack)(kind.id, 3, values)
            if frame is None:  # has no place in MAVLink 1
                continue
            try:
                wanted = reference.decode(bytearray(frame))
            except (mavlink.MAVError, UnicodeError):
                assert decoder.decode(frame) is None
                continue
            got = decoder.decode(frame)
            assert type(got) is type(wanted), name
            for field in kind.fieldnames:
                assert repr(getattr(got, field)) == repr(getattr(wanted, field)), (
                    f"{name}.{field}"
                )  # NaN is NaN


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_no_bytes_make_the_reader_fail(data: bytes) -> None:
    """Anything may come: frames found are inside what was sent, the rest waits or is counted."""
    reader, decoder = FrameReader(), Decoder()
    frames = reader.feed(data) + reader.feed(b"", last=True)
    for frame in frames:
        assert frame in data
        decoder.decode(frame)
    assert sum(map(len, frames)) + reader.garbage_bytes == len(data)


def test_signed_frames_are_understood() -> None:
    """A MAVLink 2 frame with a signature is one frame, and decodes; the signature is not checked here."""
    mav = mavlink.MAVLink(None, srcSystem=9, srcComponent=8)
    mav.signing.secret_key = bytes(32)
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = 1
    frame = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mav))
    reader = FrameReader()
    assert reader.feed(frame + b"x") == [frame]
    message = Decoder().decode(frame)
    assert message is not None
    assert message.get_type() == "HEARTBEAT"
    assert struct.unpack_from("<B", frame, 2) == (1,)
