"""The numbers by which the vehicle is flown, as the present parameters give them."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ._flight_state import Behaviour
from ._shaping import UNSHAPED, MotionShaping

Seconds = float

# A target that is less above the vehicle asks for no climb worth another acceleration.
_CLIMBS_FROM_M = 0.5


@dataclass(frozen=True, slots=True)
class StickLimits:
    """What a full stick means."""

    tilt_rad: float
    speed_mps: float
    climb_mps: float
    descent_mps: float
    yaw_radps: float
    rates_radps: float  # roll and pitch of acrobatics
    dead: float  # share of a stick's travel around its middle that has no effect
    lost_after_s: Seconds
    # A pilot takes over from these by moving a stick faster than a share of its travel in a second.
    overrides: frozenset[Behaviour] = frozenset()
    overrides_from: float = math.inf


@dataclass(frozen=True, slots=True)
class FollowTargetLimits:
    """How a leader is followed: height above home, distance from the leader, angle to its course."""

    height_m: float
    distance_m: float
    angle_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class PathLimits:
    """Speed, acceleration and jerk of paths from rest to rest."""

    speed_mps: float
    accel_mps2: float
    vertical_accel_mps2: float
    jerk_mps3: float


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """Speeds, heights and times of every manoeuvre."""

    cruise_mps: float  # positions flown on the autopilot's own account
    speed_max_mps: float  # setpoints of a companion
    setpoint_climb_mps: float  # likewise
    setpoint_descent_mps: float
    climb_mps: float
    descent_mps: float
    takeoff_mps: float
    takeoff_spool_s: Seconds  # rotors turn, nothing moves
    takeoff_ramp_s: Seconds  # the climb grows to its full speed
    takeoff_ramp_from_mps: float  # where it grows from; the vehicle leaves the ground above zero
    takeoff_height_m: float  # when a takeoff command gives none
    takeoff_reached_m: float  # nearer to its height a takeoff is over
    takeoff_beyond_m: float  # so far above its height a takeoff aims until it is over
    land_mps: float
    land_slow_below_m: float  # landing speed below, full descent above `land_fast_above_m`, linear between
    land_fast_above_m: float
    blind_land_mps: float | None  # at once, without an estimate of position; None: as any other landing
    return_height_m: float  # above home
    return_mps: float
    return_path: PathLimits | None  # None: the return is flown like any position
    return_arrives_m: float  # from home, horizontally
    return_arrives_height_m: float  # from a height that it climbs or descends to
    return_near_m: float  # nearer to home than this no climb is made
    return_climbs_by_m: (
        float | None
    )  # climb at least this much, where an autopilot does not climb to a fixed height
    waypoint_turn_mps2: float  # sideways, where a waypoint of a mission is only passed
    waypoint_path: PathLimits | None  # of a mission; None: waypoints are flown like any position
    waypoint_corner_mps2: float  # the greatest acceleration of such a path
    landing_settles_s: Seconds  # at rest on the ground, until the landing is detected
    landed_disarm_s: Seconds | None
    idle_disarm_s: Seconds | None
    setpoint_timeout_s: Seconds
    sticks: StickLimits
    follow_target: FollowTargetLimits
    reposition_delay_s: Seconds  # until a reposition takes effect
    goto_mps: float  # positions that a companion gives
    faces_beyond_m: (
        float | None
    )  # nose to the place of a reposition that is farther away; None: along the motion
    return_faces_home: bool
    return_descends_to_m: (
        float | None
    )  # above home, before it waits there; None: a return waits at the height at which it arrives
    return_waits_s: Seconds  # above home, before landing
    orbit_radius_max_m: float
    circle_radius_m: float
    circle_radps: float  # clockwise
    thrust_is_climb: bool  # thrust of attitude setpoints: 0.5 holds the height
    # Positions that the autopilot flies to on its own account, with a climb or without.
    climb_shaping: MotionShaping
    descent_shaping: MotionShaping
    takeoff_shaping: MotionShaping
    setpoint_shaping: MotionShaping = UNSHAPED  # positions of a companion that come without a velocity

    def shaping(self, down_m: float) -> MotionShaping:
        """For a target so far below the vehicle."""
        return self.climb_shaping if down_m < -_CLIMBS_FROM_M else self.descent_shaping
