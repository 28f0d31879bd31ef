"""pymavlink on PX4: python pymavlink_px4_flight.py udpin:127.0.0.1:14540 CHAPTER...

Flies all parameters, takeoff and landing. Is refused: arming during the start, PARAM_ERROR, disarming in the air.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from pymavlink_talk import Pilot, fly, mavlink

NAN = math.nan
HEIGHT_M = 8.0


class Flight(Pilot):
    land = (0, 0, 0, NAN, NAN, NAN, NAN)

    def up(self) -> tuple[float, float]:
        start = self.ready()
        self.talk.set_parameter("MIS_TAKEOFF_ALT", HEIGHT_M)
        self.talk.set_parameter("RTL_RETURN_ALT", HEIGHT_M)
        self.arm()
        self.talk.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, NAN)
        in_air = mavlink.MAV_LANDED_STATE_IN_AIR
        self.talk.until("takeoff", "EXTENDED_SYS_STATE", lambda state: state.landed_state == in_air)
        return start

    def early(self) -> dict[str, Any]:
        return {"arm": self.arm(), "texts": self.talk.texts}

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


if __name__ == "__main__":
    fly(Flight)
