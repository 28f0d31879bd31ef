"""ArduCopter: JSON physics over UDP, a step for each answer; MAVLink clients over TCP."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import sys
from pathlib import Path

from ._ardupilot_checks import AnswerChecks
from ._clients import Clients
from ._faults import PATIENCE_S, Faults
from ._frames import require
from ._pilot import Pilot, State

# ArduPilot opens its further ports while its world moves.
OTHER_PORTS_AT = 100


def fly_ardupilot() -> None:
    options = dict(zip(sys.argv[1:-1:2], sys.argv[2:-1:2], strict=True))
    require(sys.argv[-1].startswith("-I"), f"arguments {sys.argv[1:]}")
    instance = int(sys.argv[-1][2:])
    require(options["--model"] == "JSON" and float(options["--speedup"]) >= 1, f"arguments {sys.argv[1:]}")
    latitude, longitude, altitude, heading = map(float, options["--home"].split(","))
    lines = [
        line.split()
        for name in options["--defaults"].split(",")
        for line in Path(name).read_text().splitlines()
    ]
    parameters = {name: float(value) for name, value in lines}
    require(parameters["FRAME_CLASS"] == 1 and parameters["FRAME_TYPE"] == 1, "quad X is class 1, type 1")
    require(
        parameters["MOT_THST_EXPO"] == 1 and 0.125 <= parameters["MOT_THST_HOVER"] <= 0.6875, "MOT_THST_*"
    )
    rate_hz = int(parameters["SIM_RATE_HZ"])
    require(rate_hz >= 720, f"SIM_RATE_HZ {rate_hz}: the gyro is too slow for a main loop of 400 Hz")
    faults = Faults(int(parameters.get("STAND_IN_FAULT", 0)))
    Path("eeprom.bin").write_bytes(bytes(16))
    first = socket.create_server(("127.0.0.1", 5760 + 10 * instance))
    servers: list[socket.socket] = []
    # The world begins with a client on the first port.
    sockets = [first.accept()[0]]
    sockets[0].setblocking(False)
    if parameters["LOG_BACKEND_TYPE"]:
        Path("logs").mkdir()
        Path("logs", "00000001.BIN").write_bytes(b"DataFlash of the stand-in")
    physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    physics.connect(("127.0.0.1", 9002 + 10 * instance))
    physics.settimeout(PATIENCE_S)
    state = State()
    pilot = Pilot(0.174, 0.016)
    clients = Clients(pilot, state, is_px4=False, takeoff_m=10.0)
    clients.forgetful = parameters.get("STAND_IN_FORGETS", 0) == 1
    count, answer, pulses = 0, b"", [1000] * 16
    checks = AnswerChecks(state, rate_hz, (latitude, longitude, altitude), math.radians(heading))
    while True:
        packet = struct.pack("<HHI16H", 18458, rate_hz, count, *pulses)
        physics.send(packet)
        if count % 997 == 5:
            # As after a lost answer: the same frame again, which must be answered alike and without a step.
            physics.send(packet)
        answer = physics.recv(4096)
        if count % 997 == 5:
            require(physics.recv(4096) == answer, "a frame that came again got another answer")
        checks.take(answer)
        count += 1
        if count == int(parameters.get("STAND_IN_RESTART", -1)):
            count = 0
        if count == OTHER_PORTS_AT:
            servers = [socket.create_server(("127.0.0.1", port + 10 * instance)) for port in (5762, 5763)]
            for server in servers:
                server.setblocking(False)
        for server in servers:
            try:
                client = server.accept()[0]
            except BlockingIOError:
                continue
            client.setblocking(False)
            sockets.append(client)
        beat, motion = clients.due()
        for client in sockets:
            answers = b""
            with contextlib.suppress(BlockingIOError):
                answers = clients.take(client, client.recv(65536))
            out = beat + (motion if client in clients.stream_clients else b"") + answers
            if out:
                client.sendall(out)
        rotors = pilot.rotors(state)
        faults.act(state, physics)
        pulses = [round(1000 + 1000 * share) for share in rotors] + [1500] * 12
