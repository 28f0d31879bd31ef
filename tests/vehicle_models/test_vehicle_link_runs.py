"""Several links and clients at once, twice the same; and time that runs ten times as fast."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import ExitStack
from itertools import product

import pytest
from ports import free_port
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from vehicle_client import simspec

from bench.contracts import LinkSpec, VehiclePlan
from bench.simulation import StandalonePlan, run_standalone
from vehicle_models import open_x500


def log_of_a_flight(autopilot: str) -> list[tuple[str, str, bytes]]:
    """What the tap saw of 5 s with two UDP links and a TCP link, a client on each."""
    log: list[tuple[str, str, bytes]] = []
    with ExitStack() as stack:
        udp = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        links = [LinkSpec("a", "udp_in", streams="gcs"), LinkSpec("b", "udp_in")]
        links.append(LinkSpec("c", "tcp_in", streams="none"))
        spec = simspec(autopilot, environment={"wind": {"speed_mps": 4.0, "turbulence_mps": 4.0}})
        plan = VehiclePlan(spec, tuple(links))
        vehicle = stack.enter_context(open_x500(plan, lambda *entry: log.append(entry)))
        ports = {name: int(end.rsplit(":", 1)[1]) for name, end in vehicle.endpoints().items()}
        for sock, name in zip(udp, "ab", strict=True):
            sock.connect(("127.0.0.1", ports[name]))
        tcp = stack.enter_context(socket.create_connection(("127.0.0.1", ports["c"])))
        speakers = [mavlink.MAVLink(None, srcSystem=system, srcComponent=190) for system in (255, 245, 7)]
        counts = {"a": 0, "b": 0, "c": 0}
        for step in range(250):
            if step % 10 == 0:
                for name, sock, mav in zip("abc", (*udp, tcp), speakers, strict=True):
                    for frame in (
                        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
                        mavlink.MAVLink_command_long_message(1, 1, 400, 0, step // 75, 0, 0, 0, 0, 0, 0),
                        mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1),
                        mavlink.MAVLink_ping_message(step, step, 0, 0),
                    ):
                        sock.send(bytes(frame.pack(mav, force_mavlink1=name == "c")))
                        counts[name] += 1
                deadline = time.monotonic() + 10.0
                while dict(vehicle.receive()) != counts:
                    assert time.monotonic() < deadline
            vehicle.step()
    return log


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_several_links_give_the_same_log_twice(autopilot: str) -> None:
    """The messages of three clients, sent, received and forwarded, in the same order."""
    first = log_of_a_flight(autopilot)
    assert {(link, way) for link, way, _ in first} == {*product("abc", ("to_agent", "from_agent"))}
    assert first == log_of_a_flight(autopilot)


def test_ten_times_as_fast() -> None:
    """A real client sees the vehicle's clock run ten times its own, and idle arming end in its time."""
    port = free_port(socket.SOCK_DGRAM)
    stop = threading.Event()
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")
    flying = threading.Thread(
        target=run_standalone,
        args=(StandalonePlan("px4", [LinkSpec("onboard", "udp_out", port=port)], speed=10.0),),
        kwargs={"stop": stop},
    )
    flying.start()
    try:
        assert client.wait_heartbeat(timeout=10) is not None

        def at(ready: int) -> tuple[float, float]:
            """Host's and vehicle's seconds at the first attitude after `ready` ms of the vehicle's."""
            while True:
                message = client.recv_match(type="ATTITUDE", blocking=True, timeout=10)
                assert message is not None
                if message.time_boot_ms >= ready:
                    return time.monotonic(), message.time_boot_ms / 1000.0

        host, simulated = at(5000)
        client.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        acknowledged = client.recv_match(type="COMMAND_ACK", blocking=True, timeout=10)
        assert acknowledged.result == 0
        host_later, own_later = at(18000)
        # Never ahead; behind as the machine is loaded.
        assert own_later - simulated <= 10.0 * (host_later - host) + 2.0
        beat = client.recv_match(type="HEARTBEAT", blocking=True, timeout=10)
        assert not beat.base_mode & 128
    finally:
        stop.set()
        flying.join()
        client.close()
