"""pymavlink on PX4: python pymavlink_px4_flight.py udpin:127.0.0.1:14540 CHAPTER...

Flies all parameters, takeoff and landing. Is refused: arming during the start, PARAM_ERROR, disarming in the air.
"""

from __future__ import annotations

import math
import struct
import sys
from typing import Any

from logbook import distance_m, run_chapters
from pymavlink_talk import Talk, mavlink

NAN = math.nan
HEIGHT_M = 8.0


class Flight:
    def __init__(self, talk: Talk) -> None:
        self.talk = talk

    def here(self) -> tuple[float, float]:
        at = self.talk.until("a position", "GLOBAL_POSITION_INT")
        return at.lat / 1e7, at.lon / 1e7

    def ready(self) -> tuple[float, float]:
        """Where it stands, once SYS_STATUS says that it may be armed."""
        bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.talk.until(
            "a vehicle that is ready",
            "SYS_STATUS",
            lambda status: status.onboard_control_sensors_health & bit,
        )
        return self.here()

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.talk.set_parameter("MIS_TAKEOFF_ALT", HEIGHT_M)
        self.talk.set_parameter("RTL_RETURN_ALT", HEIGHT_M)
        self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        self.talk.until(
            "takeoff",
            "EXTENDED_SYS_STATE",
            lambda state: state.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR,
        )
        return start

    def early(self) -> dict[str, Any]:
        results = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        return {"arm": results, "texts": self.talk.texts}

    def parameters(self) -> dict[str, Any]:
        integer = struct.unpack("<i", struct.pack("<f", self.talk.parameter("GF_ACTION").param_value))[0]
        unknown = self.talk.parameter("NO_SUCH_PARAM")
        wrong = self.talk.set_parameter("GF_ACTION", 1.0)
        return {
            "listed": self.talk.all_parameters(),
            "float": self.talk.parameter("MPC_XY_VEL_MAX").param_value,
            "integer": integer,
            "unknown": [unknown.get_type(), unknown.error],
            "wrong_type": [wrong.get_type(), wrong.error],
        }

    def hop(self) -> dict[str, Any]:
        start = self.up()
        height_m = self.talk.until("a height", "GLOBAL_POSITION_INT").relative_alt / 1000
        disarm = self.talk.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
        land = self.talk.command(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN, NAN, NAN, NAN)
        self.talk.disarmed()
        return {
            "height_m": height_m,
            "disarm_in_air": disarm,
            "land": land,
            "from_start_m": distance_m(start, self.here()),
        }


def main() -> None:
    url, *wanted = sys.argv[1:]
    run_chapters(Flight(Talk(url)), wanted)


if __name__ == "__main__":
    main()
