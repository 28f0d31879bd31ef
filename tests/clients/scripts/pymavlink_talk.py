"""A ground station in a hundred lines of pymavlink: messages, commands, parameters and plans, blocking."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

os.environ["MAVLINK20"] = "1"  # read by pymavlink as it is imported

from logbook import PATIENCE_S
from pymavlink import mavutil

mavlink = mavutil.mavlink


@dataclass
class Item:
    """One item of a plan; x and y in 1e-7 degree."""

    command: int
    x: int = 0
    y: int = 0
    z: float = 0.0
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


class Talk:
    """One link to one vehicle.

    `feed`, when set, is called ten times a second while anything is waited for.
    """

    def __init__(self, url: str, system: int = 255) -> None:
        self.link = mavutil.mavlink_connection(url, source_system=system, source_component=190)
        self.feed: Callable[[], None] | None = None
        self.texts: list[str] = []
        self._beat_s = self._fed_s = 0.0
        if self.link.wait_heartbeat(timeout=PATIENCE_S) is None:
            sys.exit(f"no heartbeat on {url}")
        self.link.target_component = 1

    @property
    def target(self) -> tuple[int, int]:
        return self.link.target_system, self.link.target_component

    def listen(self, timeout_s: float = 0.1) -> Any:
        """The next message, or None."""
        now = time.monotonic()
        if now - self._beat_s > 0.5:
            self._beat_s = now
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        if self.feed and now - self._fed_s > 0.1:
            self._fed_s = now
            self.feed()
        message = self.link.recv_match(blocking=True, timeout=timeout_s)
        if message is not None and message.get_type() == "STATUSTEXT":
            self.texts.append(message.text.strip())
        return message

    def until(
        self,
        what: str,
        kind: str,
        holds: Callable[[Any], Any] = lambda _: True,
        timeout_s: float = PATIENCE_S,
        needed: bool = True,
    ) -> Any:
        """The first message of a kind for which `holds` does; None, or the end where it is needed, when none
        comes.
        """
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            message = self.listen()
            if message is not None and message.get_type() == kind and holds(message):
                return message
        return sys.exit(f"gave up waiting {timeout_s:.0f} s for {what}") if needed else None

    def beat(self, what: str, holds: Callable[[Any], Any]) -> None:
        """Wait for a heartbeat of the autopilot; a camera beats on the same link."""
        self.until(what, "HEARTBEAT", lambda beat: beat.get_srcComponent() == 1 and holds(beat))

    def mode(self, custom_mode: int) -> None:
        self.beat(f"mode {custom_mode}", lambda beat: beat.custom_mode == custom_mode)

    def disarmed(self) -> None:
        self.beat("disarming", lambda beat: not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def command(self, number: int, *params: float, component: int = 1) -> list[str]:
        """Every result that a COMMAND_LONG is acknowledged with: PX4 may say two."""
        padded = [*params, *[0.0] * (7 - len(params))]
        self.link.mav.command_long_send(self.link.target_system, component, number, 0, *padded)
        return self._results(number)

    def command_int(self, number: int, frame: int, *params: float) -> list[str]:
        *four, x, y, z = params
        self.link.mav.command_int_send(*self.target, frame, number, 0, 0, *four, int(x), int(y), z)
        return self._results(number)

    def _results(self, number: int) -> list[str]:
        results: list[str] = []
        patience_s = 2.0
        while ack := self.until(
            "", "COMMAND_ACK", lambda ack: ack.command == number, patience_s, needed=False
        ):
            results.append(mavlink.enums["MAV_RESULT"][ack.result].name.removeprefix("MAV_RESULT_"))
            patience_s = 0.15
        return results

    def parameter(self, name: str) -> Any:
        """PARAM_VALUE or PARAM_ERROR, or None when neither comes."""
        self.link.mav.param_request_read_send(*self.target, name.encode(), -1)
        return self._parameter_answer(name)

    def set_parameter(self, name: str, value: float, kind: int = mavlink.MAV_PARAM_TYPE_REAL32) -> Any:
        self.link.mav.param_set_send(*self.target, name.encode(), value, kind)
        return self._parameter_answer(name)

    def _parameter_answer(self, name: str) -> Any:
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            message = self.listen()
            if (
                message is not None
                and message.get_type() in ("PARAM_VALUE", "PARAM_ERROR")
                and message.param_id == name
            ):
                return message
        return None

    def all_parameters(self) -> int:
        """How many of the whole list came; as many as it promises."""
        self.link.mav.param_request_list_send(*self.target)
        received: set[int] = set()

        def counted(value: Any) -> bool:
            if value.param_index != 65535:
                received.add(value.param_index)
            return len(received) == value.param_count

        self.until("all parameters", "PARAM_VALUE", counted)
        return len(received)

    def upload(self, items: Sequence[Item], mission_type: int = 0) -> str:
        """The verdict on a plan."""
        self.link.mav.mission_count_send(*self.target, len(items), mission_type)
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            message = self.listen()
            if message is None or getattr(message, "mission_type", None) != mission_type:
                continue
            if message.get_type() in ("MISSION_REQUEST_INT", "MISSION_REQUEST") and message.seq < len(items):
                item = items[message.seq]
                self.link.mav.mission_item_int_send(
                    *self.target, message.seq, item.frame, item.command, int(message.seq == 0), 1,
                    *item.params, item.x, item.y, item.z, mission_type,
                )  # fmt: skip
            elif message.get_type() == "MISSION_ACK":
                return str(
                    mavlink.enums["MAV_MISSION_RESULT"][message.type].name.removeprefix("MAV_MISSION_")
                )
        return sys.exit("no verdict on the plan")

    def download(self, mission_type: int = 0) -> list[int]:
        """The commands of the plan that is kept."""
        self.link.mav.mission_request_list_send(*self.target, mission_type)
        count = self.until(
            "the count", "MISSION_COUNT", lambda message: message.mission_type == mission_type
        ).count
        commands = []
        for seq in range(count):
            self.link.mav.mission_request_int_send(*self.target, seq, mission_type)
            item = self.until("an item", "MISSION_ITEM_INT", lambda got: got.seq == seq)  # noqa: B023
            commands.append(item.command)
        self.link.mav.mission_ack_send(*self.target, mavlink.MAV_MISSION_ACCEPTED, mission_type)
        return commands

    def setpoint(
        self, mask: int, position: Sequence[float] = (0, 0, 0), velocity: Sequence[float] = (0, 0, 0)
    ) -> None:
        """One SET_POSITION_TARGET_LOCAL_NED."""
        self.link.mav.set_position_target_local_ned_send(
            0, *self.target, mavlink.MAV_FRAME_LOCAL_NED, mask, *position, *velocity, 0, 0, 0, 0, 0
        )
