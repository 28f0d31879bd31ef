"""How PX4 takes setpoints and sticks."""

from __future__ import annotations

from ..links._enums import MAV_FRAME
from ..policies._setpoints import SetpointPolicy
from ..state._texts import CRITICAL

SETPOINTS = SetpointPolicy(
    # In the body frame PX4 takes velocities and accelerations, and no positions.
    local_frames={MAV_FRAME.LOCAL_NED: "local", MAV_FRAME.BODY_NED: "body-velocity"},
    global_frames={
        MAV_FRAME.GLOBAL_INT: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT_INT: "home",
        MAV_FRAME.GLOBAL_TERRAIN_ALT_INT: "ground",
    },
    bad_local_frame="SET_POSITION_TARGET_LOCAL_NED coordinate frame {} unsupported",
    bad_global_frame=(CRITICAL, "SET_POSITION_TARGET_GLOBAL_INT invalid coordinate frame {}"),
    complains=True,
    axes_in_groups=False,
    speed_command_binds=False,
    faces_motion=False,
    fails_safe_when_lost=True,
    position_lapses=True,
    echo_behaviours=None,
    echo_position_mask=None,
    echo_velocity_mask=None,
    simulates_radio=False,
    radio_overrides=False,
)
