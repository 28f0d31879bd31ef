"""PX4's modes: custom_mode = sub << 24 | main << 16. A mode that cannot be armed shows system_status 0 on the ground."""

from __future__ import annotations

from .._flight import Behaviour, Mode, Stick

_AUTO, _MANUAL, _ACRO, _OFFBOARD = 29, 81, 65, 17


def _mode(
    name: str, main: int, sub: int, base: int, behaviour: Behaviour, label: str, armable: bool = False, stick: Stick | None = None
) -> Mode:
    return Mode(name, sub << 24 | main << 16, base, behaviour, armable, label, stick)


def _sticks(name: str, main: int, sub: int, base: int, stick: Stick, label: str) -> Mode:
    return _mode(name, main, sub, base, Behaviour.PILOT, label, stick=stick)


MODES = (
    _sticks("MANUAL", 1, 0, _MANUAL, Stick.ATTITUDE, "Manual"),
    _sticks("ALTCTL", 2, 0, _MANUAL, Stick.ALTITUDE, "Altitude"),
    _sticks("POSCTL", 3, 0, _MANUAL, Stick.POSITION, "Position"),
    _mode("POSCTL_ORBIT", 3, 1, _AUTO, Behaviour.CIRCLE, "Orbit"),
    _sticks("POSCTL_SLOW", 3, 2, _MANUAL, Stick.POSITION, "Position Slow"),
    _mode("AUTO_TAKEOFF", 4, 2, _AUTO, Behaviour.TAKEOFF, "Takeoff", armable=True),
    _mode("AUTO_LOITER", 4, 3, _AUTO, Behaviour.HOLD, "Hold", armable=True),
    _mode("AUTO_MISSION", 4, 4, _AUTO, Behaviour.MISSION, "Mission"),
    _mode("AUTO_RTL", 4, 5, _AUTO, Behaviour.RETURN, "RTL"),
    _mode("AUTO_LAND", 4, 6, _AUTO, Behaviour.LAND, "Land"),
    _mode("AUTO_FOLLOW", 4, 8, _OFFBOARD, Behaviour.CHASE, "Follow Target"),
    _mode("AUTO_PRECLAND", 4, 9, _AUTO, Behaviour.LAND, "Precision Land"),
    *(_mode(f"EXTERNAL{one}", 4, 10 + one, _OFFBOARD, Behaviour.HOLD, f"External {one}") for one in range(1, 9)),
    _sticks("ACRO", 5, 0, _ACRO, Stick.RATES, "Acro"),
    _mode("OFFBOARD", 6, 0, _OFFBOARD, Behaviour.FOLLOW, "Offboard", armable=True),
    _sticks("STABILIZED", 7, 0, _MANUAL, Stick.ATTITUDE, "Stabilized"),
    _mode("TERMINATION", 10, 0, 1, Behaviour.TERMINATE, "Termination"),
    _sticks("ALTITUDE_CRUISE", 11, 0, _MANUAL, Stick.ALTITUDE, "Altitude Cruise"),
)
