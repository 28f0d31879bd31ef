"""pymavlink on ArduPilot: python pymavlink_ardupilot_flight.py tcp:127.0.0.1:5760 CHAPTER...

Flies all parameters, takeoff and landing. Is refused: arming and takeoff during the start, disarming in the air.
"""

from __future__ import annotations

import sys
from typing import Any

from logbook import distance_m, run_chapters
from pymavlink_talk import Talk, mavlink

HEIGHT_M = 8.0
GUIDED = 4


class Flight:
    def __init__(self, talk: Talk) -> None:
        self.talk = talk
        self.ask_for_streams()

    def ask_for_streams(self) -> None:
        self.talk.link.mav.request_data_stream_send(*self.talk.target, mavlink.MAV_DATA_STREAM_ALL, 10, 1)

    def here(self) -> tuple[float, float]:
        at = self.talk.until("a position", "GLOBAL_POSITION_INT")
        return at.lat / 1e7, at.lon / 1e7

    def set_mode(self, number: int) -> list[str]:
        return self.talk.command(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, number
        )

    def arm(self) -> list[str]:
        return self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def ready(self) -> tuple[float, float]:
        """Where it stands, once SYS_STATUS says that it may be armed in GUIDED."""
        self.set_mode(GUIDED)
        self.talk.mode(GUIDED)
        self.talk.until(
            "the way to GUIDED",
            "EKF_STATUS_REPORT",
            lambda message: message.flags & mavlink.EKF_POS_HORIZ_ABS,
        )
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.talk.until(
            "a vehicle that is ready",
            "SYS_STATUS",
            lambda status: status.onboard_control_sensors_health & bit,
        )
        return self.here()

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.arm()
        self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
        self.talk.until(
            "takeoff", "GLOBAL_POSITION_INT", lambda at: at.relative_alt > (HEIGHT_M - 0.4) * 1000
        )
        return start

    def early(self) -> dict[str, Any]:
        """Started again, and arming before the vehicle is ready; a restart ends the streams."""
        restart = self.talk.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        self.ask_for_streams()
        takeoff = self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)
        arm = self.arm()
        return {"restart": restart, "arm": arm, "takeoff": takeoff, "texts": self.talk.texts}

    def parameters(self) -> dict[str, Any]:
        stored = self.talk.parameter("RTL_ALT").param_value
        return {
            "listed": self.talk.all_parameters(),
            "before": stored,
            "after": self.talk.set_parameter("RTL_ALT", 999999.0).param_value,
            "restored": self.talk.set_parameter("RTL_ALT", stored).param_value,
            "whole": self.talk.set_parameter("RTL_ALT_FINAL", 0.6).param_value,
            "unknown": self.talk.parameter("NO_SUCH_PARAM"),
        }

    def hop(self) -> dict[str, Any]:
        start = self.up()
        disarm = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        land = self.talk.command(mavlink.MAV_CMD_NAV_LAND)
        self.talk.disarmed()
        return {"disarm_in_air": disarm, "land": land, "from_start_m": distance_m(start, self.here())}


def main() -> None:
    url, *wanted = sys.argv[1:]
    run_chapters(Flight(Talk(url)), wanted)


if __name__ == "__main__":
    main()
