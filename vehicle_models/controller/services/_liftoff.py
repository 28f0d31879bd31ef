"""Leaving the ground and coming back to it: from the land detector's view to the flight's landed state."""

from __future__ import annotations

from ..guidance._guidance import Guidance
from ..guidance._land_detector import LandDetector
from ..guidance._manoeuvres import Takeoff
from ..guidance._return import Return
from ..policies._modes import ModePolicy
from ..state._flight_state import Behaviour, FlightTarget, LandedState
from ..state._service_context import ServiceContext
from ..state._texts import FlightEvent
from ._arming import Arming

# Looked up once, because every step compares with them.
_TAKING_OFF, _LANDING = LandedState.TAKING_OFF, LandedState.LANDING
# Above home; where no takeoff is flown, the vehicle is in the air from here on.
_IN_AIR_M = 0.5


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
                if (
                    isinstance(takeoff, Takeoff)
                    and flight.mode.behaviour is Behaviour.OFFBOARD
                    and not self._policy.takeoff
                ):
                    guidance.begin(Behaviour.OFFBOARD, flight)
                    guidance.manoeuvre = guidance.manoeuvres.follow(flight, takeoff.hold(flight))
        elif flight.landed is _LANDING:
            flight.landed = LandedState.IN_AIR
