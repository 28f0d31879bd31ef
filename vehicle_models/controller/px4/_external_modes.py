"""Modes that a companion flies (px4-ros2-interface-lib): registration, arming checks, the kind of setpoint.

Numbers and rules are those of PX4's ModeManagement and ExternalChecks, and of docs.px4.io, "PX4 ROS 2 Control Interface".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..services._modes import Modes
from ..state._flight_state import Behaviour, ExternalMode, FlightMode, FlightState
from ..state._service_context import ServiceContext
from ..state._texts import CRITICAL
from ._modes import MODES, NAV_STATES, is_placed, knows_position

_Sample = Mapping[str, Any]

_REQUEST_NS, _REPLY_NS = 300_000_000, 50_000_000
# Requests without a reply in time until a mode is unresponsive: before its first reply, and later.
_MISSED_AT_FIRST, _MISSED = 10, 3
# So often a reply makes an unresponsive mode responsive again.
_RECOVERIES = 3
_MAX_CHECKS = 8
_NONE = -1
_SLOTS = tuple(mode for mode in MODES.modes if mode.behaviour is Behaviour.EXTERNAL)
_ALL_SLOTS = sum(1 << NAV_STATES[mode.name] for mode in _SLOTS)
DEFAULT_LEVEL = "position"
# The highest flag_control_NAME_enabled of config_control_setpoints (up to 1.17) decides, as in OffboardControlMode.
_LEVEL_FLAGS = {name: name for name in ("position", "velocity", "acceleration", "attitude")} | {
    "rates": "body_rate"
}
# SetpointConfig (from 1.18): goto, trajectory, rates, attitude. PX4 knows the others up to 16; they are not flown here.
_GOTO, _LAST_TYPE = 2, 16
_LEVEL_BY_TYPE = {_GOTO: "position", 4: "position", 5: "body_rate", 6: "attitude"}
_SUCCESS, _FAILURE, _UNSUPPORTED, _UNKNOWN_TYPE = range(4)
_NEEDED_BY_LEVEL = {
    "body_rate": ("angular_velocity",),
    "attitude": ("angular_velocity", "attitude"),
    "position": ("angular_velocity", "attitude", "local_alt", "local_position"),
}
# Of the mode_req_NAME in a reply: what a flight may lack.
_REQUIREMENTS: Mapping[str, Callable[[FlightState], bool]] = {
    "local_alt": knows_position,
    "local_position": is_placed,
    "local_position_relaxed": is_placed,
    "global_position": is_placed,
    "global_position_relaxed": is_placed,
    "mission": lambda flight: flight.mission_ready,
    "home_position": lambda flight: flight.home is not None,
    "manual_control": lambda flight: flight.sticks is not None,
}


@dataclass(slots=True)
class _Registration:
    """An arming check, with the mode that it is for; without one it is a check for all modes."""

    name: tuple[int, ...]
    label: str
    mode: FlightMode | None
    nav_state: int
    selectable: bool
    level: str = DEFAULT_LEVEL
    reply: _Sample = field(default_factory=dict)
    replied: bool = False  # to the last request
    missed: int = 0
    unresponsive: bool = False
    times_unresponsive: int = 0
    leaving: bool = False

    def take_reply(self, reply: _Sample) -> None:
        self.reply, self.replied, self.missed = reply, True, 0
        if self.times_unresponsive <= _RECOVERIES:
            self.unresponsive = False

    def count_missing(self) -> None:
        allowed = _MISSED if self.reply else _MISSED_AT_FIRST
        if self.replied or self.unresponsive:
            return
        self.missed += 1
        if self.missed > allowed:
            self.unresponsive = True
            self.times_unresponsive += 1

    def runs(self, flight: FlightState) -> bool:
        reply = self.reply
        if self.unresponsive or not reply.get("can_arm_and_run"):
            return False
        return all(met(flight) for name, met in _REQUIREMENTS.items() if reply.get(f"mode_req_{name}"))

    def shown(self, flight: FlightState) -> ExternalMode:
        runs = self.runs(flight)
        armable = runs and not self.reply["mode_req_prevent_arming"]
        return ExternalMode(self.label, runs, armable, self.selectable)


class ExternalModes:
    """Registers modes and asks whether they can be flown; `flight.external_modes` shows them to all services."""

    def __init__(
        self, context: ServiceContext, modes: Modes, wing: bool, publish: Callable[[str, _Sample], None]
    ) -> None:
        self._context, self._modes, self._wing, self._publish = context, modes, wing, publish
        self._registrations: dict[int, _Registration] = {}  # by arming_check_id
        # Of names that had a slot once: they get it again (COM_MODE0_HASH and further parameters of PX4).
        self._remembered: dict[tuple[int, ...], FlightMode] = {}
        self._request_id, self._requested_ns, self._counted = 0, -_REQUEST_NS, True

    def handlers(self) -> dict[str, Callable[[_Sample], bool]]:
        """By topic; False for what names no registered mode."""
        return {
            "/fmu/in/register_ext_component_request": self._register,
            "/fmu/in/unregister_ext_component": self._unregister,
            "/fmu/in/arming_check_reply": self._take_reply,
            "/fmu/in/config_control_setpoints": self._take_flags,
            "/fmu/in/setpoint_config": self._take_type,
        }

    def tick(self) -> None:
        """After the samples of a step, as PX4: replies, what is missing, and the next request."""
        flight = self._context.flight
        if not self._registrations and not flight.external_modes:
            return
        if self._changeable:
            self._remove()
        waited_ns = flight.time_ns - self._requested_ns
        if waited_ns > _REPLY_NS and not self._counted:
            self._counted = True
            for registration in self._registrations.values():
                registration.count_missing()
        if self._registrations and waited_ns > _REQUEST_NS:
            self._request()
        registrations = self._registrations.values()
        flight.external_modes = {each.mode.name: each.shown(flight) for each in registrations if each.mode}
        flight.companion_objects = any(not each.mode and not each.runs(flight) for each in registrations)

    @property
    def level(self) -> str:
        """What the active mode controls."""
        active = self._context.flight.mode
        levels = (each.level for each in self._registrations.values() if each.mode is active)
        return next(levels, DEFAULT_LEVEL)

    def requirements(self) -> dict[str, int]:
        """Masks of nav_states for FailsafeFlags; `mode_req_other` has those that cannot be flown."""
        masks = {"mode_req_other": _ALL_SLOTS}
        for registration in self._registrations.values():
            if registration.mode is None or registration.unresponsive:
                continue
            bit = 1 << registration.nav_state
            if registration.reply.get("can_arm_and_run"):
                masks["mode_req_other"] &= ~bit
            for name, needed in registration.reply.items():
                if name.startswith("mode_req_") and needed:
                    masks[name] = masks.get(name, 0) | bit
        return masks

    @property
    def _changeable(self) -> bool:
        return not self._context.flight.armed or self._context.parameters["COM_MODE_ARM_CHK"] != 0.0

    # Registration.

    def _register(self, m: _Sample) -> bool:
        # The layout of the message is that of a release: this field came with version 2.
        version = 2 if "not_user_selectable" in m else 1
        ids = dict.fromkeys(("arming_check_id", "mode_id", "mode_executor_id"), _NONE)
        refusal = self._refusal(m)
        if refusal:
            self._context.texts.send(CRITICAL, f"External mode not registered: {refusal}")
        elif m["register_arming_check"]:
            ids |= self._add(m)
        echo = {name: m[name] for name in ("request_id", "name", "not_user_selectable") if name in m}
        reply = {**echo, **ids, "px4_ros2_api_version": version, "success": not refusal}
        self._publish("register_ext_component_reply", reply)
        return True

    def _refusal(self, m: _Sample) -> str:
        """Why a request is refused; empty when it is not."""
        reasons = {
            "armed, and COM_MODE_ARM_CHK is 0": not self._changeable,
            "no mode executors and no replaced modes here": m["register_mode_executor"]
            or m["enable_replace_internal_mode"],
            "a mode needs an arming check": m["register_mode"] and not m["register_arming_check"],
            "eight have registered already": m["register_arming_check"]
            and len(self._registrations) >= _MAX_CHECKS,
        }
        return next((reason for reason, holds in reasons.items() if holds), "")

    def _add(self, m: _Sample) -> dict[str, int]:
        check = next(number for number in range(_MAX_CHECKS) if number not in self._registrations)
        mode = self._slot(m["name"]) if m["register_mode"] else None
        nav_state = NAV_STATES[mode.name] if mode else _NONE
        selectable = not m.get("not_user_selectable", False)
        text = bytes(m["name"]).split(b"\0")[0].decode("ascii", "ignore")
        label = "".join(filter(str.isprintable, text))
        self._registrations[check] = _Registration(m["name"], label, mode, nav_state, selectable)
        return {"arming_check_id": check, "mode_id": nav_state}

    def _slot(self, name: tuple[int, ...]) -> FlightMode:
        """The name's slot of last time, else one that no name had, else any."""
        taken = [each.mode for each in self._registrations.values()]
        free = [mode for mode in _SLOTS if mode not in taken]
        remembered = self._remembered.get(name)
        if remembered in free:
            return remembered
        unused = [mode for mode in free if mode not in self._remembered.values()]
        slot = (unused or free)[0]
        if remembered is None:
            self._remembered = {other: mode for other, mode in self._remembered.items() if mode is not slot}
            self._remembered[name] = slot
        return slot

    def _unregister(self, m: _Sample) -> bool:
        registration = self._registrations.get(m["arming_check_id"])
        if registration is None or (registration.name, registration.nav_state) != (m["name"], m["mode_id"]):
            return False
        registration.leaving = True
        return True

    def _remove(self) -> None:
        """Those that leave, and the unresponsive ones that nobody has chosen."""
        for number, registration in list(self._registrations.items()):
            chosen = registration.mode is not None and registration.mode is self._context.flight.asked_mode
            if registration.leaving or (registration.unresponsive and not chosen):
                del self._registrations[number]
                if chosen:
                    self._modes.switch(MODES.hold)

    # Arming checks.

    def _take_reply(self, m: _Sample) -> bool:
        registration = self._registrations.get(m["registration_id"])
        if registration is None or m["request_id"] != self._request_id:
            return False
        registration.take_reply(m)
        return True

    def _request(self) -> None:
        self._request_id = (self._request_id + 1) % 256
        self._requested_ns, self._counted = self._context.flight.time_ns, False
        mask = 0
        for number, registration in self._registrations.items():
            registration.replied = False
            mask |= 0 if registration.unresponsive else 1 << number
        request = {"request_id": self._request_id, "valid_registrations_mask": mask}
        self._publish("arming_check_request", request)

    # The kind of setpoint.

    def _registered(self, nav_state: int) -> _Registration | None:
        registrations = self._registrations.values()
        return next((each for each in registrations if each.mode and each.nav_state == nav_state), None)

    def _take_flags(self, m: _Sample) -> bool:
        registration = self._registered(m["source_id"])
        if registration is None:
            return False
        flags = (level for name, level in _LEVEL_FLAGS.items() if m[f"flag_control_{name}_enabled"])
        registration.level = next(flags, "")
        return True

    def _take_type(self, m: _Sample) -> bool:
        registration, kind = self._registered(m["source_id"]), m["type"]
        level = _LEVEL_BY_TYPE.get(kind)
        if not 0 < kind <= _LAST_TYPE:
            result = _UNKNOWN_TYPE
        elif level is None or (kind == _GOTO and self._wing):
            result = _UNSUPPORTED
        else:
            result = _SUCCESS if registration else _FAILURE
        needed = _NEEDED_BY_LEVEL[level] if level and result == _SUCCESS else ()
        reply = {"type": kind, "source_id": m["source_id"], "result": result}
        self._publish("setpoint_config_reply", {**reply, **{f"mode_req_{name}": True for name in needed}})
        if registration and level and result == _SUCCESS and m["should_apply"]:
            registration.level = level
        return result == _SUCCESS
