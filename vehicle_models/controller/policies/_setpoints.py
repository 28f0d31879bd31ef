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
    """SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT, SET_ATTITUDE_TARGET, their echo, and
    sticks.
    """

    local_frames: Mapping[int, LocalFrame]
    global_frames: Mapping[int, GlobalFrame]
    bad_local_frame: str
    """Text for a MAV_FRAME that is not in `local_frames`; {} stands for the number."""
    bad_global_frame: StatusText
    complains: bool
    """True: a bad setpoint is ignored with a text, in any mode. False: outside the offboard mode it is
    ignored in silence, inside it the vehicle stops.
    """

    axes_in_groups: bool
    """Whether one masked axis masks its whole vector; else each axis is masked by itself."""
    speed_command_binds: bool
    """Whether DO_CHANGE_SPEED also limits positions of a companion."""
    faces_motion: bool
    """Whether the nose follows the motion where a setpoint has no heading."""
    fails_safe_when_lost: bool
    """Whether lost setpoints are a failsafe; else the vehicle stops and stays in its mode."""
    position_lapses: bool
    """Whether a position setpoint ends like any other when no more come."""
    echo_behaviours: tuple[Behaviour, ...] | None
    """Modes in which POSITION_TARGET_* are sent; None: in all, also while disarmed."""
    echo_position_mask: int | None
    """type_mask of the echo of a position; None: the bits of what is NaN."""
    echo_velocity_mask: int | None
    simulates_radio: bool
    """Whether a radio at rest gives the sticks when no client does: ArduPilot's SITL has one."""
    radio_overrides: bool
    """Whether RC_CHANNELS_OVERRIDE is taken, and MANUAL_CONTROL as an override of the radio."""
