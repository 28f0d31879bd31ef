"""Failsafes: what happens when companion, ground station, sticks, battery or position leave the vehicle alone.

One place where an action is carried out: `react` with a cause's name and what to do about it, `over` when it has gone.
Other services (a fence, say) come here as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from .._flight import Behaviour, Flight, Mode
from .._service import CommandHandler, Handler, Sender
from .._service_context import ServiceContext
from ..services._modes import Modes
from ..services._setpoints import Setpoints
from ._failsafe_policy import BatteryStep, Failsafes, Reaction, Text

_GROUND_STATION = 6  # MAV_TYPE_GCS
_STRENGTH = {Behaviour.HOLD: 1, Behaviour.RETURN: 2, Behaviour.LAND: 3, Behaviour.TERMINATE: 4}
_NEEDS_PLACE = (
    Behaviour.HOLD,
    Behaviour.TAKEOFF,
    Behaviour.RETURN,
    Behaviour.FOLLOW,
    Behaviour.MISSION,
    Behaviour.CIRCLE,
)


class Failsafe:
    """Watches links, sticks, battery and position; acts through the modes and names what it did in `flight.failsafe`."""

    def __init__(self, board: ServiceContext, modes: Modes, setpoints: Setpoints, disarm: Callable[[], None]) -> None:
        self._board = board
        self._modes = modes
        self._setpoints = setpoints
        self._disarm = disarm
        self._policy: Failsafes = board.personality.failsafes(board.parameters)
        board.parameters.on_change(self._parameters_changed)
        self._causes: dict[str, Reaction] = {}  # at work, oldest first
        self._before: Mode | None = None  # the mode that the first of them ended
        self._then: tuple[int, str] | None = None  # when the hold ends, and for which cause
        self._acting = False
        self._station_ns: int | None = None
        self._station_lost = False
        self._battery_step = 0
        self._low_since_ns: int | None = None
        self._radio_lost_ns: int | None = None
        modes.on_change.append(self._mode_changed)

    def handlers(self) -> Mapping[str, Handler]:
        return {"HEARTBEAT": self._heartbeat}

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        flight = self._board.flight
        if not flight.armed:
            if self._causes or flight.failsafe:
                self._clear()
            if self._battery_step and not self._low(flight, self._policy.battery[0]):
                self._battery_step = 0  # it has been charged
            return
        self._watch_setpoints(flight)
        self._watch_sticks(flight)
        self._watch_station(flight)
        self._watch_battery(flight)
        self._watch_radio(flight)
        self._watch_place(flight)
        if self._then and flight.time_ns >= self._then[0]:
            reaction, self._then = self._causes[self._then[1]], None
            self._act(reaction)

    def react(self, name: str, reaction: Reaction) -> None:
        """Do what `reaction` says because of the cause `name`, shown in `flight.failsafe`."""
        flight = self._board.flight
        if not flight.armed:
            return
        if self._policy.ground_disarms and reaction.action is not None and not flight.flying:
            self._say((severity, text + self._policy.ground_words) for severity, text in reaction.texts)
            self._disarm()
            return
        self._say(reaction.texts)
        stronger = self._strongest()
        if reaction.shows:
            self._causes.pop(name, None)
            self._causes[name] = reaction
            flight.failsafe = name
        if reaction.action is None or (self._policy.strongest and _strength(reaction) <= stronger):
            return
        if reaction.action is Behaviour.TERMINATE:  # no hold before it, and none that goes on
            self._then = None
        if self._then:  # the hold that runs already ends for this cause
            self._then = (self._then[0], name)
            return
        self._before = self._before or flight.mode
        if reaction.holds_s > 0.0 and not stronger:
            self._say(self._policy.hold_texts)
            self._enter(Behaviour.HOLD)
            self._then = (flight.time_ns + round(reaction.holds_s * 1e9), name)
        else:
            self._act(reaction)

    def over(self, name: str) -> None:
        """The cause has gone: back to what was before, where that is how it goes, or during the hold."""
        reaction = self._causes.get(name)
        if reaction is None:
            return
        held = self._then is not None and self._then[1] == name
        if self._policy.latched and not (held or reaction.resumes):
            return
        del self._causes[name]
        flight = self._board.flight
        flight.failsafe = next(reversed(self._causes), "")
        if not (held or reaction.resumes) or any(one.action for one in self._causes.values()):
            return
        before, self._before, self._then = self._before, None, None
        if before is not None and flight.flying:
            self._acting = True
            self._modes.switch(before)
            self._acting = False
            if before.behaviour is Behaviour.FOLLOW:
                self._setpoints.resume()

    def charge_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE: 1 is well."""
        return self._policy.battery[self._battery_step - 1].charge_state if self._battery_step else 1

    def _heartbeat(self, m: Any, sender: Sender) -> None:
        if m.type != _GROUND_STATION or not self._board.personality.is_station(sender.system, self._board.parameters):
            return
        self._station_ns = self._board.flight.time_ns
        if self._station_lost:
            self._station_lost = False
            if "link" in self._causes:
                self._say(self._policy.station_back)
            self.over("link")

    def _watch_setpoints(self, flight: Flight) -> None:
        reaction = self._policy.setpoints
        if reaction is None:
            return
        if "setpoints" in self._causes:
            if flight.flying and self._setpoints.fresh():
                self.over("setpoints")
        elif flight.mode.behaviour is Behaviour.FOLLOW and not self._setpoints.fresh():
            self.react("setpoints", reaction)

    def _watch_sticks(self, flight: Flight) -> None:
        reaction = self._policy.sticks
        if reaction is None:
            return
        if "sticks" in self._causes:
            if flight.sticks is not None:
                self.over("sticks")
        elif flight.mode.behaviour is Behaviour.PILOT and flight.sticks is None and flight.flying:
            self.react("sticks", reaction)

    def _watch_station(self, flight: Flight) -> None:
        if self._station_ns is None or self._station_lost:
            return
        if flight.time_ns - self._station_ns >= round(self._policy.station_timeout_s * 1e9):
            self._station_lost = True
            if self._policy.station_note:
                self._board.texts.note(*self._policy.station_note)
            if self._policy.station is not None:
                self.react("link", self._policy.station)

    def _watch_battery(self, flight: Flight) -> None:
        steps = self._policy.battery
        if self._battery_step >= len(steps):
            return
        step = steps[self._battery_step]
        if not self._low(flight, step):
            self._low_since_ns = None
            return
        if self._low_since_ns is None:
            self._low_since_ns = flight.time_ns
        if flight.time_ns - self._low_since_ns >= round(step.lasts_s * 1e9):
            self._low_since_ns = None
            self._battery_step += 1
            self.react("battery", step.reaction)

    def _low(self, flight: Flight, step: BatteryStep) -> bool:
        return flight.battery_fraction < step.fraction or self._volts(flight) < step.volts

    def _watch_place(self, flight: Flight) -> None:
        """Modes that need a position end when the estimate of it has been given up."""
        reaction = self._policy.position
        if flight.position_ok:
            self.over("position")
        elif reaction and "position" not in self._causes and flight.flying and flight.mode.behaviour in _NEEDS_PLACE:
            self.react("position", reaction)

    def _watch_radio(self, flight: Flight) -> None:
        policy = self._policy
        if policy.radio is None:
            return
        if not policy.radio_silent:
            self._radio_lost_ns = None
            if "radio" in self._causes:
                self._say(policy.radio_back)
                self.over("radio")
            return
        if self._radio_lost_ns is None:
            self._radio_lost_ns = flight.time_ns
        waited = flight.time_ns - self._radio_lost_ns >= round(policy.radio_after_s * 1e9)
        if waited and "radio" not in self._causes:
            self.react("radio", policy.radio)

    def _strongest(self) -> int:
        return max((_strength(one) for one in self._causes.values()), default=0)

    def _act(self, reaction: Reaction) -> None:
        self._say(reaction.acts)
        if reaction.action is not None:
            self._enter(reaction.action)

    def _enter(self, behaviour: Behaviour) -> None:
        """Change the mode for the failsafe itself, so that it is not taken for a wish of the operator."""
        flight = self._board.flight
        if behaviour in (Behaviour.RETURN, Behaviour.HOLD) and (flight.home is None or not flight.position_ok):
            behaviour = Behaviour.LAND
        self._acting = True
        if behaviour is Behaviour.TERMINATE:
            self._terminate()
        else:
            self._modes.to(behaviour)
        self._acting = False

    def _terminate(self) -> None:
        for mode in self._board.personality.modes:
            if mode.behaviour is Behaviour.TERMINATE:
                self._modes.switch(mode)
                return
        self._disarm()

    def _mode_changed(self) -> None:
        """Somebody chose another mode: what the failsafe had in mind is over."""
        if self._acting:
            return
        self._then = self._before = None
        if self._policy.latched:
            self._clear()

    def _clear(self) -> None:
        self._causes.clear()
        self._board.flight.failsafe, self._then, self._before = "", None, None

    def _parameters_changed(self) -> None:
        self._policy = self._board.personality.failsafes(self._board.parameters)
        self._battery_step = min(self._battery_step, len(self._policy.battery))

    def _volts(self, flight: Flight) -> float:
        return self._board.personality.battery_volts(flight, self._board.parameters)

    def _say(self, texts: Iterable[Text]) -> None:
        flight = self._board.flight
        for severity, text in texts:
            if "{" in text:
                used_mah = flight.battery_used_wh / 14.8 * 1000.0
                text = text.format(volts=self._volts(flight), used_mah=used_mah)
            self._board.texts.say(severity, text)


def _strength(reaction: Reaction) -> int:
    return _STRENGTH.get(reaction.action, 0) if reaction.action else 0
