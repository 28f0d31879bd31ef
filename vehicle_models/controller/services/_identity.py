"""Who the autopilot is: its version, its protocol, its modes, and where its metadata lie. All on request."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .._flight import Mode
from .._service import Command, CommandHandler, Handler, Result
from .._service_context import ServiceContext

REQUEST_PROTOCOL_VERSION, REQUEST_CAPABILITIES = 519, 520
_NOT_SELECTABLE = 2  # MAV_MODE_PROPERTY
Fields = dict[str, Any]


class Identity:
    """Answers to REQUEST_MESSAGE, as far as the personality has them, and to the two older requests."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        older: dict[int, CommandHandler] = {REQUEST_CAPABILITIES: self._old}
        if self._board.personality.protocol_versions:
            older[REQUEST_PROTOCOL_VERSION] = self._old_protocol
        return older

    def answers(self) -> Mapping[str, Callable[[Command], Fields | list[Fields] | None]]:
        """By message: the fields of one, those of several, or None where the request is refused."""
        personality = self._board.personality
        found: dict[str, Callable[[Command], Fields | list[Fields] | None]] = {
            "AUTOPILOT_VERSION": lambda command: self._version()
        }
        if personality.protocol_versions:
            found["PROTOCOL_VERSION"] = lambda command: self._protocol()
        if personality.metadata:
            found["COMPONENT_METADATA"] = lambda command: self._metadata("file_crc", "uri")
            found["COMPONENT_INFORMATION"] = lambda command: self._metadata("general_metadata_file_crc", "general_metadata_uri")
        if personality.standard_modes:
            found["AVAILABLE_MODES"] = self._modes
        if personality.event_names:
            found["CURRENT_EVENT_SEQUENCE"] = lambda command: None  # streamed, and refused when asked for
        return found

    def _old(self, command: Command) -> Result | None:
        command.sender.channel.tell("AUTOPILOT_VERSION", **self._version())
        return Result.ACCEPTED

    def _old_protocol(self, command: Command) -> Result | None:
        command.sender.channel.tell("PROTOCOL_VERSION", **self._protocol())
        return Result.ACCEPTED

    def _version(self) -> Fields:
        personality = self._board.personality
        return {
            "capabilities": personality.capabilities,
            "uid": personality.uid,
            "flight_sw_version": personality.flight_sw_version,
            "board_version": personality.board_version,
            "flight_custom_version": list(personality.flight_custom_version),
            "uid2": list(personality.uid2),
        }

    def _protocol(self) -> Fields:
        assert self._board.personality.protocol_versions
        version, least, most = self._board.personality.protocol_versions
        return {"version": version, "min_version": least, "max_version": most}

    def _metadata(self, checksum: str, uri: str) -> Fields:
        metadata = self._board.personality.metadata
        assert metadata
        return {"time_boot_ms": self._board.flight.time_ms, checksum: metadata.checksum(), uri: metadata.uri.encode()}

    def _modes(self, command: Command) -> Fields | list[Fields] | None:
        """Index 0 asks for all of them, any other for one."""
        modes, index = self._board.personality.modes, command.params[1]
        if index == 0.0:
            return [self._mode(number, mode) for number, mode in enumerate(modes, start=1)]
        if index == index and 1 <= index <= len(modes):
            return self._mode(int(index), modes[int(index) - 1])
        return None

    def _mode(self, index: int, mode: Mode) -> Fields:
        standard = self._board.personality.standard_modes.get(mode.name, 0)
        absent = mode.name.startswith("EXTERNAL")
        name = "(Mode not available)" if absent else mode.label
        return {
            "number_modes": len(self._board.personality.modes),
            "mode_index": index,
            "standard_mode": standard,
            "custom_mode": mode.custom,
            "properties": _NOT_SELECTABLE if absent else 0,
            "mode_name": b"" if standard else name.encode(),
        }
