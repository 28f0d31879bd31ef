"""Leaving the ground and coming back to it: from the land detector's view to the flight's landed state."""

from __future__ import annotations

import math

from ..guidance._guidance import Guidance
from ..guidance._manoeuvres import Takeoff
from ..guidance._return import Return
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, FlightState, FlightTarget, LandedState
from ..state._service_context import ServiceContext
from ..state._texts import FlightEvent
from ._arming import Arming

# Looked up once, because every step compares with them.
_TAKING_OFF, _LANDING = LandedState.TAKING_OFF, LandedState.LANDING
# Above home; where no takeoff is flown, the vehicle is in the air from here on.
_IN_AIR_M = 0.5


class LandDetector:
    """On the ground: the feet touch, nothing moves, and the target is not above the vehicle."""

    def __init__(self) -> None:
        self._still_s = 0.0

    def landed(self, flight: FlightState, target: FlightTarget, settles_s: float) -> bool:
        """Whether the vehicle has been at rest on the ground for long enough; called once a step while it flies."""
        attitude = target.attitude
        still = flight.on_ground and abs(flight.vd_mps) < 0.15
        # With a commanded thrust there is no target height or velocity to compare with.
        if attitude and attitude.thrust is not None:
            settles = still and attitude.thrust < 0.75 * flight.hover_thrust
        else:
            # A target above the vehicle means that it is about to leave, though its feet still touch.
            wants_down = target.velocity_ned_mps[2] > 0.05
            if target.down_m is not None:
                wants_down = target.down_m > flight.down_m - 0.05
            # Without an estimate of position the horizontal speed is not known either: both autopilots go without it.
            slow = not flight.position_ok or math.hypot(flight.vn_mps, flight.ve_mps) < 0.5
            settles = still and wants_down and slow
        self._still_s = self._still_s + flight.step_s if settles else 0.0
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


class LiftoffAndLanding:
    """Keeps `flight.landed` while the vehicle is armed."""

    def __init__(
        self, context: ServiceContext, policy: ModePolicy, guidance: Guidance, arming: Arming
    ) -> None:
        self._context = context
        self._policy = policy
        self._guidance = guidance
        self._arming = arming
        self._detector = LandDetector()
        self._landing: Return | None = None  # the return whose landing has been announced

    def rest_disarmed(self) -> None:
        """A vehicle that was disarmed by force just above the ground has landed when it meets the ground."""
        flight = self._context.flight
        if flight.on_ground:
            flight.landed = LandedState.ON_GROUND

    def update(self, target: FlightTarget) -> bool:
        """Follow one step with its target; whether the vehicle flies during it."""
        flight = self._context.flight
        if flight.flying:
            self._follow_flight(target)
        elif self._detector.wants_off(flight, target):
            self._lift_off()
        return flight.flying

    def _lift_off(self) -> None:
        self._context.flight.landed = LandedState.TAKING_OFF
        self._detector = LandDetector()
        self._arming.record_liftoff()
        self._context.texts.announce(FlightEvent.TAKEOFF_DETECTED)

    def _follow_flight(self, target: FlightTarget) -> None:
        """Follow the vehicle from liftoff to landing."""
        flight, guidance = self._context.flight, self._guidance
        if self._detector.landed(flight, target, guidance.limits.landing_settles_s):
            flight.landed = LandedState.ON_GROUND
            self._context.texts.announce(FlightEvent.LANDING_DETECTED)
            self._arming.record_landing()
        elif guidance.landing:
            flight.landed = LandedState.LANDING
            manoeuvre = guidance.manoeuvre
            if manoeuvre is not self._landing and isinstance(manoeuvre, Return) and manoeuvre.lands:
                self._landing = manoeuvre
                self._context.texts.announce(FlightEvent.RETURN_LANDS)
        elif flight.landed is _TAKING_OFF:
            takeoff = guidance.manoeuvre
            reached = takeoff.done(flight) if isinstance(takeoff, Takeoff) else flight.height_m > _IN_AIR_M
            if reached:
                flight.landed = LandedState.IN_AIR
                # Guided mode has no takeoff mode of its own; from here on it waits for setpoints.
                guided = flight.mode.behaviour is Behaviour.OFFBOARD and not self._policy.takeoff
                if guided and isinstance(takeoff, Takeoff):
                    guidance.begin(Behaviour.OFFBOARD, flight)
                    guidance.manoeuvre = guidance.manoeuvres.follow(flight, takeoff.hold(flight))
        elif flight.landed is _LANDING:
            flight.landed = LandedState.IN_AIR
