"""Setpoints of a companion: offboard in PX4's words, guided in ArduPilot's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ._board import Board, CommandHandler, Handler, Sender
from ._flight import Behaviour, Target
from ._guidance import Follow, Guidance
from ._texts import CRITICAL

_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION = 0x007, 0x038, 0x1C0
_NO_YAW, _NO_YAW_RATE = 0x400, 0x800
_NO_XY, _NO_Z = 0x003, 0x004
_NO_VXY, _NO_VZ = 0x018, 0x020


class Setpoints:
    """SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT. Attitude setpoints are counted and not flown yet."""

    def __init__(self, board: Board, guidance: Guidance) -> None:
        self._board = board
        self._guidance = guidance
        self._last_ns: int | None = None
        self._lapses = False
        self._last: Target | None = None
        self.ignored = 0

    def handlers(self) -> Mapping[str, Handler]:
        return {
            "SET_POSITION_TARGET_LOCAL_NED": self._local,
            "SET_POSITION_TARGET_GLOBAL_INT": self._global,
            "SET_ATTITUDE_TARGET": self._attitude,
        }

    def commands(self) -> Mapping[int, CommandHandler]:
        return {}

    def tick(self) -> None:
        """A companion that has fallen silent where that ends its motion, but not its mode."""
        board = self._board
        if (
            not board.personality.returns_to_setpoints
            and self._lapses
            and not self.fresh()
            and isinstance(self._guidance.manoeuvre, Follow)
        ):
            self._guidance.manoeuvre.lapse(board.flight)
            self._lapses = False

    def fresh(self) -> bool:
        """Whether setpoints have come within the timeout."""
        return self._last_ns is not None and self._board.flight.time_ns - self._last_ns < round(
            self._guidance.limits.setpoint_timeout_s * 1e9
        )

    def resume(self) -> None:
        """Go on with the last setpoint, after the mode was entered again."""
        if self._last and isinstance(self._guidance.manoeuvre, Follow):
            self._guidance.manoeuvre.give(self._last)

    def _local(self, m: Any, sender: Sender) -> None:
        kind = self._board.personality.local_frames.get(m.coordinate_frame)
        if kind is None:
            self._complain(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {m.coordinate_frame} unsupported")
            return
        flight = self._board.flight
        position, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
        yaw = m.yaw
        if kind == "body":
            position, velocity = _turned(position, flight.yaw_rad), _turned(velocity, flight.yaw_rad)
            yaw += flight.yaw_rad
        if kind in ("body", "offset"):
            position = (position[0] + flight.north_m, position[1] + flight.east_m, position[2] + flight.down_m)
        self._take("SET_POSITION_TARGET_LOCAL_NED", m.type_mask, position, velocity, yaw, m.yaw_rate)

    def _global(self, m: Any, sender: Sender) -> None:
        kind = self._board.personality.global_frames.get(m.coordinate_frame)
        if kind is None:
            self._complain(f"SET_POSITION_TARGET_GLOBAL_INT coordinate frame {m.coordinate_frame} unsupported")
            return
        flight = self._board.flight
        if abs(m.lat_int) > 900_000_000 or abs(m.lon_int) > 1_800_000_000:
            self.ignored += 1
            return
        north, east = self._board.airframe.to_local_m(m.lat_int * 1e-7, m.lon_int * 1e-7)
        home = flight.home or flight.origin
        amsl = m.alt + (home.altitude_m if kind == "home" else 0.0)
        position = (north, east, flight.origin.altitude_m - amsl)
        self._take("SET_POSITION_TARGET_GLOBAL_INT", m.type_mask, position, (m.vx, m.vy, m.vz), m.yaw, m.yaw_rate)

    def _attitude(self, m: Any, sender: Sender) -> None:
        self.ignored += 1

    def _take(
        self,
        name: str,
        mask: int,
        position: tuple[float, float, float],
        velocity: tuple[float, float, float],
        yaw: float,
        yawrate: float,
    ) -> None:
        target = self._target(mask, position, velocity, yaw, yawrate)
        if target is None:
            self._complain(f"{name} invalid")
            return
        flight = self._board.flight
        if not self._board.personality.setpoint_complaints and flight.mode.behaviour is not Behaviour.FOLLOW:
            self.ignored += 1  # heard in another mode than guided, where nobody waits for them
            return
        self._last_ns, self._last = flight.time_ns, target
        self._lapses = target.north_east_m is None or self._board.personality.position_setpoints_lapse
        if flight.mode.behaviour is Behaviour.FOLLOW:
            if not isinstance(self._guidance.manoeuvre, Follow):
                self._guidance.manoeuvre = Follow(flight)
            self._guidance.manoeuvre.give(target)

    def _target(
        self,
        mask: int,
        position: tuple[float, float, float],
        velocity: tuple[float, float, float],
        yaw: float,
        yawrate: float,
    ) -> Target | None:
        """What a setpoint means; None when it leaves horizontal or vertical motion open, or is not finite."""
        has_xy, has_z = not mask & _NO_XY, not mask & _NO_Z
        has_vxy, has_vz = not mask & _NO_VXY, not mask & _NO_VZ
        if not (has_xy or has_vxy) or not (has_z or has_vz):
            return None
        used = (*(position[:2] if has_xy else ()), *(position[2:] if has_z else ()))
        used += (*(velocity[:2] if has_vxy else ()), *(velocity[2:] if has_vz else ()))
        has_yaw, has_rate = not mask & _NO_YAW, not mask & _NO_YAW_RATE
        used += (*((yaw,) if has_yaw else ()), *((yawrate,) if has_rate else ()))
        if not all(math.isfinite(one) and abs(one) < 1e6 for one in used):
            return None
        limits = self._guidance.limits
        return Target(
            north_east_m=(position[0], position[1]) if has_xy else None,
            down_m=position[2] if has_z else None,
            velocity_ned_mps=(
                velocity[0] if has_vxy else 0.0,
                velocity[1] if has_vxy else 0.0,
                velocity[2] if has_vz else 0.0,
            ),
            yaw_rad=yaw if has_yaw else None,
            yawrate_radps=yawrate if has_rate else 0.0,
            speed_max_mps=limits.speed_max_mps,
            climb_max_mps=limits.setpoint_climb_mps,
            descent_max_mps=limits.setpoint_descent_mps,
        )

    def _complain(self, text: str) -> None:
        self.ignored += 1
        if self._board.personality.setpoint_complaints:
            self._board.texts.say(CRITICAL, text)


def _turned(vector: tuple[float, float, float], yaw_rad: float) -> tuple[float, float, float]:
    """A vector of the level body frame (forward, right, down) in north, east, down."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1], vector[2]
