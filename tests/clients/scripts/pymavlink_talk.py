"""A ground station in a hundred lines of pymavlink: messages, commands and parameters, blocking."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import Any

os.environ["MAVLINK20"] = "1"  # read by pymavlink as it is imported

from logbook import PATIENCE_S, distance_m, run_chapters
from pymavlink import mavutil

mavlink = mavutil.mavlink


class Talk:
    """One link to one vehicle."""

    def __init__(self, url: str, system: int = 255) -> None:
        self.link = mavutil.mavlink_connection(url, source_system=system, source_component=190)
        self.texts: list[str] = []
        self._beat_s = 0.0
        if self.link.wait_heartbeat(timeout=PATIENCE_S) is None:
            sys.exit(f"no heartbeat on {url}")
        self.link.target_component = 1
        self.listen()  # and beat: PX4 sends its texts to stations that it hears

    @property
    def target(self) -> tuple[int, int]:
        return self.link.target_system, self.link.target_component

    def listen(self, timeout_s: float = 0.1) -> Any:
        """The next message, or None."""
        now = time.monotonic()
        if now - self._beat_s > 0.5:
            self._beat_s = now
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
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

    def command(self, number: int, *params: float) -> list[str]:
        """Every result that a COMMAND_LONG is acknowledged with: PX4 may say two."""
        padded = [*params, *[0.0] * (7 - len(params))]
        self.link.mav.command_long_send(*self.target, number, 0, *padded)
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
            kind = message and message.get_type()
            if kind in ("PARAM_VALUE", "PARAM_ERROR") and message.param_id == name:
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


class Pilot:
    """What both autopilots are flown by; a subclass is ready and takes off in its autopilot's way."""

    land: tuple[float, ...] = ()

    def __init__(self, talk: Talk) -> None:
        self.talk = talk

    def here(self) -> tuple[float, float]:
        at = self.talk.until("a position", "GLOBAL_POSITION_INT")
        return at.lat / 1e7, at.lon / 1e7

    def arm(self) -> list[str]:
        return self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once SYS_STATUS says that it may be armed."""
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        healthy = "a vehicle that is ready"
        self.talk.until(healthy, "SYS_STATUS", lambda status: status.onboard_control_sensors_health & bit)
        return self.here()

    def up(self) -> tuple[float, float]:
        raise NotImplementedError

    def hop(self) -> dict[str, Any]:
        start = self.up()
        disarm = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        self.talk.command(mavlink.MAV_CMD_NAV_LAND, *self.land)
        self.talk.disarmed()
        return {"disarm_in_air": disarm, "from_start_m": distance_m(start, self.here())}


def fly(pilot: type[Pilot]) -> None:
    url, *wanted = sys.argv[1:]
    run_chapters(pilot(Talk(url)), wanted)
