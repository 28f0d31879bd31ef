"""A client of the bench in one file, with nothing but Python: copy it beside your agent (manifest: `air: tick`).

The air network comes and goes as JSON in the lines of the tick socket; MAVLink goes over UDP and is read and written here as
far as an agent needs it that flies by the autopilot's own modes. docs/agents-protocol.md describes both.
"""

import json
import math
import os
import select
import socket
import struct
import sys
from collections.abc import Callable, Iterator
from typing import Any

Json = dict[str, Any]
Vector = tuple[float, float, float]

OWN_SYSTEM, OWN_COMPONENT, ARDUPILOT = 246, 1, 3
NOTHING = math.nan
# Extra byte of the checksum by message, from MAVLink's definition of each.
CRC_EXTRA = {0: 50, 75: 158, 76: 152}
EARTH_M = 6378137.0


def crc(data: bytes) -> int:
    """MAVLink's checksum: CRC-16/MCRF4XX."""
    value = 0xFFFF
    for octet in data:
        low = octet ^ value & 0xFF
        low ^= (low << 4) & 0xFF
        value = ((value >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)) & 0xFFFF
    return value


class Vehicle:
    """The autopilot behind REBAR_MAVLINK: `ready`, `armed`, `east_m`, `north_m`, `height_m`."""

    def __init__(self, address: str) -> None:
        _, host, port = address.split(":")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, int(port)))
        self._peer: Any = None
        self._received = self.sent = 0
        self.ready = self.armed = False
        self._autopilot = 0
        self.latitude_deg = self.longitude_deg = self.height_m = self.amsl_m = 0.0

    def receive(self, count: int) -> None:
        """Read what has come. Lockstep states in each tick how many frames were sent since the start: wait for all of them."""
        while select.select([self._socket], [], [], 10.0 if self._received < count else 0.0)[0]:
            data, self._peer = self._socket.recvfrom(65536)
            while data:
                size = (
                    12 + data[1] + 13 * (data[2] & 1)
                )  # header, payload, checksum, and a signature where there is one
                payload = data[10 : 10 + data[1]]
                self._read(int.from_bytes(data[7:10], "little"), payload + bytes(64 - len(payload) % 64))
                self._received += 1
                data = data[size:]
        if self._received < count:
            sys.exit(f"of {count} MAVLink frames {self._received} have come")

    def _read(self, message: int, payload: bytes) -> None:
        # MAVLink leaves out zeros at the end of a payload; `receive` puts them back.
        if message == 0 and payload[5] != 8:  # HEARTBEAT, not of a ground station
            self._autopilot, self.armed = payload[5], bool(payload[6] & 128)
        elif message == 1:  # SYS_STATUS: MAV_SYS_STATUS_PREARM_CHECK among what is healthy
            self.ready = bool(struct.unpack_from("<I", payload, 8)[0] & 0x10000000)
        elif message == 33:  # GLOBAL_POSITION_INT
            _, latitude, longitude, amsl, height = struct.unpack_from("<Iiiii", payload)
            self.latitude_deg, self.longitude_deg = latitude * 1e-7, longitude * 1e-7
            self.amsl_m, self.height_m = amsl * 1e-3, height * 1e-3

    def _send(self, message: int, payload: bytes) -> None:
        if self._peer is None:  # nothing has come from it yet, so nobody knows where it listens
            return
        payload = payload.rstrip(b"\0") or b"\0"
        head = bytes((len(payload), 0, 0, self.sent % 256, OWN_SYSTEM, OWN_COMPONENT)) + message.to_bytes(
            3, "little"
        )
        checksum = crc(head + payload + bytes((CRC_EXTRA[message],)))
        self._socket.sendto(b"\xfd" + head + payload + checksum.to_bytes(2, "little"), self._peer)
        self.sent += 1

    def heartbeat(self) -> None:
        """Once a second."""
        self._send(0, struct.pack("<IBBBBB", 0, 18, 8, 0, 4, 3))
        if self._autopilot == ARDUPILOT and not self.amsl_m:  # it streams nothing of itself
            self.command(511, 1.0, 1e6)
            self.command(511, 33.0, 1e5)

    def command(self, number: int, *parameters: float) -> None:
        """COMMAND_LONG, the parameters filled up with zeros."""
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._send(76, struct.pack("<7fHBBB", *filled, number, 1, 1, 0))

    def arm(self) -> None:
        if self._autopilot == ARDUPILOT:
            self.command(176, 1.0, 4.0)  # GUIDED
        self.command(400, 1.0)

    def take_off(self, height_m: float) -> None:
        nan = NOTHING
        if self._autopilot == ARDUPILOT:
            self.command(22, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)
        else:
            self.command(22, nan, 0.0, 0.0, nan, nan, nan, self.amsl_m - self.height_m + height_m)

    def go_to(self, origin: Json, east_m: float, north_m: float, height_m: float, speed_mps: float) -> None:
        """DO_REPOSITION: the autopilot flies there by itself and stays."""
        latitude_deg, longitude_deg = degrees_of(origin, east_m, north_m)
        place = round(latitude_deg * 1e7), round(longitude_deg * 1e7), self.amsl_m - self.height_m + height_m
        self._send(75, struct.pack("<4fiifHBBBBB", speed_mps, 1.0, 0.0, NOTHING, *place, 192, 1, 1, 0, 0, 0))

    def land(self) -> None:
        self.command(21, 0.0, 0.0, 0.0, NOTHING)

    def place(self, origin: Json) -> tuple[float, float]:
        """East and north of the mission's origin, metres."""
        east_m, north_m = metres_of_degree(origin)
        return (
            (self.longitude_deg - origin["longitude_deg"]) * east_m,
            (self.latitude_deg - origin["latitude_deg"]) * north_m,
        )


