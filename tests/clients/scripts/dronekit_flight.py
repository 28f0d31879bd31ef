"""DroneKit 2.9 on ArduPilot: python dronekit_flight.py tcp:127.0.0.1:5760 CHAPTER...

Flies `wait_ready`, parameters, `simple_takeoff`, `simple_goto` with a speed, velocities, a mission with speeds and
RTL, FENCE_RADIUS, `gimbal.rotate`.
Is refused: arming during the start, disarming in the air, an unknown parameter, an unknown item.
"""

from __future__ import annotations

import collections
import collections.abc
import math
import os
import sys
import time
from typing import Any

if "payload" in sys.argv:
    # Where the gimbal looks is a message of MAVLink 2 alone; DroneKit begins with 1
    os.environ["MAVLINK20"] = "1"
collections.MutableMapping = collections.abc.MutableMapping  # type: ignore[attr-defined]  # DroneKit is older than Python 3.10

from dronekit import Command, LocationGlobalRelative, Vehicle, VehicleMode, connect  # noqa: E402
from logbook import apart, distance_m, place, run_chapters, wait_until  # noqa: E402
from pymavlink import mavutil  # noqa: E402

mavlink = mavutil.mavlink
ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
HEIGHT_M = 8.0
MAX_ATTEMPTS = 5


