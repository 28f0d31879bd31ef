"""How PX4 takes setpoints and sticks."""

from __future__ import annotations

from ..links._enums import MAV_FRAME
from ..policies._choices import choices
from ..policies._setpoints import SetpointPolicy

SETPOINTS = SetpointPolicy(
    **choices(SetpointPolicy, "px4"),
    # In the body frame PX4 takes velocities and accelerations, and no positions.
    local_frames={MAV_FRAME.LOCAL_NED: "local", MAV_FRAME.BODY_NED: "body-velocity"},
    global_frames={
        MAV_FRAME.GLOBAL_INT: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT_INT: "home",
        MAV_FRAME.GLOBAL_TERRAIN_ALT_INT: "ground",
    },
    echo_behaviours=None,
)
