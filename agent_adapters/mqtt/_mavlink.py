"""MAVLink messages as JSON and back, by the XML of the dialect common."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from agent_adapters.client import MavlinkFrame
from bench.contracts import MavlinkJson, parse_document


class MavlinkTranslator:
    """Both directions of one link. `unknown` counts frames that are no messages of the dialect."""

    def __init__(self) -> None:
        self.unknown = 0
        self._mav = mavlink.MAVLink(None)
        self._kinds = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}

    def to_json(self, frame: MavlinkFrame) -> dict[str, Any] | None:
        """The message of a frame, or None when it is none of the dialect."""
        if frame.message_id not in mavlink.mavlink_map:
            self.unknown += 1
            return None
        try:
            message = self._mav.decode(bytearray(frame.data))
        except mavlink.MAVError:
            self.unknown += 1
            return None
        fields = {name: _plain(getattr(message, name)) for name in message.fieldnames}
        return {
            "system": frame.system,
            "component": frame.component,
            "name": message.msgname,
            "fields": fields,
        }

    def frame_of(self, text: str) -> bytes | str:
        """The frame of a message that an agent sent as JSON; a text says why it is none."""
        document = parse_document(MavlinkJson, text)
        if document is None:
            return "it is no mavlink-message (rebar schema mavlink-message)"
        kind = self._kinds.get(document.name)
        if kind is None:
            return f"the dialect common has no message {document.name[:64]!r}"
        if unknown := sorted(document.fields.keys() - set(kind.fieldnames)):
            return f"{document.name} has no field {unknown[0]!r}"
        self._mav.srcSystem, self._mav.srcComponent = document.system, document.component
        values = [_field(kind, name, document.fields) for name in kind.fieldnames]
        try:
            frame = bytes(kind(*values).pack(self._mav))
        # struct.error, TypeError, ValueError and more: a value that does not fit its field, in the generated code.
        except Exception as error:
            return f"{document.name}: {error}"
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple | bytearray):
        return [_plain(item) for item in value]
    return value.decode(errors="replace") if isinstance(value, bytes) else value


def _field(kind: Any, name: str, fields: dict[str, Any]) -> Any:
    """The value of a field as the constructor takes it; zeros where the agent gave none."""
    # pymavlink keeps types in the order of the constructor, and lengths in the order of the wire.
    is_text = kind.fieldtypes[kind.fieldnames.index(name)] == "char"
    length = kind.lengths[kind.ordered_fieldnames.index(name)]
    if name not in fields:
        return b"" if is_text else [0] * length if length > 1 else 0
    value = fields[name]
    if isinstance(value, str):
        return value.encode()
    if isinstance(value, list | tuple):
        return [math.nan if item is None else item for item in value]
    return math.nan if value is None else value
