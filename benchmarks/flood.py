"""What clients that mean it no good cost a vehicle: CPU milliseconds of a controller step, and speed under a
live flood.

Run: python benchmarks/flood.py [steps]

Every row is a vehicle of its own with PX4's onboard streams and one client that behaves. With `bursts` the
other client acts between two steps, outside the clock, and does as much as the sockets hold. `live` it is a
process of its own that never rests, while the vehicle flies as fast as it can. CPU time of the vehicle's
process throughout, so that a loaded machine disturbs it little; each row has the quiet steps that were
measured between the two.
"""

from __future__ import annotations

import multiprocessing
import socket
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bench.contracts import LinkSpec, Vehicle, VehiclePlan
from bench.simspec import SimSpec
from vehicle_models import open_x500

Address = tuple[str, int]
Client = Callable[[Address, Address, ExitStack], Callable[[], None]]
"""Given the UDP and the TCP address, opens its sockets and returns what is done again and again."""

_MAV = mavlink.MAVLink(None, srcSystem=9, srcComponent=190)
_BEAT = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(_MAV))
_ASK = bytes(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OF_LOSS_T", -1).pack(_MAV))
_BURST = 400  # more datagrams than a socket holds


def quiet(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
    return lambda: None


def datagrams(data: bytes) -> Client:
    """One UDP client that sends this for ever, and never reads."""

    def client(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
        sock = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))

        def burst() -> None:
            for _ in range(_BURST):
                sock.sendto(data, udp)

        return burst

    return client


def strangers(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
    """Datagrams from sixty-four ports in turn."""
    socks = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(64)]

    def burst() -> None:
        for number in range(_BURST):
            socks[number % 64].sendto(_BEAT, udp)

    return burst


def listener(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
    """A TCP client that is silent and reads nothing."""
    stack.enter_context(socket.create_connection(tcp))
    return lambda: None


def stream(data: bytes) -> Client:
    """One TCP client that sends as much as is taken, and reads nothing at all."""

    def client(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
        sock = stack.enter_context(socket.create_connection(tcp))
        sock.setblocking(False)
        rest = b""

        def burst() -> None:
            nonlocal rest
            try:
                while True:
                    rest = rest or data
                    rest = rest[sock.send(rest) :]
            except OSError:
                pass

        return burst

    return client


def vanishing(udp: Address, tcp: Address, stack: ExitStack) -> Callable[[], None]:
    """Fifty TCP clients that connect, say half a word and vanish; those that find no place go too."""

    def burst() -> None:
        for _ in range(50):
            with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as sock:
                sock.setblocking(False)
                try:
                    sock.connect(tcp)
                except BlockingIOError:
                    continue
                except OSError:
                    return
                sock.send(b"\xfd\x09")

    return burst


CLIENTS: dict[str, Client] = {
    "quiet": quiet,
    "one message a datagram": datagrams(_BEAT),
    "requests, one a datagram": datagrams(_ASK),
    "full datagrams": datagrams(_BEAT * (1400 // len(_BEAT))),
    "datagrams of 60 kB": datagrams(_BEAT * (60_000 // len(_BEAT))),
    "garbage, nothing like a frame": datagrams(bytes(1400)),
    "garbage, beginnings of frames": datagrams(b"\xfd\xff\x00" * 460),
    "garbage, frames with wrong checksum": datagrams(b"\xfe\x01\x00\x01\x01\x00\x00\x00\x01" * 150),
    "64 strangers": strangers,
    "TCP, does not read": listener,
    "TCP, sends and does not read": stream(_BEAT * 100),
    "TCP, 50 connect and vanish": vanishing,
}


def simspec() -> SimSpec:
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (100, 0), (100, 100))]
    return SimSpec.model_validate({"name": "flood", "world": {"area": {"corners": corners}}})


def address(vehicle: Vehicle, name: str) -> Address:
    _, host, port = vehicle.endpoints()[name].split(":")
    return host, int(port)


def fly(vehicle: Vehicle, friend: socket.socket, steps: int, before: Callable[[], None]) -> float:
    """CPU seconds of the vehicle's own work."""
    spent = 0.0
    for _ in range(steps):
        before()
        friend.send(_BEAT)
        begun = time.process_time()
        vehicle.receive()
        vehicle.step()
        spent += time.process_time() - begun
        try:
            while True:
                friend.recv(65535)
        except BlockingIOError:
            pass
    return spent


def measured(client: Client, steps: int) -> tuple[float, float, float, int]:
    """Seconds of a quiet step, of one with bursts between, of one under a live flood; and what was thrown
    away.
    """
    with ExitStack() as stack:
        links = (LinkSpec("air", "udp_in"), LinkSpec("line", "tcp_in"))
        vehicle = stack.enter_context(open_x500(VehiclePlan(simspec(), links)))
        udp, tcp = address(vehicle, "air"), address(vehicle, "line")
        friend = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        friend.connect(udp)
        friend.setblocking(False)
        fly(vehicle, friend, 250, lambda: None)
        with ExitStack() as own_cpu_s:
            burst = client(udp, tcp, own_cpu_s)
            fly(vehicle, friend, 250, burst)  # queues fill
            with_bursts_s = fly(vehicle, friend, steps, burst) / steps
        fly(vehicle, friend, 250, lambda: None)
        quiet_s = fly(vehicle, friend, 5 * steps, lambda: None) / (5 * steps)
        enemy = multiprocessing.get_context("fork").Process(
            target=never_rest, args=(client, udp, tcp), daemon=True
        )
        enemy.start()
        fly(vehicle, friend, 500, lambda: None)
        live_s = fly(vehicle, friend, 5 * steps, lambda: None) / (5 * steps)
        enemy.kill()
        enemy.join()
        return quiet_s, with_bursts_s, live_s, vehicle.counters()["mavlink_dropped"]


def never_rest(client: Client, udp: Address, tcp: Address) -> None:
    with ExitStack() as stack:
        act = client(udp, tcp, stack)
        while client is not quiet:
            act()
        time.sleep(3600.0)


def main(steps: int = 300) -> None:
    print(
        f"{'CPU ms a step':36}{'quiet':>8}{'bursts':>8}{'more':>8}{'live':>8}{'speed of quiet':>16}{'dropped':>10}"
    )
    for name, client in CLIENTS.items():
        quiet_s, with_bursts_s, live_s, dropped = measured(client, steps)
        times = "".join(
            f"{1e3 * measurement:8.3f}"
            for measurement in (quiet_s, with_bursts_s, with_bursts_s - quiet_s, live_s)
        )
        print(f"{name:36}{times}{quiet_s / live_s:16.2f}{dropped:10}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
