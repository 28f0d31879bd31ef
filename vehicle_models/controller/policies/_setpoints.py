"""How an autopilot takes setpoints of a companion, and sticks of a pilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ..state._flight_state import Behaviour
from ..state._texts import StatusText

LocalFrame = Literal["local", "offset", "body", "body-velocity"]
GlobalFrame = Literal["amsl", "home", "ground"]


@dataclass(frozen=True, slots=True, kw_only=True)
class SetpointPolicy:
    """SET_POSITION_TARGET_LOCAL_NED and _GLOBAL_INT, SET_ATTITUDE_TARGET, their echo, and sticks."""

    local_frames: Mapping[int, LocalFrame]
    global_frames: Mapping[int, GlobalFrame]
    bad_local_frame: str
    bad_global_frame: StatusText
    complains: bool
    axes_in_groups: bool
    speed_command_binds: bool
    faces_motion: bool
    fails_safe_when_lost: bool
    position_lapses: bool
    echo_behaviours: tuple[Behaviour, ...] | None
    """Modes in which POSITION_TARGET_* are sent; None: in all, also while disarmed."""
    echo_position_mask: int | None
    echo_velocity_mask: int | None
    simulates_radio: bool
    radio_overrides: bool
