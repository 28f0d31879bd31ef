"""The dialect of the flight controller: pymavlink's `all`, and the messages that it lacks.

pymavlink follows ArduPilot's fork of the definitions, which lacks PX4's events, its component metadata and
the plan ids of missions (`messages.csv`; the last four it knows without their newer extensions). They are added to a
private copy of the module, so that pymavlink stays as it is for other code.
"""

from __future__ import annotations

import importlib.util
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fastcrc.crc16 import mcrf4xx

from ..._read_table import read_table

_SOURCE = "pymavlink.dialects.v20.all"
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
    "double": "d",
}
SIZES = {kind: struct.calcsize(f"<{code}") for kind, code in _CODES.items()}
"""Bytes of each type."""

Field = tuple[str, str, int]
"""Name, type, length of the array or 0."""


def _fields(text: str) -> list[Field]:
    """Fields of a definition's text: "type name" or "type[length] name", between commas."""
    fields = []
    for field in filter(None, text.split(", ")):
        kind, name = field.split()
        kind, _, length = kind.partition("[")
        fields.append((name, kind, int(length.rstrip("]") or 0)))
    return fields


def crc_extra(name: str, base: Sequence[Field]) -> int:
    """The specification's checksum over a message's own definition, without extensions."""
    text = f"{name} ".encode()
    for field, kind, length in base:
        text += f"{kind} {field} ".encode() + (bytes([length]) if length else b"")
    crc: int = mcrf4xx(text)
    return crc & 0xFF ^ crc >> 8


def _message_class(module: Any, number: int, name: str, base: list[Field], extensions: list[Field]) -> Any:
    """A message class as pymavlink's generator would write it."""
    fields = [*base, *extensions]
    # The wire's order: the largest first, stably; then the extensions.
    sorted_base = sorted(base, key=lambda field: -SIZES[field[1]])
    wire = [*sorted_base, *extensions]
    codes = "<" + "".join(f"{length or ''}{_CODES[kind]}" for _, kind, length in wire)
    order = [field[0] for field in wire]
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
        "crc_extra": crc_extra(name, sorted_base),
        "unpacker": struct.Struct(codes),
        "instance_field": None,
        "instance_offset": -1,
        "defaults": {field: _default(kind, length) for field, kind, length in fields},
        "__init__": _set_fields,
        "pack": _pack,
    }
    return type(f"MAVLink_{name.lower()}_message", (module.MAVLink_message,), attributes)


def _default(kind: str, length: int) -> bytes | int | list[int]:
    if kind == "char":
        return b""
    return [0] * length if length else 0


def _set_fields(message: Any, *values: Any, **by_name: Any) -> None:
    super(type(message), message).__init__(message.id, message.msgname)
    message._fieldnames = message.fieldnames
    message._instance_field, message._instance_offset = None, -1
    positional = dict(zip(message.defaults, values, strict=False))
    for field, value in {**message.defaults, **positional, **by_name}.items():
        if isinstance(value, bytes):
            setattr(message, f"_{field}_raw", value)
            value = value.split(b"\0", 1)[0].decode("ascii", "replace")
        setattr(message, field, value)


def _pack(message: Any, mav: Any, force_mavlink1: bool = False) -> Any:
    values: list[Any] = []
    for field in message.ordered_fieldnames:
        value = getattr(message, field)
        if isinstance(value, list | tuple):
            values += value
        else:
            values.append(value.encode() if isinstance(value, str) else value)
    packed = message.unpacker.pack(*values)
    return message._pack(mav, message.crc_extra, packed, force_mavlink1=force_mavlink1)


def _load() -> Any:
    spec = importlib.util.find_spec(_SOURCE)
    if spec is None or spec.loader is None:
        raise ImportError(_SOURCE)
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for row in read_table(Path(__file__).with_name("messages.csv")):
        number, name = int(row["number"]), row["message"]
        message = _message_class(module, number, name, _fields(row["fields"]), _fields(row["extensions"]))
        module.mavlink_map[number] = message
        setattr(module, f"MAVLINK_MSG_ID_{name}", number)
        setattr(module, message.__name__, message)
    return module


dialect: Any = _load()
"""A pymavlink dialect module: `mavlink_map`, `MAVLink`, `MAVError`, the message classes and enumerations."""
