"""How ArduCopter takes setpoints and sticks."""

from __future__ import annotations

from ..links._enums import MAV_FRAME
from ..policies._choices import choices
from ..policies._setpoints import SetpointPolicy
from ..state._flight_state import Behaviour

SETPOINTS = SetpointPolicy(
    **choices(SetpointPolicy, "ardupilot"),
    local_frames={
        MAV_FRAME.LOCAL_NED: "local",
        MAV_FRAME.LOCAL_OFFSET_NED: "offset",
        # ArduPilot treats both body frames as offsets from the vehicle, turned by its heading.
        MAV_FRAME.BODY_NED: "body",
        MAV_FRAME.BODY_OFFSET_NED: "body",
    },
    global_frames={
        MAV_FRAME.GLOBAL: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT: "home",
        MAV_FRAME.GLOBAL_INT: "amsl",
        MAV_FRAME.GLOBAL_RELATIVE_ALT_INT: "home",
        MAV_FRAME.GLOBAL_TERRAIN_ALT: "ground",
        MAV_FRAME.GLOBAL_TERRAIN_ALT_INT: "ground",
    },
    echo_behaviours=(Behaviour.OFFBOARD,),
)
