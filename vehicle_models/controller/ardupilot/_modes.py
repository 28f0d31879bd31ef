"""ArduCopter's modes. `base` carries the GUIDED flag where the mode steers position."""

from __future__ import annotations

from .._flight import Behaviour, Mode, Stick

_STEERS, _PLAIN = 89, 81

MODES = (
    Mode("STABILIZE", 0, _PLAIN, Behaviour.PILOT, stick=Stick.ATTITUDE),
    Mode("ACRO", 1, _PLAIN, Behaviour.PILOT, stick=Stick.RATES),
    Mode("ALT_HOLD", 2, _PLAIN, Behaviour.PILOT, stick=Stick.ALTITUDE),
    Mode("AUTO", 3, _STEERS, Behaviour.MISSION, armable=False),
    Mode("GUIDED", 4, _STEERS, Behaviour.FOLLOW),
    Mode("LOITER", 5, _STEERS, Behaviour.PILOT, stick=Stick.POSITION),
    Mode("RTL", 6, _PLAIN, Behaviour.RETURN, armable=False),
    Mode("CIRCLE", 7, _STEERS, Behaviour.CIRCLE, stick=Stick.POSITION),
    Mode("LAND", 9, _STEERS, Behaviour.LAND, armable=False),
    Mode("DRIFT", 11, _PLAIN, Behaviour.PILOT, stick=Stick.ATTITUDE),
    Mode("POSHOLD", 16, _STEERS, Behaviour.PILOT, stick=Stick.POSITION),
    Mode("BRAKE", 17, _STEERS, Behaviour.HOLD, armable=False),
    Mode("THROW", 18, _PLAIN, Behaviour.HOLD),
    Mode("AVOID_ADSB", 19, _STEERS, Behaviour.FOLLOW, armable=False),
    Mode("GUIDED_NOGPS", 20, _STEERS, Behaviour.FOLLOW),
    Mode("SMART_RTL", 21, _STEERS, Behaviour.RETURN, armable=False),
    Mode("ZIGZAG", 24, _STEERS, Behaviour.PILOT, stick=Stick.POSITION),
)
# Numbers that exist and cannot be had here: the name, and what else is said.
REFUSING = {
    14: ("FLIP", ""),
    15: ("AUTOTUNE", ""),
    22: ("FLOWHOLD", ""),
    23: ("FOLLOW", "Set FOLL_ENABLE = 1"),
    25: ("SYSTEMID", "No axis selected, SID_AXIS = 0"),
    27: ("AUTO RTL", "No return path or landing sequence found"),
    28: ("TURTLE", ""),
}
