"""ArduCopter: JSON physics over UDP, a step for each answer; MAVLink clients over TCP."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ._ardupilot_checks import AnswerChecks
from ._battery import ArduPilotBattery
from ._clients import Clients
from ._faults import PATIENCE_S, Faults
from ._frames import require
from ._pilot import Pilot, State

# ArduPilot opens its further ports while its world moves.
OTHER_PORTS_AT = 100


class CrudeArduPilot:
    def __init__(self, instance: int, parameters: dict[str, float], state: State) -> None:
        self.instance, self.state = instance, state
        self.pilot = Pilot(0.174, 0.016)
        battery = ArduPilotBattery(parameters, state)
        self.clients = Clients(self.pilot, state, is_px4=False, takeoff_m=10.0, battery=battery)
        self.clients.forgetful = parameters.get("STAND_IN_FORGETS", 0) == 1
        self.clients.aborts_on_nan = parameters.get("SIM_FLOAT_EXCEPT", 1.0) != 0.0
        first = socket.create_server(("127.0.0.1", 5760 + 10 * instance))
        self.servers: list[socket.socket] = []
        self.sockets = [first.accept()[0]]
        self.sockets[0].setblocking(False)

    def open_other_ports(self) -> None:
        self.servers = [
            socket.create_server(("127.0.0.1", port + 10 * self.instance)) for port in (5762, 5763)
        ]
        for server in self.servers:
            server.setblocking(False)

    def serve(self) -> None:
        for server in self.servers:
            with contextlib.suppress(BlockingIOError):
                client = server.accept()[0]
                client.setblocking(False)
                self.sockets.append(client)
        beat, motion = self.clients.due()
        for client in self.sockets:
            answers = b""
            with contextlib.suppress(BlockingIOError):
                answers = self.clients.take(client, client.recv(65536))
            out = beat + (motion if client in self.clients.stream_clients else b"") + answers
            if out:
                client.sendall(out)

    def rotors(self) -> list[float]:
        return self.pilot.rotors(self.state)


def fly_ardupilot(open_side: Callable[[int, dict[str, float], State], Any] = CrudeArduPilot) -> None:
    """`open_side` makes what flies and talks to MAVLink clients, and waits for a client on its first port."""
    options = dict(zip(sys.argv[1:-1:2], sys.argv[2:-1:2], strict=True))
    require(sys.argv[-1].startswith("-I"), f"arguments {sys.argv[1:]}")
    instance = int(sys.argv[-1][2:])
    require(options["--model"] == "JSON" and float(options["--speedup"]) >= 1, f"arguments {sys.argv[1:]}")
    latitude, longitude, altitude, heading = map(float, options["--home"].split(","))
    lines = "\n".join(Path(name).read_text() for name in options["--defaults"].split(",")).split()
    parameters = dict(zip(lines[::2], map(float, lines[1::2]), strict=True))
    require(parameters["FRAME_CLASS"] == 1 and parameters["FRAME_TYPE"] == 1, "quad X is class 1, type 1")
    require(
        parameters["MOT_THST_EXPO"] == 1 and 0.125 <= parameters["MOT_THST_HOVER"] <= 0.6875, "MOT_THST_*"
    )
    # Of upstream's copter.parm, which a SITL has: not the firmware's own defaults.
    require(
        parameters.get("FENCE_RADIUS") == 150 and parameters.get("FLTMODE1") == 7, "parameters of the SITL"
    )
    rate_hz = int(parameters["SIM_RATE_HZ"])
    require(rate_hz >= 720, f"SIM_RATE_HZ {rate_hz}: the gyro is too slow for a main loop of 400 Hz")
    faults = Faults(int(parameters.get("STAND_IN_FAULT", 0)))
    Path("eeprom.bin").write_bytes(bytes(16))
    state = State()
    side = open_side(instance, parameters, state)
    if parameters["LOG_BACKEND_TYPE"]:
        Path("logs").mkdir()
        Path("logs", "00000001.BIN").write_bytes(b"DataFlash of the stand-in")
    physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    physics.connect(("127.0.0.1", 9002 + 10 * instance))
    physics.settimeout(PATIENCE_S)
    count, pulses = 0, [1000] * 16
    checks = AnswerChecks(state, rate_hz, (latitude, longitude, altitude), math.radians(heading))
    while True:
        packet = struct.pack("<HHI16H", 18458, rate_hz, count, *pulses)
        physics.send(packet)
        if count % 997 == 5:
            # As when an answer takes more than a second. A second answer would be taken as that of the next frame, as by
            # the real one, and would be no step.
            physics.send(packet)
        checks.take(physics.recv(4096))
        count += 1
        if count == OTHER_PORTS_AT:
            side.open_other_ports()
        side.serve()
        rotors = side.rotors()
        faults.act(state, physics)
        pulses = [round(1000 + 1000 * share) for share in rotors] + [1500] * 12
