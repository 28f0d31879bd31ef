"""The dialect of the flight controller: pymavlink's `all`, and the messages that it lacks.

pymavlink follows ArduPilot's fork of the definitions, which lacks PX4's events, its component metadata and
the plan ids of missions. They are added to a private copy of the module, so that pymavlink stays as it is for
other code.
"""

from __future__ import annotations

import importlib.util
import struct
from collections.abc import Sequence
from typing import Any

from fastcrc.crc16 import mcrf4xx

_SOURCE = "pymavlink.dialects.v20.all"

# id, name, fields ("type name" or "type[length] name"); those behind "|" are MAVLink 2 extensions.
_MISSING = (
    (
        8,
        "LINK_NODE_STATUS",
        "uint64_t timestamp, uint8_t tx_buf, uint8_t rx_buf, uint32_t tx_rate, uint32_t rx_rate, uint16_t rx_parse_err,"
        "uint16_t tx_overflows, uint16_t rx_overflows, uint32_t messages_sent, uint32_t messages_received, uint32_t messages_lost",
    ),
    (80, "COMMAND_CANCEL", "uint8_t target_system, uint8_t target_component, uint16_t command"),
    (
        290,
        "ESC_INFO",
        "uint8_t index, uint64_t time_usec, uint16_t counter, uint8_t count, uint8_t connection_type, uint8_t info,"
        "uint16_t[4] failure_flags, uint32_t[4] error_count, int16_t[4] temperature",
    ),
    (
        291,
        "ESC_STATUS",
        "uint8_t index, uint64_t time_usec, int32_t[4] rpm, float[4] voltage, float[4] current",
    ),
    (
        300,
        "PROTOCOL_VERSION",
        "uint16_t version, uint16_t min_version, uint16_t max_version, uint8_t[8] spec_version_hash, uint8_t[8] library_version_hash",
    ),
    (
        380,
        "TIME_ESTIMATE_TO_TARGET",
        "int32_t safe_return, int32_t land, int32_t mission_next_item, int32_t mission_end, int32_t commanded_action",
    ),
    (
        395,
        "COMPONENT_INFORMATION",
        "uint32_t time_boot_ms, uint32_t general_metadata_file_crc, char[100] general_metadata_uri,"
        "uint32_t peripherals_metadata_file_crc, char[100] peripherals_metadata_uri",
    ),
    (397, "COMPONENT_METADATA", "uint32_t time_boot_ms, uint32_t file_crc, char[100] uri"),
    (
        410,
        "EVENT",
        "uint8_t destination_component, uint8_t destination_system, uint32_t id, uint32_t event_time_boot_ms,"
        "uint16_t sequence, uint8_t log_levels, uint8_t[40] arguments",
    ),
    (411, "CURRENT_EVENT_SEQUENCE", "uint16_t sequence, uint8_t flags"),
    (
        412,
        "REQUEST_EVENT",
        "uint8_t target_system, uint8_t target_component, uint16_t first_sequence, uint16_t last_sequence",
    ),
    (
        413,
        "RESPONSE_EVENT_ERROR",
        "uint8_t target_system, uint8_t target_component, uint16_t sequence, uint16_t sequence_oldest_available, uint8_t reason",
    ),
    # Known to pymavlink without their newer extensions.
    (
        42,
        "MISSION_CURRENT",
        "uint16_t seq | uint16_t total, uint8_t mission_state, uint8_t mission_mode,"
        "uint32_t mission_id, uint32_t fence_id, uint32_t rally_points_id",
    ),
    (
        44,
        "MISSION_COUNT",
        "uint8_t target_system, uint8_t target_component, uint16_t count | uint8_t mission_type, uint32_t opaque_id",
    ),
    (
        47,
        "MISSION_ACK",
        "uint8_t target_system, uint8_t target_component, uint8_t type | uint8_t mission_type, uint32_t opaque_id",
    ),
    (111, "TIMESYNC", "int64_t tc1, int64_t ts1 | uint8_t target_system, uint8_t target_component"),
)
_CODES = {
    "char": "s",
    "uint8_t": "B",
    "int8_t": "b",
    "int16_t": "h",
    "uint16_t": "H",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
}
_SIZES = {
    "char": 1,
    "uint8_t": 1,
    "int8_t": 1,
    "int16_t": 2,
    "uint16_t": 2,
    "uint32_t": 4,
    "int32_t": 4,
    "uint64_t": 8,
    "int64_t": 8,
    "float": 4,
}
# Name, type, length of the array or 0.
_Field = tuple[str, str, int]


