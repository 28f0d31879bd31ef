"""Version, protocol, modes, metadata and the empty list of logs of the autopilot, all on request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..links._enums import MAV_CMD
from ..policies._identity import IdentityPolicy
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, FlightMode
from ..state._service import (
    Command,
    CommandHandler,
    CommandResult,
    Fields,
    MessageAnswer,
    MessageHandler,
    MessageSender,
)
from ..state._service_context import ServiceContext

# MAV_MODE_PROPERTY
_NOT_USER_SELECTABLE = 2


class Identity:
    """Answers to REQUEST_MESSAGE, as far as the autopilot has them, and to the two older requests."""

    def __init__(self, context: ServiceContext, policy: IdentityPolicy, modes: ModePolicy) -> None:
        self._flight = context.flight
        self._parameters = context.parameters
        self._policy = policy
        self._modes = modes

    def handlers(self) -> Mapping[str, MessageHandler]:
        return {"LOG_REQUEST_LIST": self._send_empty_log_list}

    def commands(self) -> Mapping[int, CommandHandler]:
        commands: dict[int, CommandHandler] = {MAV_CMD.REQUEST_AUTOPILOT_CAPABILITIES: self._send_version}
        if self._policy.protocol_versions:
            commands[MAV_CMD.REQUEST_PROTOCOL_VERSION] = self._send_protocol
        return commands

    def answers(self) -> Mapping[str, MessageAnswer]:
        policy = self._policy
        answers: dict[str, MessageAnswer] = {"AUTOPILOT_VERSION": lambda command: self._version()}
        if policy.protocol_versions:
            answers["PROTOCOL_VERSION"] = lambda command: self._protocol()
        if policy.metadata:
            answers["COMPONENT_METADATA"] = lambda command: self._metadata("file_crc", "uri")
            answers["COMPONENT_INFORMATION"] = lambda command: self._metadata(
                "general_metadata_file_crc", "general_metadata_uri"
            )
        if policy.reports_flight:
            answers["FLIGHT_INFORMATION"] = lambda command: self._flight_information()
        if self._modes.standard_modes:
            answers["AVAILABLE_MODES"] = self._available_modes
        return answers

    def _send_empty_log_list(self, message: Any, sender: MessageSender) -> None:
        # As of an autopilot whose log backend is off: the session's recording holds what a log would.
        sender.channel.send_message("LOG_ENTRY", id=0, num_logs=0, last_log_num=0, time_utc=0, size=0)

    def _send_version(self, command: Command) -> CommandResult | None:
        command.sender.channel.send_message("AUTOPILOT_VERSION", **self._version())
        return CommandResult.ACCEPTED

    def _send_protocol(self, command: Command) -> CommandResult | None:
        command.sender.channel.send_message("PROTOCOL_VERSION", **self._protocol())
        return CommandResult.ACCEPTED

    def _version(self) -> Fields:
        policy = self._policy
        return {
            "capabilities": policy.capabilities,
            "uid": policy.uid,
            "flight_sw_version": policy.flight_sw_version,
            "board_version": policy.board_version,
            "flight_custom_version": list(policy.flight_custom_version),
            "uid2": list(policy.uid2),
        }

    def _protocol(self) -> Fields:
        assert self._policy.protocol_versions
        version, lowest, highest = self._policy.protocol_versions
        return {"version": version, "min_version": lowest, "max_version": highest}

    def _flight_information(self) -> Fields:
        """The time of arming, 0 while disarmed; the take-off is not timed."""
        f = self._flight
        return {
            "time_boot_ms": f.time_ms,
            "arming_time_utc": f.unix_start_us + f.armed_since_ns // 1000 if f.armed else 0,
            "takeoff_time_utc": 0,
            "flight_uuid": int(self._parameters["COM_FLIGHT_UUID"]),
        }

    def _metadata(self, checksum: str, uri: str) -> Fields:
        metadata = self._policy.metadata
        assert metadata
        return {
            "time_boot_ms": self._flight.time_ms,
            checksum: metadata.checksum(),
            uri: metadata.uri.encode(),
        }

    def _available_modes(self, command: Command) -> Fields | list[Fields] | None:
        """Index 0 asks for all modes, any other for one."""
        modes, index = self._modes.modes, command.params[1]
        if index == 0.0:
            return [self._mode(number, mode) for number, mode in enumerate(modes, start=1)]
        # NaN is not equal to itself.
        if index == index and 1 <= index <= len(modes):
            return self._mode(int(index), modes[int(index) - 1])
        return None

    def _mode(self, index: int, mode: FlightMode) -> Fields:
        standard_mode = self._modes.standard_modes.get(mode.name, 0)
        external = mode.behaviour is Behaviour.EXTERNAL
        registered = self._flight.external_modes.get(mode.name)
        name = registered.label if registered else "(Mode not available)" if external else mode.label
        selectable = registered.selectable if registered else not external
        return {
            "number_modes": len(self._modes.modes),
            "mode_index": index,
            "standard_mode": standard_mode,
            "custom_mode": mode.custom,
            "properties": 0 if selectable else _NOT_USER_SELECTABLE,
            # A standard mode is known by its number and needs no name.
            "mode_name": b"" if standard_mode else name.encode(),
        }
