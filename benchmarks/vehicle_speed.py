"""Simulated seconds for each CPU second of one core: the vehicle alone, and with its flight controller and a
client.

Run: python benchmarks/vehicle_speed.py [simulated seconds]

Process CPU time, not wall time, so that a loaded machine disturbs it little; each figure is the best of three
rounds in which all take their turn, and the last column sets them against the first. The client's own work is
inside the clock, but small: it sends setpoints packed beforehand and reads datagrams without decoding them.
"""

from __future__ import annotations

import gc
import math
import socket
import sys
import time
from collections.abc import Callable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from bench.contracts import LinkSpec, VehiclePlan
from bench.simspec import SimSpec
from vehicle_models import open_wing, open_x500

ROUNDS = 3


def simspec() -> SimSpec:
    wind = {"speed_mps": 5.0, "from_deg": 240.0, "turbulence_mps": 5.0}
    corners = [{"east_m": e, "north_m": n} for e, n in ((0, 0), (100, 0), (100, 100))]
    return SimSpec.model_validate(
        {"name": "speed", "world": {"area": {"corners": corners}}, "environment": {"wind": wind}}
    )


def plant_alone(span_s: float) -> float:
    """JSBSim with the cascade in its XML and our gusts, hovering at 20 m and flying squares; CPU seconds."""
    from bench.simspec import generator
    from vehicle_models._gusts import Gusts, mean_wind_ned_mps
    from vehicle_models._jsbsim import StartPose
    from vehicle_models.x500 import X500Plant

    spec = simspec()
    wind = spec.environment.wind
    plant = X500Plant(StartPose(47.3977, 8.5456, 488.0), 0.02)
    plant.set_wind_ned_mps(mean_wind_ned_mps(wind))
    gusts = Gusts(wind, 0.02, generator(spec.seeds, "gusts"))
    for name, value in {
        "armed": 1,
        "flying": 1,
        "position-mode": 1,
        "height-mode": 1,
        "target-u-m": 20,
    }.items():
        plant.write(name, float(value))
    gc.collect()  # what others left behind is not cleared away at its cost
    begun = time.process_time()
    for step in range(round(span_s * 50)):
        plant.write("target-n-m", 40.0 * (step // 500 % 2))
        plant.set_gust_ned_mps(gusts.step(plant.motion.up_m, plant.motion.airspeed_mps))
        plant.advance()
    return time.process_time() - begun


def with_controller(span_s: float, streams: str) -> tuple[float, float]:
    """The whole vehicle flying squares in offboard at 20 Hz of setpoints; CPU seconds, and messages a
    second.
    """
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    client.bind(("127.0.0.1", 0))
    client.setblocking(False)
    pack = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    peer: tuple[str, int] | None = None
    link = LinkSpec("onboard", "udp_out", port=client.getsockname()[1], streams=streams)
    with open_x500(VehiclePlan(simspec(), (link,))) as vehicle:

        def fly(seconds: float, say: Callable[[int], list[bytes]]) -> None:
            nonlocal peer
            for step in range(round(seconds * 50)):
                if peer:
                    for data in say(step):
                        client.sendto(data, peer)
                vehicle.receive()
                vehicle.step()
                while True:
                    try:
                        _, peer = client.recvfrom(65535)
                    except BlockingIOError:
                        break

        def once(data: bytes) -> Callable[[int], list[bytes]]:
            return lambda step: [data] if step == 0 else []

        def command(number: int, *params: float) -> bytes:
            padded = [*params, *[0.0] * (7 - len(params))]
            return bytes(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded).pack(pack))

        def packed(north: float) -> bytes:
            m = mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, 1, 2552, north, 0, -20, 0, 0, 0, 0, 0, 0, 0, 0
            )
            return bytes(m.pack(pack))

        places = packed(0.0), packed(40.0)

        def setpoint(step: int) -> list[bytes]:
            return [places[step // 500 % 2]] if step % 3 == 0 else []

        fly(5.0, lambda step: [])
        fly(1.0, once(command(400, 1)))
        fly(8.0, once(command(22, *[math.nan] * 7)))
        fly(0.2, setpoint)
        fly(0.2, lambda step: [command(176, 1, 6), *setpoint(step)] if step == 0 else setpoint(step))
        assert vehicle.condition().mode == "OFFBOARD"
        gc.collect()
        before, begun = vehicle.sent()["onboard"], time.process_time()
        fly(span_s, setpoint)
        spent = time.process_time() - begun
        client.close()
        return spent, (vehicle.sent()["onboard"] - before) / span_s


def fixed_wing(span_s: float, streams: str) -> tuple[float, float]:
    """The fixed wing circling in the same wind; CPU seconds, and messages a second."""
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    client.bind(("127.0.0.1", 0))
    client.setblocking(False)
    pack = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
    link = LinkSpec("onboard", "udp_out", port=client.getsockname()[1], streams=streams)
    with open_wing(VehiclePlan(simspec(), (link,))) as vehicle:

        def fly(seconds: float) -> tuple[str, int] | None:
            peer = None
            for _ in range(round(seconds * 50)):
                vehicle.receive()
                vehicle.step()
                while True:
                    try:
                        _, peer = client.recvfrom(65535)
                    except BlockingIOError:
                        break
            return peer

        peer = fly(5.0)
        assert peer
        for number, params in ((400, (1.0, *[0.0] * 6)), (22, (math.nan,) * 7)):
            client.sendto(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params).pack(pack), peer)
            fly(1.0)
        fly(30.0)
        assert vehicle.condition().mode == "AUTO_LOITER"
        gc.collect()
        before, begun = vehicle.sent()["onboard"], time.process_time()
        fly(span_s)
        spent = time.process_time() - begun
        client.close()
        return spent, (vehicle.sent()["onboard"] - before) / span_s


def best(parts: Mapping[str, Callable[[], tuple[float, float]]]) -> dict[str, tuple[float, float]]:
    """Of each part the round that took the least CPU time: seconds, and messages a second."""
    rounds = [{name: part() for name, part in parts.items()} for _ in range(ROUNDS)]
    return {name: min(run[name] for run in rounds) for name in parts}


def main(span_s: float = 60.0) -> None:
    parts: dict[str, Callable[[], tuple[float, float]]] = {
        "plant alone (cascade, gusts)": lambda: (plant_alone(span_s), 0.0),
        "vehicle, client without streams": lambda: with_controller(span_s, "none"),
        "vehicle, PX4's onboard streams": lambda: with_controller(span_s, "onboard"),
        "fixed wing, PX4's onboard streams": lambda: fixed_wing(span_s, "onboard"),
    }
    rates = best(parts)
    first_s, _ = next(iter(rates.values()))
    print(f"{'':36}{'sim s / CPU s':>14}{'us a step':>12}{'messages/s':>12}{'of the first':>14}")
    for name, (cpu_s, rate) in rates.items():
        print(
            f"{name:36}{span_s / cpu_s:14.0f}{1e6 * cpu_s / span_s / 50:12.1f}{rate:12.0f}{first_s / cpu_s:14.2f}"
        )


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
