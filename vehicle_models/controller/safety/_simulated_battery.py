"""The battery that PX4's simulation pretends when asked to: by the clock alone, whatever the rotors draw.

It is what the autopilot measures and acts on. The vehicle's own battery goes on emptying behind it, and stops the rotors.
"""

from __future__ import annotations

from collections.abc import Mapping

from .._service import CommandHandler, Handler
from .._service_context import ServiceContext


class SimulatedBattery:
    """Drains while armed, never below its least charge, and is full again when disarmed."""

    def __init__(self, board: ServiceContext) -> None:
        self._board = board
        self._plan = board.personality.pretended_battery(board.parameters)
        board.parameters.on_change(self._changed)
        self._fraction = 1.0

    def handlers(self) -> Mapping[str, Handler]:
        return {}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        flight, plan = self._board.flight, self._plan
        if plan is None:
            flight.pretended_fraction = None
            self._fraction = 1.0
            return
        left = self._fraction - flight.step_s / plan.empties_s if flight.armed else 1.0
        self._fraction = flight.pretended_fraction = max(left, plan.least_fraction)

    def _changed(self) -> None:
        self._plan = self._board.personality.pretended_battery(self._board.parameters)
