"""Whether the vehicle is on the ground or has left it."""

from __future__ import annotations

import math

from ..state._flight_state import FlightState, FlightTarget


class LandDetector:
    """On the ground: the feet touch, nothing moves, and the target is not above the vehicle."""

    def __init__(self) -> None:
        self._still_s = 0.0

    def landed(self, flight: FlightState, target: FlightTarget, settles_s: float) -> bool:
        """Whether the vehicle has been at rest on the ground for long enough; called once a step while it flies."""
        attitude = target.attitude
        # With a commanded thrust there is no target height or velocity to compare with.
        if attitude and attitude.thrust is not None:
            low = (
                attitude.thrust < 0.75 * flight.hover_thrust
                and flight.on_ground
                and abs(flight.vd_mps) < 0.15
            )
            self._still_s = self._still_s + flight.step_s if low else 0.0
            return self._still_s >= settles_s
        # A target above the vehicle means that it is about to leave, though its feet still touch.
        wants_down = (
            target.velocity_ned_mps[2] > 0.05
            if target.down_m is None
            else target.down_m > flight.down_m - 0.05
        )
        # Without an estimate of position the horizontal speed is not known either, and both autopilots go without it.
        slow = not flight.position_ok or math.hypot(flight.vn_mps, flight.ve_mps) < 0.5
        still = flight.on_ground and abs(flight.vd_mps) < 0.15 and slow
        self._still_s = self._still_s + flight.step_s if wants_down and still else 0.0
        return self._still_s >= settles_s

    def wants_off(self, flight: FlightState, target: FlightTarget) -> bool:
        """Whether a target, given on the ground, leads off it."""
        if target.attitude and target.attitude.thrust is not None:
            return target.attitude.thrust > flight.hover_thrust
        if target.down_m is None:
            return target.velocity_ned_mps[2] < -0.1
        return target.down_m < flight.down_m - 0.3

    def off(self, flight: FlightState) -> bool:
        return not flight.on_ground and flight.vd_mps < 0.0