def metres_of_degree(origin: Json) -> tuple[float, float]:
    """Of longitude and of latitude, on a sphere: a centimetre in a hundred metres is enough for a search."""
    metre = math.radians(EARTH_M + origin["altitude_m"])
    return metre * math.cos(math.radians(origin["latitude_deg"])), metre


def degrees_of(origin: Json, east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of a place in the map."""
    of_longitude_m, of_latitude_m = metres_of_degree(origin)
    return origin["latitude_deg"] + north_m / of_latitude_m, origin["longitude_deg"] + east_m / of_longitude_m


def turned(q: dict[str, float], v: Vector) -> Vector:
    """A vector turned by a quaternion as ROS writes it."""
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    a, b, c = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return v[0] + w * a + y * c - z * b, v[1] + w * b + z * a - x * c, v[2] + w * c + x * b - y * a


class Eye:
    """Detections thrown onto flat ground, by the latest pose and the camera's mount."""

    def __init__(self) -> None:
        self._poses: Json = {}
        self._mount: Json = {}
        self._k: list[float] = []

    def see(self, topic: str, message: Json) -> list[tuple[str, float, float, float]]:
        """Take in a message; the objects in it, if it holds detections: (class, score, east_m, north_m)."""
        if topic == "/tf_static":
            self._mount = message["transforms"][0]
        elif topic == "/tf":
            self._poses |= {item["child_frame_id"]: item["transform"] for item in message["transforms"]}
        elif topic.endswith("/camera_info"):
            self._k = message["k"]
        elif topic.endswith("/detections") and self._k and self._mount:
            body = self._poses.get(self._mount["header"]["frame_id"])
            found = (self._ground(body, detection) for detection in message["detections"] if body)
            return [thing for thing in found if thing]
        return []

    def _ground(self, body: Json, detection: Json) -> tuple[str, float, float, float] | None:
        box, best = detection["bbox"], detection["results"][0]["hypothesis"]
        # The middle of the lower edge stands on the ground.
        x = (box["center"]["position"]["x"] - self._k[2]) / self._k[0]
        y = (box["center"]["position"]["y"] + box["size_y"] / 2 - self._k[5]) / self._k[4]
        ray = turned(body["rotation"], turned(self._mount["transform"]["rotation"], (x, y, 1.0)))
        if ray[2] > -0.05:
            return None
        at, far = body["translation"], body["translation"]["z"] / -ray[2]
        return best["class_id"], best["score"], at["x"] + far * ray[0], at["y"] + far * ray[1]


class Bench:
    """The session: `for messages in bench.ticks(...)` gives the messages of each tick; `publish` answers with the ack."""

    def __init__(self, name: str, open_vehicle: Callable[[str], Vehicle] = Vehicle) -> None:
        self._name, self.vehicle_name = name, os.environ["REBAR_VEHICLE"]
        self.options = json.loads(os.environ.get("REBAR_OPTIONS") or "{}")
        self.vehicle = open_vehicle(os.environ["REBAR_MAVLINK"])
        self.now_s = 0.0
        self._outbox: list[Json] = []

    def publish(self, topic: str, message: Json) -> None:
        """Under /VEHICLE/agent/: reports, decisions, status, tracks, answers, consent_requests."""
        self._outbox.append({"topic": f"/{self.vehicle_name}/agent/{topic}", "message": message})

    def ticks(self, *topics: str) -> Iterator[list[tuple[str, Json]]]:
        """Messages of these topics (`mission` is /VEHICLE/mission, `/tf` itself), tick by tick to the end of the session."""
        wanted = [topic if topic[0] == "/" else f"/{self.vehicle_name}/{topic}" for topic in topics]
        host, port = os.environ["REBAR_TICK"].split(":")
        with socket.create_connection((host, int(port))) as connection, connection.makefile("rw") as lines:
            hello = {"kind": "hello", "protocol": 1, "agent": self._name, "subscribes": wanted}
            print(json.dumps({**hello, "secret": os.environ["REBAR_TICK_SECRET"]}), file=lines, flush=True)
            for line in lines:
                tick = json.loads(line)
                if tick["kind"] == "end":
                    print(tick["reason"])
                    return
                self.now_s = tick["time_ns"] * 1e-9
                self.vehicle.receive(tick["links"].get("onboard", 0))
                yield [(message["topic"], message["message"]) for message in tick.get("air", ())]
                ack = {"kind": "ack", "number": tick["number"], "links": {"onboard": self.vehicle.sent}}
                print(json.dumps({**ack, "air": self._outbox}), file=lines, flush=True)
                self._outbox = []
