"""PX4: HIL messages over TCP, in lockstep; MAVLink clients over UDP."""

from __future__ import annotations

import contextlib
import math
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ._battery import Px4Battery
from ._clients import Clients
from ._faults import PATIENCE_S, Faults
from ._frames import Mavlink, require
from ._pilot import Pilot, State
from ._px4_checks import SampleChecks

# Its MAVLink modules start by the clock of the host: where physics runs as fast as it can, that long after its own.
HELLO_S = 4.8


class CrudePx4:
    def __init__(self, instance: int, parameters: dict[str, float], state: State) -> None:
        self.state = state
        self.pilot = Pilot(parameters["CA_ROTOR0_PX"], parameters["CA_ROTOR0_KM"])
        self.clients = Clients(
            self.pilot,
            state,
            is_px4=True,
            takeoff_m=parameters.get("MIS_TAKEOFF_ALT", 2.5),
            battery=Px4Battery(parameters),
        )
        self.instance, self.hello_s = instance, parameters.get("STAND_IN_HELLO_S", HELLO_S)
        self.ports: list[tuple[socket.socket, tuple[str, int]]] = []

    def open_ports(self) -> None:
        instance = self.instance
        for local, far in ((14580 + instance, 14540 + instance), (18570 + instance, 14550)):
            port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            port.bind(("127.0.0.1", local))
            port.setblocking(False)
            self.ports.append((port, ("127.0.0.1", far)))

    @property
    def armed(self) -> bool:
        return self.pilot.armed

    @property
    def has_outputs(self) -> bool:
        return self.clients.has_outputs

    def rotors(self) -> list[float]:
        return self.pilot.rotors(self.state)

    def serve(self) -> None:
        if not self.ports and self.state.time_s >= self.hello_s:
            self.open_ports()
        serve_datagrams(self.clients, self.ports)


def fly_px4(open_side: Callable[[int, dict[str, float], State], Any] = CrudePx4) -> None:
    """`open_side` makes what flies and talks to MAVLink clients."""
    parameters = {
        name[10:]: float(text) for name, text in os.environ.items() if name.startswith("PX4_PARAM_")
    }
    require(sys.argv[1] == "-d" and sys.argv[2] == "-i", f"arguments {sys.argv[1:]}")
    require(sys.argv[4:] == ["-s", "etc/init.d-posix/rcS"], f"arguments {sys.argv[1:]}")
    require(Path(sys.argv[5]).is_file(), "the start script is not in the working folder")
    require(os.environ.get("PX4_SIM_MODEL") == "none_iris", "PX4_SIM_MODEL")
    require(os.environ["HOME"] == str(Path.cwd()), "HOME is not the working folder")
    instance = int(sys.argv[3])
    places = [
        (parameters[f"CA_ROTOR{n}_PX"], parameters[f"CA_ROTOR{n}_PY"], parameters[f"CA_ROTOR{n}_KM"])
        for n in range(4)
    ]
    signs = [tuple(math.copysign(1, value) for value in place) for place in places]
    require(signs == [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)], f"rotors at {places}")
    require(
        parameters["THR_MDL_FAC"] == 1 and 0.4 < parameters["MPC_THR_HOVER"] < 0.8,
        "THR_MDL_FAC or MPC_THR_HOVER",
    )
    require(parameters["MAV_SYS_ID"] == 1, "MAV_SYS_ID")
    Path(f"/tmp/px4_lock-{instance}").touch()
    faults = Faults(int(parameters.get("STAND_IN_FAULT", 0)))
    link = connected(4560 + instance)
    state = State()
    side = open_side(instance, parameters, state)
    checks = SampleChecks(state, 1e6 / 5000)
    mavlink = Mavlink()
    link.sendall(mavlink.pack(0, struct.pack("<IBBBBB", 0, 2, 12, 0, 0, 3)))
    link.sendall(mavlink.pack(76, struct.pack("<7fHBBB", 115, 5000, 0, 0, 0, 0, 0, 511, 0, 0, 0)))
    samples, reader = 0, Mavlink()
    if parameters.get("SDLOG_BACKEND"):
        folder = Path("log", "2026-01-01")
        folder.mkdir(parents=True)
        (folder / "10_00_00.ulg").write_bytes(b"ULog of the stand-in")
    while True:
        require(bool(select.select([link], [], [], PATIENCE_S)[0]), "silence")
        data = link.recv(65536)
        if not data:
            sys.exit(0)
        answered = False
        for number, payload in reader.read(data):
            require(not answered, "a message came behind HIL_SENSOR, before its answer")
            if number == 113:
                checks.take_gps(payload)
            elif number == 115:
                checks.take_truth(payload)
            else:
                require(number == 107, f"message {number} on the simulator link")
                checks.take_sensor(payload, side.armed)
                samples += 1
                # Outputs do not run before the eighth sample.
                answered = samples > 8 and side.has_outputs
                rotors = side.rotors()
                faults.act(state, link)
                if answered:
                    controls = struct.pack(
                        "<QQ16fB", checks.time_us, 1, *rotors, *[0.0] * 12, 128 if side.armed else 0
                    )
                    link.sendall(mavlink.pack(93, controls))
        side.serve()


def serve_datagrams(clients: Clients, ports: list[tuple[socket.socket, tuple[str, int]]]) -> None:
    beat, motion = clients.due()
    for port, far in ports:
        answers = b""
        while True:
            try:
                data, source = port.recvfrom(65536)
            except (BlockingIOError, ConnectionRefusedError):
                break
            require(source == far, f"a datagram from {source}, not {far}")
            answers += clients.take(port, data)
        if out := beat + motion + answers:
            with contextlib.suppress(ConnectionRefusedError):
                port.sendto(out, far)


def connected(port: int) -> socket.socket:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            link = socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            require(time.monotonic() < deadline_s, f"nobody listens on TCP {port}")
            time.sleep(0.0005)
        else:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return link
