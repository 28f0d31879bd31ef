"""A companion with a mode of its own at a PX4, of Zenoh, `struct`, and the keys and layouts of px4_msgs 1.17 alone.

It registers the mode, answers arming checks, arms, chooses the mode, flies to two places by trajectory setpoints, completes,
lands and leaves. Arguments: `v1` says the names of topics that have a version with it, as over uXRCE-DDS; `silent` answers no
checks any more at the first place. What it saw is printed.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Iterator
from typing import Any

from px4_companion import HASHES, Companion

HASHES |= {
    "RegisterExtComponentRequest": "dc16364abd320fd4faa00f7cb9fe239f324a7c0f9e2d71f9ed6083afe3b5de2b",
    "RegisterExtComponentReply": "cc8fe5e12b0cc58c2c976a5bcdfac5af3fa39f1b0b74c8073285dcbe6e62ed90",
    "UnregisterExtComponent": "93b673ec972cd7ee9dfb325f4dd7dbf7b3eb990af94b3a6467fc9278827ba099",
    "ArmingCheckRequest": "e4d6be7c8f4d5e08cd19e344ba59a76295dbcf71a6a29ed9efd44d6ea588a5eb",
    "ArmingCheckReply": "bbab73fbc7dedd6d2e4c40d2c14ee23f8e563fdf5e82d26d843842bfa358b07c",
    "VehicleControlMode": "edb7e835846bc77720fa87a0fb0a150051d02f0a5fad41168031a73a49ba527c",
    "ModeCompleted": "9b2bbfcc9a544dd64c8e534a342c6b4567c8486c376e724453d0f4b86f3ee21d",
}
VERSION = "_v1" if "v1" in sys.argv else ""
STATUS, PLACE, LANDED = (
    f"vehicle_status{VERSION}",
    f"vehicle_local_position{VERSION}",
    "vehicle_land_detected",
)
REQUEST, REPLY = f"arming_check_request{VERSION}", f"/fmu/in/arming_check_reply{VERSION}"
NAME = b"Two places".ljust(25, b"\0")
GOALS = ((0.0, 0.0, -5.0), (6.0, 3.0, -7.0))
API_VERSION, SET_NAV_STATE, ARM, LAND = 1, 100001, 400, 21
NAN = math.nan


class External(Companion):
    hears = (
        (STATUS, "VehicleStatus"),
        (PLACE, "VehicleLocalPosition"),
        (LANDED, "VehicleLandDetected"),
        ("vehicle_command_ack", "VehicleCommandAck"),
        ("register_ext_component_reply", "RegisterExtComponentReply"),
        (REQUEST, "ArmingCheckRequest"),
        ("mode_completed", "ModeCompleted"),
    )
    answered, silent = 0, False

    def register(self) -> None:
        values = (0, 4711, NAME, API_VERSION, True, True, False, False, 0, False)
        self.publish(
            "/fmu/in/register_ext_component_request", "RegisterExtComponentRequest", "<QQ25sxH4?B?", *values
        )

    def answer(self) -> None:
        """The newest request, if there is one that was not answered."""
        requests = self.came[f"/fmu/out/{REQUEST}"]
        if self.silent or len(requests) == self.answered:
            return
        self.answered = len(requests)
        (number,) = self.last(REQUEST, "<B", 8)
        needs = (True, True, True, True, *(False,) * 7)
        values = (0, number, self.check, 0, False, False, False, True, 0, bytes(200), *needs)
        self.publish(REPLY, "ArmingCheckReply", "<Q3B4?B200s11?", *values)

    def goto(self, goal: tuple[float, float, float]) -> None:
        values = (*goal, *(NAN,) * 9, 0.0, NAN)
        self.publish("/fmu/in/trajectory_setpoint", "TrajectorySetpoint", "<Q14f", 0, *values)

    def nav_states(self) -> tuple[Any, ...]:
        """Asked for, and flown."""
        return self.last(STATUS, "<2B", 40)

    def flight(self, stops: bool) -> Iterator[None]:
        """One thing after the other; yields at the end of each tick."""
        self.register()
        while not self.came["/fmu/out/register_ext_component_reply"]:
            yield
        reply = self.last("register_ext_component_reply", "<H?3b", 42)
        print("version, success, check, mode, executor", *reply)
        _, _, self.check, mode, _ = reply
        flags = (*(False,) * 5, *(True,) * 8, False)
        self.publish("/fmu/in/config_control_setpoints", "VehicleControlMode", "<Q14?B", 0, *flags, mode)
        self.command(SET_NAV_STATE, float(mode))
        while not (self.last(STATUS, "<?", 79) or (False,))[0]:
            self.answer()
            yield
        self.command(ARM, 1.0)
        for goal in GOALS:
            while math.dist(self.last(PLACE, "<3f", 20), goal) > 0.3:
                self.answer()
                self.goto(goal)
                yield
            print("at", *goal, "asked and flown", *self.nav_states())
            if stops:
                self.silent = True
                while self.last(STATUS, "<B", 24) != (1,):
                    yield
                    if self.last(STATUS, "<?", 56) == (True,):
                        stops and print("failsafe, asked and flown", *self.nav_states())
                        stops = False
                return
        self.publish("/fmu/in/mode_completed", "ModeCompleted", "<QBB", 0, 0, mode)
        while not self.came["/fmu/out/mode_completed"]:
            self.answer()
            yield
        self.command(LAND)
        while self.last(STATUS, "<B", 24) != (1,) or self.last(LANDED, "<?", 11) != (True,):
            self.answer()
            yield
        completed = [struct.unpack_from("<2B", sample, 12) for sample in self.came["/fmu/out/mode_completed"]]
        print("completed", *completed)
        print("acks", *self.acks())
        own = (NAME, self.check, mode, -1)
        self.publish("/fmu/in/unregister_ext_component", "UnregisterExtComponent", "<Q25s3b", 0, *own)
        for _ in range(2):
            yield
        print("can be asked for", self.last(STATUS, "<I", 48)[0] >> mode & 1)


if __name__ == "__main__":
    external = External()
    external.fly(external.flight("silent" in sys.argv))
