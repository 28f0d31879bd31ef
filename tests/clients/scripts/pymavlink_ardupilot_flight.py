"""pymavlink on ArduPilot: python pymavlink_ardupilot_flight.py tcp:127.0.0.1:5760 CHAPTER...

Flies all parameters, takeoff and landing. Is refused: arming and takeoff during the start, disarming in the air.
"""

from __future__ import annotations

from typing import Any

from pymavlink_talk import Pilot, Talk, fly, mavlink

HEIGHT_M = 8.0
GUIDED = 4


class Flight(Pilot):
    def __init__(self, talk: Talk) -> None:
        super().__init__(talk)
        self.ask_for_streams()

    def ask_for_streams(self) -> None:
        self.talk.link.mav.request_data_stream_send(*self.talk.target, mavlink.MAV_DATA_STREAM_ALL, 10, 1)

    def take_off(self) -> list[str]:
        return self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, HEIGHT_M)

    def up(self) -> tuple[float, float]:
        self.talk.command(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
        self.talk.mode(GUIDED)
        placed = mavlink.EKF_POS_HORIZ_ABS
        self.talk.until("the way to GUIDED", "EKF_STATUS_REPORT", lambda report: report.flags & placed)
        start = self.ready()
        self.arm()
        self.take_off()
        high_mm = (HEIGHT_M - 0.4) * 1000
        self.talk.until("takeoff", "GLOBAL_POSITION_INT", lambda at: at.relative_alt > high_mm)
        return start

    def early(self) -> dict[str, Any]:
        """Started again, and arming before the vehicle is ready; a restart ends the streams."""
        self.talk.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        self.ask_for_streams()
        return {"takeoff": self.take_off(), "arm": self.arm(), "texts": self.talk.texts}

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


if __name__ == "__main__":
    fly(Flight)