class Flight:
    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.texts: list[str] = []
        self.acks: list[tuple[int, int]] = []
        self.verdicts: list[int] = []
        vehicle.add_message_listener("STATUSTEXT", lambda _, __, message: self.texts.append(message.text))
        vehicle.add_message_listener(
            "COMMAND_ACK", lambda _, __, ack: self.acks.append((ack.command, ack.result))
        )
        vehicle.add_message_listener("MISSION_ACK", lambda _, __, ack: self.verdicts.append(ack.type))

    def here(self) -> tuple[float, float]:
        at = self.vehicle.location.global_relative_frame
        return at.lat, at.lon

    def mode(self, name: str) -> None:
        self.vehicle.mode = VehicleMode(name)
        wait_until(f"mode {name}", lambda: self.vehicle.mode.name == name)

    def ready(self) -> tuple[float, float]:
        self.vehicle.wait_for_armable(timeout=60)
        self.mode("GUIDED")
        return self.here()

    def armed(self) -> None:
        """Arm, and again each second as long as it is refused."""
        for _ in range(30):
            self.vehicle.armed = True
            end = time.monotonic() + 1.0
            while time.monotonic() < end:
                if self.vehicle.armed:
                    return
                time.sleep(0.01)
        sys.exit(f"not armed: {self.texts}")

    def up(self) -> tuple[float, float]:
        start = self.ready()

        def high() -> bool:
            return bool(self.vehicle.location.global_relative_frame.alt > HEIGHT_M - 0.4)

        for _ in range(MAX_ATTEMPTS):
            self.armed()
            self.vehicle.simple_takeoff(HEIGHT_M)
            # On a busy host the vehicle may have disarmed itself, being idle for DISARM_DELAY, before the takeoff came.
            wait_until("takeoff", lambda: high() or not self.vehicle.armed)
            if high():
                return start
        sys.exit(f"no takeoff: {self.texts}")

    def down(self, start: tuple[float, float]) -> float:
        wait_until("disarming", lambda: not self.vehicle.armed)
        return distance_m(start, self.here())

    def velocity(self, north_mps: float, east_mps: float) -> None:
        self.vehicle.send_mavlink(
            self.vehicle.message_factory.set_position_target_local_ned_encode(
                0, 0, 0, mavlink.MAV_FRAME_LOCAL_NED, 0xFC7, 0, 0, 0, north_mps, east_mps, 0, 0, 0, 0, 0, 0
            )
        )

    def early(self) -> dict[str, Any]:
        """Started again, and arming before it is ready."""
        self.command_long(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        wait_until("the restart", lambda: self.acks)
        # The streams that DroneKit asked for as it connected have ended with the restart.
        self.vehicle.send_mavlink(self.vehicle.message_factory.request_data_stream_encode(0, 0, 0, 4, 1))
        wait_until("a vehicle that is not ready", lambda: not self.vehicle.is_armable)
        self.acks.clear()
        self.vehicle.armed = True
        wait_until("the answer", lambda: [ack for ack in self.acks if ack[0] == ARM])
        answer = next(ack for ack in self.acks if ack[0] == ARM)
        return {"armable": bool(self.vehicle.is_armable), "ack": answer, "texts": self.texts}

    def command_long(self, number: int, first: float) -> None:
        self.vehicle.send_mavlink(
            self.vehicle.message_factory.command_long_encode(0, 0, number, 0, first, 0, 0, 0, 0, 0, 0)
        )

    def parameters(self) -> dict[str, Any]:
        before = self.vehicle.parameters["RTL_ALT"]
        self.vehicle.parameters.set("RTL_ALT", 1200, wait_ready=True)
        after = self.vehicle.parameters["RTL_ALT"]
        self.vehicle.parameters.set("RTL_ALT", before, wait_ready=True)
        return {
            "listed": len(self.vehicle.parameters), "before": before, "after": after,
            "unknown": self.vehicle.parameters.get("NO_SUCH_PARAM", wait_ready=False), "version": str(self.vehicle.version),
        }  # fmt: skip

    def hop(self) -> dict[str, Any]:
        start = self.up()
        self.acks.clear()
        self.vehicle.armed = False
        refused = wait_until("the refusal", lambda: [ack for ack in self.acks if ack[0] == 400])
        self.mode("LAND")
        return {"disarm_in_air": refused[0], "from_start_m": self.down(start)}

    def travel(self) -> dict[str, Any]:
        start = self.up()
        target = place(*start, 16.0, -12.0)
        self.vehicle.simple_goto(LocationGlobalRelative(*target, HEIGHT_M), groundspeed=4)
        fastest = 0.0

        def there() -> bool:
            nonlocal fastest
            fastest = max(fastest, self.vehicle.groundspeed)
            return distance_m(self.here(), target) < 1.0

        wait_until("the place", there)
        reached = apart(start, self.here())
        self.mode("RTL")
        return {"reached": reached, "fastest_mps": fastest, "from_start_m": self.down(start)}

    def setpoints(self) -> dict[str, Any]:
        start = self.up()
        speeds = []

        def fast() -> bool:
            self.velocity(0.0, 2.0)
            speeds.append(self.vehicle.velocity[1])
            return apart(start, self.here())[1] > 8.0

        wait_until("eight metres", fast)
        wait_until("the lapse", lambda: abs(self.vehicle.velocity[1]) < 0.2)
        stopped_at = apart(start, self.here())
        self.mode("RTL")
        return {"speed_mps": max(speeds), "stopped_at": stopped_at, "from_start_m": self.down(start)}

    def command(self, number: int, north_m: float, east_m: float, *params: float, frame: int = 3) -> Command:
        message, two = (*params, 0.0, 0.0)[:2]
        latitude, longitude = place(*self.start, north_m, east_m)
        return Command(0, 0, 0, frame, number, 0, 1, message, two, 0, 0, latitude, longitude, HEIGHT_M)

    def plan(self) -> dict[str, Any]:
        """A mission with a takeoff, two speeds and a return; one that is refused before."""
        self.start = self.ready()
        commands = (
            self.vehicle.commands
        )  # an empty mission is not downloaded first: DroneKit would wait for its first item for ever
        commands.clear()
        commands.add(self.command(22, 0.0, 0.0))
        commands.add(self.command(31999, 0.0, 0.0))
        try:
            commands.upload(timeout=3)
            refused = "uploaded"
        except Exception as error:
            refused = type(error).__name__
        verdict = self.verdicts[-1]
        commands.clear()
        for item in (
            self.command(22, 0.0, 0.0),
            self.command(178, 0.0, 0.0, 1.0, 3.0),
            self.command(16, 20.0, 0.0),
            self.command(178, 0.0, 0.0, 1.0, 6.0),
            self.command(16, 20.0, 30.0),
            self.command(20, 0.0, 0.0),
        ):
            commands.add(item)
        commands.upload()
        commands.download()
        commands.wait_ready()
        uploaded = [commands[number].command for number in range(commands.count)]
        self.armed()
        self.mode("AUTO")
        self.command_long(mavlink.MAV_CMD_MISSION_START, 0)
        speeds: dict[int, float] = {}

        def flown() -> bool:
            speeds[commands.next] = max(speeds.get(commands.next, 0.0), self.vehicle.groundspeed)
            return bool(commands.next == 6)

        wait_until("the return", flown)
        return {
            "refused": refused, "verdict": verdict, "kept": uploaded, "fastest_mps": [speeds[3], speeds[5]],
            "from_start_m": self.down(self.start),
        }  # fmt: skip

    def fence(self) -> dict[str, Any]:
        """A radius by parameters, broken by a velocity."""
        for name, value in (
            ("FENCE_RADIUS", 30),
            ("FENCE_TYPE", 2),
            ("FENCE_ACTION", 1),
            ("FENCE_ENABLE", 1),
        ):
            self.vehicle.parameters.set(name, value, wait_ready=True)
        start = self.up()

        def broken() -> bool:
            self.velocity(5.0, 0.0)
            return bool(self.vehicle.mode.name == "RTL")

        wait_until("the breach", broken)
        breached_at_m = distance_m(start, self.here())
        from_start_m = self.down(start)
        self.vehicle.parameters.set("FENCE_ENABLE", 0, wait_ready=True)
        return {"breached_at_m": breached_at_m, "from_start_m": from_start_m, "texts": self.texts}

    def payload(self) -> dict[str, Any]:
        """The gimbal, by DO_MOUNT_* messages as DroneKit has them."""
        self.ready()
        pitches: list[float] = []

        def record_pitch(_: Any, __: str, message: Any) -> None:
            w, x, y, z = message.q
            pitches.append(math.degrees(math.asin(2 * (w * y - z * x))))

        self.vehicle.add_message_listener("GIMBAL_DEVICE_ATTITUDE_STATUS", record_pitch)
        ask = self.vehicle.message_factory.command_long_encode(0, 0, 511, 0, 285, 100_000, 0, 0, 0, 0, 0)
        self.vehicle.send_mavlink(ask)
        self.vehicle.gimbal.rotate(-50, 0, 0)
        wait_until("the angle", lambda: pitches and abs(pitches[-1] + 50.0) < 1.0, 20.0)
        return {"pitch_deg": pitches[-1]}


def main() -> None:
    url, *wanted = sys.argv[1:]
    early = wanted[:1] == ["early"]  # before the long wait for everything
    vehicle = connect(url, wait_ready=not early, heartbeat_timeout=60)
    run_chapters(Flight(vehicle), wanted)
    vehicle.close()


if __name__ == "__main__":
    main()
