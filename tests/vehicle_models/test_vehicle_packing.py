"""The wire: frames byte for byte as pymavlink makes them, and whatever comes in taken without a stumble."""

from __future__ import annotations

import math
import random
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as plain

from vehicle_models.controller import AUTOPILOTS
from vehicle_models.controller.links._dialect import dialect
from vehicle_models.controller.links._frames import KINDS, Decoder, FrameReader, Packer, wire_values

HOT = sorted(
    frozenset.union(*(autopilot.telemetry.messages for autopilot in AUTOPILOTS.values()))
    | {"STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE"}
)
FLOATS = (0.0, -0.0, math.nan, math.inf, -math.inf, 1e-45, 3.4e38)


def number(draw: random.Random, kind: str) -> float | int:
    """A value of a field: often a limit or a zero, so that payloads lose their zeros at the end."""
    if kind in ("float", "double"):
        value = draw.choice((draw.gauss(0.0, 1000.0), *FLOATS))
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    bits = int("".join(filter(str.isdigit, kind)))
    low, high = (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return draw.choice((0, low, high, draw.randint(low, high)))


def fields(draw: random.Random, kind: Any) -> dict[str, Any]:
    """Values by the names of a message's fields."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    values: dict[str, Any] = {}
    for name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        if types[name] == "char":
            shortest = 0 if length else 1
            values[name] = bytes(draw.randrange(1, 128) for _ in range(draw.randint(shortest, length or 1)))
        elif length:
            values[name] = [number(draw, types[name]) for _ in range(length)]
        else:
            values[name] = number(draw, types[name])
    return values


def messages(draw: random.Random, name: str) -> tuple[Any, tuple[Any, ...]]:
    """One message as an object of pymavlink, and as a tuple in the order of the wire."""
    kind = KINDS[name]
    values = fields(draw, kind)
    theirs = plain.mavlink_map.get(kind.id, kind)
    # Its own, where pymavlink does not know it in full.
    maker = theirs if theirs.ordered_fieldnames == kind.ordered_fieldnames else kind
    return maker(*(values[fieldname] for fieldname in kind.fieldnames)), wire_values(name, **values)[1]


@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_message_is_packed_as_pymavlink_packs_it(name: str) -> None:
    """Random values, three times; those that are sent all the time, forty times."""
    draw = random.Random(name)
    for turn in range(40 if name in HOT else 3):
        message, values = messages(draw, name)
        system, sequence = draw.randrange(1, 256), draw.randrange(256)
        mav = plain.MAVLink(None, srcSystem=system, srcComponent=1)
        mav.seq = sequence
        ours = Packer(system, 1).pack(KINDS[name].id, sequence, values)
        assert ours == bytes(message.pack(mav)), (turn, values)


@pytest.mark.parametrize("name", HOT)
def test_hot_messages_of_mavlink_1(name: str) -> None:
    """Payloads of their old length; no frame at all for what MAVLink 1 has no number for."""
    draw = random.Random(name)
    for _ in range(10):
        message, values = messages(draw, name)
        frame = Packer(7, 1).pack_v1(KINDS[name].id, 9, values)
        if KINDS[name].id > 255:
            assert frame is None
            return
        mav = plain.MAVLink(None, srcSystem=7, srcComponent=1)
        mav.seq = 9
        theirs = bytes(message.pack(mav, force_mavlink1=True))
        assert frame is not None
        # pymavlink leaves MAVLink 2's later fields in frames of MAVLink 1; without them it is the same
        # payload.
        assert frame[6:-2] == theirs[6 : 6 + frame[1]]
        old = dialect.MAVLink(None)
        old.robust_parsing = False
        assert old.decode(bytearray(frame)).get_type() == name


@pytest.mark.parametrize("name", HOT)
def test_hot_messages_with_a_signature(name: str) -> None:
    """Flag, checksum and the bytes that the signature covers are pymavlink's."""
    draw = random.Random(name)
    covered: list[bytes] = []

    def sign(unsigned: bytes) -> bytes:
        covered.append(unsigned)
        return bytes(13)

    for _ in range(10):
        message, values = messages(draw, name)
        frame = Packer(7, 1).pack_signed(KINDS[name].id, 9, values, sign)
        mav = plain.MAVLink(None, srcSystem=7, srcComponent=1)
        mav.seq = 9
        mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = bytes(32), True, 5
        theirs = bytes(message.pack(mav))
        assert frame[:-13] == theirs[:-13] == covered[-1]
        assert FrameReader().feed(theirs + b"x") == [theirs]
        decoded = Decoder().decode(theirs)
        assert decoded is not None
        assert decoded.get_type() == name


def test_frames_are_found_in_garbage() -> None:
    """Whole frames survive what lies between, in pieces of any size; a wrong checksum is garbage."""
    mav = dialect.MAVLink(None, srcSystem=9, srcComponent=8)
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
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
    """Random payloads, in full and cut off: the same class with the same fields."""
    draws, reference, decoder, packer = random.Random(7), dialect.MAVLink(None), Decoder(), Packer(9, 8)
    for name, kind in KINDS.items():
        for keep in (1.0, 0.5, 0.0):
            size = kind.unpacker.size
            values = kind.unpacker.unpack(draws.randbytes(round(keep * size)).ljust(size, b"\0"))
            frame = (packer.pack_v1 if old else packer.pack)(kind.id, 3, values)
            if frame is None:  # has no place in MAVLink 1
                continue
            try:
                wanted = reference.decode(bytearray(frame))
            except (dialect.MAVError, UnicodeError):
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
