"""How an agent speaks with PX4 and with ArduPilot where the two differ: modes, arming, takeoff, parameters."""

from __future__ import annotations

from bench.values import value_class

_ARDUPILOTMEGA = 3  # of MAV_AUTOPILOT; the client does without pymavlink

Mode = tuple[int, int]
"""Parameters 2 and 3 of DO_SET_MODE: PX4's main and sub mode; ArduPilot's custom mode and 0."""


@value_class(frozen=True, slots=True)
class AutopilotKind:
    """What an agent must know of one kind of autopilot.

    `offboard` flies the setpoints of a companion computer; `hold` brakes and stays. With `has_sub_modes` a heartbeat's
    custom mode holds a main and a sub mode. `mode_answers` says how many answers ACCEPTED to DO_SET_MODE prove the change:
    PX4 gives the first whatever was asked. `arms_offboard`: arming and takeoff need the mode `offboard`.
    `takes_off_above_home`: the height of NAV_TAKEOFF is above home, not above mean sea level. `speed_parameter` limits the
    horizontal speed, in units of `speed_unit_mps`.
    """

    offboard: Mode
    hold: Mode
    rtl: Mode
    land: Mode
    has_sub_modes: bool
    mode_answers: int
    arms_offboard: bool
    takes_off_above_home: bool
    speed_parameter: str
    speed_unit_mps: float

    def mode(self, custom_mode: int) -> Mode:
        """The mode that a heartbeat states."""
        if not self.has_sub_modes:
            return custom_mode, 0
        return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF


# Modes: px4_custom_mode.h of PX4, and Mode::Number in mode.h of ArduCopter.
PX4 = AutopilotKind(
    offboard=(6, 0),
    hold=(4, 3),
    rtl=(4, 5),
    land=(4, 6),
    has_sub_modes=True,
    mode_answers=2,
    arms_offboard=False,
    takes_off_above_home=False,
    speed_parameter="MPC_XY_VEL_MAX",
    speed_unit_mps=1.0,
)
ARDUPILOT = AutopilotKind(
    offboard=(4, 0),  # GUIDED of ArduCopter
    hold=(17, 0),  # BRAKE
    rtl=(6, 0),
    land=(9, 0),
    has_sub_modes=False,
    mode_answers=1,
    arms_offboard=True,
    takes_off_above_home=True,
    speed_parameter="WPNAV_SPEED",
    speed_unit_mps=0.01,
)


def kind_of(autopilot: int) -> AutopilotKind:
    """The kind that a heartbeat's `autopilot` (MAV_AUTOPILOT) states; any other than ArduPilot is flown as PX4."""
    return ARDUPILOT if autopilot == _ARDUPILOTMEGA else PX4
