"""A companion of an ArduPilot that knows nothing of the bench: Zenoh, `struct`, and the keys and layouts of ardupilot_msgs.

It checks, changes to GUIDED, arms and takes off by services, flies by velocities of the earth and of the body, then to a
place by latitude and longitude, and lands. `early` as an argument: it arms where that is refused. What it saw is printed.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Iterator
from typing import Any

import zenoh
from zenoh_companion import DOMAIN, HEADER, ZenohCompanion

TYPES = {
    "/ap/pose/filtered": "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_"
    "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    "/ap/geopose/filtered": "geographic_msgs::msg::dds_::GeoPoseStamped_/RIHS01_"
    "a8e603c050fa992a74283bb462a96fe9d2b151b7a67b14d77250ed7cb4ed96b7",
    "/ap/status": "ardupilot_msgs::msg::dds_::Status_/RIHS01_"
    "879c4bf30bf94df9a60a99b95370ccbf52a88c79d6ce6c060841a0555d11a9e2",
    "/ap/cmd_vel": "geometry_msgs::msg::dds_::TwistStamped_/RIHS01_"
    "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    "/ap/cmd_gps_pose": "ardupilot_msgs::msg::dds_::GlobalPosition_/RIHS01_"
    "a28c875099484962d72e5b820ec758884c7a70c8dae5100444519c16da36fa04",
    "/ap/prearm_check": "std_srvs::srv::dds_::Trigger_/RIHS01_"
    "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    "/ap/mode_switch": "ardupilot_msgs::srv::dds_::ModeSwitch_/RIHS01_"
    "f296ab1010333ebd0a53944e7cb84e190c78dc8e94ec7a38b0bdbcbda2ef5b01",
    "/ap/arm_motors": "ardupilot_msgs::srv::dds_::ArmMotors_/RIHS01_"
    "99849cee95ea14f0703d481434c62aac42eef5fbd91e1df4e480a99c227793b4",
    "/ap/experimental/takeoff": "ardupilot_msgs::srv::dds_::Takeoff_/RIHS01_"
    "ec19b963d42a007afeb98f5e532edbbfa127600a0f8a4e05778249f4e3ccba30",
}
OUT = ("/ap/pose/filtered", "/ap/geopose/filtered", "/ap/status")
SERVICES = ("/ap/prearm_check", "/ap/mode_switch", "/ap/arm_motors", "/ap/experimental/takeoff")
GUIDED, LAND = 4, 9
# The stamp, and a frame of four or nine letters; every message here begins so.
EARTH, BODY = struct.pack("<iII4s", 0, 0, 4, b"map"), struct.pack("<iII12s", 0, 0, 10, b"base_link")


class Companion(ZenohCompanion):
    services = SERVICES

    def __init__(self) -> None:
        super().__init__()
        for topic in OUT:
            self.subscribe(topic, self.key(topic))

    @staticmethod
    def key(topic: str) -> str:
        return f"{DOMAIN}{topic}/{TYPES[topic]}"

    def publish(self, topic: str, data: bytes) -> None:
        self.put(topic, self.key(topic), data)

    def call(self, service: str, form: str, *values: Any) -> Any:
        """Ask, and wait tick by tick for the answer, which is returned without its header."""
        hear = self.hearer(service)
        self.session.get(
            self.key(service),
            lambda reply: hear(reply.ok),
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            payload=HEADER + struct.pack(form, *values),
            attachment=self.attachment(service),
        )
        while len(self.came[service]) < self.sent[service]:
            yield
        answer = self.came[service][-1][4:]
        print(service, answer)

    def status(self) -> tuple[bool, int, bool]:
        """Armed, mode, flying; the frame is base_link."""
        samples = self.came["/ap/status"]
        return struct.unpack_from("<?B?", samples[-1], 4 + 23) if samples else (False, 0, False)

    def place(self) -> tuple[float, float, float]:
        """East, north and up of home."""
        return struct.unpack_from("<3d", self.came["/ap/pose/filtered"][-1], 4 + 24)

    def move(self, frame: bytes, *velocity: float, turn: float = 0.0) -> None:
        padding = bytes(-len(frame) % 8)
        self.publish("/ap/cmd_vel", frame + padding + struct.pack("<6d", *velocity, 0.0, 0.0, turn))

    def go(self, latitude: float, longitude: float, height_m: float) -> None:
        values = (6, 0x0DF8, latitude, longitude, height_m, *(0.0,) * 12, 0.0)
        self.publish("/ap/cmd_gps_pose", EARTH + struct.pack("<BxH4x2df4x12df", *values))

    def flight(self, early: bool) -> Iterator[None]:
        """One thing after the other; yields at the end of each tick."""
        if early:
            # Refused: neither armed nor in GUIDED.
            yield from self.call("/ap/experimental/takeoff", "<f", 4.0)
        yield from self.call("/ap/prearm_check", "<B", 0)
        yield from self.call("/ap/mode_switch", "<B", GUIDED)
        yield from self.call("/ap/arm_motors", "<?", True)
        yield from self.call("/ap/experimental/takeoff", "<f", 5.0)
        while self.place()[2] < 4.9:
            yield
        latitude, longitude = struct.unpack_from("<2d", self.came["/ap/geopose/filtered"][0], 4 + 24)
        for frame, velocity, turn in ((EARTH, (2.0, -1.0, 0.5), 0.0), (BODY, (1.0, 0.0, 0.0), 0.5)):
            for _ in range(40):
                self.move(frame, *velocity, turn=turn)
                yield
            print("at", *(round(axis) for axis in self.place()))
        self.go(latitude, longitude, 8.0)
        for _ in range(150):
            self.go(latitude, longitude, 8.0)
            yield
            if math.dist(self.place(), (0.0, 0.0, 8.0)) < 0.2:
                break
        print("at", *(round(axis) for axis in self.place()))
        yield from self.call("/ap/mode_switch", "<B", LAND)
        while self.status()[0]:
            yield
        print("armed, mode, flying", *self.status())


if __name__ == "__main__":
    companion = Companion()
    companion.fly(companion.flight("early" in sys.argv))
