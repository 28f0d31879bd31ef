"""MAVLink frames: reading them from any bytes, packing them from plain values, and integer fields."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from operator import itemgetter
from typing import Any

from fastcrc.crc16 import mcrf4xx

from ._dialect import SIZES, Field, crc_extra, dialect

MAX_FRAME = 10 + 255 + 2 + 13
PATIENCE_BYTES = 4096
_MESSAGES: dict[int, Any] = dialect.mavlink_map
KINDS: dict[str, Any] = {kind.msgname: kind for kind in _MESSAGES.values()}
MESSAGE_NAMES: dict[int, str] = {kind.id: name for name, kind in KINDS.items()}
_CRC_EXTRA = {number: bytes([kind.crc_extra]) for number, kind in _MESSAGES.items()}
_V1, _V2 = 0xFE, 0xFD
_BEGINS = re.compile(b"[\xfd\xfe]")
_SIGNED = 0x01


class FrameReader:
    """Finds whole MAVLink 1 and 2 frames in a stream of bytes; garbage is counted and never raises."""

    def __init__(self) -> None:
        self._rest = b""
        self.garbage_bytes = 0
        self.unread_bytes = 0

    def feed(
        self, data: bytes, last: bool = False, patience: int = PATIENCE_BYTES, max_frames: int | None = None
    ) -> list[bytes]:
        """Every frame that is complete, in order. The beginning of another frame is kept until more bytes
        come.

        `last` means that no more bytes follow, as at the end of a datagram: then what is incomplete is
        garbage, and the search goes on behind its first byte. Behind `patience` bytes of garbage the rest is
        given up as garbage unread, because looking through it costs time. Behind `most` frames the rest is
        thrown away unread, and counted.
        """
        data = self._rest + data if self._rest else data
        frames: list[bytes] = []
        start, end, enough = 0, len(data), self.garbage_bytes + patience
        while start < end:
            if self.garbage_bytes > enough:
                self.garbage_bytes += end - start
                start = end
                break
            length = _length(data, start, end)
            if length > 0 and _intact(data, start, length):
                frames.append(data[start : start + length])
                start += length
                if len(frames) == max_frames:
                    self.unread_bytes += end - start
                    start = end
            elif length == 0 and not last:
                break
            else:
                next_start = _BEGINS.search(data, start + 1)
                skipped = (next_start.start() if next_start else end) - start
                self.garbage_bytes += skipped
                start += skipped
        self._rest = data[start:]
        return frames


def _length(data: bytes, at: int, end: int) -> int:
    """Bytes of the frame that begins at `at`; 0 when more must come first, -1 when none begins here."""
    first = data[at]
    if first == _V2:
        if end - at < 3:
            return 0
        if data[at + 2] & ~_SIGNED:
            return -1
        length = 12 + data[at + 1] + (13 if data[at + 2] & _SIGNED else 0)
    elif first == _V1:
        if end - at < 2:
            return 0
        length = 8 + data[at + 1]
    else:
        return -1
    return length if end - at >= length else 0


def _intact(data: bytes, at: int, length: int) -> bool:
    """Whether the checksum holds. A message that the dialect does not know cannot be checked, and passes when
    nothing or the beginning of another frame follows it.
    """
    extra = _CRC_EXTRA.get(message_id(data, at))
    if extra is None:
        return at + length == len(data) or data[at + length] in (_V1, _V2)
    tail = at + length - (15 if data[at] == _V2 and data[at + 2] & _SIGNED else 2)
    crc: int = mcrf4xx(data[at + 1 : tail] + extra)
    return crc == data[tail] | data[tail + 1] << 8


def message_id(frame: bytes, at: int = 0) -> int:
    if frame[at] == _V1:
        return frame[at + 5]
    return frame[at + 7] | frame[at + 8] << 8 | frame[at + 9] << 16


def payload_of(frame: bytes, size: int) -> bytes:
    """The first `size` bytes of a frame's payload, with the zeros that MAVLink 2 cuts at its end."""
    head = 6 if frame[0] == _V1 else 10
    return frame[head : head + min(frame[1], size)].ljust(size, b"\0")


def message_name(number: int) -> str:
    """The name of a message; its number where the dialect does not have it."""
    return MESSAGE_NAMES.get(number, f"message {number}")


def sender(frame: bytes) -> tuple[int, int]:
    """System and component that sent a frame."""
    return (frame[3], frame[4]) if frame[0] == _V1 else (frame[5], frame[6])


class Decoder:
    """From the frames of a `FrameReader` to pymavlink messages; None, and a count, for a frame that makes no
    sense.

    Messages of numbers alone, such as setpoints, are unpacked here at a fifth of pymavlink's cost, which it
    spends on headers that are not read here and on the checksum that the reader has verified. They hold their
    fields alone.
    """

    def __init__(self) -> None:
        self._mavlink: Any = dialect.MAVLink(None)
        self.malformed = 0

    def decode(self, frame: bytes) -> Any | None:
        plain = _PLAIN.get(message_id(frame))
        if plain:
            kind, unpacker, ordered = plain
            return kind(*ordered(unpacker.unpack(payload_of(frame, unpacker.size))))
        try:
            return self._mavlink.decode(bytearray(frame))
        except (dialect.MAVError, struct.error, ValueError, IndexError, TypeError, UnicodeError):
            self.malformed += 1
            return None


def target_system(frame: bytes) -> int:
    """The system that a frame is for, read without the rest; 0 for every system, or where it names none."""
    place = _target_place(message_id(frame))
    head = 6 if frame[0] == _V1 else 10
    return frame[head + place] if place is not None and place < frame[1] else 0


