"""The same search with pymavlink in place of the client's own MAVLink, on ArduPilot: a program of yours that has a link already.

In real time and warp: lockstep counts whole frames, and pymavlink tells of decoded messages.
"""

from pymavlink import mavutil
from rebar_air import OWN_COMPONENT, OWN_SYSTEM, Bench, Json, Vehicle, degrees_of
from search import main

MAV = mavutil.mavlink
RELATIVE = MAV.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
POSITION_ALONE = 0b110111111000  # what SET_POSITION_TARGET ignores


class PymavlinkVehicle(Vehicle):
    """GUIDED of ArduCopter: position targets above home."""

    def __init__(self, address: str) -> None:
        self._link = mavutil.mavlink_connection(
            address, source_system=OWN_SYSTEM, source_component=OWN_COMPONENT
        )
        self.sent = 0
        self.ready = self.armed = False
        self.latitude_deg = self.longitude_deg = self.height_m = self.amsl_m = 0.0

    def receive(self, count: int) -> None:
        while (message := self._link.recv_match(blocking=False)) is not None:
            kind = message.get_type()
            if kind == "HEARTBEAT" and message.autopilot == MAV.MAV_AUTOPILOT_ARDUPILOTMEGA:
                self.armed = bool(message.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED)
            elif kind == "SYS_STATUS":
                healthy = message.onboard_control_sensors_health
                self.ready = bool(healthy & MAV.MAV_SYS_STATUS_PREARM_CHECK)
            elif kind == "GLOBAL_POSITION_INT":
                self.latitude_deg, self.longitude_deg = message.lat * 1e-7, message.lon * 1e-7
                self.amsl_m, self.height_m = message.alt * 1e-3, message.relative_alt * 1e-3

    def heartbeat(self) -> None:
        if not self._link.target_system:  # nothing has come from it yet
            return
        self._link.mav.heartbeat_send(
            MAV.MAV_TYPE_ONBOARD_CONTROLLER, MAV.MAV_AUTOPILOT_INVALID, 0, 0, MAV.MAV_STATE_ACTIVE
        )
        if not self.amsl_m:
            self._link.mav.request_data_stream_send(1, 1, MAV.MAV_DATA_STREAM_ALL, 5, 1)

    def command(self, number: int, *parameters: float) -> None:
        self._link.mav.command_long_send(1, 1, number, 0, *parameters, *(0.0,) * (7 - len(parameters)))

    def arm(self) -> None:
        self._link.set_mode("GUIDED")
        self._link.arducopter_arm()

    def take_off(self, height_m: float) -> None:
        self.command(MAV.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)

    def go_to(self, origin: Json, east_m: float, north_m: float, height_m: float, speed_mps: float) -> None:
        self.command(MAV.MAV_CMD_DO_CHANGE_SPEED, 1, speed_mps)
        latitude_deg, longitude_deg = degrees_of(origin, east_m, north_m)
        place = round(latitude_deg * 1e7), round(longitude_deg * 1e7), height_m
        still = (0.0,) * 8
        self._link.mav.set_position_target_global_int_send(0, 1, 1, RELATIVE, POSITION_ALONE, *place, *still)

    def land(self) -> None:
        self._link.set_mode("LAND")


if __name__ == "__main__":
    main(Bench("tick-search-pymavlink", PymavlinkVehicle))
