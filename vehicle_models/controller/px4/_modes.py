"""PX4's modes: custom_mode = sub << 24 | main << 16. A mode that cannot be armed shows system_status 0 on the ground."""

from __future__ import annotations

from .._flight import Behaviour, Mode

_AUTO, _MANUAL, _ACRO, _OFFBOARD = 29, 81, 65, 17


def _mode(name: str, main: int, sub: int, base: int, behaviour: Behaviour, label: str, armable: bool = False) -> Mode:
    return Mode(name, sub << 24 | main << 16, base, behaviour, armable, label)


MODES = (
    _mode("MANUAL", 1, 0, _MANUAL, Behaviour.PILOT, "Manual"),
    _mode("ALTCTL", 2, 0, _MANUAL, Behaviour.PILOT, "Altitude"),
    _mode("POSCTL", 3, 0, _MANUAL, Behaviour.PILOT, "Position"),
    _mode("POSCTL_SLOW", 3, 2, _MANUAL, Behaviour.PILOT, "Position Slow"),
    _mode("AUTO_TAKEOFF", 4, 2, _AUTO, Behaviour.TAKEOFF, "Takeoff", armable=True),
    _mode("AUTO_LOITER", 4, 3, _AUTO, Behaviour.HOLD, "Hold", armable=True),
    _mode("AUTO_MISSION", 4, 4, _AUTO, Behaviour.MISSION, "Mission"),
    _mode("AUTO_RTL", 4, 5, _AUTO, Behaviour.RETURN, "RTL"),
    _mode("AUTO_LAND", 4, 6, _AUTO, Behaviour.LAND, "Land"),
    _mode("ACRO", 5, 0, _ACRO, Behaviour.PILOT, "Acro"),
    _mode("OFFBOARD", 6, 0, _OFFBOARD, Behaviour.FOLLOW, "Offboard", armable=True),
    _mode("STABILIZED", 7, 0, _MANUAL, Behaviour.PILOT, "Stabilized"),
)