@cache
def _target_place(number: int) -> int | None:
    """Where in its payload a message names the target system."""
    kind = _MESSAGES.get(number)
    fields = _wire_fields(kind) if kind else []
    for wanted in ("target_system", "target"):
        for place, (name, _, _) in enumerate(fields):
            if name == wanted:
                return _bytes(fields[:place])
    return None


_Plain = tuple[Any, struct.Struct, Callable[[Sequence[Any]], tuple[Any, ...]]]


def _plain(kind: Any) -> _Plain | None:
    """Class, layout on the wire, and the class's order of fields; None where a field is text or an array."""
    if any(kind.array_lengths) or "char" in kind.fieldtypes or len(kind.orders) < 2:
        return None
    return kind, kind.unpacker, itemgetter(*kind.orders)


_PLAIN = {number: plain for number, kind in _MESSAGES.items() if (plain := _plain(kind))}


def _wire_fields(kind: Any) -> list[Field]:
    """Name, type and length (0 for no array) of every field, in the order of the wire."""
    return list(zip(kind.ordered_fieldnames, _types(kind), kind.array_lengths, strict=True))


def _bytes(fields: Sequence[Field]) -> int:
    return sum(SIZES[kind] * max(length, 1) for _, kind, length in fields)


@cache
def v1_length(number: int) -> int | None:
    """Bytes of a message's payload in MAVLink 1, that is without the fields that were added later; None where
    the message has no place in MAVLink 1.

    The dialect does not mark the later fields, but its CRC_EXTRA covers the original ones alone.
    """
    kind = _MESSAGES.get(number)
    if kind is None or number > 255:
        return None
    fields = _wire_fields(kind)
    for count in range(len(fields), 0, -1):
        # Original fields are sorted by size, extensions are not.
        original = fields[:count]
        sizes = [SIZES[type_name] for _, type_name, _ in original]
        if sizes == sorted(sizes, reverse=True) and crc_extra(kind.msgname, original) == kind.crc_extra:
            return _bytes(original)
    return None


_HEAD_V1 = struct.Struct("<BBBBB")
_HEAD = struct.Struct("<BBBBBBHB")
_CRC = struct.Struct("<H")


class Packer:
    """Packs messages of one system and component, MAVLink 2, at a fifth of pymavlink's cost.

    `values` are plain numbers in the order of the wire (the message class's `ordered_fieldnames`, arrays
    spread out).
    """

    def __init__(self, system: int, component: int) -> None:
        self.system, self.component = system, component
        self._sequence = 0
        self._kinds = {number: (kind.unpacker.pack, _CRC_EXTRA[number]) for number, kind in _MESSAGES.items()}

    def pack_next(self, number: int, values: Iterable[Any]) -> bytes:
        """As `pack`, for a sender that counts its messages nowhere else."""
        frame = self.pack(number, self._sequence, values)
        self._sequence = (self._sequence + 1) & 0xFF
        return frame

    def pack_signed(
        self, number: int, sequence: int, values: Iterable[Any], sign: Callable[[bytes], bytes]
    ) -> bytes:
        """As `pack`, with the signature that `sign` makes of the frame."""
        frame = self.pack(number, sequence, values, _SIGNED)
        return frame + sign(frame)

    def pack_v1(self, number: int, sequence: int, values: Iterable[Any]) -> bytes | None:
        """Pack in MAVLink 1; None for a message that does not exist there."""
        length = v1_length(number)
        if length is None:
            return None
        pack, extra = self._kinds[number]
        payload: bytes = pack(*values)[:length]
        body = _HEAD_V1.pack(length, sequence, self.system, self.component, number) + payload
        return b"\xfe" + body + _CRC.pack(mcrf4xx(body + extra))

    def pack(self, number: int, sequence: int, values: Iterable[Any], flags: int = 0) -> bytes:
        pack, extra = self._kinds[number]
        # MAVLink 2 cuts zeros at the end of a payload, but keeps its first byte.
        payload = pack(*values).rstrip(b"\0") or b"\0"
        source = (sequence, self.system, self.component)
        body = _HEAD.pack(len(payload), flags, 0, *source, number & 0xFFFF, number >> 16) + payload
        return b"\xfd" + body + _CRC.pack(mcrf4xx(body + extra))


def wire_values(name: str, /, **fields: Any) -> tuple[int, tuple[Any, ...]]:
    """Id and values in wire order of a message given by field names; a field that is left out is zero.

    Text is bytes. This is for messages that are sent now and then; streams make their tuples themselves,
    which is faster.
    """
    kind = KINDS[name]
    values: list[Any] = []
    for field, type_name, length in _wire_fields(kind):
        value = fields.pop(field, None)
        if type_name == "char":
            values.append(value or b"")
        elif length:
            given: Sequence[Any] = value if value is not None else ()
            values.extend([*given, *[0] * (length - len(given))])
        else:
            values.append(0 if value is None else value)
    if fields:
        raise KeyError(f"{name} has no field {', '.join(fields)}")
    return kind.id, tuple(values)


def _types(kind: Any) -> list[str]:
    by_name = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    return [by_name[name] for name in kind.ordered_fieldnames]


def heading_cdeg(yaw_rad: float) -> int:
    """0 to 35999 hundredths of a degree."""
    return round(math.degrees(yaw_rad) * 100.0) % 36000


def int16(value: float) -> int:
    """The nearest integer, within the bounds of 16 bits."""
    return round(value) if -32768.0 <= value <= 32767.0 else round(min(max(value, -32768.0), 32767.0))


def hundredths(value: float) -> int:
    return int16(value * 100.0)