def _fields(text: str) -> list[_Field]:
    """Fields of a definition's text."""
    fields = []
    for field in filter(None, (part.strip() for part in text.split(","))):
        kind, name = field.split()
        kind, _, length = kind.partition("[")
        fields.append((name, kind, int(length.rstrip("]")) if length else 0))
    return fields


def _crc_extra(name: str, base: Sequence[_Field]) -> int:
    """The specification's checksum over a message's own definition, without extensions."""
    text = f"{name} ".encode()
    for field, kind, length in base:
        text += f"{kind} {field} ".encode() + (bytes([length]) if length else b"")
    crc: int = mcrf4xx(text)
    return crc & 0xFF ^ crc >> 8


def _message_class(module: Any, number: int, name: str, text: str) -> type[Any]:
    """A message class as pymavlink's generator would write it."""
    base_text, _, extensions = text.partition("|")
    fields = _fields(base_text) + _fields(extensions)
    # The wire's order: the largest first, stably.
    base = sorted(_fields(base_text), key=lambda field: -_SIZES[field[1]])
    wire = [*base, *_fields(extensions)]
    codes = "<" + "".join(f"{length or ''}{_CODES[kind]}" for _, kind, length in wire)
    order = [name for name, _, _ in wire]
    crc_extra, unpacker = _crc_extra(name, base), struct.Struct(codes)
    defaults = {
        field: b"" if kind == "char" else [0] * length if length else 0 for field, kind, length in fields
    }

    class Message(module.MAVLink_message):  # type: ignore[misc]
        def __init__(self, *values: Any, **by_name: Any) -> None:
            super().__init__(number, name)
            self._fieldnames = self.fieldnames
            self._instance_field, self._instance_offset = None, -1
            for field, value in {**defaults, **dict(zip(defaults, values, strict=False)), **by_name}.items():
                if isinstance(value, bytes):
                    setattr(self, f"_{field}_raw", value)
                    value = value.split(b"\0", 1)[0].decode("ascii", "replace")
                setattr(self, field, value)

        def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
            values: list[Any] = []
            for field in order:
                value = getattr(self, field)
                values += (
                    value
                    if isinstance(value, list | tuple)
                    else [value.encode() if isinstance(value, str) else value]
                )
            packed: bytes = self._pack(mav, crc_extra, unpacker.pack(*values), force_mavlink1=force_mavlink1)
            return packed

    attributes = {
        "id": number,
        "msgname": name,
        "fieldnames": [field[0] for field in fields],
        "ordered_fieldnames": order,
        "fieldtypes": [field[1] for field in fields],
        "fielddisplays_by_name": {},
        "fieldenums_by_name": {},
        "fieldunits_by_name": {},
        "native_format": bytearray(codes.encode()),
        "orders": [order.index(field[0]) for field in fields],
        "lengths": [1 if kind == "char" else length or 1 for _, kind, length in wire],
        "array_lengths": [length for _, _, length in wire],
        "crc_extra": crc_extra,
        "unpacker": unpacker,
        "instance_field": None,
        "instance_offset": -1,
    }
    for key, value in attributes.items():
        setattr(Message, key, value)
    Message.__name__ = f"MAVLink_{name.lower()}_message"
    return Message


def _load() -> Any:
    spec = importlib.util.find_spec(_SOURCE)
    if spec is None or spec.loader is None:
        raise ImportError(_SOURCE)
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for number, name, text in _MISSING:
        message = _message_class(module, number, name, text)
        module.mavlink_map[number] = message
        setattr(module, f"MAVLINK_MSG_ID_{name}", number)
        setattr(module, message.__name__, message)
    return module


dialect: Any = _load()
"""A pymavlink dialect module: `mavlink_map`, `MAVLink`, `MAVError`, the message classes and enumerations."""
