"""A companion of a PX4 that knows nothing of the bench: Zenoh, `struct`, and the keys and layouts of px4_msgs 1.17.

First the logic of px4_ros_com's offboard example (ten signs of life and setpoints, then mode and arming, hold at 5 m), then a
square and a landing. `stop` as an argument: silent at the first corner. What it saw is printed at the end.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Iterator
from typing import Any

from zenoh_companion import DOMAIN, ZenohCompanion

HASHES = {
    "VehicleStatus": "828bddbb7d4c2aa6ad93757955f6893be1ec5d8f11885ec7715bcdd76b5226c9",
    "VehicleLocalPosition": "690ad535169297241c696494adbd98bbdc45566645026fe7963513a29a1bf144",
    "VehicleLandDetected": "ced22fc1699e2a3746a1fa86aa4b5463b42f5b9c97e7913063365a04d8324901",
    "VehicleCommandAck": "36038d69f9db90980fb8fe154f27f22dffed0c35e530b32413cf0456aa8a29e2",
    "OffboardControlMode": "e87463f252f320d2f197d1feadd643b8645e5ef53a2b158dccfdf11372e00f9f",
    "TrajectorySetpoint": "9a7deb0cb7db5e52b441169a284b90188c4efdf06b302d55cb1db33ca0358c1a",
    "VehicleCommand": "1f0ab537807e2e20e04826633ea2c52e5431bea8eb0187152ff23bd07f1dd30b",
}
CORNERS = ((5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0))


class Companion(ZenohCompanion):
    hears: tuple[tuple[str, str], ...] = (
        ("vehicle_status", "VehicleStatus"),
        ("vehicle_local_position", "VehicleLocalPosition"),
        ("vehicle_land_detected", "VehicleLandDetected"),
        ("vehicle_command_ack", "VehicleCommandAck"),
    )

    def __init__(self) -> None:
        super().__init__()
        for topic, kind in self.hears:
            self.subscribe(f"/fmu/out/{topic}", self.key(f"/fmu/out/{topic}", kind))

    @staticmethod
    def key(topic: str, kind: str) -> str:
        return f"{DOMAIN}{topic}/px4_msgs::msg::dds_::{kind}_/RIHS01_{HASHES[kind]}"

    def publish(self, topic: str, kind: str, form: str, *values: Any) -> None:
        self.put(topic, self.key(topic, kind), struct.pack(form, *values))

    def acks(self) -> list[tuple[Any, ...]]:
        return [struct.unpack_from("<IB", sample, 12) for sample in self.came["/fmu/out/vehicle_command_ack"]]

    def hold(self, north: float, east: float) -> None:
        """As the example: everything that it leaves out is zero, and no NaN."""
        self.publish("/fmu/in/offboard_control_mode", "OffboardControlMode", "<Q7?", 0, True, *(False,) * 6)
        values = (north, east, -5.0, *(0.0,) * 9, -3.14, 0.0)
        self.publish("/fmu/in/trajectory_setpoint", "TrajectorySetpoint", "<Q14f", 0, *values)

    def command(self, number: int, *params: float) -> None:
        given = (*params, *(0.0,) * (7 - len(params)))
        values = (*given, number, 1, 1, 1, 1, 0, True)
        self.publish("/fmu/in/vehicle_command", "VehicleCommand", "<Q4f2dfI3BxHB?", 0, *values)

    def last(self, topic: str, form: str, offset: int) -> tuple[Any, ...]:
        """Some fields of the newest sample; `offset` does not count the header."""
        samples = self.came[f"/fmu/out/{topic}"]
        return struct.unpack_from(form, samples[-1], 4 + offset) if samples else ()

    def flight(self, stops: bool) -> Iterator[None]:
        """One thing after the other; yields at the end of each tick."""
        while not (self.last("vehicle_status", "<?", 79) or (False,))[0]:
            yield
        for _ in range(10):
            self.hold(0.0, 0.0)
            yield
        self.command(176, 1.0, 6.0)
        self.command(400, 1.0)
        for corner in ((0.0, 0.0), *CORNERS):
            for _ in range(60):
                self.hold(*corner)
                yield
                place = self.last("vehicle_local_position", "<3f", 20)
                if math.dist(place, (*corner, -5.0)) < 0.3:
                    break
            print("at", *(round(axis) for axis in place))
            if stops and corner == CORNERS[0]:
                for _ in range(15):
                    yield
                status = self.last("vehicle_status", "<2B", 40)
                print("asked and flown", *status, "failsafe", *self.last("vehicle_status", "<?", 56))
                while self.last("vehicle_status", "<B", 24) != (1,):
                    yield
                return
        self.command(21)
        while self.last("vehicle_status", "<B", 24) != (1,) or self.last(
            "vehicle_land_detected", "<?", 11
        ) != (True,):
            yield
        print("acks", *self.acks())


if __name__ == "__main__":
    companion = Companion()
    companion.fly(companion.flight("stop" in sys.argv))
