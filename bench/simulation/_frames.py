"""Conversions between the axes of autopilots (NED, FRD) and those of ROS (ENU, FLU; REP 103)."""

from __future__ import annotations

import math

from bench.contracts import VehicleState
from bench.simspec import Camera, SimSpec
from bench.streams import Quaternion


def base_frame(simspec: SimSpec) -> str:
    """The vehicle's body: x forward, y left, z up."""
    return f"{simspec.vehicle.name}/base_link"


def level_frame(simspec: SimSpec) -> str:
    """Position and yaw of the body, without its roll and pitch."""
    return f"{simspec.vehicle.name}/base_level"


def optical_frame(simspec: SimSpec, camera: Camera) -> str:
    """A camera's frame: x right, y down, z forward."""
    return f"{simspec.vehicle.name}/camera_{camera.name}_optical"


def body_in_map(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Orientation of base_link (FLU) in map (ENU) for an attitude of FRD against NED, yaw from north."""
    return quaternion(roll_rad, -pitch_rad, math.pi / 2.0 - yaw_rad)


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Unit quaternion of the intrinsic z-y-x rotation by yaw, pitch and roll."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def velocity_in_body(state: VehicleState) -> tuple[float, float, float]:
    """Velocity along base_link's axes (forward, left, up), m/s, as nav_msgs/Odometry wants its twist."""
    east, north, up = state.velocity_enu_mps
    cy, sy = math.cos(state.yaw_rad), math.sin(state.yaw_rad)
    cp, sp = math.cos(state.pitch_rad), math.sin(state.pitch_rad)
    cr, sr = math.cos(state.roll_rad), math.sin(state.roll_rad)
    down = -up
    ahead, aside = north * cy + east * sy, -north * sy + east * cy
    forward = ahead * cp - down * sp
    tilted = ahead * sp + down * cp
    right, below = aside * cr + tilted * sr, -aside * sr + tilted * cr
    return forward, -right, -below
