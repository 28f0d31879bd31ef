"""A PX4 in its offboard mode, by px4_msgs alone: the logic of px4_ros_com's example, then a square and a landing."""

import math

import rclpy
from px4_msgs.msg import (
    OffboardControlMode,
    TrajectorySetpoint,
    VehicleCommand,
    VehicleLandDetected,
    VehicleLocalPosition,
    VehicleStatus,
)
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

HEIGHT_M, NEAR_M, DISARMED = 5.0, 0.5, 1
CORNERS = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0), (0.0, 0.0)]  # north, east
DO_SET_MODE, ARM_DISARM, LAND = 176, 400, 21
CUSTOM_MODE, OFFBOARD = 1.0, 6.0


class Offboard(Node):
    def __init__(self):
        super().__init__("offboard_control")
        self.status, self.place, self.landed = None, None, False
        self.ticks, self.corners, self.landing = 0, list(CORNERS), False
        self.mode = self.create_publisher(OffboardControlMode, "/fmu/in/offboard_control_mode", 10)
        self.setpoint = self.create_publisher(TrajectorySetpoint, "/fmu/in/trajectory_setpoint", 10)
        self.commands = self.create_publisher(VehicleCommand, "/fmu/in/vehicle_command", 10)
        for kind, topic, hear in (
            (VehicleStatus, "vehicle_status", self.hear_status),
            (VehicleLocalPosition, "vehicle_local_position", self.hear_position),
            (VehicleLandDetected, "vehicle_land_detected", self.hear_landing),
        ):
            self.create_subscription(kind, f"/fmu/out/{topic}", hear, qos_profile_sensor_data)
        self.create_timer(0.1, self.tick)

    def hear_status(self, message):
        self.status = message

    def hear_position(self, message):
        self.place = (message.x, message.y, message.z)

    def hear_landing(self, message):
        self.landed = message.landed

    def tick(self):
        if self.status is None or self.place is None:
            return
        if self.landing:
            if self.landed and self.status.arming_state == DISARMED:
                raise SystemExit
            return
        self.hold(*self.corners[0])
        # Its checks pass once it knows its position, and in the offboard mode while setpoints come.
        if self.ticks < 10:
            self.ticks += self.status.pre_flight_checks_pass
            if self.ticks == 10:
                self.command(DO_SET_MODE, CUSTOM_MODE, OFFBOARD)
                self.command(ARM_DISARM, 1.0)
        elif math.dist(self.place, (*self.corners[0], -HEIGHT_M)) < NEAR_M:
            self.corners.pop(0)
            self.landing = not self.corners
            if self.landing:
                self.command(LAND)

    def hold(self, north_m, east_m):
        """PX4 puts its own time in place of the zeros; yaw 0 is north."""
        self.mode.publish(OffboardControlMode(position=True))
        self.setpoint.publish(TrajectorySetpoint(position=[north_m, east_m, -HEIGHT_M]))

    def command(self, number, param1=0.0, param2=0.0):
        target = {"target_system": 1, "target_component": 1, "source_system": 1, "source_component": 1}
        message = VehicleCommand(command=number, param1=param1, param2=param2, from_external=True, **target)
        self.commands.publish(message)


def main():
    rclpy.init()
    try:
        rclpy.spin(Offboard())
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
