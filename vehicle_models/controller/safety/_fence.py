"""The fence service: what happens when the vehicle is beyond the fence, or flies towards it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from ..guidance._fence_boundary import FenceBoundary
from ..links._enums import MAV_CMD
from ..policies._safety import Breach
from ..services._modes import Modes
from ..state._flight_state import Cause, FlightState, FlightTarget
from ..state._service import Command, CommandHandler, CommandResult, Stream, Values
from ..state._service_context import ServiceContext
from ._failsafe import Failsafe

# Ten checks a second are enough for a vehicle that moves at 20 m/s.
_CHECK_NS = 100_000_000
# Before the ceiling and the edges.
_BRAKING_MPS2 = 1.0
# The vehicle is not slowed down below this, and may pass an edge so slowly.
_MIN_EDGE_MPS = 0.5
# So far inside a breach is over.
_CLEARED_INSIDE_M = 1.0
# First parameter of DO_FENCE_ENABLE.
_DISABLE_FLOOR = 2.0


class Fence:
    """Watches the fence while the vehicle flies. A breach has one reaction, until it is over."""

    def __init__(
        self, context: ServiceContext, boundary: FenceBoundary, modes: Modes, failsafe: Failsafe
    ) -> None:
        self._context = context
        self._boundary = boundary
        self._policy = boundary.policy
        self._failsafe = failsafe
        self._due_ns = 0
        self._breach, self._breached_ns, self._count = Breach.NONE, 0, 0
        # How far outside the vehicle was at the last reaction; None: it is inside
        self._acted_m: float | None = None
        self._recovery_until_ns = 0
        self._holds_back = False
        modes.on_change.append(self._mode_changed)

    def commands(self) -> Mapping[int, CommandHandler]:
        return {MAV_CMD.DO_FENCE_ENABLE: self._enable} if self._policy.enable_command else {}

    def streams(self) -> Mapping[str, Stream]:
        return {"FENCE_STATUS": self._status}

    def tick(self) -> None:
        flight, boundary = self._context.flight, self._boundary
        if flight.time_ns < self._due_ns:
            return
        self._due_ns = flight.time_ns + _CHECK_NS
        if not flight.armed or not flight.flying or not boundary.enabled:
            self._breach, self._acted_m, self._recovery_until_ns = Breach.NONE, None, 0
            return
        if flight.time_ns < self._recovery_until_ns:
            return
        place = (flight.north_m, flight.east_m)
        self._breach = boundary.breach(place, flight.height_m, 0.0)
        if self._breach is not Breach.NONE:
            outside_m = boundary.outside_m(self._breach, place, flight.height_m)
            farther = outside_m > (self._acted_m or 0.0) + self._policy.repeat_distance_m
            if self._acted_m is None or (self._breach is not Breach.POLYGON and farther):
                self._act(flight, outside_m)
        # A margin keeps noise of the position from ending and renewing the breach.
        elif (
            self._acted_m is not None
            and boundary.breach(place, flight.height_m, _CLEARED_INSIDE_M) is Breach.NONE
        ):
            self._acted_m = None
            self._failsafe.clear(Cause.FENCE)
            self._context.texts.report(self._policy.cleared_text)

    def constrained(self, flight: FlightState, target: FlightTarget) -> FlightTarget:
        """The target as flown near the fence where the autopilot avoids it: slower, and below the ceiling."""
        self._holds_back = False
        margin_m = self._boundary.limits.ceiling_margin_m
        if margin_m is None or not self._boundary.enabled:
            return target
        return self._before_edges(flight, self._under_ceiling(flight, target, margin_m))

    def _under_ceiling(self, flight: FlightState, target: FlightTarget, margin_m: float) -> FlightTarget:
        ceiling_m = self._boundary.limits.ceiling_m
        if ceiling_m is None or flight.height_m > ceiling_m:
            # Too late: the reaction to the breach is flown.
            return target
        remaining_m = ceiling_m - margin_m - flight.height_m
        north, east, down = target.velocity_ned_mps
        max_climb_mps = math.sqrt(2.0 * _BRAKING_MPS2 * remaining_m) if remaining_m > 0.0 else 0.0
        if target.down_m is None and -down > max_climb_mps:
            self._holds_back = True
            return replace(target, velocity_ned_mps=(north, east, -max_climb_mps))
        if target.down_m is not None and target.down_m < flight.down_m - max(remaining_m, 0.0):
            self._holds_back = True
            return replace(target, down_m=flight.down_m - max(remaining_m, 0.0))
        return target

    def _before_edges(self, flight: FlightState, target: FlightTarget) -> FlightTarget:
        """Slow down velocities; a position beyond an edge has been refused before."""
        north, east, down = target.velocity_ned_mps
        if target.north_east_m is not None or self._breach is not Breach.NONE or north == east == 0.0:
            return target
        place = (flight.north_m, flight.east_m)
        for edge in self._boundary.nearest_edges(place):
            remaining_m = math.dist(edge, place)
            if remaining_m < 1e-6:
                continue
            direction = ((edge[0] - place[0]) / remaining_m, (edge[1] - place[1]) / remaining_m)
            max_mps = max(math.sqrt(2.0 * _BRAKING_MPS2 * remaining_m), _MIN_EDGE_MPS)
            excess = north * direction[0] + east * direction[1] - max_mps
            if excess > 0.0:
                self._holds_back = True
                north, east = north - excess * direction[0], east - excess * direction[1]
        return replace(target, velocity_ned_mps=(north, east, down)) if self._holds_back else target

    def _status(self) -> Values | None:
        """FENCE_STATUS; None while there is no fence."""
        if not self._boundary.enabled:
            return None
        # FENCE_BREACH has one value for every boundary.
        breach = (int(self._breach is not Breach.NONE), int(min(self._breach, Breach.CIRCLE)))
        return (self._breached_ns // 1_000_000, self._count, *breach, 2 if self._holds_back else 1)

    def _act(self, flight: FlightState, outside_m: float) -> None:
        self._acted_m, self._breached_ns, self._count = outside_m, flight.time_ns, min(self._count + 1, 65535)
        reaction = self._policy.reaction(self._breach, outside_m, self._context.parameters)
        self._failsafe.trigger(Cause.FENCE, reaction)

    def _mode_changed(self) -> None:
        """Give an operator who changes the mode during a breach time to bring the vehicle back."""
        if self._breach is Breach.NONE or self._policy.recovery_text is None:
            return
        self._recovery_until_ns = self._context.flight.time_ns + round(self._policy.recovery_s * 1e9)
        self._context.texts.send(*self._policy.recovery_text)

    def _enable(self, command: Command) -> CommandResult | None:
        if command.params[0] not in (0.0, 1.0, _DISABLE_FLOOR):
            return CommandResult.FAILED
        # There is no floor here, so there is nothing to disable.
        if command.params[0] != _DISABLE_FLOOR:
            self._boundary.enable(command.params[0] == 1.0)
        return CommandResult.ACCEPTED
