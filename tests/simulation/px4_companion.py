"""A companion of a PX4 that knows nothing of the bench: Zenoh, `struct`, and the keys and layouts of px4_msgs 1.17.

First the logic of px4_ros_com's offboard example (ten signs of life and setpoints, then mode and arming, hold at 5 m), then a
square and a landing. `stop` as an argument: silent at the first corner. What it saw is printed at the end.
"""

from __future__ import annotations

import json
import math
import os
import socket
import struct
import sys
import threading
from typing import Any

import zenoh

HASHES = {
    "VehicleStatus": "828bddbb7d4c2aa6ad93757955f6893be1ec5d8f11885ec7715bcdd76b5226c9",
    "VehicleLocalPosition": "690ad535169297241c696494adbd98bbdc45566645026fe7963513a29a1bf144",
    "VehicleLandDetected": "ced22fc1699e2a3746a1fa86aa4b5463b42f5b9c97e7913063365a04d8324901",
    "VehicleCommandAck": "36038d69f9db90980fb8fe154f27f22dffed0c35e530b32413cf0456aa8a29e2",
    "OffboardControlMode": "e87463f252f320d2f197d1feadd643b8645e5ef53a2b158dccfdf11372e00f9f",
    "TrajectorySetpoint": "9a7deb0cb7db5e52b441169a284b90188c4efdf06b302d55cb1db33ca0358c1a",
    "VehicleCommand": "1f0ab537807e2e20e04826633ea2c52e5431bea8eb0187152ff23bd07f1dd30b",
}
DOMAIN = os.environ["ROS_DOMAIN_ID"]
CORNERS = ((5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0))
HEADER = bytes((0, 1, 0, 0))


def key(topic: str, kind: str) -> str:
    return f"{DOMAIN}{topic}/px4_msgs::msg::dds_::{kind}_/RIHS01_{HASHES[kind]}"


class Companion:
    def __init__(self) -> None:
        config = zenoh.Config()
        for name, value in (
            ("mode", "client"),
            ("connect/endpoints", [os.environ["REBAR_ZENOH"]]),
            ("transport/auth/usrpwd/user", os.environ["REBAR_ZENOH_USER"]),
            ("transport/auth/usrpwd/password", os.environ["REBAR_ZENOH_PASSWORD"]),
            ("transport/shared_memory/enabled", False),
        ):
            config.insert_json5(name, json.dumps(value))
        self.session = zenoh.open(config)
        self.arrival = threading.Condition()
        self.came: dict[str, list[bytes]] = {}
        self.sent: dict[str, int] = {}
        self.publishers: dict[str, Any] = {}
        self.subscribers = [
            self.subscribe(f"/fmu/out/{topic}", kind)
            for topic, kind in (
                ("vehicle_status", "VehicleStatus"),
                ("vehicle_local_position", "VehicleLocalPosition"),
                ("vehicle_land_detected", "VehicleLandDetected"),
                ("vehicle_command_ack", "VehicleCommandAck"),
            )
        ]

    def subscribe(self, topic: str, kind: str) -> Any:
        self.came[topic] = []

        def hear(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            assert attachment is not None
            number, _, size, _ = struct.unpack("<qqB16s", attachment.to_bytes())
            with self.arrival:
                self.came[topic].append(sample.payload.to_bytes())
                assert (number, size) == (len(self.came[topic]), 16)
                self.arrival.notify_all()

        return self.session.declare_subscriber(key(topic, kind), hear)

    def wait(self, counts: dict[str, int]) -> None:
        """Until everything that a tick states has come."""

        def complete() -> bool:
            return all(len(self.came[topic]) >= count for topic, count in counts.items())

        with self.arrival:
            assert self.arrival.wait_for(complete, 60.0)

    def publish(self, topic: str, kind: str, form: str, *values: Any) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.session.declare_publisher(key(topic, kind))
        self.sent[topic] = self.sent.get(topic, 0) + 1
        attachment = struct.pack("<qqB16s", self.sent[topic], 0, 16, bytes(range(16)))
        self.publishers[topic].put(HEADER + struct.pack(form, *values), attachment=attachment)

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

    def fly(self, stops: bool) -> Any:
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
        acks = [struct.unpack_from("<IB", sample, 12) for sample in self.came["/fmu/out/vehicle_command_ack"]]
        print("acks", *acks)


def main() -> None:
    companion = Companion()
    host, port = os.environ["REBAR_TICK"].split(":")
    line = socket.create_connection((host, int(port))).makefile("rw", encoding="utf-8")
    hello = {"kind": "hello", "protocol": 1, "agent": "companion", "secret": os.environ["REBAR_TICK_SECRET"]}
    print(json.dumps({**hello, "subscribes": list(companion.came)}), file=line, flush=True)
    flight = companion.fly("stop" in sys.argv)
    for text in line:
        message = json.loads(text)
        if message["kind"] == "end":
            break
        companion.wait(message["topics"])
        try:
            next(flight)
        except StopIteration:
            break
        ack = {"kind": "ack", "number": message["number"], "topics": companion.sent, "links": {}}
        print(json.dumps(ack), file=line, flush=True)
    companion.session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    main()
