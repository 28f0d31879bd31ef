"""MAVLink 2 with a codec of its own, so that nothing of the bench checks itself."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from typing import NoReturn

# Number of each message that is sent or read here, and its CRC_EXTRA in MAVLink's common.xml.
NUMBERS = (0, 1, 2, 22, 23, 30, 33, 76, 77, 93, 107, 113, 115, 148, 253)
CRC_EXTRA = dict(
    zip(NUMBERS, bytes((50, 124, 137, 220, 168, 39, 104, 152, 143, 47, 108, 124, 4, 178, 83)), strict=True)
)


def violation(text: str) -> NoReturn:
    print(f"VIOLATION: {text}", flush=True)
    sys.exit(3)


def require(condition: bool, text: str) -> None:
    if not condition:
        violation(text)


def crc_table() -> list[int]:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
        table.append(value)
    return table


CRC_TABLE = crc_table()


def crc_of(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ CRC_TABLE[(crc ^ byte) & 0xFF]
    return crc


class Mavlink:
    """MAVLink 2, packed and read strictly."""

    def __init__(self) -> None:
        self.buffer = bytearray()
        self.sequence = 0
        # System and component of the message that was read last.
        self.sender = (0, 0)

    def pack(self, number: int, payload: bytes) -> bytes:
        payload = payload.rstrip(b"\0") or b"\0"
        head = struct.pack("<BBBBBBHB", len(payload), 0, 0, self.sequence, 1, 1, number, 0)
        self.sequence = (self.sequence + 1) & 0xFF
        return (
            b"\xfd" + head + payload + struct.pack("<H", crc_of(head + payload + bytes((CRC_EXTRA[number],))))
        )

    def read(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Number and payload of each frame. A message that is not known here is passed over, garbage is a violation."""
        self.buffer += data
        while len(self.buffer) >= 12:
            require(self.buffer[0] == 0xFD, f"byte {self.buffer[0]:#x} where MAVLink 2 begins")
            size = self.buffer[1] + 12
            if len(self.buffer) < size:
                return
            frame = bytes(self.buffer[:size])
            del self.buffer[:size]
            number = frame[7] | frame[8] << 8 | frame[9] << 16
            if number in CRC_EXTRA:
                crc = crc_of(frame[1:-2] + bytes((CRC_EXTRA[number],)))
                require(struct.pack("<H", crc) == frame[-2:], f"checksum of message {number}")
                self.sender = (frame[5], frame[6])
                yield number, frame[10:-2]


def unpacked(layout: str, payload: bytes) -> tuple[float, ...]:
    size = struct.calcsize(layout)
    require(len(payload) <= size, f"a payload of {len(payload)} bytes, {size} at most")
    return struct.unpack(layout, payload.ljust(size, b"\0"))
