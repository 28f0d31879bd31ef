"""Failsafes: what happens when the companion, the ground station or the battery leave the vehicle alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._board import Board, CommandHandler, Handler, Sender
from ._flight import Behaviour, Flight
from ._guidance import Guidance
from ._modes import Modes
from ._personality import Event
from ._setpoints import Setpoints

_GROUND_STATION = 6  # MAV_TYPE_GCS


class Failsafe:
    """Watches links and battery; acts through the modes and names what it did in `flight.failsafe`."""

    def __init__(self, board: Board, modes: Modes, guidance: Guidance, setpoints: Setpoints) -> None:
        self._board = board
        self._modes = modes
        self._guidance = guidance
        self._setpoints = setpoints
        self._station_ns: int | None = None
        self._station_lost = False
        self._setpoints_lost = False
        self._battery_step = 0
        self._then: tuple[int, Behaviour] | None = None
        self._acting = False
        modes.on_change.append(self._mode_changed)

    def handlers(self) -> Mapping[str, Handler]:
        return {"HEARTBEAT": self._heartbeat}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        flight = self._board.flight
        if not flight.armed:
            self._clear(flight)
            return
        self._watch_setpoints(flight)
        self._watch_station(flight)
        self._watch_battery(flight)
        if self._then and flight.time_ns >= self._then[0]:
            behaviour, self._then = self._then[1], None
            self._say(Event.FAILSAFE)
            self._enter(behaviour)

    def _clear(self, flight: Flight) -> None:
        flight.failsafe, self._then, self._setpoints_lost = "", None, False

    def _heartbeat(self, m: Any, sender: Sender) -> None:
        if m.type != _GROUND_STATION or not self._board.personality.is_station(sender.system, self._board.parameters):
            return
        self._station_ns = self._board.flight.time_ns
        if self._station_lost:
            self._station_lost = False
            self._say(Event.STATION_BACK)
            if self._board.flight.failsafe == "link":
                self._board.flight.failsafe = ""

    def _watch_setpoints(self, flight: Flight) -> None:
        personality = self._board.personality
        if not personality.returns_to_setpoints:
            return
        if flight.mode.behaviour is Behaviour.FOLLOW and not self._setpoints.fresh():
            self._setpoints_lost = True
            self._say(Event.SETPOINTS_LOST)
            self._start(flight, "setpoints", personality.setpoints_lost_behaviour, 0.0)
        elif self._setpoints_lost and self._setpoints.fresh() and flight.flying:
            self._setpoints_lost = False
            flight.failsafe, self._then = "", None
            self._enter(Behaviour.FOLLOW)
            self._setpoints.resume()

    def _watch_station(self, flight: Flight) -> None:
        limits = self._guidance.limits
        if self._station_ns is None or self._station_lost:
            return
        if flight.time_ns - self._station_ns >= round(limits.station_timeout_s * 1e9):
            self._station_lost = True
            if limits.station_action is not None:
                self._say(Event.STATION_LOST)
                self._start(flight, "link", limits.station_action, limits.station_holds_s)

    def _watch_battery(self, flight: Flight) -> None:
        steps = self._guidance.limits.battery
        while self._battery_step < len(steps) and flight.battery_fraction < steps[self._battery_step].below:
            step = steps[self._battery_step]
            self._battery_step += 1
            self._say(step.event)
            if step.action is not None:
                self._start(flight, "battery", step.action, step.holds_s)

    def _start(self, flight: Flight, name: str, behaviour: Behaviour, holds_s: float) -> None:
        flight.failsafe = name
        if holds_s > 0.0:
            self._say(Event.FAILSAFE_HOLD)
            self._enter(Behaviour.HOLD)
            self._then = (flight.time_ns + round(holds_s * 1e9), behaviour)
        else:
            self._say(Event.FAILSAFE)
            self._enter(behaviour)

    def _enter(self, behaviour: Behaviour) -> None:
        """Change the mode for the failsafe itself, so that it is not taken for a wish of the operator."""
        self._acting = True
        self._modes.to(behaviour)
        self._acting = False

    def _mode_changed(self) -> None:
        """Somebody chose another mode: what the failsafe had in mind is over."""
        if not self._acting:
            self._board.flight.failsafe, self._then, self._setpoints_lost = "", None, False

    def _say(self, event: Event) -> None:
        if event in self._board.personality.texts:
            severity, text = self._board.personality.texts[event]
            self._board.texts.say(severity, text)
